"""Counter-based random numbers of the sensors: a draw is a function of its coordinates, nothing is advanced.

World k sees the same numbers however many worlds run beside it and after a restored snapshot. The hash is SplitMix64
(Steele, Lea, Flood 2014), applied once per coordinate.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

GAMMA = wp.constant(wp.uint64(0x9E3779B97F4A7C15))
MIX1 = wp.constant(wp.uint64(0xBF58476D1CE4E5B9))
MIX2 = wp.constant(wp.uint64(0x94D049BB133111EB))
TWO_PI = wp.constant(6.283185307179586)


@wp.func
def mix64(value: wp.uint64) -> wp.uint64:
    """SplitMix64's output function."""
    z = (value ^ (value >> wp.uint64(30))) * MIX1
    z = (z ^ (z >> wp.uint64(27))) * MIX2
    return z ^ (z >> wp.uint64(31))


@wp.func
def subkey(key: wp.uint64, coordinate: int) -> wp.uint64:
    """The key of one coordinate (>= 0) below another key."""
    return mix64(key + wp.uint64(coordinate + 1) * GAMMA)


@wp.func
def frame_key(stream: wp.uint64, world: int, episode: int, frame: int) -> wp.uint64:
    """The key of one frame of one world; `stream` stands for the sensor and its seed."""
    return subkey(subkey(subkey(stream, world), episode), frame)


@wp.func
def draw_bits(key: wp.uint64, index: int) -> wp.uint64:
    """64 random bits."""
    return mix64(key + wp.uint64(index + 1) * GAMMA)


@wp.func
def draw_uniform(key: wp.uint64, index: int) -> float:
    """Uniform in [0, 1): 24 bits, so that every value is exact and 1 is never reached."""
    return float(wp.uint32(draw_bits(key, index) >> wp.uint64(40))) * 5.9604644775390625e-08


@wp.func
def draw_normals(key: wp.uint64, index: int) -> wp.vec2:
    """Two independent standard normal numbers (Box and Muller 1958), within +-6.8."""
    bits = draw_bits(key, index)
    # half a step up: the logarithm stays finite
    u = (float(wp.uint32(bits >> wp.uint64(32))) + 0.5) * 2.3283064365386963e-10
    angle = float(wp.uint32(bits & wp.uint64(0xFFFFFFFF))) * (TWO_PI * 2.3283064365386963e-10)
    radius = wp.sqrt(-2.0 * wp.log(wp.min(u, 1.0)))
    return wp.vec2(radius * wp.cos(angle), radius * wp.sin(angle))


@wp.func
def draw_normal(key: wp.uint64, index: int) -> float:
    """A standard normal number."""
    return draw_normals(key, index)[0]
