"""Image processing of a camera, from light to pixel values: vignetting, exposure, response curve, noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Annotated, Any, Final

import numpy as np
import warp as wp

from simwarp.core.arrays import WritableArray, writable_from
from simwarp.core.constraints import Fraction, Meaning, NotNegative, Positive
from simwarp.model.checks import checked_names
from simwarp.model.rules import RULES, instance_of
from simwarp.sensors.cameras.image_processing_kernels import RESPONSE_STEPS, ImagingArrays
from simwarp.sensors.interface import Configuration

PER_WORLD: Final = ("exposure", "vignetting", "noise_mean", "noise_sigma", "noise_slope", "noise_intercept")
"""Arrays of `ImageProcessing` that may differ by world."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Imaging(Configuration):
    """From light to pixel values, in this order.

    light x (1 - G + G cos⁴ angle) x exposure -> value = light^(1 / gamma), cut at 1 -> + N(mean, sigma) per channel
    + N(0, sqrt(slope value + intercept)) -> cut to 0..1 -> 256 levels.

    Attributes:
        exposure: factor of light.
        gamma: of the response; 1: values are proportional to light.
        vignetting: G; 1 is the cos⁴ law of a simple lens, 0 none.
        noise_mean, noise_sigma: of the noise that is the same at every pixel; one number, or one per channel. Values
            are 0 to 1.
        noise_slope, noise_intercept: variance per value and variance of the noise that depends on the pixel (shot and
            read noise; Foi et al. 2008).
    """

    exposure: NotNegative = 1.0
    gamma: Annotated[Positive, Meaning("1 for a linear response")] = 2.2
    vignetting: Fraction = 0.0
    noise_mean: float | tuple[float, float, float] = 0.0
    noise_sigma: NotNegative | tuple[NotNegative, NotNegative, NotNegative] = 0.0
    noise_slope: NotNegative = 0.0
    noise_intercept: NotNegative = 0.0


class ImageProcessing:
    """An `Imaging` on a device: arrays to write into between steps.

    Args:
        imaging: initial values.
        world_count: number of worlds W.
        device: Warp device.
        per_world: names of the arrays below that get a row per world.

    Attributes:
        exposure, vignetting, noise_slope, noise_intercept: (1 or W,).
        noise_mean, noise_sigma: (1 or W,) vec3.

    Raises:
        ModelError: a value breaks its rule, or `per_world` names no array.
    """

    exposure: WritableArray
    vignetting: WritableArray
    noise_mean: WritableArray
    noise_sigma: WritableArray
    noise_slope: WritableArray
    noise_intercept: WritableArray

    @RULES.arguments("camera")
    def __init__(
        self, imaging: Annotated[Imaging, instance_of(Imaging, "write Imaging(exposure=...)")], world_count: int,
        device: Any, per_world: Iterable[str] = (),
    ) -> None:  # fmt: skip
        wanted = checked_names("camera", "per_world", per_world, PER_WORLD)
        place = np.arange(RESPONSE_STEPS + 1) / RESPONSE_STEPS
        self.arrays = ImagingArrays()
        self.arrays.response = wp.array((place**2) ** (1.0 / imaging.gamma), dtype=wp.float32, device=device)
        for name in PER_WORLD:
            given: Any = getattr(imaging, name)
            dtype = wp.vec3 if name in ("noise_mean", "noise_sigma") else wp.float32
            values = np.broadcast_to(np.float32(given), 3 if dtype is wp.vec3 else ())
            copies = world_count if name in wanted else 1
            array = writable_from(np.repeat(values[None], copies, axis=0), dtype, device)
            setattr(self, name, array)
            setattr(self.arrays, name, array)
