"""A camera that is put where the host wants it, in some of the worlds, for pictures that people look at."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import with_zeros
from simwarp.core.object_repr import Readable, plural
from simwarp.core.rotation import matrix_of
from simwarp.core.types import ModelError, Pose
from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors.cameras.camera import (
    OUTPUTS,
    CameraConfig,
    camera_numbers,
    lights_of,
    render_arguments,
)
from simwarp.sensors.cameras.image_kernels import Views, aim_freely, render
from simwarp.sensors.cameras.image_processing import ImageProcessing
from simwarp.sensors.cameras.lights import Lighting, Lights
from simwarp.sensors.clock import Field, check_frames
from simwarp.sensors.ranging.scanning import scene_model
from simwarp.sensors.scene import Scene
from simwarp.simulation.state import State


class FreeCamera(Readable):
    """Takes pictures at any time, outside the step; one view of each of some worlds.

    Args:
        scene: instances that it sees.
        worlds: indices of the worlds that are seen; the same one may come twice.
        config: configuration of the camera; its schedule does not matter.
        lights: of the scene.

    Attributes:
        outputs: by name, (views, height, width, channels): one array each, overwritten by each picture.

    Raises:
        ModelError: there is no such world, or a number of the camera is not usable.
    """

    def __init__(
        self, scene: Scene, worlds: Sequence[int], config: CameraConfig, lights: Lights | Lighting | None = None
    ) -> None:
        model = scene_model("free camera", scene)
        chosen = np.asarray(worlds, dtype=np.int32).reshape(-1)
        if not chosen.size or chosen.min() < 0 or chosen.max() >= model.world_count:
            raise ModelError(
                f"free camera: worlds must be indices below {model.world_count}, got {list(worlds)!r}; name one"
            )
        self.scene, self.config, self.worlds = scene, config, tuple(int(world) for world in chosen)
        self._device = model.device
        self._numbers = camera_numbers(config)
        self._tables = scene.tables(config.groups)
        self._views = with_zeros(Views(), len(chosen), model.device)
        self._views.world = wp.array(chosen, dtype=wp.int32, device=model.device)
        due = np.zeros(model.world_count, np.int32)
        due[chosen] = 1
        self._due: wp.array = wp.array(due, dtype=wp.int32, device=model.device)
        self._image_processing = ImageProcessing(config.imaging, model.world_count, model.device)
        self.lights = lights_of(lights, scene, ())
        shape = (len(chosen), config.height, config.width)
        fields: dict[str, Field] = {
            name: Field((*shape[1:], OUTPUTS[name][1]), OUTPUTS[name][2]) for name in config.outputs
        }
        check_frames("free camera", fields, len(chosen), model.device)
        self.outputs: dict[str, wp.array] = {
            name: wp.zeros((*shape, OUTPUTS[name][1]), dtype=OUTPUTS[name][2], device=model.device)
            for name in config.outputs
        }
        self._sums = wp.zeros((0, 0), dtype=wp.vec3, device=model.device)

    def _readable_title(self) -> str:
        return f": {plural(len(self.worlds), 'world')} of {self.config.width} x {self.config.height} pixels"

    def render(self, state: State, poses: Sequence[Pose]) -> npt.NDArray[Any]:
        """A picture of the present state from these poses, one per view (`look_at` makes them).

        Returns:
            (views, height, width, channels) of the first output, a copy; the others are in `outputs`.

        Raises:
            ModelError: the poses are not as many as the views.
        """
        self.aim(state, poses, self._numbers)
        inputs, outputs, parts = render_arguments(
            self._numbers, self._views, self.scene, self._tables, self.lights, self._image_processing, self._sums,
            self.outputs,
        )  # fmt: skip
        wp.launch(render, dim=(len(poses), parts), device=self._device, inputs=[WorldRange(), *inputs], outputs=outputs)
        return self.outputs[self.config.outputs[0]].numpy().copy()

    def aim(self, state: State, poses: Sequence[Pose], numbers: Any, *, placed: bool = False) -> None:
        """Puts the scene where a state has it, unless it is there, and the camera at these poses.

        Args:
            state: of the scene's model.
            poses: one per view.
            numbers: of the camera, as kernels read them.
            placed: the scene is there.

        Raises:
            ModelError: the poses are not as many as the views.
        """
        if len(poses) != len(self.worlds):
            raise ModelError(f"free camera: there must be {len(self.worlds)} poses, got {len(poses)}; one per view")
        place = np.array([pose.position for pose in poses], np.float64)
        axes = np.array([matrix_of(pose.rotation) for pose in poses], np.float32)
        self._views.rot = wp.array(axes, dtype=wp.mat33, device=self._device)
        if not placed:
            self.scene.place(state, self._tables, self._due)
        wp.launch(
            aim_freely, dim=len(poses), device=self._device,
            inputs=[WorldRange(), numbers, wp.array(place, dtype=wp.vec3d, device=self._device), self._tables],
            outputs=[self._views],
        )  # fmt: skip

    def extent(self, state: State, *, fixed: bool = False) -> npt.NDArray[np.float64]:
        """(views, 2, 3) lowest and highest corner of what moves with bodies, world axes [m]; zeros without any.

        With `fixed` also of what stands still, but for endless planes.
        """
        self.scene.place(state, self._tables, self._due)
        origin = self._tables.origin.numpy()[list(self.worlds)]
        boxes: tuple[Any, ...] = (self._tables.lower, self._tables.upper)
        lower, upper = (array.numpy()[list(self.worlds)].astype(np.float64) for array in boxes)
        counts = ((self.scene.body >= 0) | fixed)[None, :] & (upper >= lower).all(axis=-1) & (upper < 1e17).all(axis=-1)
        if not counts.any():
            return np.repeat(origin[:, None], 2, axis=1)
        low = np.where(counts[..., None], lower, np.inf).min(axis=1)
        high = np.where(counts[..., None], upper, -np.inf).max(axis=1)
        return np.stack([low, high], axis=1) + origin[:, None]
