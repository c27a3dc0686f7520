"""Channels of a frame: means over the window, true and measured."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.sensors.clock_kernels import STEP, ClockSettings, SampleEvents
from simwarp.sensors.noise_kernels import NoiseArrays, noise_elapsed, noisy

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func
def add_up(world: int, channel: int, value: wp.float64, tick: SampleEvents, sums: wp.array2d[wp.float64]) -> wp.float64:
    """Adds a sample of this sub-step; returns the sum so far."""
    total = value
    if tick.first[world] == 0:
        total += sums[world, channel]
    sums[world, channel] = total
    return total


@wp.func
def window_length(world: int, clock: ClockSettings, tick: SampleEvents) -> int:
    """Samples of a complete frame."""
    if tick.mode[world] == STEP:
        return wp.max(clock.window, 1)
    return 1


@wp.func
def frame_elapsed(world: int, tick: SampleEvents, state: StateArrays, noise: NoiseArrays) -> wp.float64:
    """`noise_elapsed` where the frame is complete."""
    if tick.complete[world] == 1:
        return noise_elapsed(world, tick, state, noise)
    return wp.float64(0.0)


@wp.func
def write_channel(
    world: int, column: int, channel: int, value: wp.float64, elapsed: wp.float64, clock: ClockSettings,
    tick: SampleEvents,
    noise: NoiseArrays, sums: wp.array2d[wp.float64], truth: wp.array2d[float], data: wp.array2d[float],
):  # fmt: skip
    """Adds a sample to the window; where the frame is complete, writes the mean, true and measured.

    `column` is that of the frame, `channel` that of the noise, `elapsed` from `frame_elapsed`.
    """
    total = add_up(world, column, value, tick, sums)
    if tick.complete[world] == 1:
        mean = total / wp.float64(window_length(world, clock, tick))
        row = tick.row[world]
        truth[row, column] = float(mean)
        data[row, column] = float(noisy(world, channel, mean, elapsed, tick, noise))


@wp.func
def write_vector(
    world: int, first: int, value: wp.vec3d, clock: ClockSettings,
    tick: SampleEvents, state: StateArrays, noise: NoiseArrays,
    sums: wp.array2d[wp.float64], truth: wp.array2d[float], data: wp.array2d[float],
):  # fmt: skip
    """Three channels with noise of their own, from column `first` on."""
    elapsed = frame_elapsed(world, tick, state, noise)
    for axis in range(3):
        write_channel(world, first + axis, axis, value[axis], elapsed, clock, tick, noise, sums, truth, data)
