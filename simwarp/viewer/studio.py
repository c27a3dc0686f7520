"""A camera that goes along with a body: what `simwarp play` films with."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Readable, plural
from simwarp.core.rotation import matrix_of
from simwarp.core.types import WORLD, Pose, Vec3, finite_vector
from simwarp.sensors.cameras.camera import CameraConfig, look_at
from simwarp.sensors.cameras.lenses import Pinhole
from simwarp.sensors.cameras.lights import Lighting
from simwarp.sensors.interface import body_index
from simwarp.sensors.scene import Scene
from simwarp.viewer.free_camera import FreeCamera
from simwarp.viewer.ground_height import GroundHeight
from simwarp.viewer.ground_marks import GroundFinder, draw_marks, marks_for, quieter
from simwarp.viewer.line_overlay import Polyline, draw_lines
from simwarp.viewer.sparing_camera import SparingCamera

if TYPE_CHECKING:
    from simwarp.simulation.simulation import Simulation

FIELD: Final = 0.7
"""Of view [rad]."""
SIDE: Final = (-0.62, -1.0, 0.52)
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
        turns: with the body's heading: target and eye are in axes that are turned with it about the vertical.
        follows: False: it stays where it is at the start, until the body is elsewhere at once, as after a reset.
        side: direction from the target to the camera where there is no eye.
    """

    body: int | str = 0
    target: Vec3 | None = None
    eye: Vec3 | None = None
    fov: float = FIELD
    calm: float = 0.25
    turns: bool = False
    follows: bool = True
    side: Vec3 = SIDE


