"""Drivers that follow a path: steering by PID on a point ahead, by Stanley's law or by yaw rate, and a PID that holds a
speed.
"""

from enum import IntEnum

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.vehicle.drivers_kernels import forward_speed
from simwarp.vehicle.paths_kernels import PathPoint, PathTables, nearest_on_path

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


class SteeringLaw(IntEnum):
    """Steering law of a path tracker."""

    LOOK_AHEAD = 0
    STANLEY = 1
    UNICYCLE = 2


STANLEY = wp.constant(int(SteeringLaw.STANLEY))
UNICYCLE = wp.constant(int(SteeringLaw.UNICYCLE))
TURN = wp.constant(6.2831853)
LEAST_SHRINKAGE = wp.constant(0.1)  # of 1 - curvature x distance: beyond is the centre of the path's curve


@wp.struct
class Gains:
    """Of a PID controller."""

    proportional: float
    integral: float
    derivative: float


@wp.struct
class PathTrackerTables:
    """Constant data of a driver."""

    law: int  # SteeringLaw
    chassis: int
    reference: wp.vec3  # the vehicle's frame from the chassis' centre of mass, body axes [m]
    ahead: float  # of the point that is steered, along the vehicle's x axis from its frame [m]
    steering: Gains  # per m; Stanley's: [1/s], [1/(m s)]; a unicycle's: [s/rad], [1/rad]
    dead_zone: float  # of the distance from the path, Stanley's [m]
    soft_speed: float  # added to the speed, Stanley's and a unicycle's [m/s]
    full_angle: float  # of the road wheels at full input, Stanley's [rad]
    approach: float  # length over which a unicycle comes back to its path [m]
    full_yaw_rate: float  # at full input, a unicycle's [rad/s]
    speed: Gains  # per m/s
    throttle_threshold: float
    start: float  # before this time the vehicle stands on its brakes [s]
    ramp: float  # the speed rises from zero for this long [s]


@wp.struct
class PathTrackerState:
    """State and outputs of a path tracker, per world."""

    segment: wp.array[int]  # of the path; -1: not looked for yet
    started: wp.array[int]  # 1: the controllers have errors of one step ago
    steering_error: wp.array[float]  # one step ago [m]; a unicycle's [rad/s]
    steering_sum: wp.array[float]  # [m s]; a unicycle's [rad]
    speed_error: wp.array[float]  # one step ago [m/s]
    speed_sum: wp.array[float]  # [m]
    throttle: wp.array[float]
    distance: wp.array[float]  # of the steered point from the path [m], positive to the left
    arc: wp.array[float]  # along the path [m]


@wp.func
def pid(gains: Gains, error: float, last: float, total: float, dt: float) -> float:
    """Output of a PID: `total` holds the integral already."""
    return gains.proportional * error + gains.integral * total + gains.derivative * (error - last) / dt


@wp.func
def stanley_angle(tracker: PathTrackerTables, distance: float, total: float, heading: float, speed: float) -> float:
    """Angle of the road wheels [rad]: the path's direction, and an approach that is flatter the faster it goes.

    Args:
        tracker: gains.
        distance: of the front axle from the path [m], positive to the left.
        total: integral of -distance behind the dead zone [m s].
        heading: of the path seen from the vehicle [rad].
        speed: forwards [m/s].
    """
    beyond = wp.max(wp.abs(distance) - tracker.dead_zone, 0.0)
    if distance > 0.0:
        beyond = -beyond
    pull = tracker.steering.proportional * beyond + tracker.steering.integral * total
    return heading + wp.atan2(pull, tracker.soft_speed + wp.max(speed, 0.0))


@wp.func
def unicycle_yaw_rate(tracker: PathTrackerTables, point: PathPoint, turn: float, heading: float, speed: float) -> float:
    """Yaw rate that follows a path [rad/s]: that of the curve, and of the turn to the direction of approach.

    Args:
        tracker: length of the approach and soft speed.
        point: of the path.
        turn: from the vehicle's heading to the direction of approach [rad].
        heading: of the path seen from the vehicle [rad].
        speed: forwards [m/s].
    """
    along = wp.max(speed, 0.0)
    shrinkage = wp.max(1.0 - point.curvature * point.distance, LEAST_SHRINKAGE)
    curve = along * point.curvature * wp.cos(heading) / shrinkage
    # critically damped: a quarter of the length for the turn, the length for the distance
    back = (along + tracker.soft_speed) * (4.0 / tracker.approach) * 2.0 * wp.sin(0.5 * turn)
    return curve + back


@wp.func
def pedals(
    world: int, dt: float, tracker: PathTrackerTables, target: float, speed: float, memory: PathTrackerState
) -> wp.vec2:
    """Throttle and braking that hold a speed. Too fast with the throttle open closes that first, then brakes."""
    error = target - speed
    last = memory.speed_error[world]
    if memory.started[world] == 0:
        last = error
    total = memory.speed_sum[world] + 0.5 * dt * (error + last)
    output = pid(tracker.speed, error, last, total, dt)
    memory.speed_error[world] = error
    # the integral rests while the pedals are at their ends
    if wp.abs(output) < 1.0:
        memory.speed_sum[world] = total
    output = wp.clamp(output, -1.0, 1.0)
    throttle = float(0.0)
    braking = float(0.0)
    if output > 0.0:
        throttle = output
    elif memory.throttle[world] > tracker.throttle_threshold:
        throttle = 1.0 + output
    else:
        braking = -output
    memory.throttle[world] = throttle
    return wp.vec2(throttle, braking)


