"""Drivers: scripted inputs over time, with a speed controller, for all worlds at once."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.piecewise_linear import bounded_value
from simwarp.kernels.core.world_range import WorldRange

wp.set_module_options({"enable_backward": False})

STEERING = wp.constant(0)
THROTTLE = wp.constant(1)
BRAKING = wp.constant(2)
SPEED = wp.constant(3)


@wp.struct
class Script:
    """Four piecewise linear functions of time, constant beyond their ends, shared by all worlds: steering, throttle,
    braking, and the speed to hold [m/s]; a negative speed leaves the pedals to their own functions.
    """

    start: wp.array[int]  # CSR over the four
    time: wp.array[float]  # s
    value: wp.array[float]
    proportional: float  # pedal per m/s
    integral: float  # pedal per m
    brake_share: float  # braking per pedal below zero


@wp.func
def forward_speed(world: int, chassis: int, reference: wp.vec3, state: StateArrays) -> float:
    """Speed of a point of the chassis along its x axis [m/s]."""
    q = state.body_rot[world, chassis]
    rotation = wp.quat(float(q[0]), float(q[1]), float(q[2]), float(q[3]))
    omega = state.body_omega[world, chassis]
    v = state.body_v[world, chassis] + wp.cross(omega, wp.quat_rotate(rotation, reference))
    return wp.dot(v, wp.quat_rotate(rotation, wp.vec3(1.0, 0.0, 0.0)))


@wp.kernel
def run_script(
    # inputs
    worlds: WorldRange,
    dt: float,
    script: Script,
    chassis: wp.array[int],  # (V,) of the vehicles that follow it
    reference: wp.vec3,
    state: StateArrays,
    # outputs
    error_sum: wp.array2d[float],  # (W, V) integral of the speed error [m]
    vehicle_input: wp.array3d[float],  # (W, V, 4)
):
    """A script's inputs at this time; dim (W, V). The speed controller is a PI whose integral rests while a pedal is at
    its end.
    """
    index, number = wp.tid()
    world = worlds.first + index
    time = float(state.world_time[world])
    vehicle_input[world, number, 0] = bounded_value(STEERING, time, script.start, script.time, script.value)
    target = bounded_value(SPEED, time, script.start, script.time, script.value)
    if target < 0.0:
        vehicle_input[world, number, 1] = bounded_value(THROTTLE, time, script.start, script.time, script.value)
        vehicle_input[world, number, 2] = bounded_value(BRAKING, time, script.start, script.time, script.value)
        return
    error = target - forward_speed(world, chassis[number], reference, state)
    pedal = script.proportional * error + script.integral * error_sum[world, number]
    if wp.abs(pedal) < 1.0:
        error_sum[world, number] = error_sum[world, number] + dt * error
    vehicle_input[world, number, 1] = wp.clamp(pedal, 0.0, 1.0)
    vehicle_input[world, number, 2] = wp.clamp(-script.brake_share * pedal, 0.0, 1.0)
