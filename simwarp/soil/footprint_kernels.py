"""Where shapes stand over the soil: their poses, the nodes below them, how deep each is in the ground."""

import warp as wp

from simwarp.kernels.collision.shape import PLANE, Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float
from simwarp.soil.deformed_surface_kernels import FARTHEST
from simwarp.soil.pages_kernels import find_page, slot_in
from simwarp.soil.shape_surface_kernels import GENTLE, ball_low, box_column, capsule_low, lowest_face
from simwarp.soil.soil_tables_kernels import BALL, BLADE, BOX, CAPSULE, WHEEL, SoilNodes, SoilShapes, SoilTables
from simwarp.soil.wheel_surface_kernels import UPRIGHT, Column, column_above
from simwarp.vehicle.tires.ground_kernels import GroundPoint, ground_below

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

SLACK = wp.constant(0.02)
"""Of the ground's height below a shape, taken into its footprint where the ground is no plane [radii]."""
LEANEST = wp.constant(0.25)
"""Cosine of the greatest angle between the ground's normal and that along which it presses: 75 degrees."""
ON_FACE = wp.constant(2.0e-5)
"""Distance from a face below which a lowest point is on it [radii of the ball around a box, half widths of a wheel]."""
TREAD = wp.constant(0.999)
"""Distance from a wheel's axis above which a lowest point is on its tread [radii]."""
TILTED = wp.constant(0.2)
"""Vertical part of an axis above which a wheel's whole outline counts."""


@wp.struct
class Pose:
    """Place and motion of a shape, relative to where it is at the start of the step."""

    kind: int
    x: wp.vec3d  # centre, world [m]
    axis: wp.vec3
    side: wp.vec3  # first axis of a box
    v: wp.vec3  # of the centre of mass of its body [m/s]
    omega: wp.vec3
    centre: wp.vec3  # from the centre of mass to the shape's centre [m]
    moved: wp.vec3  # of the centre within the step [m]
    moved_axis: wp.vec3
    moved_side: wp.vec3
    near: float  # height above the ground within which a node counts [m]
    radius: float
    half_width: float
    crown: float
    half: wp.vec3


@wp.struct
class Footprint:
    """Nodes that may be below a shape: columns x0 to x1, rows y0 to y1; none where x1 < x0."""

    x0: int
    x1: int
    y0: int
    y1: int


@wp.func
def holds(foot: Footprint, column: int, row: int) -> bool:
    """True where a node is in a footprint."""
    return column >= foot.x0 and column <= foot.x1 and row >= foot.y0 and row <= foot.y1


@wp.func
def turned(axis: wp.vec3, angle: wp.vec3) -> wp.vec3:
    """A unit vector turned by a small angle, to second order: the soil is so stiff that micrometres count."""
    first = wp.cross(angle, axis)
    return wp.normalize(axis + first + 0.5 * wp.cross(angle, first))


@wp.func
def shape_pose(world: int, shape: int, dt: float, shapes: SoilShapes, state: StateArrays) -> Pose:
    """A shape now, and where its velocity leads it."""
    body = shapes.body[shape]
    q = state.body_rot[world, body]
    offset = wp.quat_rotate(q, to_double(shapes.offset_b[shape]))
    p = Pose()
    p.kind = shapes.kind[shape]
    p.x = state.body_x[world, body] + offset
    p.axis = to_float(wp.quat_rotate(q, to_double(shapes.axis_b[shape])))
    p.v = state.body_v[world, body]
    p.omega = state.body_omega[world, body]
    p.centre = to_float(offset)
    p.radius = shapes.radius[shape]
    moved = dt * (p.v + wp.cross(p.omega, p.centre))
    # one that flies off at any speed looks no farther ahead than it is high
    p.moved = moved * wp.min(1.0, p.radius / wp.max(wp.length(moved), 1.0e-9))
    p.moved_axis = wp.normalize(p.axis + dt * wp.cross(p.omega, p.axis))
    p.near = 3.0 * wp.length(p.moved)
    p.half_width = shapes.half_width[shape]
    p.crown = shapes.crown[shape]
    if p.kind != WHEEL:
        # corners of a box and ends of a capsule come to the ground by turning
        p.near += 3.0 * (p.radius + p.half_width) * wp.min(dt * wp.length(p.omega), 1.0)
        p.moved_axis = turned(p.axis, dt * p.omega)
        if p.kind == BOX:
            p.half = shapes.half[shape]
            p.side = to_float(wp.quat_rotate(q, to_double(shapes.side_b[shape])))
            side = turned(p.side, dt * p.omega)
            p.moved_side = wp.normalize(side - wp.dot(side, p.moved_axis) * p.moved_axis)
    return p


@wp.func
def box_axes(axis: wp.vec3, side: wp.vec3) -> wp.mat33:
    """Columns: a box's axes."""
    return wp.matrix_from_cols(side, wp.cross(axis, side), axis)


