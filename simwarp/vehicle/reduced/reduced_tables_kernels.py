"""Tables and state of vehicles on tabulated suspensions, and how a wheel stands by its tables."""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

WHEELS = wp.constant(4)


class row8(wp.types.vector(length=8, dtype=wp.float32)):  # type: ignore[misc]
    """A place of a wheel's table: x, y, axis x, axis z, windup, spring load, bar's twist, nothing."""


@wp.struct
class ReducedTables:
    """What all worlds share. Wheels: front left, front right, rear left, rear right; vehicle frames have the chassis'
    axes and their origin in its centre of mass.
    """

    first: wp.vec4i  # row of each wheel's first place in `place`
    rows: wp.vec4i
    columns: wp.vec4i
    rates: wp.vec4i  # columns of `damper`
    travel_first: wp.vec4  # [m]
    travel_scale: wp.vec4  # rows per metre
    rate_first: wp.vec4  # [m/s]
    rate_scale: wp.vec4  # columns per m/s
    height: wp.vec4  # of the centres at no travel [m]
    free: wp.vec4  # 0: the wheel does not travel
    place: wp.array[row8]
    damper: wp.array[float]  # rows of all wheels, rates within them [N]
    damper_first: wp.vec4i
    mass: wp.vec4  # of the travel [kg]
    momentum: wp.array[wp.vec3]  # per rate of the travel [kg]
    moment: wp.array[wp.vec3]  # about the chassis' centre of mass [kg·m]
    bar_stiffness: wp.vec2  # front, rear [N·m/rad]
    bar_damping: wp.vec2
    spin_inertia: wp.vec4  # of the wheels alone [kg·m²]
    spin_compliance: wp.mat44  # inverse inertia of all that turns with the wheels [1/(kg·m²)]
    drive: wp.vec4  # speed of the drive shaft per wheel's speed seen from the chassis
    brake_torque: wp.vec4  # at full braking [N·m]
    motor_inertia: float  # 0: the engine turns with the drive shaft [kg·m²]
    input_inertia: float
    gear_damping: float  # of the slip behind the gears [N·m·s/rad]
    locks: int  # clutches of differentials
    lock_row: wp.mat44  # rows: clutches; slip per wheel's speed
    lock_answer: wp.mat44  # the wheels' speeds per impulse of each [1/(kg·m²)]
    lock_inertia: wp.vec4  # against the slip of each [kg·m²]
    lock_held: wp.vec4  # torque of the open clutch [N·m]
    lock_torque: wp.vec4  # torque added when it closes [N·m]


@wp.struct
class ReducedState:
    """State and readings of reduced vehicles; (W, V · wheels) and (W, V)."""

    travel: wp.array2d[float]  # [m]
    travel_rate: wp.array2d[float]  # [m/s]
    spin: wp.array2d[float]  # of the wheel about its axis, of all rotation [rad/s]
    turn: wp.array2d[wp.float64]  # angle of the wheel seen from the chassis [rad]
    turn_rate: wp.array2d[float]  # its rate [rad/s]
    axis: wp.array2d[wp.vec3]  # of the wheel to the left, chassis' axes
    motor_speed: wp.array2d[float]  # [rad/s]
    input_speed: wp.array2d[float]
    scale: wp.array3d[float]  # (1 or W, V · wheels, 2): factors of springs and of dampers


@wp.struct
class Corner:
    """A wheel by its tables; axes of the chassis."""

    r: wp.vec3  # centre, from the chassis' centre of mass [m]
    slope: wp.vec3  # way of the centre per travel
    axis: wp.vec3  # unit, to the left
    lean: wp.vec3  # turn across the axis per travel [rad/m]
    windup: float  # turn of the brake about the axis per travel [rad/m]
    spring_load: float  # [N]
    bar_twist: float  # [rad]
    bar_slope: float  # [rad/m]


@wp.func
def segment(value: float, first: float, scale: float, count: int) -> wp.vec2:
    """Number of the segment of equally spaced places, and the share of it; end segments go on."""
    along = (value - first) * scale
    number = wp.clamp(wp.floor(along), 0.0, float(count - 2))
    return wp.vec2(number, along - number)


@wp.func
def corner(wheel: int, travel: float, steering: float, t: ReducedTables) -> Corner:
    """Bilinear in travel and steering."""
    columns = t.columns[wheel]
    row = segment(travel, t.travel_first[wheel], t.travel_scale[wheel], t.rows[wheel])
    at = t.first[wheel] + int(row[0]) * columns
    low = t.place[at]
    high = t.place[at + columns]
    if columns > 1:
        column = segment(steering, -1.0, 0.5 * float(columns - 1), columns)
        at += int(column[0])
        low = (1.0 - column[1]) * t.place[at] + column[1] * t.place[at + 1]
        high = (1.0 - column[1]) * t.place[at + columns] + column[1] * t.place[at + columns + 1]
    rise = high - low
    here = low + row[1] * rise
    rise *= t.travel_scale[wheel]
    result = Corner()
    result.r = wp.vec3(here[0], here[1], t.height[wheel] + travel)
    result.slope = t.free[wheel] * wp.vec3(rise[0], rise[1], 1.0)
    across = wp.sqrt(1.0 - here[2] * here[2] - here[3] * here[3])
    result.axis = wp.vec3(here[2], across, here[3])
    turned = wp.vec3(rise[2], -(here[2] * rise[2] + here[3] * rise[3]) / across, rise[3])
    result.lean = t.free[wheel] * wp.cross(result.axis, turned)
    result.windup = t.free[wheel] * here[4]
    result.spring_load = here[5]
    result.bar_twist = here[6]
    result.bar_slope = rise[6]
    return result


@wp.func
def damper_load(wheel: int, travel: float, rate: float, t: ReducedTables) -> wp.vec2:
    """Load [N], and its slope over the rate [N·s/m]."""
    row = segment(travel, t.travel_first[wheel], t.travel_scale[wheel], t.rows[wheel])
    rates = t.rates[wheel]
    column = segment(rate, t.rate_first[wheel], t.rate_scale[wheel], rates)
    at = t.damper_first[wheel] + int(row[0]) * rates + int(column[0])
    # what the ends of the travel say holds beyond them
    share = wp.clamp(row[1], 0.0, 1.0)
    low = (1.0 - share) * t.damper[at] + share * t.damper[at + rates]
    high = (1.0 - share) * t.damper[at + 1] + share * t.damper[at + rates + 1]
    return wp.vec2(low + column[1] * (high - low), (high - low) * t.rate_scale[wheel])
