"""Forces on blades: the passive wedge of soil ahead of each strip, by the fundamental equation of earth moving.

Reece (1965), The fundamental equation of earth-moving mechanics; McKyes (1985), Soil Cutting and Tillage, chapter 2:
P = (gamma g d^2 N_gamma + c d N_c + q d N_q + c_a d N_ca) w, with the failure angle that makes it least. The surcharge
q is the weight of the loose soil that lies on the wedge, as the grid has it.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.soil.deformed_surface_kernels import node_drop
from simwarp.soil.footprint_kernels import node_number, soil_at
from simwarp.soil.pages_kernels import find_page, slot_in
from simwarp.soil.pressing_kernels import ShapeSum, add_block
from simwarp.soil.soil_columns_kernels import COHESION, DENSITY, TAN_PHI
from simwarp.soil.soil_tables_kernels import SoilBlades, SoilNodes, SoilReports, SoilShapes, SoilTables
from simwarp.vehicle.tires.ground_kernels import ground_below

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

STRIPS = wp.constant(8)
"""Across a blade: each meets the soil ahead of its own middle."""
SAMPLES = wp.constant(24)
"""Of the surface ahead of a strip, a node's spacing apart."""
FIRST = wp.constant(1.5)
"""Of the spacing: how far ahead of the edge the first one is. Nodes that the edge has passed are not in it."""
ANGLES = wp.constant(64)
"""Failure angles that are tried."""
FLATTEST = wp.constant(0.03)
"""The smallest of them [rad]: a heap on firm ground shears off along that."""
CREEP = wp.constant(0.005)
"""Speed into the soil at which the whole resistance is there [m/s]."""
LEVEL = wp.constant(0.2)
"""Horizontal part of an edge below which a blade does not cut."""
NO_GROUND = wp.constant(-1.0e3)
"""Level where there is none [m]."""

vec_samples = wp.types.vector(length=24, dtype=float)


@wp.struct
class BladePose:
    """A blade's edge and face."""

    cuts: int  # 0: the edge stands upright
    x: wp.vec3d  # middle of the edge, world [m]
    arm: wp.vec3  # to it from the centre of mass of its body [m]
    ahead: wp.vec2  # horizontal, across the edge
    across: wp.vec2  # horizontal, along the edge to the left
    slope: float  # rise of the edge per metre to the left
    face: wp.vec3  # up along the face
    rake: float  # of the face, from the ground ahead [rad]
    v: wp.vec3  # of the centre of mass
    omega: wp.vec3


@wp.func
def blade_pose(world: int, blade: int, blades: SoilBlades, shapes: SoilShapes, state: StateArrays) -> BladePose:
    """Where a blade is."""
    b = BladePose()
    shape = blades.shape[blade]
    body = shapes.body[shape]
    q = state.body_rot[world, body]
    offset = wp.quat_rotate(q, to_double(shapes.offset_b[shape]))
    b.x = state.body_x[world, body] + offset
    b.arm = to_float(offset)
    b.v = state.body_v[world, body]
    b.omega = state.body_omega[world, body]
    up_b = shapes.axis_b[shape]
    ahead_b = shapes.side_b[shape]
    edge = to_float(wp.quat_rotate(q, to_double(wp.cross(up_b, ahead_b))))
    lean = blades.rake[blade]
    b.face = to_float(wp.quat_rotate(q, to_double(wp.sin(lean) * up_b - wp.cos(lean) * ahead_b)))
    flat = wp.sqrt(edge[0] * edge[0] + edge[1] * edge[1])
    if flat > LEVEL and wp.isfinite(wp.length_sq(b.v) + wp.length_sq(b.omega) + float(wp.length_sq(b.x))):
        b.cuts = 1
        b.across = wp.vec2(edge[0] / flat, edge[1] / flat)
        b.ahead = wp.vec2(b.across[1], -b.across[0])
        b.slope = edge[2] / flat
        b.rake = wp.atan2(b.face[2], -(b.face[0] * b.ahead[0] + b.face[1] * b.ahead[1]))
    return b


