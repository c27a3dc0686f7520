"""Device half of the Jacobian of a point: motion columns of the step's own joint geometry, moved to the point."""

import warp as wp

from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.kernels.dynamics.assembly import clear_velocities, place_joints
from simwarp.kernels.dynamics.bodies import load_poses
from simwarp.kernels.dynamics.joints import FREE
from simwarp.kernels.dynamics.world import Scratch, pack

wp.set_module_options({"enable_backward": False})


@wp.struct
class Column:
    """Motion of a point per unit rate of one coordinate, world axes."""

    linear: wp.vec3
    angular: wp.vec3


@wp.func
def lay_columns(world: int, topology: Topology, parameters: Parameters, config: StepConfig, work: Work):
    """Motion columns of all tree joints at the poses in `work`."""
    clear_velocities(topology, work)
    for tree_dof in range(topology.tree_dof_count):
        work.rate[tree_dof] = 0.0
    place_joints(world, topology, parameters, config, work)


@wp.func
def point_of(body: int, point: wp.vec3d, work: Work) -> wp.vec3d:
    """A point of a body in the world [m]."""
    return work.x[body] + work.rot[body] * point


@wp.func
def column_at(
    world: int, link: int, tree_dof: int, place: wp.vec3d, topology: Topology, parameters: Parameters, work: Work
) -> Column:
    """The column of a coordinate of a link, at a point of what the link carries."""
    column = Column()
    centre = work.x[topology.link_body[link]]
    if topology.link_type[link] == FREE:
        joint = topology.link_joint[link]
        if joint >= 0:
            body = topology.link_body[link]
            row = world_row(world, parameters.joint_anchor1.shape[0])
            centre = work.x[body] + work.rot[body] * parameters.joint_anchor1[row, joint]
        local = tree_dof - topology.link_tree_dof[link]
        axis = wp.vec3()
        axis[local % 3] = 1.0
        if local < 3:
            column.linear = axis
        else:
            column.angular = axis
    else:
        column.linear = work.s_lin[tree_dof]
        column.angular = work.s_ang[tree_dof]
    column.linear += wp.cross(column.angular, to_float(place - centre))
    return column


@wp.kernel
def measure_point_jacobian(
    worlds: WorldRange, mask: wp.array[wp.bool], body: int, point: wp.vec3d, config: StepConfig, topology: Topology,
    parameters: Parameters, scratch: Scratch, state: StateArrays, position: wp.array[wp.vec3d],
    jacobian: wp.array3d[float],
):  # fmt: skip
    """Position of a point of a body, and its Jacobian (6, dofs): linear rows, then angular ones."""
    world = worlds.first + wp.tid()
    if not mask[world]:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    load_poses(world, topology, state, work)
    lay_columns(world, topology, parameters, config, work)
    place = point_of(body, point, work)
    position[world] = place
    for dof in range(topology.dof_count):
        for row in range(6):
            jacobian[world, row, dof] = 0.0
    link = topology.body_link[body]
    while link >= 0:
        for tree_dof in range(topology.link_tree_dof[link], topology.link_tree_dof[link + 1]):
            dof = topology.tree_dof_to_dof[tree_dof]
            if dof >= 0:
                column = column_at(world, link, tree_dof, place, topology, parameters, work)
                for row in range(3):
                    jacobian[world, row, dof] = column.linear[row]
                    jacobian[world, 3 + row, dof] = column.angular[row]
        link = topology.link_parent[link]
