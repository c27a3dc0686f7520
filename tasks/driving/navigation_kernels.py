"""Device half of the estimate of a vehicle's pose: readings, and the noise that the task draws for them."""

import warp as wp

from ..framework.randomness_kernels import Draws, episode_key, normal_at, step_key

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

NONE = wp.constant(wp.float64(0.0))


@wp.struct
class Navigator:
    """Readings of receiver and gyroscope; of no length where there are none."""

    position: wp.array2d[float]  # (W, 3) [m]
    velocity: wp.array2d[float]  # (W, 3) [m/s]
    rate: wp.array2d[float]  # (W, 3) [rad/s]
    heading: wp.array[float]  # (W,) integrated [rad]
    period: float  # between two readings [s]
    place_noise: wp.float64  # standard deviations: of a place, per axis [m]
    speed_noise: wp.float64  # of a velocity, per axis [m/s]
    rate_noise: wp.float64  # of a turn rate [rad/s]
    rate_bias: wp.float64  # of its bias in an episode [rad/s]
    place_stream: wp.array[wp.uint64]  # streams of the noise
    speed_stream: wp.array[wp.uint64]
    rate_stream: wp.array[wp.uint64]
    bias_stream: wp.array[wp.uint64]


@wp.func
def estimated_place(world: int, navigator: Navigator, draws: Draws) -> wp.vec2:
    """Place by the receiver [m]."""
    key = step_key(navigator.place_stream, world, draws)
    return wp.vec2(
        navigator.position[world, 0] + normal_at(key, 0, NONE, navigator.place_noise),
        navigator.position[world, 1] + normal_at(key, 1, NONE, navigator.place_noise),
    )


@wp.func
def estimated_speed(world: int, navigator: Navigator, draws: Draws) -> float:
    """Speed by the receiver [m/s]."""
    key = step_key(navigator.speed_stream, world, draws)
    x = navigator.velocity[world, 0] + normal_at(key, 0, NONE, navigator.speed_noise)
    y = navigator.velocity[world, 1] + normal_at(key, 1, NONE, navigator.speed_noise)
    return wp.sqrt(x * x + y * y)


@wp.kernel
def advance_heading(navigator: Navigator, draws: Draws):
    """Turn the heading by what the gyroscope measured over the control step that ends."""
    world = wp.tid()
    bias = normal_at(episode_key(navigator.bias_stream, world, draws), 0, NONE, navigator.rate_bias)
    noise = normal_at(step_key(navigator.rate_stream, world, draws), 0, NONE, navigator.rate_noise)
    turn = navigator.period * (navigator.rate[world, 2] + (bias + noise))
    navigator.heading[world] = navigator.heading[world] + turn


@wp.kernel
def estimate_positions(
    navigator: Navigator, draws: Draws, place: wp.array[wp.vec2], heading: wp.array[float], speed: wp.array[float]
):  # fmt: skip
    """Estimates of all worlds."""
    world = wp.tid()
    place[world] = estimated_place(world, navigator, draws)
    heading[world] = navigator.heading[world]
    speed[world] = estimated_speed(world, navigator, draws)
