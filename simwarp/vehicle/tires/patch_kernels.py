"""Contact of a wheel, taken as a disc, with the ground.

The contact frame has x forward, y to the left and z along the ground's normal. The wheel's centre is float64;
everything else is relative to it and float32.

- Single point: a plane through the ground below the disc's lowest point, with the ground's normal turned into the plane
  of the disc, stands for the ground; the deflection is what the disc lacks of its radius to that plane. The flank of a
  kerb looks like an endless slope: for edges and gaps shorter than the patch take the envelope.
- Four point: the plane is that of four points of the ground, 0.1 radius before and behind and 0.3 width beside.
- Envelope (Sui & Hirshey 1999): the area that disc and ground share, over 100 columns, is turned into the deflection of
  a disc on a plane that shares as much: area = r²/2 (a - sin a), deflection = r (1 - cos(a/2)).
- Shapes: normal and deflection are found before (tire_obstacles_kernels.py).
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.vector_math import to_double
from simwarp.vehicle.tires.ground_kernels import GroundPoint, TerrainTables, ground_below
from simwarp.vehicle.tires.parameter_vector_kernels import Common, TireContact

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FLATTEST = wp.constant(1.0e-3)  # square of the sine between axis and vertical below which the wheel lies on its side
COLUMNS = wp.constant(100)
SLOWEST = wp.constant(0.1)  # [m/s]: slips at lower speeds are taken as at this one


@wp.struct
class Wheel:
    """A wheel as it moves; world axes."""

    x: wp.vec3d  # centre [m]
    axis: wp.vec3  # unit, to the left when it rolls forward
    v: wp.vec3  # of the centre [m/s]
    omega_w: wp.vec3  # of the body [rad/s]
    spin: float  # about the axis, positive when it rolls forward [rad/s]


@wp.struct
class Patch:
    """The contact of a wheel."""

    touching: int
    deflection: float  # [m]
    arm: wp.vec3  # from the wheel's centre to the point of contact, world axes [m]
    forward: wp.vec3  # axes of the frame of contact, world
    left: wp.vec3
    normal: wp.vec3
    camber: float  # positive: the upper side leans to the right [rad]
    v: wp.vec3  # of the wheel's centre, frame of contact [m/s]
    spin: float  # [rad/s]
    friction: float  # of the road, as the tire may use it
    load: float  # normal force [N]
    effective_radius: float  # [m]
    slide: wp.vec2  # velocity of sliding [m/s]


@wp.struct
class Envelopes:
    """What wheels meet, where the ground and shapes around them are looked at; (W, wheels), empty where none is."""

    normal: wp.array2d[wp.vec3]  # unit, world axes
    deflection: wp.array2d[float]  # 0: nothing is met [m]


@wp.struct
class TireForce:
    """Force and torque of a tire on its wheel; contact frame, about the point of contact."""

    force: wp.vec3  # [N]
    torque: wp.vec3  # [N·m]


@wp.func
def make_patch(wheel: Wheel, point: GroundPoint, deflection: float) -> Patch:
    """The patch at a point of the ground."""
    patch = Patch()
    forward = wp.cross(wheel.axis, point.normal)
    if deflection > 0.0 and wp.length_sq(forward) > FLATTEST:
        patch.touching = 1
        patch.deflection = deflection
        patch.arm = point.arm
        patch.normal = point.normal
        patch.forward = wp.normalize(forward)
        patch.left = wp.cross(patch.normal, patch.forward)
        patch.camber = wp.atan2(wp.dot(wheel.axis, patch.normal), wp.dot(wheel.axis, patch.left))
        patch.v = wp.vec3(wp.dot(wheel.v, patch.forward), wp.dot(wheel.v, patch.left), wp.dot(wheel.v, patch.normal))
        patch.spin = wheel.spin
    return patch


@wp.func
def lowest(wheel: Wheel, radius: float) -> wp.vec3:
    """From the centre to the disc's lowest point."""
    across = wp.normalize(wp.cross(wheel.axis, wp.vec3(0.0, 0.0, 1.0)))
    return radius * wp.cross(wheel.axis, across)


@wp.func
def project_to_wheel_plane(wheel: Wheel, normal: wp.vec3) -> wp.vec3:
    """A normal turned into the plane of the disc."""
    return wp.normalize(normal - wp.dot(normal, wheel.axis) * wheel.axis)


@wp.func
def single_point(world: int, wheel: Wheel, radius: float, terrain: TerrainTables, assets: Assets) -> Patch:
    """One point under the wheel."""
    none = Patch()
    lift = 2.0 * radius
    point = ground_below(world, wheel.x, lowest(wheel, radius), lift, terrain, assets)
    if point.found == 0 or point.arm[2] >= 0.0:
        return none
    n = project_to_wheel_plane(wheel, point.normal)
    distance = -wp.dot(point.arm, n)
    deflection = radius - distance
    if deflection <= 0.0:
        return none
    point = ground_below(world, wheel.x, -distance * n, lift, terrain, assets)
    if point.found == 0:
        return none
    return make_patch(wheel, point, deflection)


