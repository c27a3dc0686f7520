"""Encoders on coordinates, and meters of one rate: turns of a body or a joint, speed along an axis."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors.clock_kernels import BEGIN, IDLE, STEP, ClockSettings, SampleEvents
from simwarp.sensors.motion.mount_motion_kernels import MountArrays, body_rate, mount_rotation, mount_velocity
from simwarp.sensors.noise_kernels import NoiseArrays, noisy
from simwarp.sensors.vector_sensor_kernels import frame_elapsed, write_channel

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

POSITION = wp.constant(0)
COUNTS = wp.constant(1)
SPEED = wp.constant(2)


@wp.struct
class EncoderArrays:
    """Parameters and state of an encoder; n coordinates."""

    reading: int  # POSITION, COUNTS or SPEED
    dof: wp.array[int]  # (n,) columns of joint_x
    ratio: wp.array2d[wp.float64]  # (1 or W, n) travel of the encoder's shaft per coordinate
    step: wp.array2d[wp.float64]  # (1 or W, n) of the shaft per count, 0: not counted [rad or m]
    # Coordinates [rad or m], not the shaft's: the ratio may be written in the middle of an episode.
    origin: wp.array2d[wp.float64]  # (W, n) at the beginning of the episode
    last: wp.array2d[wp.float64]  # (W, n) after the last sub-step
    start: wp.array2d[wp.float64]  # (W, n) at the beginning of the window


@wp.func
def counted(shaft: wp.float64, step: wp.float64) -> wp.float64:
    """The number of whole steps nearest to a position."""
    return wp.floor(shaft / step + wp.float64(0.5))


@wp.func
def on_a_step(shaft: wp.float64, step: wp.float64) -> wp.float64:
    """Position quantised to counts."""
    if step > wp.float64(0.0):
        return counted(shaft, step) * step
    return shaft


@wp.kernel
def sample_encoder(
    # inputs
    worlds: WorldRange,
    dt: wp.float64,
    clock: ClockSettings,
    state: StateArrays,
    tick: SampleEvents,
    # in and out
    encoder: EncoderArrays,
    noise: NoiseArrays,
    # outputs
    truth: wp.array2d[float],
    data: wp.array2d[float],
):
    """The latest position or count of a frame's window; the speed is its change over the window."""
    world = worlds.first + wp.tid()
    if tick.mode[world] == IDLE:
        return
    elapsed = frame_elapsed(world, tick, state, noise)
    copy = world_row(world, encoder.ratio.shape[0])
    row = tick.row[world]
    for index in range(encoder.dof.shape[0]):
        dof = encoder.dof[index]
        ratio = encoder.ratio[copy, index]
        step = encoder.step[copy, index]
        place = state.joint_x[world, dof]
        shaft = ratio * place
        if tick.mode[world] == BEGIN:
            encoder.origin[world, index] = place
        if tick.first[world] == 1:
            encoder.start[world, index] = encoder.last[world, index]
        encoder.last[world, index] = place
        if tick.complete[world] == 1:
            true = shaft
            value = shaft
            if encoder.reading == SPEED:
                true = ratio * wp.float64(state.joint_qd[world, dof])
                value = true
                if clock.window > 0 and tick.mode[world] == STEP:
                    time = wp.float64(clock.window) * dt
                    begin = ratio * encoder.start[world, index]
                    true = (shaft - begin) / time
                    value = (on_a_step(shaft, step) - on_a_step(begin, step)) / time
                value = noisy(world, index, value, elapsed, tick, noise)
            else:
                value = noisy(world, index, shaft, elapsed, tick, noise)
                if encoder.reading == POSITION:
                    value = on_a_step(value, step)
                else:
                    begin = ratio * encoder.origin[world, index]
                    true = (shaft - begin) / step
                    value = counted(value, step) - counted(begin, step)
            truth[row, index] = float(true)
            data[row, index] = float(value)


@wp.struct
class RateMeter:
    """One rate of a body or a coordinate."""

    dof: int  # column of joint_qd, -1: of the mount
    turning: int  # 1: angular velocity, 0: velocity
    axis: wp.vec3d  # unit, sensor axes
    scale: wp.float64  # reading per SI unit
    mount: MountArrays


@wp.func
def measured_rate(world: int, meter: RateMeter, state: StateArrays) -> wp.float64:
    """m/s or rad/s."""
    if meter.dof >= 0:
        return wp.float64(state.joint_qd[world, meter.dof])
    axis = wp.quat_rotate(mount_rotation(world, meter.mount, state), meter.axis)
    if meter.turning == 1:
        return wp.dot(axis, body_rate(world, meter.mount.body, state))
    return wp.dot(axis, mount_velocity(world, meter.mount, state))


@wp.kernel
def sample_rate(
    # inputs
    worlds: WorldRange,
    clock: ClockSettings,
    meter: RateMeter,
    state: StateArrays,
    tick: SampleEvents,
    # in and out
    noise: NoiseArrays,
    sums: wp.array2d[wp.float64],
    # outputs
    truth: wp.array2d[float],
    data: wp.array2d[float],
):
    """The mean of a rate over the window."""
    world = worlds.first + wp.tid()
    if tick.collecting[world] == 0:
        return
    value = meter.scale * measured_rate(world, meter, state)
    elapsed = frame_elapsed(world, tick, state, noise)
    write_channel(world, 0, 0, value, elapsed, clock, tick, noise, sums, truth, data)
