"""Wheels pressed into soil: the nodes below each, their pressure and shear, and the implicit forces on the wheel.

A wheel gets a force F and a symmetric 6 x 6 block D of mass, which stands for how F changes with the velocity over the
step: (M + D) dv = h F. Sinkage is predicted at the pose that the present velocity leads to.
"""

import warp as wp

from simwarp.kernels.collision.shape import PLANE, Assets
from simwarp.kernels.core.fields import ControlArrays, StateArrays
from simwarp.kernels.core.spatial import to_double, to_float
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.soil.law import Law, law_of, press
from simwarp.kernels.soil.pages import find_page, take_page
from simwarp.kernels.soil.soil_tables import (
    K_C,
    LEAN_X,
    LEAN_Y,
    PAGE_NODES,
    SHEAR,
    SIDE,
    SINKAGE,
    YIELD,
    SoilNodes,
    SoilReports,
    SoilTables,
    SoilWheels,
)
from simwarp.kernels.soil.wheel_surface import NOTHING, column_above
from simwarp.kernels.vehicle.tires.ground import ground_below

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

SLACK = wp.constant(0.02)
"""Of the ground's height below a wheel, taken into its footprint where the ground is no plane [radii]."""
FARTHEST = wp.constant(wp.float64(1.0e9))
"""Nodes from the origin beyond which there is no soil: their numbers are whole numbers of 32 bits."""
TILTED = wp.constant(0.2)
"""Vertical part of an axis above which a wheel's whole outline counts."""
STILL = wp.constant(1.0e-9)
"""Way within a step below which shear has no direction [m]."""


@wp.struct
class Pose:
    """Place and motion of a wheel, relative to where it is at the start of the step."""

    x: wp.vec3d  # centre, world [m]
    axis: wp.vec3
    v: wp.vec3  # of the centre of mass of its body [m/s]
    omega: wp.vec3
    centre: wp.vec3  # from the centre of mass to the wheel's centre [m]
    moved: wp.vec3  # of the centre within the step [m]
    moved_axis: wp.vec3
    radius: float
    half_width: float
    crown: float


@wp.struct
class Footprint:
    """Nodes that may be below a wheel: columns x0 to x1, rows y0 to y1; none where x1 < x0."""

    x0: int
    x1: int
    y0: int
    y1: int


@wp.func
def wheel_pose(world: int, wheel: int, dt: float, wheels: SoilWheels, state: StateArrays) -> Pose:
    """A wheel now, and where its velocity leads it."""
    body = wheels.body[wheel]
    q = state.body_rot[world, body]
    offset = wp.quat_rotate(q, to_double(wheels.offset_b[wheel]))
    p = Pose()
    p.x = state.body_x[world, body] + offset
    p.axis = to_float(wp.quat_rotate(q, wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))))
    p.v = state.body_v[world, body]
    p.omega = state.body_omega[world, body]
    p.centre = to_float(offset)
    moved = dt * (p.v + wp.cross(p.omega, p.centre))
    # one that flies off at any speed looks no farther ahead than it is high
    p.moved = moved * wp.min(1.0, wheels.radius[wheel] / wp.max(wp.length(moved), 1.0e-9))
    p.moved_axis = wp.normalize(p.axis + dt * wp.cross(p.omega, p.axis))
    p.radius = wheels.radius[wheel]
    p.half_width = wheels.half_width[wheel]
    p.crown = wheels.crown[wheel]
    return p


@wp.func
def node_number(x: wp.float64, offset: float, spacing: float) -> int:
    """The last column or row of nodes up to x + offset; exact far from the origin too."""
    return int(wp.floor((x + wp.float64(offset)) / wp.float64(spacing)))


