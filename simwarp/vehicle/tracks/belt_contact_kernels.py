"""A point of a belt on the ground: its normal force in series with the belt behind it, and its shear.

Bekker (1969), Introduction to Terrain-Vehicle Systems; Wong (2008), Theory of Ground Vehicles, chapters 2 and 6.
"""

import warp as wp

from simwarp.soil.bekker_janosi_kernels import Law
from simwarp.vehicle.tracks.belt_tables_kernels import BeltParameter

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

SOIL_STEPS = wp.constant(4)  # of Newton for a sinkage; it comes from one side and cannot pass
SIDE_STEPS = wp.constant(5)  # of the same with pads at the sides, kept between bounds


@wp.struct
class Pressed:
    """A point on the ground."""

    force: float  # along its normal [N]
    lift: float  # [m]
    sinkage: float  # deepest [m]
    area: float  # of soil that is pressed [m²]


@wp.func
def press_hard(depth: float, rate: float, line: float, backing: float, length: float, p: wp.array[float]) -> Pressed:
    """A pad on ground that does not give way, in series with the belt behind it.

    Args:
        depth: of the belt without its lift below the ground's surface [m].
        rate: of that [m/s].
        line: lift at which the belt pulls nowhere [m].
        backing: stiffness of the belt against more [N/m].
        length: of the belt that the point stands for [m].
        p: parameters.
    """
    ground = p[BeltParameter.GROUND_STIFFNESS] * length
    stiffness = ground * backing / (ground + backing)
    found = Pressed()
    elastic = stiffness * (depth - line)
    found.lift = line
    if elastic > 0.0:
        found.lift = line + elastic / backing
        found.force = wp.max(elastic + p[BeltParameter.GROUND_DAMPING] * stiffness * rate, 0.0)
    return found


@wp.func
def soil_pressure(z: float, deepest: float, limit: float, law: Law) -> wp.vec2:
    """Pressure of soil at a sinkage, and its slope: elastic above the deepest one so far, plastic below.

    Args:
        z: [m].
        deepest: sinkage so far [m].
        limit: pressure there [Pa].
        law: of the soil.
    """
    if z <= 0.0:
        return wp.vec2()
    elastic = limit + law.elastic * (z - deepest)
    if z > deepest:
        plastic = law.stiffness * wp.pow(z, law.exponent)
        if plastic < elastic:
            return wp.vec2(plastic, law.exponent * plastic / z)
    return wp.vec2(wp.max(elastic, 0.0), wp.where(elastic > 0.0, law.elastic, 0.0))


@wp.func
def press_sides(
    reach: float, backing: float, area: float, side_area: float, height: float, deepest: float, limit: float,
    sunk: float, law: Law,
) -> wp.vec3:  # fmt: skip
    """Sinkage, and pressures of pads in the middle and at the sides, where the latter touch as well.

    Args:
        reach: sinkage, if the belt did not yield [m].
        backing: as of `press_hard`.
        area, side_area: of pads [m²].
        height: of those at the sides above the others [m].
        deepest, limit: sinkage so far [m], and pressure there [Pa].
        sunk: sinkage of the pads in the middle alone, which is too much [m].
        law: of the soil.
    """
    low = float(height)
    high = float(sunk)
    z = float(sunk)
    sides = wp.max(deepest - height, 0.0)
    most = law.stiffness * wp.pow(sides, law.exponent)
    for _ in range(SIDE_STEPS):
        middle = soil_pressure(z, deepest, limit, law)
        beside = soil_pressure(z - height, sides, most, law)
        excess = area * middle[0] + side_area * beside[0] - backing * (reach - z)
        low = wp.where(excess < 0.0, z, low)
        high = wp.where(excess < 0.0, high, z)
        z -= excess / (area * middle[1] + side_area * beside[1] + backing)
        z = wp.where(z < low or z > high, 0.5 * (low + high), z)
    middle = soil_pressure(z, deepest, limit, law)
    return wp.vec3(z, middle[0], soil_pressure(z - height, sides, most, law)[0])


@wp.func
def press_soil(
    depth: float, rate: float, line: float, backing: float, length: float, deepest: float, law: Law,
    p: wp.array[float],
) -> Pressed:  # fmt: skip
    """Bekker's soil in series with the belt: elastic above the deepest sinkage so far, plastic below.

    Args:
        depth, rate, line, backing, length: as of `press_hard`.
        deepest: sinkage so far [m].
        law: of the soil.
        p: parameters.
    """
    area = p[BeltParameter.WIDTH] * length
    found = Pressed()
    found.lift = line
    found.sinkage = deepest
    found.area = area
    reach = depth - line  # sinkage, if the belt did not yield
    limit = law.stiffness * wp.pow(wp.max(deepest, 0.0), law.exponent)
    left = deepest - limit / law.elastic
    if reach <= wp.max(left, 0.0):
        return found
    elastic = area * law.elastic
    z = (backing * reach + elastic * left) / (backing + elastic)
    pressure = law.elastic * (z - left)
    if z > deepest:
        stiff = area * law.stiffness
        # The equation is convex for n >= 1 and concave below: this side has no turning back
        z = wp.where(law.exponent >= 1.0, reach, wp.max(deepest, 1.0e-5))
        for _ in range(SOIL_STEPS):
            z = wp.max(z, 1.0e-5)
            yielding = stiff * wp.pow(z, law.exponent)
            z -= (yielding - backing * (reach - z)) / (law.exponent * yielding / z + backing)
        z = wp.clamp(z, deepest, reach)
        pressure = wp.min(law.stiffness * wp.pow(z, law.exponent), limit + law.elastic * (z - deepest))
    force = area * pressure
    height = p[BeltParameter.SIDE_HEIGHT]
    if p[BeltParameter.SIDE_WIDTH] > 0.0 and z > height:
        side_area = p[BeltParameter.SIDE_WIDTH] * length
        both = press_sides(reach, backing, area, side_area, height, deepest, limit, z, law)
        z = both[0]
        force = area * both[1] + side_area * both[2]
        if both[2] > 0.0:
            found.area += side_area
    found.sinkage = wp.max(z, deepest)
    found.lift = line + force / backing
    share = backing / (backing + found.area * law.elastic)
    found.force = wp.max(force + found.area * law.damping * share * rate, 0.0)
    return found


@wp.func
def traction_of(shear: wp.vec2, slip: wp.vec2, load: float, friction: float, p: wp.array[float]) -> wp.vec2:
    """Coulomb's friction with an elastic beginning, against the way that was slid; damped below the limit."""
    limit = friction * load
    force = -(limit / p[BeltParameter.SHEAR_LENGTH]) * (shear + p[BeltParameter.SHEAR_DAMPING] * slip)
    size = wp.length(force)
    if size > limit:
        force *= limit / size
    return force


@wp.func
def soil_traction_of(shear: wp.vec2, slip: wp.vec2, load: float, area: float, law: Law, time: float) -> wp.vec2:
    """Janosi's and Hanamoto's shear of a soil that Mohr and Coulomb limit; damped by `time` below the limit."""
    limit = law.cohesion * area + load * law.tan_phi
    way = wp.length(shear)
    rest = wp.exp(-way / law.shear_length)
    force = -(limit / law.shear_length * rest * time) * slip
    if way > 0.0:
        force -= limit * (1.0 - rest) / way * shear
    size = wp.length(force)
    if size > limit:
        force *= limit / size
    return force
