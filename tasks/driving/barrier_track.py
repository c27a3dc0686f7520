"""Barrier track: a car drives a lap of a race track between red and white barriers.

After ``barrier_track-v0`` of gym-chrono: the track's size, the camera and the reward are the original's.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar

import torch

import simwarp as sw

from ..framework.recorded_launches import NamedRows, TensorFunction
from ..framework.registry import register
from .barrier_track_kernels import find_corners_outside, reward_lane_offset
from .driven_vehicles import SEDAN
from .driving_config import DrivingConfig
from .lapping import LappingConfig, LappingRewards, LappingTask, Start
from .outlines import corners
from .training_defaults import PEDALS_BY_CAMERA

WIDTH = 12.5
"""Between the feet of the barriers [m]."""


@dataclasses.dataclass(frozen=True)
class BarrierTrackRewards(LappingRewards):
    """Weights of the reward."""

    progress: float = 0.05
    """Per metre along the lane."""
    failure: float = -0.5
    """Touching a barrier: little, or a car that cannot see yet learns to stand still."""
    aside: float = -0.005
    """Per metre from the middle of the lane, in each step."""


@dataclasses.dataclass(frozen=True)
class BarrierTrackConfig(LappingConfig):
    """Configuration of :class:`BarrierTrackTask`."""

    dt: float = 0.0025
    """Physics step [s]."""
    decimation: int = 40
    """Physics steps per control step: ten actions a second."""
    max_episode_steps: int = 2000
    """Control steps after which an episode is truncated at the latest; ``patience`` is what counts."""
    camera_fov: float = math.pi / 2.0
    """Horizontal field of view [rad]."""
    tracks: int = 16
    """Number of tracks, to the left and to the right; every episode is driven on one of them."""
    start: Start = Start.ANYWHERE
    """Start position of an episode."""
    speed: float = 8.0
    """At which a lap is to be driven [m/s]."""
    rewards: BarrierTrackRewards = BarrierTrackRewards()
    """Weights of the reward."""


@register("barrier-track")
class BarrierTrackTask(LappingTask[BarrierTrackConfig]):
    """Observations: ``camera`` (W, height, width, 3) uint8 and ``policy`` (W, 3): speed, yaw rate, steering; or, with
    ``obs`` state, ``policy`` (W, 18): place in the lane, points ahead, motion.

    Actions: steering (positive to the left), and throttle (positive) or brake (negative).
    """

    summary: ClassVar[str] = "barrier track: a car drives a lap between barriers, by camera or by state"
    instruction: ClassVar[str] = "Drive a lap of the race track between the barriers."
    config_type: ClassVar[type[DrivingConfig]] = BarrierTrackConfig
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 100,
        "num_envs": 256,
        "steps_per_iteration": 32,
        "network.init_std": 0.5,
        "ppo.gamma": 0.99,
        "ppo.entropy": 0.002,
    }
    training_by_obs: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "state": {"network.hidden": (64, 64)},
        "camera": {**PEDALS_BY_CAMERA, "iterations": 200},
    }
    distilling: ClassVar[Mapping[str, Any]] = {"iterations": 60}
    # Grip and delays that it never met upset it: docs/results.md, "Driving: light, fog, delays, other vehicles"
    trained_in: ClassVar[Mapping[str, Any]] = {"conditions": "random"}
    distilled_in: ClassVar[Mapping[str, Any]] = trained_in
    vehicle_name: ClassVar[str] = SEDAN.vehicle_name
    full_name: ClassVar[str] = SEDAN.full_name
    tire: ClassVar[str | None] = SEDAN.tire
    chassis_half: ClassVar[tuple[float, float, float]] = SEDAN.chassis_half
    chassis_place: ClassVar[tuple[float, float, float]] = SEDAN.chassis_place
    camera_place: ClassVar[tuple[float, float, float]] = SEDAN.camera_place
    view_distance: ClassVar[float] = 10.0
    course_label: ClassVar[int] = 8
    preview: ClassVar[float] = 5.0

    @property
    def lane_half(self) -> float:
        """Distance from the middle of the lane at which the side of the car touches a barrier parallel to it [m]."""
        return 0.5 * WIDTH - self.chassis_half[1]

    def make_track(self, number: int) -> sw.scenery.Track:
        """Return a race track of about 100 m across."""
        return sw.scenery.race_track(number, width=WIDTH)

    def course_mesh(self, track: sw.scenery.Track, number: int) -> sw.scenery.VisualMesh:
        """Return road and barriers."""
        course = sw.scenery.race_course(track)
        return sw.scenery.joined([course.road, course.left.mesh, course.right.mesh])

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show grass too."""
        super().visuals(visuals)
        grass = visuals.texture(sw.sensors.ImageTexture(image=sw.scenery.ground_texture("grass"), metres=(8.0, 8.0)))
        visuals.add_plane(name="ground", texture=grass, color=(1.0, 1.0, 1.0), label=1, pose=sw.pose((0.0, 0.0, -0.01)))

    def setup(self) -> None:
        """Make the corners of the car, and record what is this task's own."""
        super().setup()
        where = [self._car, self.simulation.state.arrays, self.routes.tables, self.lap]
        fixed = [0.5 * WIDTH, corners(self.chassis_half, self.device), *where]
        self._find_outside = TensorFunction(find_corners_outside, fixed, [(torch.bool, ())], self.device)
        self._reward_offset = NamedRows(self, reward_lane_offset, ("aside",), self.config.rewards.aside, *where)

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``progress``, ``lap``, ``failure`` and how far ``aside`` of the middle the car drives."""
        return super().rewards() | self._reward_offset()

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``collision`` with a barrier, ``upset`` and ``lap``."""
        ends = super().terminations()
        return {"collision": ends["off_lane"], "upset": ends["upset"], "lap": ends["lap"]}
