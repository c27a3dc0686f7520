"""What a world shows over time, for files of other programs: meshes, and where they are at every frame."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Readable, plural
from simwarp.core.rotation import matrix_of
from simwarp.sensors.cameras.lights import Lighting
from simwarp.sensors.scene import Scene
from simwarp.simulation.simulation import Simulation
from simwarp.viewer.live.batches import HIDDEN, Batch, Batches
from simwarp.viewer.live.body_readback import BodyReadback
from simwarp.viewer.live.page_meshes import Triangles, linear
from simwarp.viewer.studio import FollowCamera, Shot

Array = npt.NDArray[np.float64]

GROUND_FACTOR: Final = 10.0
"""Side of the square that stands for an endless plane, over the size of all else."""
WHITE: Final = (1.0, 1.0, 1.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Track:
    """Where something is at every frame.

    Attributes:
        places: (F, 3) [m].
        turns: (F, 4) xyzw; neighbours less than half a turn apart as quaternions.
        scales: (F, 3).
    """

    places: Array
    turns: Array
    scales: Array

    def moves(self, name: str) -> bool:
        """Whether one of the arrays changes."""
        values = getattr(self, name)
        return bool((values != values[:1]).any())

    def matrix(self, frame: int) -> Array:
        """(4, 4) of a frame."""
        matrix = np.eye(4)
        matrix[:3, :3] = matrix_of(self.turns[frame]) * self.scales[frame]
        matrix[:3, 3] = self.places[frame]
        return matrix


@dataclasses.dataclass(frozen=True, eq=False)
class SceneNode:
    """A mesh with one colour or those of its vertices.

    Attributes:
        name: of the instance, unique.
        mesh: triangles, that nodes may share.
        color: linear albedo.
        fixed: no body carries it.
        track: poses in world axes, and the scale of the mesh.
        shapes: (F, V, 3) vertices at every frame, of what deforms [m]; None: those of the mesh.
    """

    name: str
    mesh: Triangles
    color: tuple[float, ...]
    fixed: bool
    track: Track
    shapes: npt.NDArray[np.float32] | None = None


class SceneRecording(Readable):
    """Frames of one world: what the web viewer shows of it, textures as their mean colours, soil without its ruts.

    Args:
        simulation: whose state is recorded.
        scene: of its model.
        world: which is recorded.
        shot: of the camera that goes along.
        size: width and height of the camera's picture [pixels].
        lighting: of the scene.

    Attributes:
        times: of the frames so far [s].
        camera: that goes along with a body.
        lighting: of the scene.
    """

    def __init__(
        self, simulation: Simulation, scene: Scene, *, world: int = 0, shot: Shot | None = None,
        size: tuple[int, int] = (960, 540), lighting: Lighting | None = None,
    ) -> None:  # fmt: skip
        self.lighting = lighting or Lighting()
        self.camera = FollowCamera(
            simulation, scene, shot, worlds=(world,), width=size[0], height=size[1], lighting=self.lighting
        )
        self.times: list[float] = []
        self._batches = Batches(scene, [world])
        self._bodies = BodyReadback(simulation.state, np.array([world], np.int64))
        self._looks: dict[Any, tuple[Triangles, tuple[float, ...], int]] = {}
        self._tracks: dict[Any, dict[int, Array]] = {}
        self._shapes: dict[Any, dict[int, npt.NDArray[np.float32]]] = {}
        self._state = simulation.state
        self._poses: list[Any] = []

    def _readable_title(self) -> str:
        return f": {plural(len(self._tracks), 'node')}, {plural(len(self.times), 'frame')}"

    def add(self, time: float) -> None:
        """Records the present state as the frame of a time [s]."""
        frame = len(self.times)
        self.times.append(time)
        self._poses.append(self.camera.aim(time)[0])
        self._bodies.read()
        self._batches.read_scenery()
        places, turns = self._batches.poses(self._bodies)
        vertices = self._batches.vertices(self._state)
        for batch in self._batches.batches:
            for row, instance in enumerate(batch.instances):
                key = self._look(batch, row)
                pose = np.concatenate([places[0, instance], turns[0, instance], batch.scales[row]])
                self._tracks.setdefault(key, {})[frame] = pose
                if batch.surface >= 0:
                    self._shapes.setdefault(key, {})[frame] = vertices[batch.key].copy()

    def nodes(self) -> list[SceneNode]:
        """All that was seen in some frame; grounds are squares."""
        names: dict[str, int] = {}
        found = []
        for key, (mesh, color, instance) in self._looks.items():
            title = self._batches.scene.names[instance]
            names[title] = names.get(title, 0) + 1
            name = title if names[title] == 1 else f"{title} ({names[title]})"
            fixed = bool(self._batches.scene.body[instance] < 0)
            found.append(SceneNode(name, mesh, color, fixed, self._track(self._tracks[key]), self._shapes_of(key)))
        return [*found, *self._grounds(found)]

    def camera_track(self) -> Track:
        """Where the camera is at every frame: x forward, y to the left, z up [m]."""
        places = np.array([pose.position for pose in self._poses])
        turns = np.array([pose.rotation for pose in self._poses])
        return Track(places, _unwound(turns), np.ones_like(places))

    def _look(self, batch: Batch, row: int) -> Any:
        """Key of a mesh in a colour on an instance: a node."""
        instance = int(batch.instances[row])
        color = WHITE if batch.mesh.color is not None else tuple((batch.colors[row] / 255.0).tolist())
        key = (instance, batch.key, color)
        self._looks.setdefault(key, (batch.mesh, color, instance))
        return key

    def _track(self, seen: dict[int, Array]) -> Track:
        """Of all frames; one that is not seen is too small to be."""
        rows = np.empty((len(self.times), 10))
        last = seen[min(seen)]
        for frame in range(len(self.times)):
            last = seen.get(frame, last)
            rows[frame] = last
            if frame not in seen:
                rows[frame, 7:] = HIDDEN
        return Track(rows[:, :3], _unwound(rows[:, 3:7]), rows[:, 7:])

    def _shapes_of(self, key: Any) -> npt.NDArray[np.float32] | None:
        """Of all frames: where something is not seen it keeps its last shape."""
        seen = self._shapes.get(key)
        if seen is None:
            return None
        shapes = [seen[min(seen)]]
        for frame in range(len(self.times)):
            shapes.append(seen.get(frame, shapes[-1]))
        return np.stack(shapes[1:])

    def _grounds(self, nodes: list[SceneNode]) -> list[SceneNode]:
        """Squares in place of endless planes, around all that was seen."""
        places = np.concatenate([*(node.track.places for node in nodes), self.camera_track().places])
        reach = GROUND_FACTOR * max(float(np.ptp(places, axis=0).max()), 1.0)
        corners = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)], np.float32)
        square = Triangles(corners, np.array([(0, 1, 2), (0, 2, 3)], np.uint32))
        found = []
        for number, ground in enumerate(self._batches.grounds):
            middle = places.mean(axis=0) - ground.position
            normal = matrix_of(ground.rotation)[:, 2]
            place = ground.position + middle - (middle @ normal) * normal
            count = len(self.times)
            track = Track(
                np.tile(place, (count, 1)),
                np.tile(ground.rotation, (count, 1)),
                np.tile((reach, reach, 1.0), (count, 1)),
            )
            color = tuple(linear(ground.color / 255.0).tolist())
            found.append(SceneNode(f"ground {number}", square, color, True, track))
        return found


def _unwound(turns: Array) -> Array:
    """The same rotations, each on the same side as the one before it."""
    signs = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    return np.concatenate([turns[:1], turns[1:] * signs[:, None]])
