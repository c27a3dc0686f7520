"""Shapes pressed into fresh soil where they stand: nodes remember what carries each, without a fall."""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.soil.bekker_janosi_kernels import Law, law_of
from simwarp.soil.deformed_surface_kernels import node_drop
from simwarp.soil.footprint_kernels import (
    Below,
    Footprint,
    Pose,
    footprint_of,
    inverse_half_width,
    kept_footprint,
    meets_another,
    node_below,
    owns,
    shape_pose,
    soil_at,
)
from simwarp.soil.pages_kernels import find_page, slot_in
from simwarp.soil.pressing_kernels import claim_pages_below, clear_world
from simwarp.soil.soil_columns_kernels import K_C
from simwarp.soil.soil_tables_kernels import (
    BLADE,
    LEAN_X,
    LEAN_Y,
    SHEAR,
    SINKAGE,
    YIELD,
    SoilNodes,
    SoilReports,
    SoilShapes,
    SoilTables,
)
from simwarp.vehicle.tires.ground_kernels import ground_below

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FITS = wp.constant(4)
"""Times that stresses are fitted to a force and a moment: shear and pressure depend on each other."""
THIN = wp.constant(0.05)
"""Second moment of a contact, per square of the nodes' spacing, below which it bears no moment."""
MARGIN = wp.constant(1.5)
"""Of the pressure that a node carries: where it yields. What stands has rocked before, and may lean otherwise now."""
HALVINGS = wp.constant(24)
"""Of the range in which a depth is looked for: a micrometre in ten metres."""
SHEARED = wp.constant(3.0)
"""Shear lengths that a node under a standing shape was sheared: 95 % of its strength hold it."""


@wp.func
def imprinted_below(
    world: int, shape: int, column: int, row: int, crowded: bool, p: Pose, soil: SoilTables, shapes: SoilShapes,
    state: StateArrays, assets: Assets, nodes: SoilNodes,
) -> Below:  # fmt: skip
    """A node below a shape that stands; `found` is 0 where the shape does not press on it."""
    b = node_below(world, column, row, p, soil, assets)
    if b.sinkage <= 0.0 or b.share <= 0.0:
        b.found = 0
    if b.found == 1 and crowded and not owns(world, shape, column, row, b, 0.0, soil, shapes, state, assets, nodes):
        b.found = 0
    return b


@wp.struct
class Imprint:
    """Stresses that a standing shape leaves: pressure v (share + slope . place), v that of fresh soil, and a lean."""

    share: float
    slope: wp.vec3  # along the ground [1/m]
    lean: wp.vec3  # of the shear, along the ground


@wp.struct
class ImprintSum:
    """Sums over the nodes below a shape, about its centre."""

    pushed: wp.vec3  # of fresh soil's pressures [N]
    strength: float  # most that shear holds [N]
    arm: wp.vec3  # its first moment [N m]
    wanted: wp.mat33  # force along the normal, moments about two axes along the ground: per share and slopes
    spread: wp.vec2  # second moments along the ground [N m^2]


@wp.func
def imprinted_pressure(b: Below, law: Law, fit: Imprint) -> float:
    """Of a node, under the fitted stresses [Pa]."""
    part = fit.share + fit.slope[0] * b.x + fit.slope[1] * b.y + fit.slope[2] * b.height
    return wp.max(part, 0.0) * law.stiffness * wp.pow(b.sinkage, law.exponent)


@wp.func
def imprinted_strength(pressure: float, law: Law) -> float:
    """Shear stress that holds such a node at most [Pa]."""
    return (law.cohesion + pressure * law.tan_phi) * (1.0 - wp.exp(-SHEARED))


@wp.func
def sum_imprint(
    world: int, shape: int, foot: Footprint, crowded: bool, normal: wp.vec3, fit: Imprint, law: Law, p: Pose,
    soil: SoilTables, shapes: SoilShapes, state: StateArrays, assets: Assets, nodes: SoilNodes,
) -> ImprintSum:  # fmt: skip
    """Sums for a fit, row by row."""
    s = ImprintSum()
    side = wp.normalize(wp.cross(normal, wp.vec3(1.0, 0.0, 0.0)))
    ahead = wp.cross(side, normal)
    for row in range(foot.y0, foot.y1 + 1):
        for column in range(foot.x0, foot.x1 + 1):
            b = imprinted_below(world, shape, column, row, crowded, p, soil, shapes, state, assets, nodes)
            if b.found == 1:
                area = soil.spacing * soil.spacing * b.share
                fresh = area * law.stiffness * wp.pow(b.sinkage, law.exponent)
                arm = wp.vec3(b.x, b.y, b.low)
                strength = area * imprinted_strength(imprinted_pressure(b, law, fit), law)
                s.pushed += fresh * b.normal
                s.strength += strength
                s.arm += strength * arm
                turn = wp.cross(arm, b.normal)
                u = wp.dot(ahead, wp.vec3(b.x, b.y, b.height))
                w = wp.dot(side, wp.vec3(b.x, b.y, b.height))
                parts = fresh * wp.vec3(1.0, u, w)
                s.wanted += wp.outer(wp.vec3(wp.dot(normal, b.normal), wp.dot(ahead, turn), wp.dot(side, turn)), parts)
                s.spread += fresh * wp.vec2(u * u, w * w)
    return s