@wp.func
def surface_parts(world: int, x: wp.vec3d, dx: float, dy: float, soil: SoilTables, assets: Assets, nodes: SoilNodes,
) -> wp.vec2:  # fmt: skip
    """Level of the firm ground at x + (dx, dy), from x, and height of the loose soil on it, between four nodes [m]."""
    column = node_number(x[0], dx, soil.spacing)
    row = node_number(x[1], dy, soil.spacing)
    spacing = wp.float64(soil.spacing)
    found = wp.vec2()
    for corner in range(4):
        i = column + (corner & 1)
        j = row + (corner >> 1)
        cx = float(wp.float64(i) * spacing - x[0])
        cy = float(wp.float64(j) * spacing - x[1])
        weight = wp.max(0.0, 1.0 - wp.abs(cx - dx) / soil.spacing) * wp.max(0.0, 1.0 - wp.abs(cy - dy) / soil.spacing)
        g = ground_below(world, x, wp.vec3(cx, cy, 0.0), 1.0, soil.terrain, assets)
        firm = wp.where(g.found == 1, g.arm[2], NO_GROUND)
        page = find_page(world, i >> 3, j >> 3, nodes)
        if page >= 0 and g.found == 1:
            slot = slot_in(page, i, j)
            raised = nodes.raised[world, slot]
            firm -= node_drop(world, slot, g.normal, nodes) + wp.max(raised, 0.0)
            found[1] += weight * wp.max(raised, 0.0)
        found[0] += weight * firm
    return found


@wp.struct
class Wedge:
    """Soil ahead of a strip, and what it may resist with."""

    depth: float  # of the edge below the firm ground [m]
    loose: vec_samples  # height of the loose soil above the edge or the firm ground at the samples [m]
    weight: float  # of soil, per volume [N/m^3]
    cohesion: float
    phi: float
    rake: float
    delta: float  # angle of friction on the face
    adhesion: float
    spacing: float  # of the samples [m]


@wp.func
def surcharge(w: Wedge, beta: float) -> float:
    """Area of the loose soil above a failure line at an angle: all above the firm part of the wedge, and what lies
    above the line where it goes on through the heap [m^2].
    """
    foot = w.depth / wp.tan(beta)
    total = float(0.0)
    for k in range(SAMPLES):
        x = (FIRST + float(k)) * w.spacing
        above = w.loose[k] - wp.max(0.0, x - foot) * wp.tan(beta)
        if above <= 0.0:
            break
        total += above * w.spacing * wp.where(k == 0, FIRST + 0.5, 1.0)
    return total


@wp.func
def passive_force(w: Wedge) -> float:
    """P of the fundamental equation per metre of width, at the failure angle that makes it least [N/m]."""
    least = float(1.0e30)
    steepest = wp.pi - w.rake - w.delta - w.phi - 0.02
    cot_rake = 1.0 / wp.tan(w.rake)
    for k in range(ANGLES):
        beta = FLATTEST + (steepest - FLATTEST) * float(k) / float(ANGLES - 1)
        cot_beta = 1.0 / wp.tan(beta)
        cot_slip = 1.0 / wp.tan(beta + w.phi)
        below = wp.cos(w.rake + w.delta) + wp.sin(w.rake + w.delta) * cot_slip
        if below > 1.0e-4 and cot_rake + cot_beta > 0.0:
            load = w.weight * (0.5 * w.depth * w.depth * (cot_rake + cot_beta) + surcharge(w, beta))
            load += w.cohesion * w.depth * (1.0 + cot_beta * cot_slip)
            load += w.adhesion * w.depth * (1.0 - cot_rake * cot_slip)
            least = wp.min(least, load / below)
    return wp.where(least < 1.0e30, wp.max(least, 0.0), 0.0)