@wp.func
def footprint_of(world: int, p: Pose, soil: SoilTables, assets: Assets) -> Footprint:
    """The nodes that a wheel may touch now or at the end of the step."""
    foot = Footprint()
    foot.x1 = -1
    if not wp.isfinite(wp.length_sq(p.axis) + wp.length_sq(p.moved)):
        return foot
    g = ground_below(world, p.x, wp.vec3(), p.radius, soil.terrain, assets)
    if g.found == 0 or wp.max(wp.abs(p.x[0]), wp.abs(p.x[1])) > FARTHEST * wp.float64(soil.spacing):
        return foot
    deep = g.arm[2] + p.radius + wp.abs(p.moved[2]) + p.half_width * wp.abs(p.axis[2])
    along = float(p.radius)
    if soil.terrain.kind == PLANE:
        # a leaning plane reaches the wheel earlier on its upper side
        deep += p.radius * wp.sqrt(wp.max(0.0, 1.0 - g.normal[2] * g.normal[2]))
        if deep <= 0.0:
            return foot
        if deep < p.radius:
            along = wp.sqrt(deep * (2.0 * p.radius - deep))
    elif deep + (SLACK + 1.0) * p.radius <= 0.0:
        return foot
    flat = wp.max(wp.sqrt(p.axis[0] * p.axis[0] + p.axis[1] * p.axis[1]), 1.0e-6)
    ax = wp.abs(p.axis[0]) / flat
    ay = wp.abs(p.axis[1]) / flat
    across = p.half_width + p.radius * wp.abs(p.axis[2]) + soil.spacing * float(soil.weighted)
    reach_x = along * ay + across * ax + wp.abs(p.moved[0])
    reach_y = along * ax + across * ay + wp.abs(p.moved[1])
    if wp.abs(p.axis[2]) > TILTED:  # it may lie on its side
        reach_x = wp.length(wp.vec2(p.radius, p.half_width)) + wp.abs(p.moved[0])
        reach_y = reach_x - wp.abs(p.moved[0]) + wp.abs(p.moved[1])
    foot.x0 = node_number(p.x[0], -reach_x, soil.spacing) + 1
    foot.x1 = node_number(p.x[0], reach_x, soil.spacing)
    foot.y0 = node_number(p.x[1], -reach_y, soil.spacing) + 1
    foot.y1 = node_number(p.x[1], reach_y, soil.spacing)
    return foot


@wp.func
def soil_at(world: int, x: wp.vec3d, soil: SoilTables) -> int:
    """Index of the soil at a place; outside the map that of its nearest cell."""
    rows = soil.soil_map.shape[1]
    columns = soil.soil_map.shape[2]
    if rows * columns == 0:
        return 0
    zero = wp.float64(0.0)
    column = wp.clamp(wp.floor((x[0] - soil.map_origin[0]) / soil.map_cell[0]), zero, wp.float64(columns - 1))
    row = wp.clamp(wp.floor((x[1] - soil.map_origin[1]) / soil.map_cell[1]), zero, wp.float64(rows - 1))
    return soil.soil_map[world_row(world, soil.soil_map.shape[0]), int(row), int(column)]


@wp.struct
class Below:
    """A node of the undeformed ground, from a wheel's centre."""

    found: int
    x: float
    y: float
    height: float
    normal: wp.vec3
    sinkage: float  # of the wheel's surface along the normal [m]; negative where there is none
    share: float  # of its cell that the wheel covers
    low: float  # the wheel's surface, from its centre [m]


@wp.func
def node_below(world: int, column: int, row: int, p: Pose, soil: SoilTables, assets: Assets) -> Below:
    """The ground at a node, and how deep the wheel is in it now."""
    b = Below()
    spacing = wp.float64(soil.spacing)
    b.x = float(wp.float64(column) * spacing - p.x[0])
    b.y = float(wp.float64(row) * spacing - p.x[1])
    g = ground_below(world, p.x, wp.vec3(b.x, b.y, 0.0), p.radius, soil.terrain, assets)
    b.found = g.found
    b.height = g.arm[2]
    b.normal = g.normal
    above = column_above(b.x, b.y, p.axis, p.radius, p.half_width, p.crown, soil.spacing * float(soil.weighted))
    b.sinkage = g.normal[2] * (b.height - above.height)
    b.share = above.share
    b.low = above.height
    return b


@wp.func
def inverse_half_width(world: int, p: Pose, foot: Footprint, soil: SoilTables, assets: Assets) -> float:
    """Perimeter over twice the area of the touched rectangle in the wheel's axes [1/m]; 0 without one."""
    flat = wp.sqrt(p.axis[0] * p.axis[0] + p.axis[1] * p.axis[1])
    ax = p.axis[0] / wp.max(flat, 1.0e-6)
    ay = p.axis[1] / wp.max(flat, 1.0e-6)
    widest = 2.0 * p.half_width
    if wp.abs(p.axis[2]) > TILTED:  # it may lie on its side: a disc, whose axis has no direction in the ground
        widest = 2.0 * (p.half_width * flat + p.radius * wp.abs(p.axis[2]))
        if flat < 1.0e-3:
            ax = 0.0
            ay = 1.0
    low = float(1.0e9)
    high = float(-1.0e9)
    left = float(-1.0e9)
    right = float(1.0e9)
    for row in range(foot.y0, foot.y1 + 1):
        for column in range(foot.x0, foot.x1 + 1):
            b = node_below(world, column, row, p, soil, assets)
            if b.found == 1 and b.sinkage > 0.0:
                along = b.x * ay - b.y * ax
                across = b.x * ax + b.y * ay
                low = wp.min(low, along)
                high = wp.max(high, along)
                left = wp.max(left, across)
                right = wp.min(right, across)
    if high < low:
        return 0.0
    cell = soil.spacing * (wp.abs(ax) + wp.abs(ay))
    length = wp.min(high - low + cell, 2.0 * p.radius)
    width = wp.min(left - right + cell, widest)
    return (length + width) / (length * width)


