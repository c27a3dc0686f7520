"""Shapes pressed into soil: the nodes below each, their pressure and shear, and the implicit forces on its body.

A body gets a force F and a symmetric 6 x 6 block D of mass, which stands for how F changes with the velocity over the
step: (M + D) dv = h F. Sinkage is predicted at the pose that the present velocity leads to.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import ControlArrays, StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.soil.bekker_janosi_kernels import Law, law_of
from simwarp.soil.deformed_surface_kernels import greatest_raise, node_drop
from simwarp.soil.footprint_kernels import (
    Below,
    Pose,
    footprint_of,
    holds,
    inverse_half_width,
    keep_footprint,
    kept_footprint,
    level_footprint,
    meets_another,
    node_below,
    node_number,
    owns,
    raised_node,
    shape_pose,
    soil_at,
    surface_above,
    surface_normal,
)
from simwarp.soil.node_stress_kernels import node_stress
from simwarp.soil.pages_kernels import claim_page, find_page, slot_in
from simwarp.soil.soil_columns_kernels import K_C
from simwarp.soil.soil_tables_kernels import (
    BALL,
    CAPSULE,
    SINKAGE,
    WHEEL,
    SoilNodes,
    SoilReports,
    SoilShapes,
    SoilTables,
)
from simwarp.soil.wheel_surface_kernels import NOTHING

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class ShapeSum:
    """Force, moment about the centre of mass, and the block D of a shape."""

    force: wp.vec3
    moment: wp.vec3
    mass: wp.mat33
    coupling: wp.mat33
    inertia: wp.mat33
    touched: int
    sunk: float  # sum of what nodes' drops grew by [m]


@wp.func
def add_block(total: ShapeSum, weight: float, arm: wp.vec3, direction: wp.vec3) -> ShapeSum:
    """Adds weight J^T n n^T J, with J the velocity of a point at `arm` from the centre of mass."""
    s = total
    turn = wp.cross(arm, direction)
    scaled = weight * direction
    s.mass += wp.outer(scaled, direction)
    s.coupling += wp.outer(turn, scaled)
    s.inertia += wp.outer(weight * turn, turn)
    return s


@wp.func
def add_elastic_block(total: ShapeSum, weight: float, arm: wp.vec3, direction: wp.vec3, p: Pose) -> ShapeSum:
    """As `add_block`, but a spin that leaves the surface where it is does not move the point: of a wheel or capsule
    about its axis, of a ball about any.
    """
    s = total
    turn = wp.cross(arm, direction)
    if p.kind == WHEEL:
        turn -= wp.dot(turn, p.axis) * p.axis
    elif p.kind == BALL:
        turn = wp.cross(p.centre, direction)
    elif p.kind == CAPSULE:
        turn -= wp.dot(wp.cross(arm - p.centre, direction), p.axis) * p.axis
    scaled = weight * direction
    s.mass += wp.outer(scaled, direction)
    s.coupling += wp.outer(turn, scaled)
    s.inertia += wp.outer(weight * turn, turn)
    return s


@wp.func
def press_node(
    total: ShapeSum, slot: int, world: int, area: float, dt: float, b: Below, p: Pose, law: Law, soil: SoilTables,
    nodes: SoilNodes,
) -> ShapeSum:  # fmt: skip
    """Moves the memory of a node on, and adds what it does to the shape."""
    s = total
    ground = b.normal
    lowest = wp.vec3(b.x, b.y, wp.where(b.low == NOTHING, b.height, b.low))
    arm = p.centre + lowest
    n = ground
    upright = float(1.0)
    if soil.along_surface == 1:
        n = surface_normal(lowest, ground, p)
        upright = wp.dot(n, ground)
    v = p.v + wp.cross(p.omega, arm)
    cell = soil.spacing * float(soil.weighted)
    moved = surface_above(b.x - p.moved[0], b.y - p.moved[1], p, p.moved_axis, p.moved_side, cell)
    after = ground[2] * (b.height - p.moved[2] - moved.height)
    if moved.height == NOTHING or b.low == NOTHING:
        after = -NOTHING
    stress = node_stress(slot, world, dt, b.sinkage, after, v, n, law, soil, nodes)
    s.sunk += stress.sunk / ground[2]
    if stress.bears == 0:
        return s
    share = area / upright  # of the surface above the cell
    force = share * (stress.pressure * n - stress.against)
    s.force += force
    s.moment += wp.cross(arm - 0.5 * p.moved, force)  # all through the step the wheel moves on over the node
    # a way along n sinks the surface by 1 / upright of it
    s = add_elastic_block(s, share / upright * dt * dt * stress.stiffness, arm, n, p)
    s = add_block(s, share * dt * stress.damping, arm, n)
    side = wp.normalize(wp.cross(n, wp.vec3(1.0, 0.0, 0.0)))
    s = add_block(s, share * stress.drag, arm, side)
    s = add_block(s, share * stress.drag, arm, wp.cross(side, n))
    s.touched += 1
    return s


@wp.func
def claim_pages_below(
    world: int, dt: float, step: int, soil: SoilTables, shapes: SoilShapes, assets: Assets, state: StateArrays,
    nodes: SoilNodes,
):  # fmt: skip
    """Marks the pages below all shapes of a world as used in a step, then takes those that are missing: none that
    something stands on is given away, whatever the order of the shapes. Those of sheets, which come after the shapes,
    are known already (`survey_sheets`).
    """
    missing = int(0)
    lift = greatest_raise(world, nodes)
    for shape in range(nodes.foot.shape[1]):
        if shape < shapes.body.shape[0]:
            found = footprint_of(world, shape_pose(world, shape, dt, shapes, state), lift, soil, assets)
            keep_footprint(world, shape, found, nodes)
        foot = kept_footprint(world, shape, nodes)
        if foot.x0 <= foot.x1:
            for y in range(foot.y0 >> 3, (foot.y1 >> 3) + 1):
                for x in range(foot.x0 >> 3, (foot.x1 >> 3) + 1):
                    page = find_page(world, x, y, nodes)
                    if page < 0:
                        missing += 1
                    else:
                        nodes.used_at[world, page] = step
    if missing == 0:
        return
    for shape in range(nodes.foot.shape[1]):
        foot = kept_footprint(world, shape, nodes)
        if foot.x0 <= foot.x1:
            for y in range(foot.y0 >> 3, (foot.y1 >> 3) + 1):
                for x in range(foot.x0 >> 3, (foot.x1 >> 3) + 1):
                    claim_page(world, x, y, step, nodes)


@wp.kernel
def claim_pages(
    # inputs
    worlds: WorldRange,
    dt: float,
    soil: SoilTables,
    shapes: SoilShapes,
    assets: Assets,
    state: StateArrays,
    # in and out
    nodes: SoilNodes,
):
    """Pages below all shapes of a world; dim W."""
    world = worlds.first + wp.tid()
    step = nodes.step[world] + 1
    nodes.step[world] = step
    claim_pages_below(world, dt, step, soil, shapes, assets, state, nodes)


@wp.func
def write_body(world: int, body: int, total: ShapeSum, control: ControlArrays):
    """All that acts on a body from the elements so far."""
    control.element_force[world, body] = total.force
    control.element_torque[world, body] = total.moment
    control.element_mass[world, body] = total.mass
    control.element_coupling[world, body] = total.coupling
    control.element_inertia[world, body] = total.inertia


@wp.kernel
def press_shapes(
    # inputs
    worlds: WorldRange,
    dt: float,
    soil: SoilTables,
    shapes: SoilShapes,
    assets: Assets,
    state: StateArrays,
    # in and out
    nodes: SoilNodes,
    # outputs
    reports: SoilReports,
    control: ControlArrays,
):
    """Force and block of each shape; dim (W, shapes). Nodes are summed row by row.

    All in the kernel: a function of these arguments, which are kilobytes, costs 5 % where it is not inlined.
    """
    index, shape = wp.tid()
    world = worlds.first + index
    p = shape_pose(world, shape, dt, shapes, state)
    lift = greatest_raise(world, nodes)
    foot = kept_footprint(world, shape, nodes)
    total = ShapeSum()
    sunk = float(0.0)
    deepest = nodes.deepest[world, shape]
    if foot.x0 <= foot.x1 and foot.y0 <= foot.y1:
        copy = world_row(world, soil.parameter.shape[0])
        kind = soil_at(world, p.x, soil)
        inverse_b = float(0.0)
        if soil.parameter[copy, kind, K_C] != 0.0:
            inverse_b = inverse_half_width(world, p, foot, soil, assets, nodes)
        law = law_of(copy, kind, inverse_b, soil.parameter)
        crowded = meets_another(world, shape, foot, nodes)
        middle_x = node_number(p.x[0], 0.5 * soil.spacing, soil.spacing)
        middle_y = node_number(p.x[1], 0.5 * soil.spacing, soil.spacing)
        level = level_footprint(world, p, foot, lift, soil, assets)
        for row in range(foot.y0, foot.y1 + 1):
            page_x = int(0x7FFFFFFF)
            page = int(-1)
            for column in range(foot.x0, foot.x1 + 1):
                if column >> 3 != page_x:
                    page_x = column >> 3
                    page = find_page(world, page_x, row >> 3, nodes)
                slot = slot_in(page, column, row)
                raised = float(0.0)
                tested = page >= 0
                if lift > 0.0 and tested:
                    raised = nodes.raised[world, slot]
                    tested = raised > 0.0 or holds(level, column, row)
                if tested:
                    b = raised_node(node_below(world, column, row, p, soil, assets), raised)
                    area = soil.spacing * soil.spacing * b.share
                    # a node that the shape comes to within the step counts already
                    mine = b.found == 1 and b.sinkage > -p.near and area > 0.0
                    if crowded and mine:
                        mine = owns(world, shape, column, row, b, dt, soil, shapes, state, assets, nodes)
                    if mine:
                        total = press_node(total, slot, world, area, dt, b, p, law, soil, nodes)
                        deepest = wp.max(deepest, node_drop(world, slot, b.normal, nodes))
                        if column == middle_x and row == middle_y:
                            sunk = wp.max(b.sinkage, nodes.node[world, slot, SINKAGE]) / b.normal[2] - raised
    nodes.deepest[world, shape] = deepest
    if soil.pushed > 0.0:
        nodes.pending[world, shape] = nodes.pending[world, shape] + soil.pushed * total.sunk
    reports.touched[world, shape] = total.touched
    reports.sinkage[world, shape] = sunk
    reports.before_v[world, shape] = p.v
    reports.before_omega[world, shape] = p.omega
    reports.pushed[world, shape] = total.force
    reports.turned[world, shape] = total.moment
    reports.mass[world, shape] = total.mass
    reports.coupling[world, shape] = total.coupling
    reports.inertia[world, shape] = total.inertia
    if shapes.alone[shape] == 1:
        write_body(world, shapes.body[shape], total, control)


@wp.kernel
def carry_bodies(
    # inputs
    worlds: WorldRange,
    shapes: SoilShapes,
    reports: SoilReports,
    # outputs
    control: ControlArrays,
):
    """Forces and implicit blocks of bodies with several shapes, or on which elements before the soil act; dim
    (W, those). A body's shapes are summed in order.
    """
    index, at_body = wp.tid()
    world = worlds.first + index
    body = shapes.shared[at_body]
    first = shapes.member_start[at_body]
    shape = shapes.member[first]
    total = ShapeSum()
    total.force = reports.pushed[world, shape]
    total.moment = reports.turned[world, shape]
    total.mass = reports.mass[world, shape]
    total.coupling = reports.coupling[world, shape]
    total.inertia = reports.inertia[world, shape]
    for at in range(first + 1, shapes.member_start[at_body + 1]):
        shape = shapes.member[at]
        total.force += reports.pushed[world, shape]
        total.moment += reports.turned[world, shape]
        total.mass += reports.mass[world, shape]
        total.coupling += reports.coupling[world, shape]
        total.inertia += reports.inertia[world, shape]
    if shapes.adds[at_body] >= 1:
        total.force += control.element_force[world, body]
        total.moment += control.element_torque[world, body]
    if shapes.adds[at_body] == 2:
        total.mass += control.element_mass[world, body]
        total.coupling += control.element_coupling[world, body]
        total.inertia += control.element_inertia[world, body]
    write_body(world, body, total, control)


@wp.kernel
def report_shapes(
    # inputs
    worlds: WorldRange,
    dt: float,
    shapes: SoilShapes,
    state: StateArrays,
    # outputs
    reports: SoilReports,
):
    """What acted on the shapes in a sub-step, F - D dv / h; dim (W, shapes)."""
    index, shape = wp.tid()
    world = worlds.first + index
    body = shapes.body[shape]
    dv = (state.body_v[world, body] - reports.before_v[world, shape]) / dt
    domega = (state.body_omega[world, body] - reports.before_omega[world, shape]) / dt
    coupling = reports.coupling[world, shape]
    force = reports.pushed[world, shape] - reports.mass[world, shape] * dv - domega * coupling
    moment = reports.turned[world, shape] - reports.inertia[world, shape] * domega - coupling * dv
    q = state.body_rot[world, body]
    offset = to_float(wp.quat_rotate(q, to_double(shapes.offset_b[shape])))
    reports.force_w[world, shape] = force
    reports.torque_w[world, shape] = moment - wp.cross(offset, force)
    reports.load[world, shape] = force[2]
    reports.slip_ratio[world, shape] = 0.0
    if shapes.kind[shape] == WHEEL:
        axis = to_float(wp.quat_rotate(q, to_double(shapes.axis_b[shape])))
        ahead = wp.normalize(wp.cross(axis, wp.vec3(0.0, 0.0, 1.0)))
        omega = state.body_omega[world, body]
        v = wp.dot(ahead, state.body_v[world, body] + wp.cross(omega, offset))
        rolled = shapes.radius[shape] * wp.dot(omega, axis)
        fast = wp.max(wp.abs(v), wp.abs(rolled))
        reports.slip_ratio[world, shape] = wp.where(fast > 1.0e-3, (rolled - v) / wp.max(fast, 1.0e-3), 0.0)


@wp.func
def clear_world(world: int, nodes: SoilNodes):
    """Fresh soil in a world. Pages are emptied when they are taken."""
    nodes.count[world] = 0
    nodes.step[world] = 0
    nodes.recycled[world] = 0
    for shape in range(nodes.deepest.shape[1]):
        nodes.deepest[world, shape] = 0.0
    for shape in range(nodes.highest.shape[1]):
        nodes.highest[world, shape] = 0.0
        nodes.pending[world, shape] = 0.0
    for at in range(nodes.entry.shape[1]):
        nodes.entry[world, at] = 0


@wp.kernel
def clear_soil(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    # in and out
    nodes: SoilNodes,
):
    """Fresh soil in the worlds of a mask; dim W."""
    world = worlds.first + wp.tid()
    if mask[world]:
        clear_world(world, nodes)
