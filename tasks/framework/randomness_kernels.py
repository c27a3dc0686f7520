"""Random numbers of tasks: functions of (seed and purpose, world, episode, step, column), by SplitMix64.

A purpose's stream stands in memory, so that a captured step goes on after the seed has changed.
"""

import warp as wp

from simwarp.sensors.random_kernels import GAMMA, mix64

# Sums and products are rounded one by one, as torch does: the same numbers as ever
wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

UNIT = wp.constant(wp.float64(1.0 / 4294967296.0))
TURN = wp.constant(wp.float64(6.283185307179586 / 4294967296.0))
LOW_WORD = wp.constant(wp.uint64(0xFFFFFFFF))


@wp.struct
class Draws:
    """Coordinates of the draws of every world."""

    world: wp.array[wp.int64]  # (W,) its index in the whole batch
    episode: wp.array[wp.int64]  # (W,)
    step: wp.array[wp.int64]  # (W,) control steps of the episode


@wp.func
def counted(key: wp.uint64, coordinate: wp.int64) -> wp.uint64:
    """The key of a coordinate below another key."""
    return mix64(wp.uint64(coordinate) * GAMMA + key)


@wp.func
def episode_key(stream: wp.array[wp.uint64], world: int, draws: Draws) -> wp.uint64:
    """The key of a world's draws of one purpose in its episode."""
    key = mix64(wp.uint64(draws.world[world] + wp.int64(1)) * GAMMA + stream[0])
    return counted(key, draws.episode[world])


@wp.func
def step_key(stream: wp.array[wp.uint64], world: int, draws: Draws) -> wp.uint64:
    """The same in its control step."""
    return counted(episode_key(stream, world, draws), draws.step[world])


@wp.func
def bits_at(key: wp.uint64, column: int) -> wp.uint64:
    """64 random bits."""
    return mix64(wp.uint64(column + 1) * GAMMA + key)


@wp.func
def unit_at(key: wp.uint64, column: int) -> float:
    """Whole number in [0, 2**24), which float32 holds exactly."""
    return float(wp.uint32(bits_at(key, column) >> wp.uint64(40)))


@wp.func
def uniform_at(key: wp.uint64, column: int, low: float, high: float) -> float:
    """Uniform in [low, high)."""
    return unit_at(key, column) * ((high - low) * 5.9604644775390625e-08) + low


@wp.func
def normal_at(key: wp.uint64, column: int, mean: wp.float64, std: wp.float64) -> float:
    """Normal, by Box and Muller; the radius from the upper half, half a step up so that its logarithm is finite."""
    bits = bits_at(key, column)
    radius = (wp.float64(bits >> wp.uint64(32)) + wp.float64(0.5)) * UNIT
    angle = wp.float64(bits & LOW_WORD) * TURN
    return float(mean + std * (wp.sqrt(wp.float64(-2.0) * wp.log(radius)) * wp.cos(angle)))


@wp.func
def drawing_key(per_step: int, stream: wp.array[wp.uint64], world: int, draws: Draws) -> wp.uint64:
    """The key of an episode, or of one of its steps."""
    key = episode_key(stream, world, draws)
    if per_step == 1:
        key = counted(key, draws.step[world])
    return key


@wp.kernel
def draw_bits(per_step: int, stream: wp.array[wp.uint64], draws: Draws, values: wp.array2d[wp.int64]):
    """64 bits for every world and column."""
    world, column = wp.tid()
    values[world, column] = wp.int64(bits_at(drawing_key(per_step, stream, world, draws), column))


@wp.kernel
def draw_uniform(
    per_step: int, low: float, scale: float, stream: wp.array[wp.uint64], draws: Draws, values: wp.array2d[float],
):  # fmt: skip
    """Low, and scale times a whole number below 2**24."""
    world, column = wp.tid()
    values[world, column] = unit_at(drawing_key(per_step, stream, world, draws), column) * scale + low


@wp.kernel
def draw_normal(
    per_step: int, mean: wp.float64, std: wp.float64, stream: wp.array[wp.uint64], draws: Draws,
    values: wp.array2d[float],
):  # fmt: skip
    """Normal numbers."""
    world, column = wp.tid()
    values[world, column] = normal_at(drawing_key(per_step, stream, world, draws), column, mean, std)


@wp.kernel
def draw_integers(
    per_step: int, low: wp.int64, count: wp.int64, stream: wp.array[wp.uint64], draws: Draws,
    values: wp.array2d[wp.int64],
):  # fmt: skip
    """Whole numbers from low on, of count."""
    world, column = wp.tid()
    bits = bits_at(drawing_key(per_step, stream, world, draws), column) >> wp.uint64(32)
    values[world, column] = wp.int64((bits * wp.uint64(count)) >> wp.uint64(32)) + low
