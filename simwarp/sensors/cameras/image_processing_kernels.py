"""From light to pixel values: vignetting, exposure, response, noise, eight bits."""

import warp as wp

from simwarp.kernels.core.tables import world_row
from simwarp.sensors.random_kernels import draw_normals, subkey

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

RESPONSE_STEPS = wp.constant(1024)
NOISE_PURPOSE = wp.constant(1)


@wp.struct
class ImagingArrays:
    """Image processing between lens and pixel value; arrays have leading dimension 1 or W."""

    response: wp.array[float]  # (RESPONSE_STEPS + 1,) value of light s² at s = i / RESPONSE_STEPS
    exposure: wp.array[float]  # factor of light
    vignetting: wp.array[float]  # G of 1 - G + G cos⁴
    noise_mean: wp.array[wp.vec3]  # of values 0 to 1, per channel
    noise_sigma: wp.array[wp.vec3]
    noise_slope: wp.array[float]  # variance per value
    noise_intercept: wp.array[float]  # variance


@wp.func
def response_of(light: float, response: wp.array[float]) -> float:
    """Value 0 to 1 of light; 1 and above are white. The table is over the root: gamma curves are steep at black."""
    place = wp.sqrt(wp.clamp(light, 0.0, 1.0)) * float(RESPONSE_STEPS)
    step = wp.min(int(place), RESPONSE_STEPS - 1)
    part = place - float(step)
    return (1.0 - part) * response[step] + part * response[step + 1]


@wp.func
def process(
    world: int, light: wp.vec3, cosine: float, pixel: int, key: wp.uint64, arrays: ImagingArrays
) -> wp.vec3:  # fmt: skip
    """Pixel values, 0 to 1.

    Args:
        world: index.
        light: linear.
        cosine: of the angle between the pixel's ray and the axis.
        pixel: index in the image, for the noise.
        key: of the frame, for the noise.
        arrays: numbers.
    """
    vignetting = arrays.vignetting[world_row(world, arrays.vignetting.shape[0])]
    square = cosine * cosine
    gain = arrays.exposure[world_row(world, arrays.exposure.shape[0])] * (
        1.0 - vignetting + vignetting * square * square
    )
    value = wp.vec3(
        response_of(gain * light[0], arrays.response),
        response_of(gain * light[1], arrays.response),
        response_of(gain * light[2], arrays.response),
    )
    mean = arrays.noise_mean[world_row(world, arrays.noise_mean.shape[0])]
    sigma = arrays.noise_sigma[world_row(world, arrays.noise_sigma.shape[0])]
    slope = arrays.noise_slope[world_row(world, arrays.noise_slope.shape[0])]
    intercept = arrays.noise_intercept[world_row(world, arrays.noise_intercept.shape[0])]
    largest = wp.max(wp.max(sigma[0], sigma[1]), sigma[2])
    if largest > 0.0 or slope != 0.0 or intercept != 0.0:
        noise_key = subkey(key, NOISE_PURPOSE)
        first = draw_normals(noise_key, 2 * pixel)
        second = draw_normals(noise_key, 2 * pixel + 1)
        normal = wp.vec3(first[0], first[1], second[0])
        for c in range(3):
            variance = sigma[c] * sigma[c] + wp.max(slope * value[c] + intercept, 0.0)
            value[c] = value[c] + wp.sqrt(variance) * normal[c]
    value += mean
    return wp.vec3(wp.clamp(value[0], 0.0, 1.0), wp.clamp(value[1], 0.0, 1.0), wp.clamp(value[2], 0.0, 1.0))


@wp.func
def byte_of(value: float) -> wp.uint8:
    """The nearest of 256 levels."""
    return wp.uint8(value * 255.0 + 0.5)
