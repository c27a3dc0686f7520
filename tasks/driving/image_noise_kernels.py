"""Device half of a camera that is disturbed: contrast and noise of an image, drawn by the task."""

import warp as wp

from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors.random_kernels import draw_normals

from ..framework.randomness_kernels import Draws, step_key

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})


LEVEL = wp.constant(1.0 / 255.0)


@wp.struct
class Disturbance:
    """What is done to the images, and the stream of the noise."""

    contrast: wp.array[float]  # (W,) factor of the distance of a value from grey, 0.5
    noise: wp.array[float]  # (W,) standard deviation of the noise of each value, which is 0 to 1
    stream: wp.array[wp.uint64]
    last: wp.array[wp.uint64]  # (W,) key of the image that was made last; 0: it is to be made anew


@wp.kernel
def disturb_images(
    # inputs
    worlds: WorldRange,
    chunk: int,
    whole: int,
    clear: wp.array2d[wp.uint8],
    disturbance: Disturbance,
    draws: Draws,
    # outputs
    seen: wp.array2d[wp.uint8],
):
    """A thread takes `chunk` pairs of values of one world's image (W, values); a pair shares one draw.

    Where a thread takes all of them (`whole`), an image that is there already is not made again.
    """
    index, part = wp.tid()
    world = worlds.first + index
    count = clear.shape[1]
    contrast = disturbance.contrast[world]
    noise = disturbance.noise[world]
    key = step_key(disturbance.stream, world, draws)
    if whole == 1:
        if disturbance.last[world] == key:
            return
        disturbance.last[world] = key
    for pair in range(part * chunk, wp.min((part + 1) * chunk, (count + 1) / 2)):
        normal = wp.vec2()
        if noise > 0.0:
            normal = draw_normals(key, pair)
        for side in range(wp.min(2, count - 2 * pair)):
            column = 2 * pair + side
            value = 0.5 + contrast * (float(clear[world, column]) * LEVEL - 0.5) + noise * normal[side]
            seen[world, column] = wp.uint8(wp.clamp(value, 0.0, 1.0) * 255.0 + 0.5)
