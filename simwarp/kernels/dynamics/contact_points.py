"""How the points of contacts move with links: points of bodies, and of the faces of meshes.

A point of a face moves with its three corners, by their shares; a force on it acts on them by these. Corners are nodes,
or go with a body that the mesh is glued to. They lie on one way up the elimination tree (mesh_links.py), so that a row
is walked from the owner's node, the deepest, and what acts on the others waits there for it.
"""

import warp as wp

from simwarp.kernels.core.face_tables import OWNER
from simwarp.kernels.core.fields import ContactArrays
from simwarp.kernels.core.tables import Topology, Work
from simwarp.kernels.core.vector_math import matrix_to_float, to_float
from simwarp.kernels.dynamics.bilateral_rows import link_of
from simwarp.kernels.meshes.mesh_links import NODE, node_column

wp.set_module_options({"enable_backward": False})


@wp.func
def cross_matrix(arm: wp.vec3, frame: wp.mat33) -> wp.mat33:
    """Rows: arm x row of the frame."""
    return -frame * wp.skew(arm)


@wp.func
def point_velocity(link: int, arm: wp.vec3, ang: wp.array[wp.vec3], lin: wp.array[wp.vec3]) -> wp.vec3:
    """Velocity of a point of a link; zero for the world."""
    v = wp.vec3()
    if link >= 0:
        v = lin[link] + wp.cross(ang[link], arm)
    return v


@wp.func
def corner_arm(point: int, topology: Topology, work: Work) -> wp.vec3:
    """From the centre of mass of a corner's body to it; zero for a node."""
    arm = wp.vec3()
    body = topology.face_point[point, 0]
    if body >= 0:
        arm = matrix_to_float(work.rot[body]) * to_float(topology.face_place[point])
    return arm


@wp.func
def face_velocity(
    face: int, shares: wp.vec3, ang: wp.array[wp.vec3], lin: wp.array[wp.vec3], topology: Topology, work: Work
) -> wp.vec3:
    """Velocity of a point of a face."""
    v = wp.vec3()
    for k in range(3):
        point = topology.face[face, k]
        link = link_of(topology.face_point[point, 0], topology)
        v += shares[k] * point_velocity(link, corner_arm(point, topology, work), ang, lin)
    return v


@wp.func
def leave_at_corners(face: int, shares: wp.vec3, frame: wp.mat33, topology: Topology, work: Work) -> float:
    """What rows with the axes of a frame do at the corners of a face waits there (`mesh_waiting`), but for the owner's,
    whose share is returned.
    """
    owner = link_of(topology.shape_body[topology.face[face, OWNER]], topology)
    share = float(0.0)
    for k in range(3):
        point = topology.face[face, k]
        link = link_of(topology.face_point[point, 0], topology)
        lin = frame * shares[k]
        if link == owner:
            share = shares[k]
        elif link >= 0:
            if topology.link_type[link] == NODE:
                column = node_column(link, topology)
                work.mesh_waiting[column] = work.mesh_waiting[column] + lin
            else:
                ang = cross_matrix(corner_arm(point, topology, work), lin)
                for pair in range((topology.mesh_columns - topology.mesh_nodes) // 2):
                    if topology.mesh_owner[pair] == link:
                        column = topology.mesh_nodes + 2 * pair
                        work.mesh_waiting[column] = work.mesh_waiting[column] + lin
                        work.mesh_waiting[column + 1] = work.mesh_waiting[column + 1] + ang
    return share


@wp.func
def add_face_force(world: int, contact: int, face: int, force: wp.vec3, topology: Topology, contacts: ContactArrays):
    """A force on a face, to those on its corners' spheres and bodies."""
    shares = contacts.contact_weights[world, contact]
    for k in range(3):
        point = topology.face[face, k]
        body = topology.face_point[point, 0]
        shape = topology.face_point[point, 1]
        if shape < 0:
            shape = topology.face[face, OWNER]
        part = shares[k] * force
        contacts.shape_contact_force[world, shape] = contacts.shape_contact_force[world, shape] + part
        if body >= 0:
            contacts.body_contact_force[world, body] = contacts.body_contact_force[world, body] + part