@wp.func
def surface_above(dx: float, dy: float, p: Pose, axis: wp.vec3, side: wp.vec3, cell: float) -> Column:
    """A shape's lowest point over a node, from its centre, with its axes as given; `cell` as in `column_above`."""
    if p.kind == WHEEL:
        return column_above(dx, dy, axis, p.radius, p.half_width, p.crown, cell)
    if p.kind == BOX:
        return box_column(dx, dy, box_axes(axis, side), p.half, cell)
    c = Column()
    c.share = 1.0
    if p.kind == CAPSULE:
        c.height = capsule_low(dx, dy, axis, p.radius, p.half_width)
    else:
        c.height = ball_low(dx, dy, p.radius)
    return c


@wp.func
def surface_normal(lowest: wp.vec3, ground: wp.vec3, p: Pose) -> wp.vec3:
    """Unit normal, into the shape, of its surface at a lowest point, given from its centre. Where that leans from the
    ground's normal by more than `LEANEST`, it is turned back to it.
    """
    inward = -lowest
    if p.kind == BOX:
        axes = box_axes(p.axis, p.side)
        place = wp.transpose(axes) * lowest
        face = lowest_face(axes)
        for k in range(3):  # another one beyond its edge
            gentle = -wp.sign(place[k]) * axes[2, k] > GENTLE
            if gentle and wp.abs(wp.abs(place[k]) - p.half[k]) < ON_FACE * p.radius:
                face = k
        inward = -wp.sign(place[face]) * wp.vec3(axes[0, face], axes[1, face], axes[2, face])
    elif p.kind == CAPSULE:
        inward += wp.clamp(wp.dot(lowest, p.axis), -p.half_width, p.half_width) * p.axis
    elif p.kind == WHEEL:
        across = wp.dot(lowest, p.axis)
        ahead = wp.cross(p.axis, wp.vec3(0.0, 0.0, 1.0))
        at_side = wp.abs(wp.abs(across) - p.half_width) < ON_FACE * p.half_width
        inside = wp.length(lowest - across * p.axis) < TREAD * p.radius
        if (at_side and inside) or wp.length(ahead) < UPRIGHT:
            inward = -wp.sign(across) * p.axis
        else:
            # a point beside the tread was moved along the axis: its place ahead is what is left of it
            ahead = wp.normalize(ahead)
            forward = wp.clamp(wp.dot(lowest, ahead) / p.radius, -1.0, 1.0)
            inward = wp.sqrt(1.0 - forward * forward) * wp.cross(ahead, p.axis) - forward * ahead
            if p.crown > 0.0:
                inward -= across / p.crown * p.axis
    inward = wp.normalize(inward)
    upright = wp.dot(inward, ground)
    if upright < LEANEST:
        along = wp.normalize(inward - upright * ground)
        inward = LEANEST * ground + wp.sqrt(1.0 - LEANEST * LEANEST) * along
    return inward


@wp.func
def node_number(x: wp.float64, offset: float, spacing: float) -> int:
    """The last column or row of nodes up to x + offset; exact far from the origin too."""
    return int(wp.floor((x + wp.float64(offset)) / wp.float64(spacing)))


@wp.func
def wheel_reach(p: Pose, g: GroundPoint, lift: float, soil: SoilTables) -> wp.vec2:
    """How far along X and Y a wheel may touch nodes; negative where it is above the ground."""
    deep = g.arm[2] + p.radius + wp.abs(p.moved[2]) + p.half_width * wp.abs(p.axis[2]) + lift
    along = float(p.radius)
    if soil.terrain.kind == PLANE:
        # a leaning plane reaches the wheel earlier on its upper side
        deep += p.radius * wp.sqrt(wp.max(0.0, 1.0 - g.normal[2] * g.normal[2]))
        if deep <= 0.0:
            return wp.vec2(-1.0, -1.0)
        if deep < p.radius:
            along = wp.sqrt(deep * (2.0 * p.radius - deep))
    elif deep + (SLACK + 1.0) * p.radius <= 0.0:
        return wp.vec2(-1.0, -1.0)
    flat = wp.max(wp.sqrt(p.axis[0] * p.axis[0] + p.axis[1] * p.axis[1]), 1.0e-6)
    ax = wp.abs(p.axis[0]) / flat
    ay = wp.abs(p.axis[1]) / flat
    across = p.half_width + p.radius * wp.abs(p.axis[2]) + soil.spacing * float(soil.weighted)
    reach_x = along * ay + across * ax + wp.abs(p.moved[0])
    reach_y = along * ax + across * ay + wp.abs(p.moved[1])
    if wp.abs(p.axis[2]) > TILTED:  # it may lie on its side
        reach_x = wp.length(wp.vec2(p.radius, p.half_width)) + wp.abs(p.moved[0])
        reach_y = reach_x - wp.abs(p.moved[0]) + wp.abs(p.moved[1])
    return wp.vec2(reach_x, reach_y)