def headings(rotations: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """(n,) angles of the x axes of (n, 4) rotations (xyzw) about the vertical [rad]."""
    x, y, z, w = np.asarray(rotations, np.float64).T
    angles: npt.NDArray[np.float64] = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return angles


def about_vertical(vectors: npt.ArrayLike, angles: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """(n, 3) vectors after a turn about the vertical by (n,) angles [rad]."""
    x, y, z = np.asarray(vectors, np.float64).T
    cos, sin = np.cos(angles), np.sin(angles)
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)


class FollowCamera(Readable):
    """Pictures of some worlds from a camera that follows a body.

    Args:
        simulation: whose state is seen.
        scene: of its model.
        shot: the view.
        worlds: indices of those that are seen.
        width, height: of one world's picture [pixels].
        samples: s x s rays per pixel.
        lighting: None: sun and sky.
        marks: crosses on the ground at whole metres.
        quiet: less pattern on grounds, so that what stands on them is seen.
        sparing: plain parts of the pictures get fewer rays, where that is faster; for films.
    """

    def __init__(
        self, simulation: Simulation, scene: Scene, shot: Shot | None = None, *, worlds: Sequence[int] = (0,),
        width: int = 480, height: int = 320, samples: int = 2, lighting: Lighting | None = None,
        marks: bool = False, quiet: bool = False, sparing: bool = False,
    ) -> None:  # fmt: skip
        self._simulation = simulation
        self._shot = Shot() if shot is None else shot
        config = CameraConfig(
            width=width, height=height, samples=samples, lens=Pinhole(fov=self._shot.fov), far=2000.0,
            outputs=("rgb", "depth", "normals", "instance"),
        )  # fmt: skip
        spares = sparing and SparingCamera.suits(scene, config)
        self.camera = (SparingCamera if spares else FreeCamera)(scene, worlds, config, lighting)
        self._body = body_index("studio", self._shot.body, simulation.model) if simulation.model.body_count else WORLD
        extent = self.camera.extent(simulation.state)
        self._size = max(float(np.linalg.norm(extent[:, 1] - extent[:, 0], axis=1).max()), 1e-3)
        self._followed = self._last = self._places()
        self._heading = self._headings()
        middle = extent.mean(axis=1) - self._followed
        given = self._shot.target
        self._target = middle if given is None else np.tile(finite_vector("Shot", "target", given, 3), (len(middle), 1))
        narrow = min(0.5 * self._shot.fov, math.atan(height / width * math.tan(0.5 * self._shot.fov)))
        side = finite_vector("Shot", "side", self._shot.side, 3)
        away = side / max(float(np.linalg.norm(side)), 1e-9) * 0.5 * self._size / math.sin(narrow)
        self._eye = away if self._shot.eye is None else finite_vector("Shot", "eye", self._shot.eye, 3)
        self._time: float | None = None
        self._ground = GroundFinder(scene) if marks or quiet else None
        self._quiet = quiet
        self._floor = GroundHeight(scene, worlds)
        self._marks = marks_for(float(np.linalg.norm(self._eye))) if marks else None

    def _readable_title(self) -> str:
        config = self.camera.config
        return f": {plural(len(self.camera.worlds), 'world')} of {config.width} x {config.height} pixels"

    def render(self, time: float, lines: Sequence[Sequence[Polyline]] = ()) -> npt.NDArray[np.uint8]:
        """(worlds, height, width, 3) of the present state.

        Args:
            time: since the start [s], for how far the camera goes.
            lines: of each of the worlds, drawn into its picture; empty: none.
        """
        poses = self.aim(time)
        pictures: npt.NDArray[np.uint8] = self.camera.render(self._simulation.state, poses)
        if self._ground is not None:
            self._finish_grounds(pictures, poses)
        if any(lines):
            depths = self.camera.outputs["depth"].numpy()[..., 0]
            for picture, depth, pose, own in zip(pictures, depths, poses, lines, strict=True):
                picture[:] = draw_lines(picture, depth, pose, self._shot.fov, own)
        return pictures

    def cut(self) -> None:
        """Be where what it follows is in the next picture at once, however far that has gone."""
        self._time = None

    @property
    def follows(self) -> bool:
        """Whether there is a body that the shot is about."""
        return self._body != WORLD

    def floors(self, places: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """(worlds,) height of the ground below places (worlds, 3) [m]; without one, of the lowest point that moves."""
        found = self._floor.at(places)
        missing = ~np.isfinite(found)
        if missing.any():
            found[missing] = self.camera.extent(self._simulation.state)[missing, 0, 2]
        return found

    @property
    def fov(self) -> float:
        """Horizontal field of view [rad]."""
        return self._shot.fov

    def aim(self, time: float) -> list[Pose]:
        """Poses of the cameras in the present state, one step of following later: x forward, y left, z up.

        Args:
            time: since the start [s].
        """
        places, headings = self._places(), self._headings()
        passed = math.inf if self._time is None else max(time - self._time, 0.0)
        share = 1.0 - math.exp(-passed / max(self._shot.calm, 1e-6)) if self._shot.follows else 0.0
        # a world that was reset is elsewhere at once
        jumped = np.linalg.norm(places - self._last, axis=1) > self._size
        shares = np.where(jumped, 1.0, share)
        self._followed = self._followed + shares[:, None] * (places - self._followed)
        turn = (headings - self._heading + math.pi) % (2.0 * math.pi) - math.pi
        self._heading = self._heading + shares * turn
        self._time, self._last = time, places
        eyes = about_vertical(np.tile(self._eye, (len(places), 1)), self._heading)
        targets = self._followed + about_vertical(self._target, self._heading)
        return [look_at(target + eye, target) for target, eye in zip(targets, eyes, strict=True)]

    def _finish_grounds(self, pictures: npt.NDArray[np.uint8], poses: Sequence[Pose]) -> None:
        assert self._ground is not None
        depths, normals, instances = (self.camera.outputs[name].numpy() for name in ("depth", "normals", "instance"))
        for picture, depth, normal, instance, pose in zip(pictures, depths, normals, instances, poses, strict=True):
            if self._quiet:
                picture[:] = quieter(picture, self._ground.sure(instance[..., 0]))
            if self._marks is not None:
                ground = self._ground.find(instance[..., 0], normal, matrix_of(pose.rotation))
                picture[:] = draw_marks(picture, depth[..., 0], normal, ground, pose, self._shot.fov, self._marks)

    def _headings(self) -> npt.NDArray[np.float64]:
        """(worlds,) angle of the body's x axis about the vertical [rad]; 0 where the camera does not turn with it."""
        worlds = list(self.camera.worlds)
        if self._body == WORLD or not self._shot.turns:
            return np.zeros(len(worlds))
        return headings(self._simulation.state.body_rot.numpy()[worlds, self._body])

    def _places(self) -> npt.NDArray[np.float64]:
        """(worlds, 3) what is followed [m]."""
        if self._body == WORLD:
            return np.zeros((len(self.camera.worlds), 3))
        return self._simulation.state.body_x.numpy()[list(self.camera.worlds), self._body].astype(np.float64)
