"""A drawbar test: a carriage behind the vehicle holds its speed, and the driver lets the wheels turn ever faster."""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, StateArrays
from simwarp.kernels.core.world_range import WorldRange
from simwarp.vehicle.drivers_kernels import forward_speed

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

LEAST_SPEED = wp.constant(0.01)
"""Of the wheels' surface below which slip is not told [m/s]."""


@wp.struct
class Carriage:
    """What all worlds share."""

    chassis: int
    reference: wp.vec3  # of the chassis' centre of mass, where speed is measured [m]
    wheel: wp.array[int]  # driven ones, in the order of the vehicle's reports
    spindle: wp.array[int]
    turn: wp.array[int]  # rate of each wheel's turning in joint_qd, forwards positive
    radius: wp.array[float]  # [m]
    mass: float  # of the vehicle [kg]
    weight: float  # [N]
    start: float  # time at which the carriage moves off [s]
    ramp: float  # to its speed [s]
    sweep: float  # from the first slip to the last one [s]
    speed: float  # of the carriage [m/s]
    first_slip: float
    last_slip: float
    stiffness: float  # of the carriage's speed controller [1/s²]
    damping: float  # [1/s]
    proportional: float  # throttle per error of the wheels' surface speed [s/m]
    integral: float  # throttle per integrated error [1/m]


@wp.struct
class DrawbarState:
    """Of the controllers, and what the test measures; all (W,)."""

    force_sum: wp.array[float]  # integrated speed error of the carriage [m]
    throttle_sum: wp.array[float]
    slip: wp.array[float]
    pull: wp.array[float]  # on the carriage [N]
    share: wp.array[float]  # pull over weight
    torque: wp.array[float]  # of the soil or road on driven wheels, against their turning [N·m]


@wp.kernel
def pull_carriage(
    # inputs
    worlds: WorldRange,
    dt: float,
    carriage: Carriage,
    wheel_torque: wp.array2d[wp.vec3],
    state: StateArrays,
    # in and out
    drawbar: DrawbarState,
    control: ControlArrays,
    # outputs
    vehicle_input: wp.array2d[float],
):
    """Pull on the chassis at the height of its wheels' centres, added to what acts on it; the pedals; dim W."""
    world = worlds.first + wp.tid()
    time = float(state.world_time[world]) - carriage.start
    wheels = carriage.spindle.shape[0]
    surface = float(0.0)
    height = float(0.0)
    torque = float(0.0)
    for wheel in range(wheels):
        spindle = carriage.spindle[wheel]
        surface += carriage.radius[wheel] * state.joint_qd[world, carriage.turn[wheel]] / float(wheels)
        height += float(state.body_x[world, spindle][2]) / float(wheels)
        q = state.body_rot[world, spindle]
        axis = wp.quat_rotate(wp.quat(float(q[0]), float(q[1]), float(q[2]), float(q[3])), wp.vec3(0.0, 1.0, 0.0))
        torque -= wp.dot(wheel_torque[world, carriage.wheel[wheel]], axis)
    speed = forward_speed(world, carriage.chassis, carriage.reference, state)
    drawbar.torque[world] = torque
    drawbar.slip[world] = wp.where(surface > LEAST_SPEED, 1.0 - speed / wp.max(surface, LEAST_SPEED), 0.0)
    vehicle_input[world, 0] = 0.0
    if time < 0.0:
        drawbar.pull[world] = 0.0
        drawbar.share[world] = 0.0
        vehicle_input[world, 1] = 0.0
        vehicle_input[world, 2] = 1.0
        return
    goal = carriage.speed * wp.min(1.0, time / carriage.ramp)
    faster = speed - goal
    drawbar.force_sum[world] = drawbar.force_sum[world] + dt * faster
    pull = carriage.mass * (carriage.damping * faster + carriage.stiffness * drawbar.force_sum[world])
    drawbar.pull[world] = pull
    drawbar.share[world] = pull / carriage.weight
    q = state.body_rot[world, carriage.chassis]
    ahead = wp.quat_rotate(wp.quat(float(q[0]), float(q[1]), float(q[2]), float(q[3])), wp.vec3(1.0, 0.0, 0.0))
    ahead = wp.normalize(wp.vec3(ahead[0], ahead[1], 0.0))
    force = -pull * ahead
    arm = wp.vec3(0.0, 0.0, height - float(state.body_x[world, carriage.chassis][2]))
    control.element_force[world, carriage.chassis] = control.element_force[world, carriage.chassis] + force
    control.element_torque[world, carriage.chassis] = control.element_torque[world, carriage.chassis] + wp.cross(
        arm, force
    )
    part = wp.clamp((time - carriage.ramp) / carriage.sweep, 0.0, 1.0)
    slip = carriage.first_slip + part * (carriage.last_slip - carriage.first_slip)
    slower = goal / (1.0 - slip) - surface
    pedal = carriage.proportional * slower + carriage.integral * drawbar.throttle_sum[world]
    if wp.abs(pedal - 0.5) < 0.5 or pedal * slower < 0.0:  # the integral rests while the pedal is at an end
        drawbar.throttle_sum[world] = drawbar.throttle_sum[world] + dt * slower
    vehicle_input[world, 1] = wp.clamp(pedal, 0.0, 1.0)
    vehicle_input[world, 2] = 0.0