@wp.func
def shape_reach(p: Pose, g: GroundPoint, lift: float, soil: SoilTables) -> wp.vec2:
    """The same of the other shapes: half of the box around each, less where a round one is hardly in the ground."""
    extent = wp.vec3(p.radius, p.radius, p.radius)
    if p.kind == BOX:
        axes = box_axes(p.axis, p.side)
        for k in range(3):
            extent[k] = wp.dot(wp.abs(wp.vec3(axes[k, 0], axes[k, 1], axes[k, 2])), p.half)
            extent[k] += wp.where(k < 2, soil.spacing * float(soil.weighted), 0.0)
    deep = g.arm[2] + extent[2] + p.near + lift
    if p.kind == CAPSULE:
        deep += p.half_width * wp.abs(p.axis[2])
    if soil.terrain.kind == PLANE:
        deep += (p.radius + p.half_width) * wp.sqrt(wp.max(0.0, 1.0 - g.normal[2] * g.normal[2]))
        if deep <= 0.0:
            return wp.vec2(-1.0, -1.0)
        if p.kind != BOX and deep < p.radius:
            chord = wp.sqrt(deep * (2.0 * p.radius - deep))
            extent = wp.vec3(chord, chord, p.radius)
    elif deep + (SLACK + 1.0) * (p.radius + p.half_width) <= 0.0:
        return wp.vec2(-1.0, -1.0)
    if p.kind == CAPSULE:
        extent += p.half_width * wp.abs(p.axis)
    return wp.vec2(extent[0] + p.near, extent[1] + p.near)


@wp.func
def footprint_of(world: int, p: Pose, lift: float, soil: SoilTables, assets: Assets) -> Footprint:
    """The nodes that a shape may touch now or at the end of the step, on ground that rises by at most `lift` [m]."""
    foot = Footprint()
    foot.x1 = -1
    if p.kind == BLADE or not wp.isfinite(wp.length_sq(p.axis) + wp.length_sq(p.moved)):
        return foot
    g = ground_below(world, p.x, wp.vec3(), p.radius, soil.terrain, assets)
    if g.found == 0 or wp.max(wp.abs(p.x[0]), wp.abs(p.x[1])) > FARTHEST * wp.float64(soil.spacing):
        return foot
    reach = wp.vec2()
    if p.kind == WHEEL:
        reach = wheel_reach(p, g, lift, soil)
    else:
        reach = shape_reach(p, g, lift, soil)
    if reach[0] < 0.0 or not wp.isfinite(reach[0] + reach[1]):
        return foot
    foot.x0 = node_number(p.x[0], -reach[0], soil.spacing) + 1
    foot.x1 = node_number(p.x[0], reach[0], soil.spacing)
    foot.y0 = node_number(p.x[1], -reach[1], soil.spacing) + 1
    foot.y1 = node_number(p.x[1], reach[1], soil.spacing)
    return foot


@wp.func
def level_footprint(
    world: int, p: Pose, foot: Footprint, lift: float, soil: SoilTables, assets: Assets
) -> Footprint:  # fmt: skip
    """The part of a footprint beyond which a shape meets only nodes that were raised."""
    if lift == 0.0:
        return foot
    return footprint_of(world, p, 0.0, soil, assets)


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
    """A node of the undeformed ground, from a shape's centre."""

    found: int
    x: float
    y: float
    height: float
    normal: wp.vec3
    sinkage: float  # of the shape's surface along the normal [m]; negative where there is none
    share: float  # of its cell that the shape covers
    low: float  # the shape's surface, from its centre [m]
    raised: float  # of the ground by soil that was pushed aside, which height and sinkage have in them [m]


@wp.func
def node_below(world: int, column: int, row: int, p: Pose, soil: SoilTables, assets: Assets) -> Below:
    """The ground at a node, and how deep the shape is in it now."""
    b = Below()
    spacing = wp.float64(soil.spacing)
    b.x = float(wp.float64(column) * spacing - p.x[0])
    b.y = float(wp.float64(row) * spacing - p.x[1])
    g = ground_below(world, p.x, wp.vec3(b.x, b.y, 0.0), p.radius, soil.terrain, assets)
    b.found = g.found
    b.height = g.arm[2]
    b.normal = g.normal
    above = surface_above(b.x, b.y, p, p.axis, p.side, soil.spacing * float(soil.weighted))
    b.sinkage = g.normal[2] * (b.height - above.height)
    b.share = above.share
    b.low = above.height
    return b