@wp.func
def strip_ahead(
    world: int, b: BladePose, along: float, soil: SoilTables, assets: Assets, nodes: SoilNodes
) -> Wedge:  # fmt: skip
    """The surface ahead of a strip whose middle is `along` metres to the left of the blade's."""
    w = Wedge()
    w.spacing = soil.spacing
    edge = b.slope * along
    for k in range(SAMPLES):
        x = (FIRST + float(k)) * soil.spacing
        dx = b.ahead[0] * x + b.across[0] * along
        dy = b.ahead[1] * x + b.across[1] * along
        parts = surface_parts(world, b.x, dx, dy, soil, assets, nodes)
        if k == 0:
            w.depth = parts[0] - edge
        w.loose[k] = wp.max(0.0, parts[1] + wp.min(w.depth, 0.0))
    w.depth = wp.max(w.depth, 0.0)
    return w


@wp.kernel
def push_blades(
    # inputs
    worlds: WorldRange,
    dt: float,
    gravity: wp.array[wp.vec3],
    soil: SoilTables,
    shapes: SoilShapes,
    blades: SoilBlades,
    assets: Assets,
    state: StateArrays,
    nodes: SoilNodes,
    # outputs
    reports: SoilReports,
):
    """Force and block of each blade in the rows of its shape; dim (W, blades). Soil resists what moves into it, and
    never pulls: below `CREEP` its force grows with the speed.
    """
    index, blade = wp.tid()
    world = worlds.first + index
    b = blade_pose(world, blade, blades, shapes, state)
    if b.cuts == 0 or b.rake < 0.1 or b.rake > 3.0:
        return
    shape = blades.shape[blade]
    copy = world_row(world, soil.parameter.shape[0])
    kind = soil_at(world, b.x, soil)
    heavy = -gravity[world_row(world, gravity.shape[0])][2] * soil.parameter[copy, kind, DENSITY]
    width = blades.width[blade]
    part = width / float(STRIPS)
    total = ShapeSum()
    deep = float(0.0)
    for strip in range(STRIPS):
        along = (float(strip) + 0.5) * part - 0.5 * width
        w = strip_ahead(world, b, along, soil, assets, nodes)
        w.weight = heavy
        w.cohesion = soil.parameter[copy, kind, COHESION]
        w.phi = wp.atan(soil.parameter[copy, kind, TAN_PHI])
        w.rake = b.rake
        w.delta = blades.friction[blade]
        w.adhesion = blades.adhesion[blade]
        deep += w.depth / float(STRIPS)
        if w.depth + w.loose[0] > 0.0:
            size = passive_force(w)
            grip = w.adhesion * w.depth / wp.sin(b.rake)
            level = size * wp.sin(b.rake + w.delta) + grip * wp.cos(b.rake)
            upright = size * wp.cos(b.rake + w.delta) - grip * wp.sin(b.rake)
            against = part * wp.vec3(b.ahead[0] * level, b.ahead[1] * level, upright)  # of the blade on the soil
            most = wp.length(against)
            # a third up the firm wedge, on the face
            up = (w.depth + w.loose[0]) / 3.0 / wp.max(b.face[2], 0.1)
            arm = b.arm + wp.vec3(b.across[0] * along, b.across[1] * along, b.slope * along) + up * b.face
            if most > 0.0:
                direction = against / most
                speed = wp.dot(direction, b.v + wp.cross(b.omega, arm))
                if speed > 0.0:
                    force = -wp.min(speed / CREEP, 1.0) * against
                    total.force += force
                    total.moment += wp.cross(arm, force)
                    total = add_block(total, dt * most / wp.max(speed, CREEP), arm, direction)
                    total.touched += 1
    reports.touched[world, shape] = total.touched
    reports.sinkage[world, shape] = deep
    reports.pushed[world, shape] = total.force
    reports.turned[world, shape] = total.moment
    reports.mass[world, shape] = total.mass
    reports.coupling[world, shape] = total.coupling
    reports.inertia[world, shape] = total.inertia
