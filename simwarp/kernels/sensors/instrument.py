"""Means over the window of a frame."""

import warp as wp

from simwarp.kernels.sensors.clock import STEP, ClockSettings, Tick

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func
def add_up(world: int, channel: int, value: wp.float64, tick: Tick, sums: wp.array2d[wp.float64]) -> wp.float64:
    """Adds a sample of this sub-step; returns the sum so far."""
    total = value
    if tick.first[world] == 0:
        total += sums[world, channel]
    sums[world, channel] = total
    return total


@wp.func
def window_length(world: int, clock: ClockSettings, tick: Tick) -> int:
    """Samples of a complete frame."""
    if tick.mode[world] == STEP:
        return wp.max(clock.window, 1)
    return 1
