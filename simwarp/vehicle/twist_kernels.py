"""A driver who holds a forward speed and a yaw rate: throttle, brakes and gear by the one, steering by the other."""

import warp as wp

from simwarp.kernels.core.world_range import WorldRange

wp.set_module_options({"enable_backward": False})


@wp.struct
class TwistLaw:
    """Gains of the two controllers, shared by all worlds: inputs per command, per error and per its integral."""

    speed: wp.vec3  # pedal [s/m, s/m, 1/m]
    yaw_rate: wp.vec3  # steering [s/rad, s/rad, 1/rad]
    brake_share: float  # braking per pedal below zero
    standstill: float  # a speed below which gears are changed and brakes hold [m/s]


@wp.func
def pi_output(gains: wp.vec3, command: float, error: float, total: float) -> float:
    """Feedforward and PI."""
    return gains[0] * command + gains[1] * error + gains[2] * total


@wp.func
def next_total(total: float, error: float, output: float, dt: float) -> float:
    """The integral, which rests where the input is at its end and the error drives it further."""
    if wp.abs(output) >= 1.0 and output * error > 0.0:
        return total
    return total + dt * error


@wp.func
def gear_for(gear: int, command: float, speed: float, standstill: float) -> int:
    """Reverse for commands backwards and a forward gear for those ahead, once the vehicle is slow enough."""
    if command < 0.0 and gear >= 0 and speed < standstill:
        return -1
    if command > 0.0 and gear <= 0 and speed > -standstill:
        return 1
    return gear


@wp.kernel
def drive_twist(
    # inputs
    worlds: WorldRange,
    dt: float,
    law: TwistLaw,
    command: wp.array2d[float],  # (W, 2) forward speed [m/s], yaw rate [rad/s]
    velocity_b: wp.array[wp.vec3],  # (W,) [m/s]
    omega_b: wp.array[wp.vec3],  # (W,) [rad/s]
    # in and out
    gear: wp.array[int],  # (W,), or empty: the vehicle only goes ahead
    error_sum: wp.array[wp.vec2],  # (W,) integrals of the errors [m], [rad]
    # outputs
    vehicle_input: wp.array3d[float],  # (W, 1, 4)
):
    """Inputs of all worlds; the clutch is left alone."""
    world = worlds.first + wp.tid()
    speed = velocity_b[world][0]
    yaw_rate = omega_b[world][2]
    wanted = command[world, 0]
    turn = command[world, 1]
    total = error_sum[world]
    direction = float(1.0)
    if gear.shape[0] > 0:
        chosen = gear_for(gear[world], wanted, speed, law.standstill)
        if chosen != gear[world]:
            gear[world] = chosen
            total[0] = 0.0
        if chosen < 0:
            direction = -1.0
    # against the gear it first comes to rest
    along = wp.max(direction * wanted, 0.0)
    error = along - direction * speed
    pedal = pi_output(law.speed, along, error, total[0])
    total[0] = next_total(total[0], error, pedal, dt)
    steering_error = turn - yaw_rate
    steering = pi_output(law.yaw_rate, turn, steering_error, total[1])
    total[1] = next_total(total[1], steering_error, steering, dt)
    throttle = wp.clamp(pedal, 0.0, 1.0)
    braking = wp.clamp(-law.brake_share * pedal, 0.0, 1.0)
    if along == 0.0:
        total[0] = 0.0
        throttle = 0.0
        if turn == 0.0 and wp.abs(speed) < law.standstill:
            braking = 1.0
    if turn == 0.0 and along == 0.0:
        total[1] = 0.0
        steering = 0.0
    error_sum[world] = total
    vehicle_input[world, 0, 0] = wp.clamp(steering, -1.0, 1.0)
    vehicle_input[world, 0, 1] = throttle
    vehicle_input[world, 0, 2] = braking
