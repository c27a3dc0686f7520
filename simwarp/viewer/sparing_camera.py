"""A camera that looks closely only where there is something to see: for films, whose images are mostly plain ground.

One ray for each square of 2 x 2 pixels tells where instances, normals or colours change. Those squares and their
neighbours get all rays of each pixel, as `FreeCamera` casts them, bit by bit; in the others colour and depth lie
between those of the squares.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp
from PIL import Image
from scipy.ndimage import binary_dilation

from simwarp.core.types import Pose
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors.cameras.camera import OUTPUTS, CameraConfig, camera_numbers, render_arguments
from simwarp.sensors.cameras.chosen_pixels_kernels import render_chosen
from simwarp.sensors.cameras.image_kernels import render
from simwarp.sensors.cameras.lights import Lighting, Lights
from simwarp.sensors.scene import Scene
from simwarp.simulation.state import State
from simwarp.viewer.free_camera import FreeCamera

Array = npt.NDArray[Any]

CONTRAST: Final = 16
"""Of sRGB bytes: so much a square differs, twice, from the mean of its neighbours where it is looked at closely."""
BEND: Final = 0.4
"""Of a component of normals, likewise."""
SEEN: Final = ("rgb", "depth", "normals", "instance")
"""Outputs that it has, and needs."""
_CHUNK: Final = 256


class SparingCamera(FreeCamera):
    """A `FreeCamera` that casts a fifth of the rays where most of the image is plain.

    Args:
        scene, worlds, lights: see `FreeCamera`.
        config: of even width and height, with more than one ray for each pixel and the outputs `SEEN`.
    """

    def __init__(
        self, scene: Scene, worlds: Sequence[int], config: CameraConfig, lights: Lights | Lighting | None = None
    ) -> None:
        super().__init__(scene, worlds, config, lights)
        half = dataclasses.replace(config, width=config.width // 2, height=config.height // 2, samples=1)
        self._squares = camera_numbers(half)
        self._squares.spread = self._numbers.spread  # textures as sharp as they will be
        shape = (len(self.worlds), half.height, half.width)
        self._coarse: dict[str, wp.array] = {
            name: wp.zeros((*shape, OUTPUTS[name][1]), dtype=OUTPUTS[name][2], device=self._device) for name in SEEN
        }
        self.close = 1.0
        """Share of the last picture's pixels that were looked at closely."""

    @staticmethod
    def suits(scene: Scene, config: CameraConfig) -> bool:
        """Whether it can take the pictures of a configuration, and faster: on a CPU."""
        even = not (config.width % 2 or config.height % 2)
        return bool(
            scene.model.device.is_cpu and even and config.samples > 1 and set(config.outputs) == set(SEEN)
            and min(config.width, config.height) >= 32
        )  # fmt: skip

    def render(self, state: State, poses: Sequence[Pose]) -> Array:
        """A picture of the present state from these poses, see `FreeCamera.render`."""
        self.aim(state, poses, self._squares)
        inputs, outputs, parts = self._arguments(self._squares, self._coarse)
        wp.launch(render, dim=(len(poses), parts), device=self._device, inputs=[WorldRange(), *inputs], outputs=outputs)
        coarse = {name: array.numpy() for name, array in self._coarse.items()}
        close = np.stack([_changes(*(coarse[name][view] for name in SEEN)) for view in range(len(poses))])
        for name, array in self.outputs.items():
            array.numpy()[:] = _BETWEEN[name](coarse[name])
        view, row, column = np.nonzero(close.repeat(2, axis=1).repeat(2, axis=2))
        chosen = np.stack([view, row * self.config.width + column], axis=1).astype(np.int32)
        self.close = len(chosen) / (close.size * 4)
        self.aim(state, poses, self._numbers, placed=True)
        inputs, outputs, _ = self._arguments(self._numbers, self.outputs)
        wp.launch(
            render_chosen, dim=-(-len(chosen) // _CHUNK), device=self._device,
            inputs=[_CHUNK, wp.array(chosen, dtype=wp.vec2i, device=self._device), *inputs[1:]], outputs=outputs[1:],
        )  # fmt: skip
        return self.outputs[self.config.outputs[0]].numpy().copy()

    def _arguments(self, numbers: Any, frames: dict[str, wp.array]) -> tuple[list[Any], list[Any], int]:
        return render_arguments(
            numbers, self._views, self.scene, self._tables, self.lights, self._image_processing, self._sums, frames
        )


def _changes(rgb: Array, depth: Array, normals: Array, instance: Array) -> Array:
    """(height, width) squares between which and a neighbour something changes that is not in between."""
    apart = np.zeros(instance.shape[:2], bool)
    things, apart_x, apart_y = instance[..., 0], apart[:, 1:-1], apart[1:-1]
    for values in (rgb.max(axis=-1), rgb.min(axis=-1)):  # colours that differ in a channel differ in their extremes
        shade = values.astype(np.int16)
        apart_x |= abs(2 * shade[:, 1:-1] - shade[:, 2:] - shade[:, :-2]) >= CONTRAST
        apart_y |= abs(2 * shade[1:-1] - shade[2:] - shade[:-2]) >= CONTRAST
    for axis in range(3):
        part = normals[..., axis]
        apart_x |= abs(2.0 * part[:, 1:-1] - part[:, 2:] - part[:, :-2]) > BEND
        apart_y |= abs(2.0 * part[1:-1] - part[2:] - part[:-2]) > BEND
    edges = np.zeros_like(apart)
    across, down = things[:, 1:] != things[:, :-1], things[1:] != things[:-1]
    for side, change in ((edges[:, 1:], across), (edges[:, :-1], across), (edges[1:], down), (edges[:-1], down)):
        side |= change
    return apart | binary_dilation(edges)


def _doubled(values: Array, mode: str) -> Array:
    """(views, 2 h, 2 w, c) values between those of squares (views, h, w, c), which stand for their middles."""
    size = 2 * values.shape[2], 2 * values.shape[1]
    images = [Image.fromarray(each.squeeze(-1) if mode == "F" else each) for each in values]
    doubled = np.stack([np.asarray(image.resize(size, Image.Resampling.BILINEAR)) for image in images])
    return doubled.reshape(len(values), size[1], size[0], values.shape[3])


def _repeated(values: Array) -> Array:
    return values.repeat(2, axis=1).repeat(2, axis=2)


_BETWEEN: Final = {
    "rgb": lambda values: _doubled(values, "RGB"),
    "depth": lambda values: 1.0 / _doubled(1.0 / values, "F"),  # which is linear along a plane
    "normals": _repeated,
    "instance": _repeated,
}
