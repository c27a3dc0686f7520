"""Triangles of the surfaces of meshes that touch other shapes: their corners, which go with nodes and bodies.

A face comes with the sphere of one of its corners, its owner: that whose link is the deepest, so that the ways up from
the others are parts of the owner's (mesh_links.py). A contact on a face names the sphere of the owner as its shape, and
has the face and a weight for each corner beside it.

The code is empty in a kernel that is compiled with `WITHOUT_FACES`.
"""

import warp as wp

from simwarp.kernels.core.fields import ContactArrays, StateArrays
from simwarp.kernels.core.tables import Topology

wp.set_module_options({"enable_backward": False})

WITHOUT_FACES = "WITHOUT_FACES"
"""Macro of the kernels of models without such triangles."""

ACROSS = wp.constant(3)
"""Columns of `Topology.face` from here: of each edge, which begins at corner k, the point across it; -1: a border."""
EDGE = wp.constant(6)
"""The number of that edge."""
TWO_SIDED = wp.constant(9)
"""1: both sides of the face touch."""
OWNER = wp.constant(10)
"""Shape of the owner's sphere."""


@wp.func_native(f"""
#ifdef {WITHOUT_FACES}
    return false;
#else
    return true;
#endif
""")
def has_face_code() -> bool:
    """Whether the kernel is one for models with faces."""
    ...


@wp.func
def has_faces(topology: Topology) -> bool:
    """Whether triangles of meshes touch other shapes."""
    return topology.face_count > 0


@wp.func
def face_point(point: int, world: int, topology: Topology, state: StateArrays) -> wp.vec3d:
    """Where a corner is [m]."""
    body = topology.face_point[point, 0]
    place = topology.face_place[point]
    if body >= 0:
        place = state.body_x[world, body] + wp.quat_rotate(state.body_rot[world, body], place)
    return place


@wp.func
def face_of(world: int, contact: int, topology: Topology, contacts: ContactArrays) -> int:
    """The face that a contact is on, -1: none."""
    face = int(-1)
    if has_face_code():
        if topology.face_count > 0:
            face = contacts.contact_face[world, contact]
    return face


@wp.func
def face_side(face: int, world: int, contact: int, topology: Topology, contacts: ContactArrays) -> int:
    """Which of a contact's shapes, 0 or 1, stands for its face; -1: it has none."""
    side = int(-1)
    if face >= 0:
        side = wp.where(contacts.contact_shape0[world, contact] == topology.face[face, OWNER], 0, 1)
    return side
