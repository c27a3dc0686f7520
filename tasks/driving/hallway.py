"""Hallway: a model car drives a lap of an indoor corridor, between green cones on its left and red ones on its right.

After ``rccar_hallway-v0`` of gym-chrono: the width of the lane, the camera, and the start on a turn are the original's;
tracks and corridor are made by computing.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import torch
import warp as wp

import simwarp as sw

from ..framework.recorded_launches import WorldLaunch, filled, launch_over, share_over
from ..framework.registry import register
from ..framework.variants import Variant
from .driving_config import DrivingConfig
from .hallway_kernels import SpeedControl, begin_control, drive_on_held, hold_on, steer_held
from .lapping import LappingConfig, LappingRewards, LappingTask
from .training_defaults import BY_CAMERA, BY_IMAGES_ALONE

WIDTH = 1.1
"""Of the lane between the cones [m]."""
CORRIDOR = 2.2
"""Width of the corridor [m]."""
_CONE_APART = 0.8


@dataclasses.dataclass(frozen=True)
class HallwayRewards(LappingRewards):
    """Weights of the reward. The original has 10 per metre, and -200 for leaving."""

    progress: float = 0.2
    """Per metre along the lane."""
    lap: float = 2.0
    """A full lap, which ends the episode."""
    failure: float = -4.0
    """Leaving the lane, or turning over."""


@dataclasses.dataclass(frozen=True)
class HallwayConfig(LappingConfig):
    """Configuration of :class:`HallwayTask`."""

    dt: float = 0.002
    """Physics step [s]."""
    decimation: int = 50
    """Physics steps per control step: ten actions a second."""
    max_episode_steps: int = 2000
    """Control steps after which an episode is truncated at the latest; ``patience`` is what counts."""
    camera_fov: float = math.pi / 2.0
    """Horizontal field of view [rad]."""
    soil_spacing: float = 0.02
    """Of the soil's nodes [m]: the car's wheels are narrow."""
    pedals: bool = False
    """The policy works the pedals too; otherwise a controller holds the speed."""
    speed: float = 0.75
    """At which a lap is driven [m/s]."""
    red_left: bool = False
    """Red cones on the left and green ones on the right, not the other way round."""
    rewards: HallwayRewards = HallwayRewards()
    """Weights of the reward."""
    variant: Variant = Variant.SIMWARP
    """thesis: larger images alone, cones, rewards and time as in the thesis."""

    VARIANTS: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {
            "images_alone": True,
            "camera_width": 160,
            "camera_height": 90,
            "red_left": True,
            "max_episode_steps": 400,  # of the code: 40 s, less than a lap takes
            "action_rise_time": 0.65,
            "rewards.progress": 10.0,
            "rewards.lap": 0.0,
            "rewards.failure": -200.0,
        }
    }


@register("hallway")
class HallwayTask(LappingTask[HallwayConfig]):
    """Observations: ``camera`` (W, height, width, 3) uint8 and ``policy`` (W, 3): speed, yaw rate, steering; in the
    variant ``thesis`` the image alone; or, with ``obs`` state, ``policy`` (W, 17 or 18): place in the lane, points
    ahead, motion.

    Actions: steering (positive to the left); with ``pedals`` throttle (positive) or brake (negative) too.
    """

    summary: ClassVar[str] = "hallway: a model car drives a lap of a corridor between cones, by camera or by state"
    instruction: ClassVar[str] = "Drive a lap of the corridor between the green and the red cones."
    config_type: ClassVar[type[DrivingConfig]] = HallwayConfig
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 120,
        "num_envs": 256,
        "steps_per_iteration": 32,
        "network.init_std": 0.5,
        "ppo.gamma": 0.98,
        "ppo.entropy": 0.002,
    }
    training_by_obs: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "state": {"network.hidden": (64, 64)},
        "camera": BY_CAMERA,
    }
    training_by_variant: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {**BY_IMAGES_ALONE, "ppo.reward_scale": 0.02}
    }
    distilling: ClassVar[Mapping[str, Any]] = {"iterations": 60}
    # By camera it knows the one corridor, and the one light, that it learns: docs/results.md, "Tracks never seen"
    distilled_in: ClassVar[Mapping[str, Any]] = {"tracks": 16, "conditions": "random"}
    vehicle_name: ClassVar[str] = "artcar"
    full_name: ClassVar[str] = "artcar"
    tire: ClassVar[str | None] = "tmeasy"
    chassis_half: ClassVar[tuple[float, float, float]] = (0.28, 0.16, 0.05)
    chassis_place: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 0.0)
    camera_place: ClassVar[tuple[float, float, float]] = (-0.075, 0.0, 0.15)
    state_buffers: ClassVar[Mapping[str, str]] = {**LappingTask.state_buffers, "integral": "_integral"}
    course_label: ClassVar[int] = 10
    preview: ClassVar[float] = 0.5

    def __init__(
        self, config: HallwayConfig, num_worlds: int, *, device: str = "cpu", seed: int = 0, first_world: int = 0
    ) -> None:
        self.action_size = 2 if config.pedals else 1
        super().__init__(config, num_worlds, device=device, seed=seed, first_world=first_world)

    @property
    def lane_half(self) -> float:
        """The original's: the width over 2.75."""
        return WIDTH / 2.75

    def make_track(self, number: int) -> sw.scenery.Track:
        """Return a track around blocks of rooms."""
        return sw.scenery.indoor_track(number, width=WIDTH)

    def course_mesh(self, track: sw.scenery.Track, number: int) -> sw.scenery.VisualMesh:
        """Return walls, floor, ceiling and cones."""
        walls = sw.scenery.corridor(track, width=CORRIDOR, seed=self.config.first_track + number)
        left, right = (
            sw.scenery.arranged(sw.scenery.cone(color, height=0.25), track.marks(_CONE_APART, side)).mesh
            for side, color in zip(
                (1.0, -1.0), ("red", "green") if self.config.red_left else ("green", "red"), strict=True
            )
        )
        return sw.scenery.joined([walls.walls.mesh, walls.floor, walls.ceiling, left, right])

    def shot(self) -> sw.viewer.Shot:
        """From behind, as far as no wall comes between in a bend."""
        target, eye = (0.4, 0.0, 0.05), (-1.55, -0.25, 0.85)
        return sw.viewer.Shot(body=self.parts.chassis, target=target, eye=eye, fov=1.2, calm=0.15, turns=True)

    def lighting(self) -> sw.sensors.Lighting:
        """Light from all sides, a little more from above, and no sun."""
        return sw.sensors.Lighting(suns=(), ambient=(0.9, 0.88, 0.84), ambient_below=(0.45, 0.44, 0.42))

    def setup(self) -> None:
        """Make the speed controller's memory."""
        super().setup()
        config, state, car = self.config, self.simulation.state.arrays, self._car
        integral = wp.zeros(self.num_worlds, dtype=float, device=str(self.device))
        self._integral = sw.to_torch(integral)
        self._control = filled(SpeedControl, speed=config.speed, dt=config.dt, integral=integral)
        self._begin_control = launch_over(self, begin_control, self._every_world, self._control)
        self._steer_held = launch_over(self, steer_held, self.action, self._control, state, car)
        self._hold_on = launch_over(self, hold_on, self._control, state, car)

    def start(self, world_mask: torch.Tensor) -> None:
        """In the lane, at rest."""
        super().start(world_mask)
        self._begin_control.on(world_mask)

    def physics_launches(self) -> Sequence[WorldLaunch]:
        """Return the action's way, steering, and the pedals by policy or controller."""
        if self.config.pedals:
            return super().physics_launches()
        path, state = self._path, self.simulation.state.arrays
        arguments = [self._control, state, path.reach, path.request, self.action, self._car, self._drive]
        return [share_over(self.simulation, drive_on_held, *arguments)]

    def begin_step(self) -> None:
        """Count physics steps anew."""
        super().begin_step()
        self._physics_step = 0

    def apply(self, action: torch.Tensor) -> None:
        """Steer; pedals as the policy says, or as the speed controller does."""
        if self.config.pedals:
            super().apply(action)
        else:
            self._steer_held.on(action)

    def after_physics(self) -> None:
        """Let the controller act before the next physics step, where `apply` does not come again."""
        super().after_physics()
        self._physics_step += 1
        if not self._path.limited and not self.config.pedals and self._physics_step < self.config.decimation:
            self._hold_on.launch()
