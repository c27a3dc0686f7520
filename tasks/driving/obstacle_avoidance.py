"""Obstacle avoidance: a truck drives along a straight road past three pillars that stand anywhere across it.

After ``camera_obstacle_avoidance-v0`` of gym-chrono: the road, the pillars, the camera and the end
are the original's.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import torch

from simwarp.tasks import Ge, Le, Positive

from ..framework.drawing import Drawing, Line
from ..framework.frames import to_heading
from ..framework.registry import register
from .base import VEHICLE_ARRAYS, DrivingConfig, DrivingTask, outline
from .ranging import RangeFan

if TYPE_CHECKING:
    from simwarp import ModelBuilder
    from simwarp.sensors import Visuals

PILLARS_X = (25.0, 50.0, 75.0)
PILLAR_HALF = (1.0, 1.0, 5.0)
ROAD_HALF_WIDTH = 7.5
TRUCK_HALF_WIDTH = 1.2
PILLAR_COLOR = (0.04, 0.04, 0.7)
_LENGTHS = 25.0
_REACH, _RAYS, _FAN = 30.0, 25, math.radians(150.0)
_SPEED = 10.0


@dataclasses.dataclass(frozen=True)
class ObstacleAvoidanceConfig(DrivingConfig):
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
    progress_weight: float = 0.1
    """Reward per metre nearer to the end."""
    bonus: float = 9.0
    """Reward at the end. The original pays 33 per metre and 3000 at the end: the same ratio."""
    failure_weight: float = 1.0
    """Taken for touching a pillar or leaving the road: less than the way to the first pillar pays, or a truck that
    cannot see yet learns to stand still. The original takes nothing."""

    def validate(self) -> None:
        """Check sizes."""
        super().validate()


@register("obstacle-avoidance")
class ObstacleAvoidanceTask(DrivingTask[ObstacleAvoidanceConfig]):
    """Observations: ``camera`` (W, height, width, 3) uint8 and ``policy`` (W, 3): speed, yaw rate, steering; or, with
    ``obs`` state, ``policy`` (W, 38): place across the road, heading, motion, inputs, the next two pillars, and ranges
    to pillars in a fan of directions.

    Actions: steering (positive to the left), and throttle (positive) or brake (negative).
    """

    summary: ClassVar[str] = "obstacle avoidance: a truck passes three pillars on a road, by camera or by state"
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

    def build_world(self, builder: ModelBuilder) -> None:
        """Three pillars; a reset moves them across the road."""
        import simwarp as sw

        self.pillars = [
            builder.add_shape_box(
                sw.WORLD, half=PILLAR_HALF, pose=sw.pose((x, 0.0, PILLAR_HALF[2])), name=f"pillar_{index}"
            )
            for index, x in enumerate(PILLARS_X)
        ]

    def visuals(self, visuals: Visuals) -> None:
        """Blue pillars on a grey road; nothing beside it."""
        import simwarp as sw

        super().visuals(visuals)
        for pillar in self.pillars:
            visuals.show(pillar, color=PILLAR_COLOR, label=1)
        visuals.add_box(
            sw.WORLD, half=(125.0, ROAD_HALF_WIDTH, 5.0), pose=sw.pose((75.0, 0.0, -5.0)), name="road",
            color=(0.3, 0.3, 0.3),
        )  # fmt: skip

    def setup(self) -> None:
        """Make views of the pillars."""
        from simwarp import to_torch

        super().setup()
        self._shape_x = to_torch(self.simulation.model.shape_x)
        first = self.pillars[0]
        self._pillar_x = self._shape_x[:, first : first + len(self.pillars)]
        self._before = torch.zeros(self.num_worlds, dtype=torch.float64, device=self.device)
        self._fan = RangeFan(_RAYS, _FAN, _REACH, self.device)
        radius = math.hypot(*PILLAR_HALF[:2])
        self._pillar_radius = torch.full((self.num_worlds, len(PILLARS_X)), radius, device=self.device)
        self._far = torch.tensor([2.0 * _LENGTHS, 0.0], device=self.device)

    def begin_step(self) -> None:
        """Store the distance to the end."""
        super().begin_step()
        self._before.copy_(self._distance())

    def _distance(self) -> torch.Tensor:
        """(W,) from the end of the road, at its middle [m]."""
        point, _ = self.pose()
        return torch.hypot(self.config.end - point[:, 0], point[:, 1])

    def measured(self) -> torch.Tensor:
        """Return (W, 3): speed, yaw rate, steering."""
        motion = self.motion()
        return torch.stack([motion[:, 0] / _SPEED, motion[:, 2], self.action[:, 0]], dim=1)

    def exact_state(self) -> torch.Tensor:
        """Return (W, 38): place across the road, heading, motion, inputs, the next two pillars, ranges to pillars."""
        motion = self.motion()
        point, heading = self.pose()
        passed = (self._pillar_x[..., 0] < point[:, :1] - 3.0).sum(dim=1, keepdim=True)
        place = to_heading((self._pillar_x[..., :2] - point[:, :2].unsqueeze(1)).float(), heading)
        places = torch.cat([place, self._far.expand(self.num_worlds, 2, 2)], dim=1)
        index = (passed + torch.arange(2, device=self.device)).unsqueeze(2).expand(-1, -1, 2)
        ranges = self._fan.ranges(place, self._pillar_radius)
        following = places.gather(1, index) / _LENGTHS
        return torch.cat(
            [
                self.measured(),
                motion[:, 1:2],
                self.action[:, 1:],
                (point[:, 1:2] / ROAD_HALF_WIDTH).float(),
                heading.sin().unsqueeze(1),
                heading.cos().unsqueeze(1),
                ((self.config.end - point[:, :1]) / self.config.end).float(),
                following.flatten(1),
                1.0 - ranges / _REACH,
            ],
            dim=1,
        )

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``progress`` towards the end, the ``goal``'s bonus, and what a ``failure`` costs."""
        return {
            "failure": -self.config.failure_weight * (self._hit | self._off_road()).float(),
            "progress": (self.config.progress_weight * (self._before - self._distance())).float(),
            "goal": self.config.bonus * self._at_end().float(),
        }

    def _at_end(self) -> torch.Tensor:
        point, _ = self.pose()
        return (point[:, 0] > self.config.end) & ~self._hit & ~self._off_road()

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``goal``, ``collision`` with a pillar, and ``off_road``."""
        return {
            "goal": self._at_end(),
            "collision": self._hit.clone(),
            "off_road": self._off_road(),
        }

    def _off_road(self) -> torch.Tensor:
        """(W,) bool: beside the road, or turned over."""
        point, _ = self.pose()
        return (point[:, 1].abs() + TRUCK_HALF_WIDTH > ROAD_HALF_WIDTH) | self.upset()

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Pillars anywhere across the road."""
        spread = self.config.spread
        aside = self.random.uniform("pillars", -spread, spread, size=len(PILLARS_X)).double()
        self._pillar_x[..., 1] = torch.where(world_mask.unsqueeze(1), aside, self._pillar_x[..., 1])

    def start(self, world_mask: torch.Tensor) -> None:
        """Stand at the beginning of the road, where the simulation's initial state is."""

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the ``distance`` along the road [m]."""
        point, _ = self.pose()
        return {"distance": point[:, 0].float()}

    def drawing(self) -> Drawing:
        """Draw road, pillars and truck from above."""
        point, heading = self.pose()
        worlds = self.num_worlds
        lines = []
        for y in (-ROAD_HALF_WIDTH, ROAD_HALF_WIDTH):
            edge = point.new_tensor([[0.0, y, 0.0], [self.config.end, y, 0.0]]).float()
            lines.append(Line(edge.expand(worlds, 2, 3), "0.6", 1.0))
        corner = point.new_tensor([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]).float()
        for pillar in range(len(PILLARS_X)):
            foot = self._pillar_x[:, pillar, :2].float().unsqueeze(1) + corner
            lines.append(Line(torch.nn.functional.pad(foot, (0, 1)), "tab:blue", 2.0))
        lines.append(Line(outline(point, heading, self.chassis_half), "tab:orange", 2.0))
        return Drawing(tuple(lines), ((-5.0, self.config.end + 5.0), (-9.0, 9.0)))