@wp.struct
class WheelSum:
    """Force, moment about the centre of mass, and the block D of a wheel."""

    force: wp.vec3
    moment: wp.vec3
    mass: wp.mat33
    coupling: wp.mat33
    inertia: wp.mat33
    touched: int


@wp.func
def add_block(total: WheelSum, weight: float, arm: wp.vec3, direction: wp.vec3) -> WheelSum:
    """Adds weight J^T n n^T J, with J the velocity of a point at `arm` from the centre of mass."""
    s = total
    turn = wp.cross(arm, direction)
    scaled = weight * direction
    s.mass += wp.outer(scaled, direction)
    s.coupling += wp.outer(turn, scaled)
    s.inertia += wp.outer(weight * turn, turn)
    return s


@wp.func
def add_elastic_block(total: WheelSum, weight: float, arm: wp.vec3, direction: wp.vec3, axis: wp.vec3) -> WheelSum:
    """As `add_block`, but the wheel's own spin does not move the point: its surface stays where it is."""
    s = total
    turn = wp.cross(arm, direction)
    turn -= wp.dot(turn, axis) * axis
    scaled = weight * direction
    s.mass += wp.outer(scaled, direction)
    s.coupling += wp.outer(turn, scaled)
    s.inertia += wp.outer(weight * turn, turn)
    return s


@wp.func
def lean_of(slot: int, world: int, n: wp.vec3, nodes: SoilNodes) -> wp.vec3:
    """Direction of a node's shear, in the plane of the ground."""
    lean = wp.vec3(nodes.node[world, slot, LEAN_X], nodes.node[world, slot, LEAN_Y], 0.0)
    lean[2] = -(n[0] * lean[0] + n[1] * lean[1]) / n[2]
    return lean


@wp.func
def remember_shear(
    slot: int, world: int, dt: float, slide: wp.vec3, n: wp.vec3, soil: SoilTables, nodes: SoilNodes
):  # fmt: skip
    """Moves the way that a node was sheared on, and its direction towards that of the slip."""
    speed = wp.length(slide)
    nodes.node[world, slot, SHEAR] = nodes.node[world, slot, SHEAR] + speed * dt
    if soil.scalar_shear == 0 and speed > 0.0:
        ahead = slide / speed
        lean = ahead + wp.exp(-speed * dt / soil.length) * (lean_of(slot, world, n, nodes) - ahead)
        nodes.node[world, slot, LEAN_X] = lean[0]
        nodes.node[world, slot, LEAN_Y] = lean[1]


