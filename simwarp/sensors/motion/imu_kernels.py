"""Specific force and angular velocity at a point of a body, in axes of the sensor."""

import warp as wp

from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float, turned
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors.clock_kernels import BEGIN, IDLE, ClockSettings, SampleEvents
from simwarp.sensors.motion.mount_motion_kernels import MountArrays, body_rate, body_velocity
from simwarp.sensors.noise_kernels import NoiseArrays
from simwarp.sensors.vector_sensor_kernels import write_vector

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class InertialArrays:
    """Channels and state of an inertial sensor."""

    accelerometer: int  # first channel of the specific force, -1: none
    gyroscope: int  # of the angular velocity
    # The body in the middle of the last sub-step, world axes; the point's own velocity would jump with its mount.
    velocity: wp.array[wp.vec3d]  # of the centre of mass [m/s]
    omega: wp.array[wp.vec3d]  # [rad/s]
    rotation: wp.array[wp.quatd]
    sums: wp.array2d[wp.float64]  # over the window


@wp.func
def turning_velocity(omega: wp.vec3d, rotation: wp.quatd, point: wp.vec3d) -> wp.vec3d:
    """Velocity of a point of a body about its centre of mass, world axes [m/s]."""
    return wp.cross(omega, wp.quat_rotate(rotation, point))


@wp.kernel
def sample_inertial(
    # inputs
    worlds: WorldRange,
    dt: wp.float64,
    clock: ClockSettings,
    mount: MountArrays,
    parameters: Parameters,
    state: StateArrays,
    tick: SampleEvents,
    # in and out
    inertial: InertialArrays,
    accelerometer_noise: NoiseArrays,
    gyroscope_noise: NoiseArrays,
    # outputs
    truth: wp.array2d[float],
    data: wp.array2d[float],
):
    """After a sub-step. A step's velocities hold in its middle; their change acts at the end of the step before.

    The point's velocity in the middle of a sub-step is v + omega x (R p), R the orientation there. Two of them, both of
    the point p as it is mounted now, differ by the acceleration at the end of the first, in whose axes it is given. So
    a steady turn shows omega^2 r along the radius alone, up to (omega dt)^2 / 24 of it.
    """
    world = worlds.first + wp.tid()
    if tick.mode[world] == IDLE:
        return
    rotation = mount.rotation[world_row(world, mount.rotation.shape[0])]
    point = mount.position[world_row(world, mount.position.shape[0])]
    omega = body_rate(world, mount.body, state)
    velocity = body_velocity(world, mount.body, state)
    before = rotation
    middle = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    if mount.body >= 0:
        q = state.body_rot[world, mount.body]
        middle = turned(q, to_float(omega * (wp.float64(-0.5) * dt)))
        before = turned(q, to_float(omega * -dt)) * rotation
        if tick.mode[world] == BEGIN:
            before = q * rotation
    acceleration = wp.vec3d()
    if tick.mode[world] != BEGIN:
        last = inertial.velocity[world] + turning_velocity(inertial.omega[world], inertial.rotation[world], point)
        acceleration = (velocity + turning_velocity(omega, middle, point) - last) / dt
    inertial.velocity[world] = velocity
    inertial.omega[world] = omega
    inertial.rotation[world] = middle
    if tick.collecting[world] == 0:
        return
    if inertial.accelerometer >= 0:
        gravity = to_double(parameters.gravity[world_row(world, parameters.gravity.shape[0])])
        force = wp.quat_rotate_inv(before, acceleration - gravity)
        write_vector(
            world, inertial.accelerometer, force, clock, tick, state, accelerometer_noise, inertial.sums, truth, data
        )
    if inertial.gyroscope >= 0:
        rate = wp.quat_rotate_inv(before, omega)
        write_vector(world, inertial.gyroscope, rate, clock, tick, state, gyroscope_noise, inertial.sums, truth, data)
