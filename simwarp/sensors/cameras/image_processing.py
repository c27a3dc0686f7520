"""Image processing of a camera, from light to pixel values: vignetting, exposure, response curve, noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import warp as wp

from simwarp.core.arrays import WritableArray, writable_from
from simwarp.core.types import ModelError, Vec3, finite_vector, shown
from simwarp.kernels.sensors.cameras.image_processing import RESPONSE_STEPS, ImagingArrays
from simwarp.model.checks import finite_number, positive_number
from simwarp.sensors.interface import wanted_arrays

PER_WORLD: Final = ("exposure", "vignetting", "noise_mean", "noise_sigma", "noise_slope", "noise_intercept")
"""Arrays of `ImageProcessing` that may differ by world."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Imaging:
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

    exposure: float = 1.0
    gamma: float = 2.2
    vignetting: float = 0.0
    noise_mean: float | Vec3 = 0.0
    noise_sigma: float | Vec3 = 0.0
    noise_slope: float = 0.0
    noise_intercept: float = 0.0


class ImageProcessing:
    """An `Imaging` on a device: arrays to write into between steps.

    Args:
        imaging: initial values.
        world_count: W.
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

    def __init__(self, imaging: Imaging, world_count: int, device: Any, per_world: Iterable[str] = ()) -> None:
        if not isinstance(imaging, Imaging):
            raise ModelError(f"camera: imaging must be an Imaging, got {shown(imaging)}; write Imaging(exposure=...)")
        wanted = wanted_arrays("camera", per_world, PER_WORLD)
        gamma = positive_number("Imaging", "gamma", imaging.gamma, "", "1 is a linear response")
        place = np.arange(RESPONSE_STEPS + 1) / RESPONSE_STEPS
        self.arrays = ImagingArrays()
        self.arrays.response = wp.array((place**2) ** (1.0 / gamma), dtype=wp.float32, device=device)
        for name in PER_WORLD:
            values, dtype = _value(imaging, name)
            copies = world_count if name in wanted else 1
            array = writable_from(np.repeat(values[None], copies, axis=0), dtype, device)
            setattr(self, name, array)
            setattr(self.arrays, name, array)


def _value(imaging: Imaging, name: str) -> tuple[Any, Any]:
    """One world's checked value, and its type."""
    given: Any = getattr(imaging, name)
    if name in ("noise_mean", "noise_sigma"):
        values = finite_vector("Imaging", name, (given,) * 3 if isinstance(given, (int, float)) else given, 3)
        if name == "noise_sigma" and values.min() < 0.0:
            raise ModelError(f"Imaging: noise_sigma must be >= 0, got {shown(given)}; use 0 for none")
        return values.astype(np.float32), wp.vec3
    value = finite_number("Imaging", name, given)
    if value < 0.0:
        raise ModelError(f"Imaging: {name} must be >= 0, got {shown(given)}; use 0 for none")
    if name == "vignetting" and value > 1.0:
        raise ModelError(f"Imaging: vignetting must be between 0 and 1, got {shown(given)}; 1 is the cos⁴ law")
    return np.float32(value), wp.float32