@wp.func
def press_node(
    total: WheelSum, slot: int, world: int, area: float, dt: float, b: Below, p: Pose, law: Law, soil: SoilTables,
    nodes: SoilNodes,
) -> WheelSum:  # fmt: skip
    """Moves the memory of a node on, and adds what it does to the wheel."""
    s = total
    n = b.normal
    before = press(b.sinkage, nodes.node[world, slot, SINKAGE], nodes.node[world, slot, YIELD], law)
    nodes.node[world, slot, SINKAGE] = before.plastic
    nodes.node[world, slot, YIELD] = before.limit
    touched = before.pressure > 0.0
    arm = p.centre + wp.vec3(b.x, b.y, wp.where(b.low == NOTHING, b.height, b.low))
    v = p.v + wp.cross(p.omega, arm)
    rising = wp.dot(v, n)
    slide = v - rising * n
    if touched:
        remember_shear(slot, world, dt, slide, n, soil, nodes)
    cell = soil.spacing * float(soil.weighted)
    moved = column_above(
        b.x - p.moved[0], b.y - p.moved[1], p.moved_axis, p.radius, p.half_width, p.crown, cell
    )  # fmt: skip
    after = n[2] * (b.height - p.moved[2] - moved.height)
    pressed = press(after, before.plastic, before.limit, law)
    if pressed.pressure <= 0.0 or moved.height == NOTHING or b.low == NOTHING:
        return s
    damping = wp.where(touched, law.damping, 0.0)  # of a node reached within the step it comes with the next one
    pressure = pressed.pressure - damping * rising
    if pressure < 0.0:  # soil does not pull
        pressure = 0.0
        damping = 0.0
    way = after - b.sinkage
    stiffness = law.elastic
    if wp.abs(way) >= 1.0e-7:
        stiffness = wp.clamp((pressed.pressure - before.pressure) / way, 0.0, law.elastic)
    speed = wp.length(slide)
    sheared = nodes.node[world, slot, SHEAR]
    most = (law.cohesion + pressure * law.tan_phi) * (1.0 - wp.exp(-sheared / law.shear_length))
    against = wp.vec3()
    drag = float(0.0)
    if soil.scalar_shear == 1:
        drag = dt * most / wp.max(speed, STILL / dt)
        against = slide * (drag / dt)
    else:
        turned = speed * dt / soil.length
        taken = dt / soil.length  # (1 - e^-q) / (q l) h, its limit at rest
        if turned > 1.0e-4:
            taken = (1.0 - wp.exp(-turned)) / speed
        held = soil.rest_time * wp.exp(-speed / soil.rest_speed) / soil.length
        against = lean_of(slot, world, n, nodes) + held * slide
        against = most * against / wp.max(1.0, wp.length(against))
        drag = dt * most * (taken + held)
    force = area * (pressure * n - against)
    s.force += force
    s.moment += wp.cross(arm - 0.5 * p.moved, force)  # all through the step the wheel moves on over the node
    s = add_elastic_block(s, area * dt * dt * stiffness, arm, n, p.axis)
    s = add_block(s, area * dt * damping, arm, n)
    side = wp.normalize(wp.cross(n, wp.vec3(1.0, 0.0, 0.0)))
    s = add_block(s, area * drag, arm, side)
    s = add_block(s, area * drag, arm, wp.cross(side, n))
    s.touched += 1
    return s


@wp.func
def owns(
    world: int, wheel: int, column: int, row: int, b: Below, dt: float, soil: SoilTables, wheels: SoilWheels,
    state: StateArrays, assets: Assets,
) -> bool:  # fmt: skip
    """False where another wheel is deeper at a node, or as deep and of a smaller index."""
    mine = bool(True)
    for other in range(wheels.body.shape[0]):
        if other != wheel:
            p = wheel_pose(world, other, dt, wheels, state)
            theirs = node_below(world, column, row, p, soil, assets).sinkage
            if theirs > 0.0 and (theirs > b.sinkage or (theirs == b.sinkage and other < wheel)):
                mine = False
    return mine


@wp.func
def meets_another(
    world: int, wheel: int, foot: Footprint, dt: float, soil: SoilTables, wheels: SoilWheels, state: StateArrays,
    assets: Assets,
) -> bool:  # fmt: skip
    """True where the footprint of another wheel crosses this one's."""
    found = bool(False)
    for other in range(wheels.body.shape[0]):
        if other != wheel:
            f = footprint_of(world, wheel_pose(world, other, dt, wheels, state), soil, assets)
            if f.x0 <= foot.x1 and foot.x0 <= f.x1 and f.y0 <= foot.y1 and foot.y0 <= f.y1:
                found = True
    return found


@wp.kernel
def take_pages(
    # inputs
    worlds: WorldRange,
    dt: float,
    soil: SoilTables,
    wheels: SoilWheels,
    assets: Assets,
    state: StateArrays,
    # in and out
    nodes: SoilNodes,
):
    """Pages below all wheels of a world; dim W."""
    world = worlds.first + wp.tid()
    step = nodes.step[world] + 1
    nodes.step[world] = step
    for wheel in range(wheels.body.shape[0]):
        foot = footprint_of(world, wheel_pose(world, wheel, dt, wheels, state), soil, assets)
        if foot.x0 <= foot.x1:
            for y in range(foot.y0 >> 3, (foot.y1 >> 3) + 1):
                for x in range(foot.x0 >> 3, (foot.x1 >> 3) + 1):
                    take_page(world, x, y, step, nodes)


