"""Sensor noise: stages that act one after the other on each channel of a frame (simwarp/sensors/noise.py)."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.sensors.clock_kernels import BEGIN, SampleEvents
from simwarp.sensors.random_kernels import draw_normal

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

NORMAL = wp.constant(0)
"""mean, standard deviation"""
BIAS_WALK = wp.constant(1)
"""rate [unit/sqrt(s)], standard deviation at the beginning"""
BOUNDED_DRIFT = wp.constant(2)
"""standard deviation, correlation time [s]"""
QUANTISATION = wp.constant(3)
"""step, unused"""
SATURATION = wp.constant(4)
"""lower, upper"""


@wp.struct
class NoiseArrays:
    """Stages of noise."""

    kind: wp.array[int]  # (stages,)
    parameter: wp.array4d[float]  # (1 or W, stages, channels, 2)
    bias: wp.array3d[float]  # (W, stages, channels): of stages that remember one
    time: wp.array[wp.float64]  # (W,) of the last frame [s]
    first_draw: int  # index of the first random number


@wp.func
def noise_elapsed(world: int, tick: SampleEvents, state: StateArrays, noise: NoiseArrays) -> wp.float64:
    """Time since the last frame that was taken [s]; below 0 where the world's state was set. Call it once a frame."""
    now = state.world_time[world]
    elapsed = now - noise.time[world]
    noise.time[world] = now
    if tick.mode[world] == BEGIN:
        elapsed = wp.float64(-1.0)
    return elapsed


@wp.func
def noisy(
    world: int, channel: int, value: wp.float64, elapsed: wp.float64, tick: SampleEvents, noise: NoiseArrays
) -> wp.float64:
    """The value after all stages. Biases are advanced by the exact law of their time, so that frames may be skipped."""
    result = value
    copy = world_row(world, noise.parameter.shape[0])
    for stage in range(noise.kind.shape[0]):
        kind = noise.kind[stage]
        first = wp.float64(noise.parameter[copy, stage, channel, 0])
        second = wp.float64(noise.parameter[copy, stage, channel, 1])
        if kind == QUANTISATION:
            result = first * wp.floor(result / first + wp.float64(0.5))
        elif kind == SATURATION:
            result = wp.clamp(result, first, second)
        else:
            index = noise.first_draw + stage * noise.parameter.shape[2] + channel
            draw = wp.float64(draw_normal(tick.key[world], index))
            if kind == NORMAL:
                result += first + second * draw
            else:
                bias = wp.float64(noise.bias[world, stage, channel])
                if kind == BIAS_WALK:
                    if elapsed < wp.float64(0.0):
                        bias = second * draw
                    else:
                        bias += first * wp.sqrt(elapsed) * draw
                else:
                    if elapsed < wp.float64(0.0):
                        bias = first * draw
                    else:
                        kept = wp.exp(-elapsed / second)
                        bias = kept * bias + first * wp.sqrt(wp.float64(1.0) - kept * kept) * draw
                noise.bias[world, stage, channel] = float(bias)
                result += bias
    return result