@wp.func
def four_point(
    world: int, wheel: Wheel, radius: float, width: float, terrain: TerrainTables, assets: Assets
) -> Patch:  # fmt: skip
    """The plane of four points around the one under the wheel."""
    none = Patch()
    lift = 2.0 * radius
    point = ground_below(world, wheel.x, lowest(wheel, radius), lift, terrain, assets)
    if point.found == 0 or point.arm[2] >= 0.0:
        return none
    n = project_to_wheel_plane(wheel, point.normal)
    below = wp.dot(point.arm, n) * n
    forward = wp.normalize(wp.cross(wheel.axis, n))
    left = wp.cross(n, forward)
    before = ground_below(world, wheel.x, below + 0.1 * radius * forward, lift, terrain, assets)
    behind = ground_below(world, wheel.x, below - 0.1 * radius * forward, lift, terrain, assets)
    beside = ground_below(world, wheel.x, below + 0.3 * width * left, lift, terrain, assets)
    beyond = ground_below(world, wheel.x, below - 0.3 * width * left, lift, terrain, assets)
    if before.found + behind.found + beside.found + beyond.found < 4:
        return none
    point.arm = 0.25 * (before.arm + behind.arm + beside.arm + beyond.arm)
    point.normal = wp.normalize(wp.cross(before.arm - behind.arm, beside.arm - beyond.arm))
    return make_patch(wheel, point, radius + wp.dot(point.arm, n))


@wp.func
def segment_deflection(area: float, radius: float) -> float:
    """Deflection of a disc whose cut-off segment has an area: Newton on a - sin a = 2 area / r², which is convex, from
    above.
    """
    share = wp.min(2.0 * area / (radius * radius), 3.14159265)
    angle = wp.min(wp.pow(6.0 * share, 1.0 / 3.0) * 1.1, 3.14159265)
    for _ in range(8):
        slope = 1.0 - wp.cos(angle)
        if slope > 1.0e-6:
            angle -= (angle - wp.sin(angle) - share) / slope
    return radius * (1.0 - wp.cos(0.5 * angle))


@wp.func
def envelope(world: int, wheel: Wheel, radius: float, terrain: TerrainTables, assets: Assets) -> Patch:
    """The deflection that shares as much area with a plane as the disc with the ground."""
    none = Patch()
    low = lowest(wheel, radius)
    point = ground_below(world, wheel.x, low, radius, terrain, assets)
    if point.found == 0 or point.arm[2] >= 0.0:
        return none
    n = project_to_wheel_plane(wheel, point.normal)
    across = wp.normalize(wp.cross(wheel.axis, wp.vec3(0.0, 0.0, 1.0)))
    step = 2.0 * radius / float(COLUMNS)
    area = float(0.0)
    for column in range(1, COLUMNS):
        along = float(column) * step - radius
        chord = low * wp.sqrt(wp.max(1.0 - along * along / (radius * radius), 0.0))
        ground = ground_below(world, wheel.x, chord + along * across, radius, terrain, assets)
        if ground.found == 1:
            area += step * wp.max(ground.arm[2] - chord[2], 0.0)
    if area <= 0.0:
        return none
    deflection = segment_deflection(area, radius)
    point = ground_below(world, wheel.x, -(radius - deflection) * n, radius, terrain, assets)
    if point.found == 0:
        return none
    point.arm = -(radius - deflection) * n
    return make_patch(wheel, point, deflection)


@wp.func
def enveloped(world: int, index: int, wheel: Wheel, radius: float, envelopes: Envelopes) -> Patch:
    """Contact with what was found around wheel number `index`."""
    point = GroundPoint()
    point.normal = envelopes.normal[world, index]
    deflection = envelopes.deflection[world, index]
    if deflection <= 0.0:
        return Patch()
    point.arm = -(radius - deflection) * project_to_wheel_plane(wheel, point.normal)
    return make_patch(wheel, point, deflection)


@wp.func
def find_patch(
    world: int, index: int, wheel: Wheel, method: int, p: wp.array[float], terrain: TerrainTables,
    envelopes: Envelopes, assets: Assets,
) -> Patch:  # fmt: skip
    """Contact of a wheel with the ground; neither load nor friction yet."""
    radius = p[Common.RADIUS]
    patch = Patch()
    upright = wp.cross(wheel.axis, wp.vec3(0.0, 0.0, 1.0))
    if wp.length_sq(upright) < FLATTEST:
        return patch
    if method == TireContact.FOUR_POINT:
        patch = four_point(world, wheel, radius, p[Common.WIDTH], terrain, assets)
    elif method == TireContact.ENVELOPE:
        patch = envelope(world, wheel, radius, terrain, assets)
    elif method == TireContact.SHAPES:
        patch = enveloped(world, index, wheel, radius, envelopes)
    else:
        patch = single_point(world, wheel, radius, terrain, assets)
    patch.effective_radius = radius - p[Common.RADIUS_SHARE] * patch.deflection
    patch.slide = wp.vec2(patch.v[0] - patch.spin * patch.effective_radius, patch.v[1])
    return patch


@wp.func
def slip_ratio(patch: Patch) -> float:
    """Longitudinal slip -(v_x - omega r) / |v_x|: positive when driving."""
    return -patch.slide[0] / wp.max(wp.abs(patch.v[0]), SLOWEST)


@wp.func
def slip_angle(patch: Patch) -> float:
    """atan(v_y / |v_x|) [rad]: positive when the wheel drifts to the left."""
    return wp.atan(patch.v[1] / wp.max(wp.abs(patch.v[0]), SLOWEST))


@wp.func
def contact_point(wheel: Wheel, patch: Patch) -> wp.vec3d:
    """The point of contact [m]."""
    return wheel.x + to_double(patch.arm)