@wp.func
def fit_imprint(
    world: int, shape: int, foot: Footprint, crowded: bool, force: wp.vec3, torque: wp.vec3, law: Law, p: Pose,
    soil: SoilTables, shapes: SoilShapes, state: StateArrays, assets: Assets, nodes: SoilNodes,
) -> Imprint:  # fmt: skip
    """Stresses that carry a force and a moment about the shape's centre (but for that about the normal)."""
    fit = Imprint()
    fit.share = 1.0
    if wp.length_sq(force) == 0.0:
        return fit
    up = wp.vec3(0.0, 0.0, 1.0)
    total = sum_imprint(world, shape, foot, crowded, up, fit, law, p, soil, shapes, state, assets, nodes)
    if wp.length_sq(total.pushed) == 0.0:
        return fit
    normal = wp.normalize(total.pushed)
    side = wp.normalize(wp.cross(normal, wp.vec3(1.0, 0.0, 0.0)))
    ahead = wp.cross(side, normal)
    pressed = wp.dot(force, normal)
    if pressed <= 0.0:
        return fit
    along = force - pressed * normal
    fit.share = pressed / wp.length(total.pushed)
    for _ in range(FITS):
        total = sum_imprint(world, shape, foot, crowded, normal, fit, law, p, soil, shapes, state, assets, nodes)
        if total.strength > 0.0:
            # what no shear can hold is left out
            fit.lean = -along / wp.max(total.strength, 1.02 * wp.length(along))
        rest = torque + wp.cross(total.arm, fit.lean)
        known = wp.vec3(pressed, wp.dot(ahead, rest), wp.dot(side, rest))
        thin = wp.min(total.spread[0], total.spread[1])
        if thin > THIN * soil.spacing * soil.spacing * wp.length(total.pushed):
            found = wp.inverse(total.wanted) * known
            fit.share = found[0]
            fit.slope = found[1] * ahead + found[2] * side
    return fit


@wp.func
def imprint_shape(
    world: int, shape: int, force_b: wp.vec3, torque_b: wp.vec3, soil: SoilTables, shapes: SoilShapes, assets: Assets,
    state: StateArrays, nodes: SoilNodes,
):  # fmt: skip
    """Presses one shape in."""
    p = shape_pose(world, shape, 0.0, shapes, state)
    foot = kept_footprint(world, shape, nodes)
    deepest = float(0.0)
    if foot.x0 <= foot.x1 and foot.y0 <= foot.y1:
        copy = world_row(world, soil.parameter.shape[0])
        kind = soil_at(world, p.x, soil)
        inverse_b = float(0.0)
        if soil.parameter[copy, kind, K_C] != 0.0:
            inverse_b = inverse_half_width(world, p, foot, soil, assets, nodes)
        law = law_of(copy, kind, inverse_b, soil.parameter)
        crowded = meets_another(world, shape, foot, nodes)
        q = state.body_rot[world, shapes.body[shape]]
        force = to_float(wp.quat_rotate(q, to_double(force_b)))
        torque = to_float(wp.quat_rotate(q, to_double(torque_b)))
        fit = fit_imprint(world, shape, foot, crowded, force, torque, law, p, soil, shapes, state, assets, nodes)
        for row in range(foot.y0, foot.y1 + 1):
            for column in range(foot.x0, foot.x1 + 1):
                b = imprinted_below(world, shape, column, row, crowded, p, soil, shapes, state, assets, nodes)
                page = int(-1)
                if b.found == 1:
                    page = find_page(world, column >> 3, row >> 3, nodes)
                if page >= 0:
                    slot = slot_in(page, column, row)
                    # no more than springs back within its depth: a node without depth does not push
                    pressure = wp.min(imprinted_pressure(b, law, fit), law.elastic * b.sinkage)
                    nodes.node[world, slot, SINKAGE] = b.sinkage - pressure / law.elastic
                    fresh = law.stiffness * wp.pow(b.sinkage, law.exponent)
                    deepest = wp.max(deepest, node_drop(world, slot, b.normal, nodes))
                    nodes.node[world, slot, YIELD] = wp.max(MARGIN * pressure, fresh)
                    nodes.node[world, slot, SHEAR] = SHEARED * law.shear_length
                    nodes.node[world, slot, LEAN_X] = fit.lean[0]
                    nodes.node[world, slot, LEAN_Y] = fit.lean[1]
    nodes.deepest[world, shape] = deepest