@wp.kernel
def press_wheels(
    # inputs
    worlds: WorldRange,
    dt: float,
    soil: SoilTables,
    wheels: SoilWheels,
    assets: Assets,
    state: StateArrays,
    # in and out
    nodes: SoilNodes,
    # outputs
    reports: SoilReports,
    control: ControlArrays,
):
    """Forces and implicit blocks of all wheels; dim (W, wheels). Nodes are summed row by row."""
    index, wheel = wp.tid()
    world = worlds.first + index
    body = wheels.body[wheel]
    p = wheel_pose(world, wheel, dt, wheels, state)
    foot = footprint_of(world, p, soil, assets)
    total = WheelSum()
    sunk = float(0.0)
    if foot.x0 <= foot.x1 and foot.y0 <= foot.y1:
        copy = world_row(world, soil.parameter.shape[0])
        kind = soil_at(world, p.x, soil)
        inverse_b = float(0.0)
        if soil.parameter[copy, kind, K_C] != 0.0:
            inverse_b = inverse_half_width(world, p, foot, soil, assets)
        law = law_of(copy, kind, inverse_b, soil.parameter)
        crowded = meets_another(world, wheel, foot, dt, soil, wheels, state, assets)
        middle_x = node_number(p.x[0], 0.5 * soil.spacing, soil.spacing)
        middle_y = node_number(p.x[1], 0.5 * soil.spacing, soil.spacing)
        page_x = int(0x7FFFFFFF)
        page_y = int(0)
        page = int(-1)
        for row in range(foot.y0, foot.y1 + 1):
            for column in range(foot.x0, foot.x1 + 1):
                b = node_below(world, column, row, p, soil, assets)
                # a node that the wheel comes to within the step counts already
                close = b.sinkage > -3.0 * wp.length(p.moved)
                if b.found == 1 and close:
                    if column >> 3 != page_x or row >> 3 != page_y:
                        page_x = column >> 3
                        page_y = row >> 3
                        page = find_page(world, page_x, page_y, nodes)
                    area = soil.spacing * soil.spacing * b.share
                    mine = bool(True)
                    if crowded:
                        mine = owns(world, wheel, column, row, b, dt, soil, wheels, state, assets)
                    if page >= 0 and area > 0.0 and mine:
                        slot = page * PAGE_NODES + (row & (SIDE - 1)) * SIDE + (column & (SIDE - 1))
                        total = press_node(total, slot, world, area, dt, b, p, law, soil, nodes)
                        if column == middle_x and row == middle_y:
                            sunk = wp.max(b.sinkage, nodes.node[world, slot, SINKAGE]) / b.normal[2]
    control.element_force[world, body] = total.force
    control.element_torque[world, body] = total.moment
    control.element_mass[world, body] = total.mass
    control.element_coupling[world, body] = total.coupling
    control.element_inertia[world, body] = total.inertia
    reports.touched[world, wheel] = total.touched
    reports.sinkage[world, wheel] = sunk
    reports.before_v[world, wheel] = p.v
    reports.before_omega[world, wheel] = p.omega


@wp.kernel
def report_wheels(
    # inputs
    worlds: WorldRange,
    dt: float,
    wheels: SoilWheels,
    control: ControlArrays,
    state: StateArrays,
    # outputs
    reports: SoilReports,
):
    """What acted on the wheels in a sub-step, F - D dv / h; dim (W, wheels)."""
    index, wheel = wp.tid()
    world = worlds.first + index
    body = wheels.body[wheel]
    dv = (state.body_v[world, body] - reports.before_v[world, wheel]) / dt
    domega = (state.body_omega[world, body] - reports.before_omega[world, wheel]) / dt
    coupling = control.element_coupling[world, body]
    force = control.element_force[world, body] - control.element_mass[world, body] * dv - domega * coupling
    moment = control.element_torque[world, body] - control.element_inertia[world, body] * domega - coupling * dv
    q = state.body_rot[world, body]
    offset = to_float(wp.quat_rotate(q, to_double(wheels.offset_b[wheel])))
    reports.force_w[world, wheel] = force
    reports.torque_w[world, wheel] = moment - wp.cross(offset, force)
    reports.load[world, wheel] = force[2]
    axis = to_float(wp.quat_rotate(q, wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))))
    ahead = wp.normalize(wp.cross(axis, wp.vec3(0.0, 0.0, 1.0)))
    omega = state.body_omega[world, body]
    v = wp.dot(ahead, state.body_v[world, body] + wp.cross(omega, offset))
    rolled = wheels.radius[wheel] * wp.dot(omega, axis)
    fast = wp.max(wp.abs(v), wp.abs(rolled))
    reports.slip_ratio[world, wheel] = wp.where(fast > 1.0e-3, (rolled - v) / wp.max(fast, 1.0e-3), 0.0)


@wp.kernel
def clear_soil(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    # in and out
    nodes: SoilNodes,
):
    """Fresh soil in the worlds of a mask; dim W. Pages are emptied when they are taken."""
    world = worlds.first + wp.tid()
    if mask[world]:
        nodes.count[world] = 0
        nodes.step[world] = 0
        nodes.recycled[world] = 0
        for at in range(nodes.entry.shape[1]):
            nodes.entry[world, at] = 0
