"""Device half of the hallway: the controller that holds the speed."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange

from .base_kernels import Car, Drive, begin_physics, car_heading, motion_of, work_pedals

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

PROPORTIONAL = wp.constant(0.4)
INTEGRAL = wp.constant(0.4)


@wp.struct
class SpeedControl:
    """A controller of the speed ahead."""

    speed: float  # [m/s]
    dt: float  # [s]
    integral: wp.array[float]  # (W,) [m]


@wp.func
def hold_speed(world: int, control: SpeedControl, car: Car, state: StateArrays):
    """Work the pedals for one physics step."""
    error = control.speed - motion_of(world, car_heading(world, car, state), car, state)[0]
    integral = wp.clamp(control.integral[world] + control.dt * error, -1.0, 1.0)
    control.integral[world] = integral
    work_pedals(world, wp.clamp(PROPORTIONAL * error + INTEGRAL * integral, -1.0, 1.0), car)


@wp.kernel
def drive_on_held(
    worlds: WorldRange,
    control: SpeedControl, state: StateArrays, reach: wp.array[float], request: wp.array2d[float],
    action: wp.array2d[float], car: Car, drive: Drive,
):  # fmt: skip
    """Before a physics step: steer, and hold the speed."""
    world = worlds.first + wp.tid()
    begin_physics(world, reach, request, action, car, drive)
    hold_speed(world, control, car, state)


@wp.kernel
def steer_held(action: wp.array2d[float], control: SpeedControl, state: StateArrays, car: Car):
    """Steering by the policy, pedals by the controller."""
    world = wp.tid()
    car.input[world, 0] = action[world, 0]
    hold_speed(world, control, car, state)


@wp.kernel
def hold_on(control: SpeedControl, state: StateArrays, car: Car):
    """The controller alone."""
    hold_speed(wp.tid(), control, car, state)


@wp.kernel
def begin_control(mask: wp.array[wp.bool], control: SpeedControl):
    """Forget the sum of the errors."""
    world = wp.tid()
    if mask[world]:
        control.integral[world] = 0.0