@wp.kernel
def imprint_worlds(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    rest_force_b: wp.array2d[wp.vec3],  # (W, shapes) at the shape's centre, body axes [N]; 0: what fresh soil bears
    rest_torque_b: wp.array2d[wp.vec3],  # about it [N·m]
    soil: SoilTables,
    shapes: SoilShapes,
    assets: Assets,
    state: StateArrays,
    # in and out
    nodes: SoilNodes,
):
    """Fresh soil, and all shapes pressed into it at their poses, in the worlds of a mask; dim W."""
    world = worlds.first + wp.tid()
    if mask[world]:
        clear_world(world, nodes)
        claim_pages_below(world, 0.0, 0, soil, shapes, assets, state, nodes)
        for shape in range(shapes.body.shape[0]):
            imprint_shape(
                world, shape, rest_force_b[world, shape], rest_torque_b[world, shape], soil, shapes, assets, state,
                nodes,
            )  # fmt: skip


@wp.kernel
def keep_forces(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    shapes: SoilShapes,
    state: StateArrays,
    reports: SoilReports,
    # outputs
    rest_force_b: wp.array2d[wp.vec3],
    rest_torque_b: wp.array2d[wp.vec3],
):
    """What acts on the shapes now, in axes of their bodies, in the worlds of a mask; dim (W, shapes)."""
    index, shape = wp.tid()
    world = worlds.first + index
    if mask[world]:
        q = state.body_rot[world, shapes.body[shape]]
        rest_force_b[world, shape] = to_float(wp.quat_rotate_inv(q, to_double(reports.force_w[world, shape])))
        rest_torque_b[world, shape] = to_float(wp.quat_rotate_inv(q, to_double(reports.torque_w[world, shape])))


@wp.func
def carried_by_fresh(
    world: int, p: Pose, law: Law, soil: SoilTables, assets: Assets,
) -> float:  # fmt: skip
    """Vertical force that fresh soil bears under a shape at a pose [N]."""
    total = float(0.0)
    foot = footprint_of(world, p, 0.0, soil, assets)
    for row in range(foot.y0, foot.y1 + 1):
        if foot.x0 <= foot.x1:
            for column in range(foot.x0, foot.x1 + 1):
                b = node_below(world, column, row, p, soil, assets)
                if b.found == 1 and b.sinkage > 0.0:
                    total += b.share * b.normal[2] * law.stiffness * wp.pow(b.sinkage, law.exponent)
    return total * soil.spacing * soil.spacing


@wp.kernel
def find_resting_shifts(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    rest_force_b: wp.array2d[wp.vec3],
    soil: SoilTables,
    shapes: SoilShapes,
    assets: Assets,
    state: StateArrays,
    # outputs
    shift: wp.array2d[float],
):
    """How far up each shape would rest on fresh soil, in the worlds of a mask; dim (W, shapes)."""
    index, shape = wp.tid()
    world = worlds.first + index
    if not mask[world]:
        return
    shift[world, shape] = 0.0
    p = shape_pose(world, shape, 0.0, shapes, state)
    q = state.body_rot[world, shapes.body[shape]]
    load = to_float(wp.quat_rotate(q, to_double(rest_force_b[world, shape])))[2]
    g = ground_below(world, p.x, wp.vec3(), p.radius, soil.terrain, assets)
    if load <= 0.0 or g.found == 0 or p.kind == BLADE:
        return
    copy = world_row(world, soil.parameter.shape[0])
    kind = soil_at(world, p.x, soil)
    centre = p.x
    # from the centre on the ground to the shape above it
    low = g.arm[2]
    high = g.arm[2] + 2.0 * (p.radius + p.half_width)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        p.x = centre + wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(middle))
        inverse_b = float(0.0)
        if soil.parameter[copy, kind, K_C] != 0.0:
            inverse_b = inverse_half_width(
                world, p, footprint_of(world, p, 0.0, soil, assets), soil, assets, SoilNodes()
            )
        if carried_by_fresh(world, p, law_of(copy, kind, inverse_b, soil.parameter), soil, assets) > load:
            low = middle
        else:
            high = middle
    shift[world, shape] = 0.5 * (low + high)