@wp.func
def raised_node(below: Below, raised: float) -> Below:
    """A node whose ground was raised [m]."""
    b = below
    if raised != 0.0:
        b.raised = raised
        b.height += raised
        b.sinkage = b.normal[2] * (b.height - b.low)
    return b


@wp.struct
class Patch:
    """Axes along the ground in which the touched rectangle is taken, and its greatest size."""

    across: wp.vec2  # not quite a unit vector where an axis stands upright
    length: float
    width: float


@wp.func
def patch_of(p: Pose) -> Patch:
    """Of a wheel along its axis; of a box along its lowest face."""
    found = Patch()
    axis = p.axis
    found.length = 2.0 * p.radius
    found.width = 2.0 * p.half_width
    if p.kind == BALL or (p.kind == CAPSULE and wp.abs(p.axis[2]) > 0.9):
        axis = wp.vec3(0.0, 1.0, 0.0)
    if p.kind == BALL or p.kind == CAPSULE:
        found.width += found.length
    if p.kind == BOX:
        axes = box_axes(p.axis, p.side)
        face = lowest_face(axes)
        wide = (face + 2) % 3
        axis = wp.vec3(axes[0, wide], axes[1, wide], axes[2, wide])
        found.length = 2.0 * p.half[(face + 1) % 3]
        found.width = 2.0 * p.half[wide]
    flat = wp.max(wp.sqrt(axis[0] * axis[0] + axis[1] * axis[1]), 1.0e-6)
    found.across = wp.vec2(axis[0] / flat, axis[1] / flat)
    if p.kind == WHEEL and wp.abs(axis[2]) > TILTED:  # it may lie on its side: a disc, whose axis has no direction
        found.width = 2.0 * (p.half_width * flat + p.radius * wp.abs(axis[2]))
        if flat < 1.0e-3:
            found.across = wp.vec2(0.0, 1.0)
    return found


@wp.func
def inverse_half_width(
    world: int, p: Pose, foot: Footprint, soil: SoilTables, assets: Assets, nodes: SoilNodes
) -> float:  # fmt: skip
    """Perimeter over twice the area of the touched rectangle in the shape's axes [1/m]; 0 without one.

    With the raises of `nodes`; `SoilNodes()` has none.
    """
    patch = patch_of(p)
    ax = patch.across[0]
    ay = patch.across[1]
    low = float(1.0e9)
    high = float(-1.0e9)
    left = float(-1.0e9)
    right = float(1.0e9)
    for row in range(foot.y0, foot.y1 + 1):
        for column in range(foot.x0, foot.x1 + 1):
            b = node_below(world, column, row, p, soil, assets)
            if nodes.raised.shape[1] > 0:
                page = find_page(world, column >> 3, row >> 3, nodes)
                if page >= 0:
                    b = raised_node(b, nodes.raised[world, slot_in(page, column, row)])
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
    length = wp.min(high - low + cell, patch.length)
    width = wp.min(left - right + cell, patch.width)
    return (length + width) / (length * width)


@wp.func
def keep_footprint(world: int, shape: int, foot: Footprint, nodes: SoilNodes):
    """For all that comes in this step."""
    nodes.foot[world, shape] = wp.vec4i(foot.x0, foot.x1, foot.y0, foot.y1)


@wp.func
def kept_footprint(world: int, shape: int, nodes: SoilNodes) -> Footprint:
    """Of this step."""
    kept = nodes.foot[world, shape]
    foot = Footprint()
    foot.x0 = kept[0]
    foot.x1 = kept[1]
    foot.y0 = kept[2]
    foot.y1 = kept[3]
    return foot


@wp.func
def owns(
    world: int, shape: int, column: int, row: int, b: Below, dt: float, soil: SoilTables, shapes: SoilShapes,
    state: StateArrays, assets: Assets, nodes: SoilNodes,
) -> bool:  # fmt: skip
    """False where another shape is deeper at a node, or as deep and of a smaller index."""
    mine = bool(True)
    for other in range(shapes.body.shape[0]):
        f = kept_footprint(world, other, nodes)
        if other != shape and f.x0 <= column and column <= f.x1 and f.y0 <= row and row <= f.y1:
            p = shape_pose(world, other, dt, shapes, state)
            theirs = raised_node(node_below(world, column, row, p, soil, assets), b.raised).sinkage
            if theirs > 0.0 and (theirs > b.sinkage or (theirs == b.sinkage and other < shape)):
                mine = False
    return mine


@wp.func
def meets_another(world: int, shape: int, foot: Footprint, nodes: SoilNodes) -> bool:
    """True where the footprint of another shape crosses this one's."""
    found = bool(False)
    for other in range(nodes.foot.shape[1]):
        f = kept_footprint(world, other, nodes)
        if other != shape and f.x0 <= foot.x1 and foot.x0 <= f.x1 and f.y0 <= foot.y1 and foot.y0 <= f.y1:
            found = True
    return found
