"""Rows of sensors: frames of cameras and lidars, in worlds that differ."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.bench.health import Health
from simwarp.bench.measure import Row, TimedRun, measure_run
from simwarp.core.types import WORLD, Pose, pose
from simwarp.model.builder import ModelBuilder
from simwarp.sensors.cameras.camera import Camera, CameraConfig
from simwarp.sensors.interface import Mount, Schedule
from simwarp.sensors.ranging.beams import VLP_16_ELEVATION, BeamTable
from simwarp.sensors.ranging.lidar import Lidar, LidarConfig
from simwarp.sensors.scene import Scene, Visuals
from simwarp.simulation.simulation import Simulation

Floats = npt.NDArray[np.float64]

RATE: Final = 30.0
"""Frames per second of the cameras; a step is one frame."""
OBSTACLES: Final = 50
HALF_WIDTH: Final = 40.0
"""Of the ground [m]."""
VIEW: Final = (80, 45)
VLP_16_COLUMNS: Final = 900
_SEED: Final = 5


def _rock(seed: int) -> Floats:
    """(24, 3) points on a dented ball of 0.5 m."""
    points = np.random.default_rng(seed).standard_normal((24, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * (0.5, 0.5, 0.4)


def _hills() -> Floats:
    x, y = np.meshgrid(*(np.linspace(-HALF_WIDTH, HALF_WIDTH, 64),) * 2)
    return np.sin(x / 6.0) * np.cos(y / 7.0)


def _corridor() -> tuple[Floats, npt.NDArray[np.int64]]:
    """Walls, floor and ceiling of a closed corridor 3 m wide, in 12 000 triangles."""
    turns, around = 1000, 6
    angle = np.linspace(0.0, 2.0 * np.pi, turns, endpoint=False)
    radius = 20.0 + 4.0 * np.sin(3.0 * angle)
    profile = np.array([(-1.5, 0.0), (1.5, 0.0), (1.5, 1.5), (1.5, 3.0), (-1.5, 3.0), (-1.5, 1.5)])
    r = radius[:, None] + profile[:, 0]
    ring = np.stack(
        [r * np.cos(angle)[:, None], r * np.sin(angle)[:, None], np.broadcast_to(profile[:, 1], r.shape)], -1
    )
    here = np.arange(turns)[:, None] * around
    there = np.roll(here, -1, axis=0)
    k, m = np.arange(around), (np.arange(around) + 1) % around
    first = np.stack([here + k, there + m, there + k], -1)
    second = np.stack([here + k, here + m, there + m], -1)
    return ring.reshape(-1, 3), np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])


def _carrier(worlds: int, device: str, name: str, draws: np.random.Generator) -> Scene:
    """A scene in which a body without weight carries a sensor on."""
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    start: Pose = (
        pose((19.0, 0.0, 1.4), (0.0, 0.0, 0.70710678, 0.70710678)) if "corridor" in name else pose((0.0, 0.0, 2.2))
    )
    ahead = (0.0, 1.0, 0.0) if "corridor" in name else (1.0, 0.0, 0.0)
    builder.add_body("carrier", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=start, velocity=ahead)
    places = np.concatenate([draws.uniform(-30.0, 30.0, (OBSTACLES, 2)), np.full((OBSTACLES, 1), 0.4)], axis=1)
    if name == "camera-flat":
        builder.add_shape_plane()
        for index, place in enumerate(places):
            match index % 3:
                case 0:
                    builder.add_shape_box(WORLD, half=(0.5, 0.5, 0.8), pose=pose(place))
                case 1:
                    builder.add_shape_sphere(WORLD, radius=0.6, pose=pose(place))
                case _:
                    builder.add_shape_cylinder(WORLD, radius=0.4, half_length=0.8, pose=pose(place))
    elif name != "camera-corridor":
        builder.add_shape_height_field(WORLD, _hills(), size=(2.0 * HALF_WIDTH,) * 2)
        for index, place in enumerate(places):
            builder.add_shape_hull(WORLD, _rock(index % 8), scale=(1.5, 1.5, 1.5), pose=pose(place))
    visuals = Visuals(builder)
    if name == "camera-corridor":
        visuals.add_mesh(WORLD, *_corridor(), color=(0.7, 0.65, 0.6))
    model = builder.finalize(worlds, device, per_world=("shape_x",) if builder.shapes else ())
    if builder.shapes:
        x = model.shape_x.numpy()
        x[:, 1:, :2] = np.stack(
            [np.random.default_rng(world).uniform(-30.0, 30.0, (OBSTACLES, 2)) for world in range(worlds)]
        )
        model.shape_x.assign(x)
    return visuals.finalize(model)


class SensorExaminer:
    """Judges what a sensor shows: there, not uniform, the world still moving."""

    def __init__(self, run: SensorRun) -> None:
        self.run = run

    def examine(self) -> Health:
        """Every world has a frame, and every frame shows more than one thing."""
        data, valid = self.run.sensor.data.numpy(), self.run.sensor.valid.numpy()
        problems = []
        if not valid.all():
            problems.append(f"{int((~valid).sum())} worlds have no frame")
        flat = data.reshape(len(data), -1).astype(np.float64)
        if not np.isfinite(flat[np.abs(flat) < np.inf]).all() or not (flat.std(axis=1) > 0.0).all():
            problems.append("a frame shows nothing")
        return Health(tuple(problems), 0.0, 0.0, 0.0, float(np.abs(self.run.sim.state.body_v.numpy()).max(initial=0.0)))


class SensorRun(TimedRun):
    """A camera or lidar that takes a frame with every step."""

    def __init__(self, name: str, worlds: int, device: str, dt: float | None) -> None:
        scene = _carrier(worlds, device, name, np.random.default_rng(_SEED))
        model = scene.model
        step = 1.0 / RATE if dt is None else dt
        mount, schedule = Mount(body=0), Schedule(rate=1.0 / step)
        self.sensor: Any
        if name == "lidar":
            columns = np.linspace(np.pi, -np.pi, VLP_16_COLUMNS, endpoint=False)
            config = LidarConfig(schedule=schedule, beams=BeamTable(azimuth=columns, elevation=VLP_16_ELEVATION))
            self.sensor = Lidar(scene, mount, config)
        else:
            self.sensor = Camera(scene, mount, CameraConfig(width=VIEW[0], height=VIEW[1], schedule=schedule))
        super().__init__(Simulation(model, step, sensors=[self.sensor]), 2.0)

    def set_motion(self) -> None:
        """All start at the same place, among obstacles of their own."""
        self._start_here(SensorExaminer(self))


def measure_sensor(name: str, worlds: int, device: str, dt: float | None, seconds: float) -> Row:
    """Times frames of a camera or lidar.

    Raises:
        ModelError: the worlds do not fit into memory.
    """
    return measure_run(name, worlds, seconds, lambda count: SensorRun(name, count, device, dt))
