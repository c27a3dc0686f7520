"""Images of a policy's camera: rendered with the light and fog of an episode, then with its contrast and noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import torch
import warp as wp

import simwarp as sw

from ..framework.recorded_launches import WorldLaunch, filled, share_over
from ..randomisation.randomness import WorldRandom
from .image_noise_kernels import Disturbance, disturb_images

RAYLEIGH: Final = (0.046, 0.108, 0.265)
"""Optical depth of clear air towards the zenith at 680, 550 and 440 nm: scattering at sea level of 5.8, 13.5 and
33.1e-6 /m (Bruneton and Neyret 2008) over a height of 8 km."""


def air_mass(elevation: torch.Tensor) -> torch.Tensor:
    """Return how much air is in the way of the sun, as a multiple of that towards the zenith (Kasten and Young 1989).

    Args:
        elevation: of the sun [rad].
    """
    degrees = elevation * (180.0 / math.pi)
    return 1.0 / (elevation.sin() + 0.50572 * (degrees + 6.07995) ** -1.6364)


class CameraImages:
    """Images (W, height, width, 3) uint8 of a camera, in the conditions of each world.

    Args:
        camera: sensor of the policy, with rows for each world in `ConditionsConfig.camera_arrays`.
        simulation: that takes the images.
        random: of the task, which draws the noise.
        name: of the vehicle, of several in a world: its noise is its own.

    Attributes:
        has_sun: the task's light has one.
    """

    def __init__(self, camera: sw.sensors.Camera, simulation: Any, random: WorldRandom, name: str = "") -> None:
        lights = camera.lights
        self._simulation, self._random, self._purpose = simulation, random, f"image noise{name}"
        self._exposure, self._fog = sw.to_torch(camera.image_processing.exposure), sw.to_torch(lights.fog_density)
        self._sun, self._sun_color = sw.to_torch(lights.sun_direction), sw.to_torch(lights.sun_color)
        self._built_sun, self._built_color = self._sun.clone(), self._sun_color.clone()
        self._depth = torch.tensor(RAYLEIGH, device=self._sun.device)
        self.has_sun = self._sun.shape[1] > 0
        self._image = sw.to_torch(camera.data)
        self._disturb: WorldLaunch | None = None
        self._values: Mapping[str, torch.Tensor] = {}

    def built_sun(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return elevation and azimuth (W,) of the first sun as built [rad]."""
        x, y, z = self._built_sun[:, 0].unbind(1)
        return z.asin(), torch.atan2(y, x)

    def bind(self, values: Mapping[str, torch.Tensor]) -> None:
        """Record what makes the image that a policy sees of the rendered one.

        Args:
            values: name of a condition -> (W,), of the running episodes; those that are neutral are not there.
        """
        self._values = values
        if not {"image_noise", "contrast"} & values.keys():
            return
        clear, seen = self._image, torch.zeros_like(self._image)
        worlds, device = len(clear), clear.device
        self._made = torch.zeros(worlds, dtype=torch.int64, device=device)
        disturbance = filled(
            Disturbance,
            contrast=values.get("contrast", torch.ones(worlds, device=device)),
            noise=values.get("image_noise", torch.zeros(worlds, device=device)),
            stream=self._random.stream(self._purpose),
            last=wp.from_torch(self._made, dtype=wp.uint64),
        )
        pairs = (clear[0].numel() + 1) // 2
        chunk = 1 if clear.is_cuda else pairs  # on a CPU threads share worlds
        self._disturb = share_over(
            self._simulation, disturb_images, chunk, int(chunk == pairs), clear.view(worlds, -1), disturbance,
            self._random.draws, seen.view(worlds, -1), threads_per_world=-(-pairs // chunk),
        )  # fmt: skip
        self._image = seen

    def begin(self, world_mask: torch.Tensor) -> None:
        """Begin an episode, or take it up, in the worlds of a mask (W,) bool: their image is made anew."""
        if self._disturb is not None:
            self._made.masked_fill_(world_mask, 0)

    def read(self) -> torch.Tensor:
        """Return the image (W, height, width, 3) uint8 with contrast and noise of this control step; the buffer itself.

        A function of the camera's image and of this control step's draws alone: it may be called at any time. An image
        that the camera holds for several control steps has other noise in each.
        """
        if self._disturb is not None:
            self._disturb.launch()
        return self._image

    def light_up(self) -> None:
        """Write light, fog and sun of the episodes into what the camera renders by."""
        if "light" in self._values:
            self._exposure.copy_(self._values["light"])
        if "fog" in self._values:
            self._fog.copy_(self._values["fog"])
        if self._values.keys() & {"sun_elevation", "sun_azimuth"}:
            self._write_sun()

    def _write_sun(self) -> None:
        """Turn the first sun, and let the air redden it: as built where it stands as built."""
        built, around = self.built_sun()
        elevation = self._values.get("sun_elevation", built)
        azimuth = self._values.get("sun_azimuth", around)
        level = elevation.cos()
        self._sun[:, 0] = torch.stack([level * azimuth.cos(), level * azimuth.sin(), elevation.sin()], dim=1)
        more = (air_mass(elevation) - air_mass(built)).unsqueeze(1)
        self._sun_color[:, 0] = self._built_color[:, 0] * (-self._depth * more).exp()
