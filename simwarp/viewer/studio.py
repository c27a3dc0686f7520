"""A camera that goes along with a body: what `simwarp play` films with."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, Vec3, finite_vector
from simwarp.sensors.cameras.camera import CameraConfig, look_at
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.cameras.lights import Lighting
from simwarp.sensors.interface import body_index
from simwarp.sensors.scene import Scene
from simwarp.viewer.free_camera import FreeCamera
from simwarp.viewer.lines import Polyline, draw_lines

if TYPE_CHECKING:
    from simwarp.simulation.simulation import Simulation

FIELD: Final = 0.7
"""Of view [rad]."""
SIDE: Final = np.array([-0.62, -1.0, 0.52])
"""Direction from the target to the camera, unless a shot gives one."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Shot:
    """View of a world.

    Attributes:
        body: body that the camera follows, by name or index; `WORLD`: it stands still.
        target: point that it looks at, from the body's position (the origin for `WORLD`), world axes [m]; None: the
            middle of what moves, as it is at the start.
        eye: its position, from the target [m]; None: so far away that all that moves is in sight at the start.
        fov: horizontal field of view [rad].
        calm: time in which it catches up with the body [s].
    """

    body: int | str = 0
    target: Vec3 | None = None
    eye: Vec3 | None = None
    fov: float = FIELD
    calm: float = 0.25


class FollowCamera:
    """Pictures of some worlds from a camera that follows a body.

    Args:
        simulation: whose state is seen.
        scene: of its model.
        shot: the view.
        worlds: indices of those that are seen.
        width, height: of one world's picture [pixels].
        samples: s x s rays per pixel.
        lighting: None: sun and sky.
    """

    def __init__(
        self, simulation: Simulation, scene: Scene, shot: Shot | None = None, *, worlds: Sequence[int] = (0,),
        width: int = 480, height: int = 320, samples: int = 2, lighting: Lighting | None = None,
    ) -> None:  # fmt: skip
        self._simulation = simulation
        self._shot = Shot() if shot is None else shot
        config = CameraConfig(
            width=width, height=height, samples=samples, lens=Pinhole(fov=self._shot.fov), far=2000.0,
            outputs=("rgb", "depth"),
        )  # fmt: skip
        self.camera = FreeCamera(scene, worlds, config, lighting)
        self._body = body_index("studio", self._shot.body, simulation.model) if simulation.model.body_count else WORLD
        extent = self.camera.extent(simulation.state)
        self._size = max(float(np.linalg.norm(extent[:, 1] - extent[:, 0], axis=1).max()), 1e-3)
        self._followed = self._places()
        middle = extent.mean(axis=1) - self._followed
        self._target = middle if self._shot.target is None else finite_vector("Shot", "target", self._shot.target, 3)
        narrow = min(0.5 * self._shot.fov, math.atan(height / width * math.tan(0.5 * self._shot.fov)))
        away = SIDE / np.linalg.norm(SIDE) * 0.5 * self._size / math.sin(narrow)
        self._eye = away if self._shot.eye is None else finite_vector("Shot", "eye", self._shot.eye, 3)
        self._time: float | None = None

    def take(self, time: float, lines: Sequence[Sequence[Polyline]] = ()) -> npt.NDArray[np.uint8]:
        """(worlds, height, width, 3) of the present state.

        Args:
            time: since the start [s], for how far the camera goes.
            lines: of each of the worlds, drawn into its picture; empty: none.
        """
        places = self._places()
        passed = math.inf if self._time is None else max(time - self._time, 0.0)
        share = 1.0 - math.exp(-passed / max(self._shot.calm, 1e-6))
        way = places - self._followed
        # a world that was reset is elsewhere at once
        jumped = np.linalg.norm(way, axis=1, keepdims=True) > self._size
        self._followed = self._followed + np.where(jumped, 1.0, share) * way
        self._time = time
        poses = [look_at(target + self._eye, target) for target in self._followed + self._target]
        pictures: npt.NDArray[np.uint8] = self.camera.take(self._simulation.state, poses)
        if any(lines):
            depths = self.camera.outputs["depth"].numpy()[..., 0]
            for picture, depth, pose, own in zip(pictures, depths, poses, lines, strict=True):
                picture[:] = draw_lines(picture, depth, pose, self._shot.fov, own)
        return pictures

    def cut(self) -> None:
        """Be where what it follows is in the next picture at once, however far that has gone."""
        self._time = None

    def _places(self) -> npt.NDArray[np.float64]:
        """(worlds, 3) what is followed [m]."""
        if self._body == WORLD:
            return np.zeros((len(self.camera.worlds), 3))
        return self._simulation.state.body_x.numpy()[list(self.camera.worlds), self._body].astype(np.float64)
