"""Reference of what disturbs the images of driving tasks: Python integers and float64, one value at a time."""

from __future__ import annotations

import hashlib
import math

import numpy as np

from tests.reference.sensors.sensor_noise import GAMMA, mix, normals


def image_key(seed: int, world: int, episode: int, step: int) -> int:
    """The key of the noise of one image: of a seed, a world of the whole batch, its episode and its control step."""
    digest = int.from_bytes(hashlib.blake2b(b"image noise", digest_size=8).digest(), "little")
    key = mix(mix(seed * GAMMA) ^ digest)
    for coordinate in (world + 1, episode, step):
        key = mix(coordinate * GAMMA + key)
    return key


def disturbed(image: np.ndarray, contrast: float, noise: float, key: int) -> np.ndarray:
    """Values of an image, not rounded: [0, 255]."""
    values = []
    for index, level in enumerate(image.ravel()):
        value = 0.5 + contrast * (int(level) / 255.0 - 0.5) + noise * normals(key, index // 2)[index % 2]
        values.append(255.0 * min(max(value, 0.0), 1.0))
    return np.array(values).reshape(image.shape)


def reddened(color: np.ndarray, elevation: float, built: float) -> np.ndarray:
    """Colour of a sun at an elevation, of that which it has as built [rad]."""

    def masses(angle: float) -> float:
        """Kasten and Young 1989, table of the formula with the elevation in degrees."""
        degrees = math.degrees(angle)
        return 1.0 / (math.sin(angle) + 0.50572 * math.pow(degrees + 6.07995, -1.6364))

    scattering = np.array([5.8e-6, 13.5e-6, 33.1e-6]) * 8000.0
    return color * np.exp(-scattering * (masses(elevation) - masses(built)))
