"""Forces that a body feels in contact, and those that a joint transmits."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float, turned
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors.clock_kernels import STEP, ClockSettings, SampleEvents
from simwarp.sensors.motion.mount_motion_kernels import MountArrays, body_rate
from simwarp.sensors.noise_kernels import NoiseArrays
from simwarp.sensors.vector_sensor_kernels import write_vector

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func
def axes_of_forces(world: int, dt: wp.float64, mount: MountArrays, state: StateArrays) -> wp.quatd:
    """Sensor axes to world axes at the beginning of the sub-step, where its forces have their directions."""
    q = mount.rotation[world_row(world, mount.rotation.shape[0])]
    if mount.body >= 0:
        back = to_float(body_rate(world, mount.body, state) * -dt)
        return turned(state.body_rot[world, mount.body], back) * q
    return q


@wp.kernel
def sample_forces(
    # inputs
    worlds: WorldRange,
    dt: wp.float64,
    clock: ClockSettings,
    mount: MountArrays,
    force: wp.array2d[wp.vec3],  # (W, things), world axes
    torque: wp.array2d[wp.vec3],  # the same, or without columns
    index: int,
    state: StateArrays,
    tick: SampleEvents,
    # in and out
    force_noise: NoiseArrays,
    torque_noise: NoiseArrays,
    sums: wp.array2d[wp.float64],
    # outputs
    truth: wp.array2d[float],
    data: wp.array2d[float],
):
    """A force, and a torque where there is one, in axes of the sensor; zero before the first step."""
    world = worlds.first + wp.tid()
    if tick.collecting[world] == 0:
        return
    q = axes_of_forces(world, dt, mount, state)
    value = wp.vec3d()
    if tick.mode[world] == STEP:
        value = wp.quat_rotate_inv(q, to_double(force[world, index]))
    write_vector(world, 0, value, clock, tick, state, force_noise, sums, truth, data)
    if torque.shape[1] > 0:
        if tick.mode[world] == STEP:
            value = wp.quat_rotate_inv(q, to_double(torque[world, index]))
        write_vector(world, 3, value, clock, tick, state, torque_noise, sums, truth, data)


@wp.kernel
def sample_touch(
    # inputs
    worlds: WorldRange,
    threshold: float,
    tick: SampleEvents,
    data: wp.array2d[float],  # of this frame, measured
    # outputs
    touch: wp.array[wp.uint8],
):
    """Touch signal: 1 if the measured force is at least the threshold."""
    world = worlds.first + wp.tid()
    if tick.complete[world] == 1:
        row = tick.row[world]
        size = wp.length(wp.vec3(data[row, 0], data[row, 1], data[row, 2]))
        touch[row] = wp.uint8(wp.where(size >= threshold and size > 0.0, 1, 0))
