"""Obstacle avoidance: a truck drives along a straight road past three pillars that stand anywhere across it.

After ``camera_obstacle_avoidance-v0`` of gym-chrono: the road, the pillars, the camera and the end
are the original's.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import (
    ComputedRows,
    Drawing,
    Ge,
    Le,
    Line,
    NamedRows,
    Positive,
    RewardWeights,
    Variant,
    filled,
    launch_over,
    register,
)
from simwarp.tasks.driving import (
    VEHICLE_ARRAYS,
    DrivingConfig,
    DrivingTask,
    RangeFan,
    VehicleChoiceConfig,
    outline,
)

from .obstacle_avoidance_kernels import (
    Road,
    begin_way,
    compute_road_rewards,
    draw_pillars,
    end_way,
    measure_road_distance,
    measure_way,
    observe_way,
)
from .training_defaults import BY_IMAGES_ALONE

PILLARS_X = (25.0, 50.0, 75.0)
PILLAR_HALF = (1.0, 1.0, 5.0)
ROAD_HALF_WIDTH = 7.5
PILLAR_COLOR = (0.04, 0.04, 0.7)
_REACH, _RAYS, _FAN = 30.0, 25, math.radians(150.0)


@dataclasses.dataclass(frozen=True)
class ObstacleAvoidanceRewards(RewardWeights):
    """Weights of the reward."""

    failure: float = -1.0
    """Touching a pillar or leaving the road: less than the way to the first pillar earns, or a truck that cannot see
    yet learns to stand still. The original has no such term."""
    progress: float = 0.1
    """Per metre nearer to the end."""
    goal: float = 9.0
    """At the end. The original has 33 per metre and 3000 at the end: the same ratio."""


@dataclasses.dataclass(frozen=True)
class ObstacleAvoidanceConfig(VehicleChoiceConfig):
    """Configuration of :class:`ObstacleAvoidanceTask`."""

    dt: float = 0.003
    """Physics step [s]."""
    decimation: int = 33
    """Physics steps per control step: ten actions a second."""
    max_episode_steps: int = 200
    """Control steps after which an episode is truncated: 20 s."""
    spread: Annotated[float, Ge(0.0), Le(ROAD_HALF_WIDTH)] = 5.0
    """Pillars stand within this of the middle of the road [m]."""
    end: Positive = 100.0
    """Distance along the road that is to be driven [m]."""
    rewards: ObstacleAvoidanceRewards = ObstacleAvoidanceRewards()
    """Weights of the reward."""
    throttle_alone: bool = False
    """The second action is throttle from end to end, none at -1, and there is no brake."""
    variant: Variant = Variant.SIMWARP
    """thesis: images alone, throttle without a brake, and rewards as in the thesis."""

    VARIANTS: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {
            "images_alone": True,
            "throttle_alone": True,
            "action_rise_time": (1.0, 0.25),  # of the code: 1 s, and 0.5 s from no throttle to all of it
            "rewards.failure": 0.0,
            "rewards.progress": 0.1 / 0.003,  # of the code: 0.1 times the way over its physics step
            "rewards.goal": 3000.0,
        }
    }


@register("obstacle-avoidance")
class ObstacleAvoidanceTask(DrivingTask[ObstacleAvoidanceConfig]):
    """Observations: ``camera`` (W, height, width, 3) uint8 and ``policy`` (W, 3): speed, yaw rate, steering; in the
    variant ``thesis`` the image alone; or, with ``obs`` state, ``policy`` (W, 38): place across the road, heading,
    motion, inputs, the next two pillars, and ranges to pillars in a fan of directions.

    Actions: steering (positive to the left), and throttle (positive) or brake (negative).
    """

    summary: ClassVar[str] = "obstacle avoidance: a truck passes three pillars on a road, by camera or by state"
    instruction: ClassVar[str] = "Drive along the road past the pillars."
    config_type: ClassVar[type[DrivingConfig]] = ObstacleAvoidanceConfig
    per_world: ClassVar[tuple[str, ...]] = ("shape_x", *VEHICLE_ARRAYS)
    success_reasons: ClassVar[frozenset[str]] = frozenset({"goal"})
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 60,
        "num_envs": 256,
        "steps_per_iteration": 32,
        "network.init_std": 0.5,
        "ppo.gamma": 0.99,
        "ppo.entropy": 0.002,
    }
    training_by_variant: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {**BY_IMAGES_ALONE, "network.init_mean": (0.0, 0.0), "ppo.reward_scale": 0.003}
    }
    distilling: ClassVar[Mapping[str, Any]] = {"iterations": 40}
    # At no more cost it sees by dusk and in fog too: docs/results.md, "Driving: light, fog, delays, other vehicles"
    distilled_in: ClassVar[Mapping[str, Any]] = {"conditions": "random"}

    @property
    def throttle_alone(self) -> bool:
        """The second action is throttle from end to end."""
        return self.config.throttle_alone

    def build_world(self, builder: sw.ModelBuilder) -> None:
        """Three pillars; a reset moves them across the road."""
        self.pillars = [
            builder.add_shape_box(
                sw.WORLD, half=PILLAR_HALF, pose=sw.pose((x, 0.0, PILLAR_HALF[2])), name=f"pillar_{index}"
            )
            for index, x in enumerate(PILLARS_X)
        ]

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Blue pillars on a grey road; nothing beside it."""
        super().visuals(visuals)
        for pillar in self.pillars:
            visuals.show(pillar, color=PILLAR_COLOR, label=1)
        visuals.add_box(
            sw.WORLD, half=(125.0, ROAD_HALF_WIDTH, 5.0), pose=sw.pose((75.0, 0.0, -5.0)), name="road",
            color=(0.3, 0.3, 0.3),
        )  # fmt: skip

    def setup(self) -> None:
        """Make buffers, and record what a step launches."""
        super().setup()
        config, model, worlds, device = self.config, self.simulation.model, self.num_worlds, self.device
        fan = RangeFan(_RAYS, _FAN, _REACH, device)
        road = filled(
            Road,
            end=config.end,
            spread=config.spread,
            progress_weight=config.rewards.progress,
            goal_weight=config.rewards.goal,
            failure_weight=config.rewards.failure,
            reach=_REACH,
            radius=math.hypot(*PILLAR_HALF[:2]),
            direction=fan.direction,
            aside=self.random.stream("pillars"),
            first=self.pillars[0],
            shape_x=model.shape_x,
            before=wp.zeros(worlds, dtype=wp.float64, device=str(device)),
        )
        self._pillar_x = sw.to_torch(model.shape_x)[:, self.pillars[0] : self.pillars[-1] + 1]
        car, drive, state = self._car, self._drive, self.simulation.state.arrays
        self._draw = launch_over(self, draw_pillars, self._every_world, road, self.random.draws)
        self._begin_way = launch_over(self, begin_way, road, car, state)
        self._measure = ComputedRows(self, measure_way, car, state, self.action, width=3)
        self._observe = ComputedRows(self, observe_way, road, car, state, self.action, width=13 + _RAYS)
        moving = [road, car, drive, state]
        self._compute_rewards = NamedRows(self, compute_road_rewards, ("failure", "progress", "goal"), *moving)
        ends = ("goal", "collision", "off_road")
        self._find_ends = NamedRows(self, end_way, ends, *moving, dtype=torch.bool)
        self._measure_distance = NamedRows(self, measure_road_distance, ("distance",), car, state)

    def begin_step(self) -> None:
        """Store the distance to the end."""
        super().begin_step()
        self._begin_way.launch()

    def measured(self) -> torch.Tensor:
        """Return (W, 3): speed, yaw rate, steering; the buffer itself."""
        return self._measure()

    def exact_state(self) -> torch.Tensor:
        """Return (W, 38): place across the road, heading, motion, inputs, the next two pillars, ranges to pillars; the
        buffer itself.
        """
        return self._observe()

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return the penalty of a ``failure``, ``progress`` towards the end, and the ``goal``'s bonus."""
        return self._compute_rewards()

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``goal``, ``collision`` with a pillar, and ``off_road``."""
        return self._find_ends()

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Pillars anywhere across the road."""
        self._draw.on(world_mask)

    def start(self, world_mask: torch.Tensor) -> None:
        """Stand at the beginning of the road, where the simulation's initial state is."""

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the ``distance`` along the road [m]."""
        return self._measure_distance()

    def drawing(self) -> Drawing:
        """Draw road, pillars and truck from above, and the line to reach."""
        point, heading = self.pose()
        worlds = self.num_worlds
        lines = []
        for y in (-ROAD_HALF_WIDTH, ROAD_HALF_WIDTH):
            edge = point.new_tensor([[0.0, y, 0.0], [self.config.end, y, 0.0]]).float()
            lines.append(Line(edge.expand(worlds, 2, 3), "0.6", 1.0))
        finish = point.new_tensor([[self.config.end, y, 0.0] for y in (-ROAD_HALF_WIDTH, ROAD_HALF_WIDTH)]).float()
        lines.append(Line(finish.expand(worlds, 2, 3), "tab:green", 3.0))
        corner = point.new_tensor([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]).float()
        for pillar in range(len(PILLARS_X)):
            foot = self._pillar_x[:, pillar, :2].float().unsqueeze(1) + corner
            lines.append(Line(torch.nn.functional.pad(foot, (0, 1)), "tab:blue", 2.0, only_maps=True))
        lines.append(Line(outline(point, heading, self.chassis_half), "tab:orange", 2.0, only_maps=True))
        return Drawing(tuple(lines), ((-5.0, self.config.end + 5.0), (-9.0, 9.0)))