@wp.kernel
def follow_path(
    # inputs
    worlds: WorldRange,
    dt: float,
    trackers: wp.array[PathTrackerTables],  # (1 or W,)
    paths: PathTables,
    path: wp.array[int],  # (1 or W,)
    target_speed: wp.array[float],  # (1 or W,) [m/s]
    state: StateArrays,
    # outputs
    memory: PathTrackerState,
    vehicle_input: wp.array2d[float],
):
    """Steering, throttle and braking of all worlds; the clutch is left alone."""
    world = worlds.first + wp.tid()
    tracker = trackers[world_row(world, trackers.shape[0])]
    q = state.body_rot[world, tracker.chassis]
    ahead = tracker.reference + wp.vec3(tracker.ahead, 0.0, 0.0)
    offset = wp.quat_rotate(q, wp.vec3d(wp.float64(ahead[0]), wp.float64(ahead[1]), wp.float64(ahead[2])))
    x = state.body_x[world, tracker.chassis] + offset
    point = nearest_on_path(path[world_row(world, path.shape[0])], memory.segment[world], wp.vec2d(x[0], x[1]), paths)
    memory.segment[world] = point.segment
    memory.distance[world] = point.distance
    memory.arc[world] = point.arc
    time = float(state.world_time[world] - wp.float64(tracker.start))
    if time < 0.0:
        vehicle_input[world, 0] = 0.0
        vehicle_input[world, 1] = 0.0
        vehicle_input[world, 2] = 1.0
        return
    speed = forward_speed(world, tracker.chassis, tracker.reference, state)
    axis = wp.quat_rotate(q, wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0)))
    forward = wp.vec2(float(axis[0]), float(axis[1]))
    heading = wp.atan2(forward[0] * point.tangent[1] - forward[1] * point.tangent[0], wp.dot(forward, point.tangent))
    target = target_speed[world_row(world, target_speed.shape[0])]
    if time < tracker.ramp:
        target *= time / tracker.ramp
    error = -point.distance
    yaw_rate = float(0.0)
    if tracker.law == UNICYCLE:
        turn = heading - wp.atan(point.distance / tracker.approach)
        turn -= TURN * wp.round(turn / TURN)
        yaw_rate = unicycle_yaw_rate(tracker, point, turn, heading, speed)
        up = wp.quat_rotate(q, wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0)))
        error = yaw_rate - wp.dot(state.body_omega[world, tracker.chassis], to_float(up))
        target *= wp.max(wp.cos(turn), 0.0)  # it turns on the spot where the path leads back
    last = memory.steering_error[world]
    if memory.started[world] == 0:
        last = error
    total = memory.steering_sum[world] + 0.5 * dt * (error + last)
    memory.steering_error[world] = error
    output = float(0.0)
    if tracker.law == STANLEY:
        output = stanley_angle(tracker, point.distance, total, heading, speed) / tracker.full_angle
    else:
        output = pid(tracker.steering, error, last, total, dt)
    if tracker.law == UNICYCLE:
        output += yaw_rate / tracker.full_yaw_rate
    if wp.abs(output) < 1.0:
        memory.steering_sum[world] = total
    vehicle_input[world, 0] = wp.clamp(output, -1.0, 1.0)
    feet = pedals(world, dt, tracker, target, speed, memory)
    memory.started[world] = 1
    vehicle_input[world, 1] = feet[0]
    vehicle_input[world, 2] = feet[1]


@wp.kernel
def approach_target(
    # inputs
    worlds: WorldRange,
    dt: float,
    gain: wp.vec4,  # [1/s]; a negative one is no lag at all
    rate: wp.vec4,  # most change per second; a negative one is no limit
    target: wp.array2d[float],  # (W, 4) steering -1..1, throttle, braking, clutch 0..1
    # outputs
    vehicle_input: wp.array2d[float],
):
    """Moves a vehicle's inputs towards what a person or a policy asks for: a lag of first order within a rate."""
    world = worlds.first + wp.tid()
    for channel in range(4):
        low = wp.where(channel == 0, -1.0, 0.0)
        change = wp.clamp(target[world, channel], low, 1.0) - vehicle_input[world, channel]
        if gain[channel] >= 0.0:
            change *= 1.0 - wp.exp(-gain[channel] * dt)
        if rate[channel] >= 0.0:
            change = wp.clamp(change, -rate[channel] * dt, rate[channel] * dt)
        vehicle_input[world, channel] = vehicle_input[world, channel] + change


@wp.kernel
def restart_trackers(
    # inputs
    mask: wp.array[wp.bool],
    # outputs
    memory: PathTrackerState,
):
    """Forgets the place on the path and what the controllers add up, in the worlds of a mask."""
    world = wp.tid()
    if not mask[world]:
        return
    memory.segment[world] = -1
    memory.started[world] = 0
    memory.steering_sum[world] = 0.0
    memory.speed_sum[world] = 0.0
    memory.throttle[world] = 0.0
