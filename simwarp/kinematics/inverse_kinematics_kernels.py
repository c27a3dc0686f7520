"""Device half of inverse kinematics: damped least squares within the joints' limits, one thread per world."""

import warp as wp

from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.kernels.dynamics.assembly import place_links
from simwarp.kernels.dynamics.bodies import load_poses
from simwarp.kernels.dynamics.world import Scratch, pack
from simwarp.kinematics.jacobian_kernels import column_at, lay_columns, point_of

wp.set_module_options({"enable_backward": False})

BLOCKED = wp.constant(2)
"""A coordinate at its stop, which this step would push further."""


@wp.struct
class Search:
    """What is moved, and how."""

    body: int
    point: wp.vec3d  # from the body's centre of mass, its axes [m]
    movable: wp.array[int]  # (dofs,) 1: the search turns it
    iterations: int
    tolerance: wp.float64  # distance at which it stops [m]
    damping: wp.float64  # beside half of the squared error [m/rad]
    longest: wp.float64  # step of a coordinate [rad or m]


@wp.struct
class SearchArrays:
    """Memory of the search."""

    column: wp.array2d[wp.vec3d]  # (W, dofs) [m/rad or 1]
    turn: wp.array2d[wp.float64]  # (W, dofs) step
    free: wp.array2d[int]  # (W, dofs) 1: takes part, 0: does not, BLOCKED


@wp.struct
class Found:
    """What the search found."""

    q: wp.array2d[float]  # (W, dofs)
    error: wp.array[float]  # (W,) distance left [m]
    iterations: wp.array[int]  # (W,)


@wp.func
def lay_point_columns(
    world: int, place: wp.vec3d, search: Search, topology: Topology, parameters: Parameters, work: Work,
    arrays: SearchArrays,
):  # fmt: skip
    """Columns of the coordinates that carry the point, and which of them may move."""
    for dof in range(topology.dof_count):
        arrays.free[world, dof] = 0
    link = topology.body_link[search.body]
    while link >= 0:
        for tree_dof in range(topology.link_tree_dof[link], topology.link_tree_dof[link + 1]):
            dof = topology.tree_dof_to_dof[tree_dof]
            if dof >= 0:
                if search.movable[dof] == 1:
                    column = column_at(world, link, tree_dof, place, topology, parameters, work)
                    moved = column.linear
                    arrays.column[world, dof] = wp.vec3d(
                        wp.float64(moved[0]), wp.float64(moved[1]), wp.float64(moved[2])
                    )
                    arrays.free[world, dof] = 1
        link = topology.link_parent[link]


@wp.func
def least_squares(
    world: int, count: int, error: wp.vec3d, damping: wp.float64, longest: wp.float64, arrays: SearchArrays
):  # fmt: skip
    """The step J'(J J' + damping)⁻¹ e of the free coordinates, shortened to the longest."""
    gram = damping * wp.identity(n=3, dtype=wp.float64)
    for dof in range(count):
        if arrays.free[world, dof] == 1:
            gram += wp.outer(arrays.column[world, dof], arrays.column[world, dof])
    weight = wp.inverse(gram) * error
    largest = wp.float64(0.0)
    for dof in range(count):
        turn = wp.float64(0.0)
        if arrays.free[world, dof] == 1:
            turn = wp.dot(arrays.column[world, dof], weight)
        arrays.turn[world, dof] = turn
        largest = wp.max(largest, wp.abs(turn))
    if largest > longest:
        for dof in range(count):
            arrays.turn[world, dof] = arrays.turn[world, dof] * (longest / largest)


@wp.func
def block(world: int, count: int, parameters: Parameters, q: wp.array2d[float], arrays: SearchArrays) -> int:
    """Take coordinates out that stand at a stop and would be pushed further; how many."""
    blocked = int(0)
    low = world_row(world, parameters.joint_limit_lower.shape[0])
    high = world_row(world, parameters.joint_limit_upper.shape[0])
    for dof in range(count):
        if arrays.free[world, dof] == 1:
            turn = arrays.turn[world, dof]
            value = q[world, dof]
            if (turn > wp.float64(0.0) and value >= parameters.joint_limit_upper[high, dof]) or (
                turn < wp.float64(0.0) and value <= parameters.joint_limit_lower[low, dof]
            ):
                arrays.free[world, dof] = BLOCKED
                blocked += 1
    return blocked


@wp.func
def turn_within_limits(world: int, count: int, parameters: Parameters, q: wp.array2d[float], arrays: SearchArrays):
    """Take the step, up to the stops."""
    low = world_row(world, parameters.joint_limit_lower.shape[0])
    high = world_row(world, parameters.joint_limit_upper.shape[0])
    for dof in range(count):
        if arrays.free[world, dof] == 1:
            value = float(wp.float64(q[world, dof]) + arrays.turn[world, dof])
            value = wp.min(value, parameters.joint_limit_upper[high, dof])
            q[world, dof] = wp.max(value, parameters.joint_limit_lower[low, dof])


@wp.kernel
def search_coordinates(
    worlds: WorldRange, mask: wp.array[wp.bool], start: wp.array2d[float], target: wp.array[wp.vec3d],
    search: Search, config: StepConfig, topology: Topology, parameters: Parameters, scratch: Scratch,
    state: StateArrays, arrays: SearchArrays, found: Found,
):  # fmt: skip
    """Coordinates that bring the point to its target, from those of the start; the state stays as it is."""
    world = worlds.first + wp.tid()
    if not mask[world]:
        return
    work = pack(scratch, scratch_slot_of(world, worlds))
    count = topology.dof_count
    for dof in range(count):
        found.q[world, dof] = start[world, dof]
        arrays.free[world, dof] = search.movable[dof]
        arrays.turn[world, dof] = wp.float64(0.0)
    turn_within_limits(world, count, parameters, found.q, arrays)  # a start beyond a stop
    load_poses(world, topology, state, work)
    iteration = int(0)
    left = wp.float64(0.0)
    while True:
        place_links(world, topology, parameters, found.q, work)
        place = point_of(search.body, search.point, work)
        error = target[world] - place
        left = wp.length(error)
        if not (left > search.tolerance) or iteration >= search.iterations:
            break
        lay_columns(world, topology, parameters, config, work)
        lay_point_columns(world, place, search, topology, parameters, work, arrays)
        damping = wp.float64(0.5) * left * left + search.damping * search.damping
        least_squares(world, count, error, damping, search.longest, arrays)
        while block(world, count, parameters, found.q, arrays) > 0:
            least_squares(world, count, error, damping, search.longest, arrays)
        turn_within_limits(world, count, parameters, found.q, arrays)
        iteration += 1
    found.error[world] = float(left)
    found.iterations[world] = iteration
