"""Off-road navigation: a utility vehicle drives to a goal across open ground with rocks and trees, or over hills.

After ``off_road_gator-v0`` and ``-v3`` of gym-chrono: start and goal on a circle, ten actions a second, twenty seconds.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import torch

from simwarp.tasks import Ge, Gt, Le, NotNegative

from ..framework.config import require
from ..framework.drawing import Drawing, Line
from ..framework.frames import to_heading
from ..framework.registry import register
from .base import CHASSIS_GROUP, VEHICLE_ARRAYS, DrivingConfig, DrivingTask, Frame, outline
from .hills import Hills
from .obstacles import Kind, Obstacles
from .ranging import RangeFan

if TYPE_CHECKING:
    from simwarp import Model, ModelBuilder
    from simwarp.sensors import Scene, Visuals

_FIELDS = 8
_SIDE = 160.0
_SPEED = 8.0
_REACH = 20.0
_RAYS = 25
_FAN = math.radians(240.0)
_TRIES = 6
GROUND_TEXTURES = ("grass", "dirt", "gravel", "sand")


@dataclasses.dataclass(frozen=True)
class OffRoadConfig(DrivingConfig):
    """Configuration of :class:`OffRoadTask`."""

    dt: float = 0.0025
    """Physics step [s]."""
    decimation: int = 40
    """Physics steps per control step: ten actions a second."""
    max_episode_steps: int = 200
    """Control steps after which an episode is truncated: 20 s."""
    camera_fov: float = math.pi / 2.0
    """Horizontal field of view [rad]."""
    obstacles: Annotated[int, Ge(0), Le(500)] = 30
    """Rocks, bushes and trees."""
    obstacle_scale: Annotated[float, Gt(0.0), Le(4.0)] = 1.0
    """Factor of their sizes."""
    hills: NotNegative = 0.0
    """Height of the hills as a share of ``hill_height``; 0: flat ground."""
    hill_height: Annotated[float, Gt(0.0), Le(5.0)] = 3.0
    """Greatest height above or depth below the middle at ``hills`` 1 [m]."""
    half: float = 40.0
    """Obstacles stand in a square of twice this side [m]."""
    border: float = 60.0
    """An episode ends where the vehicle is farther than this from the middle, along x or y [m]."""
    radius: float = 40.0
    """Of the circle on which start and goal lie [m]."""
    goal_radius: float = 10.0
    """Distance at which the goal is reached [m]."""
    clearance: float = 15.0
    """No obstacle stands nearer to start or goal [m]."""
    goal_frame: Frame = Frame.VEHICLE
    """Axes in which the goal is observed."""
    progress_weight: float = 0.1
    """Reward per metre nearer to the goal."""
    goal_weight: float = 5.0
    """Reward at the goal. The original pays 1 per metre, 2500 at the goal, and takes 250 for a failure."""
    failure_weight: float = 5.0
    """Taken for touching an obstacle, leaving the map or turning over."""
    change_weight: float = 0.0
    """Taken per change of the action; the original's later version has half its metre."""

    def validate(self) -> None:
        """Check sizes."""
        super().validate()
        require(self.hills * self.hill_height <= 10.0, self, "hills", "at most 10 m / hill_height")
        require(0.0 < self.radius < self.border <= 0.45 * _SIDE, self, "border", f"in (radius, {0.45 * _SIDE:g}] m")
        require(0.0 < self.half <= self.border, self, "half", "in (0, border]")
        require(0.0 < self.goal_radius < self.radius, self, "goal_radius", "in (0, radius)")
        require(2.0 <= self.clearance < self.radius, self, "clearance", "in [2, radius) m")


@register("off-road")
class OffRoadTask(DrivingTask[OffRoadConfig]):
    """Observations: ``camera`` (W, height, width, 3) uint8 and ``policy`` (W, 6): goal, heading and speed as GPS and
    IMU tell them; or, with ``obs`` state, ``policy`` (W, 38): exact goal, motion, tilt, and ranges to obstacles.

    Actions: steering (positive to the left), and throttle (positive) or brake (negative).
    """

    summary: ClassVar[str] = "off-road: a utility vehicle drives to a goal between rocks and trees, over hills"
    config_type: ClassVar[type[DrivingConfig]] = OffRoadConfig
    per_world: ClassVar[tuple[str, ...]] = (*VEHICLE_ARRAYS, *Obstacles.model_arrays)
    success_reasons: ClassVar[frozenset[str]] = frozenset({"goal"})
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 120,
        "num_envs": 256,
        "steps_per_iteration": 32,
        "network.init_std": 0.6,
        "ppo.gamma": 0.99,
        "ppo.entropy": 0.002,
    }
    vehicle_name: ClassVar[str] = "gator"
    full_name: ClassVar[str] = "gator"
    tire: ClassVar[str | None] = "tmeasy"
    chassis_half: ClassVar[tuple[float, float, float]] = (1.35, 0.75, 0.35)
    chassis_place: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 0.2)
    navigates: ClassVar[bool] = True
    camera_place: ClassVar[tuple[float, float, float]] = (0.65, 0.0, 0.75)

    _texture: torch.Tensor | None = None

    # ---- the world -----------------------------------------------------------------------------------------------

    def build_world(self, builder: ModelBuilder) -> None:
        """Slots for obstacles; the ground, if it is not flat."""
        from simwarp.scenery import ROCKS, bush, rock, tree

        kinds = [Kind(rock(kind, seed), (0.6, 1.3)) for seed, kind in enumerate(ROCKS)]
        kinds += [Kind(bush("round", 0), (0.7, 1.4))]
        kinds += [Kind(tree(kind, 0), (0.6, 1.0)) for kind in ("spruce", "oak")]
        self.obstacles = Obstacles(kinds, max(1, self.config.obstacles), group=1, mask=CHASSIS_GROUP)
        self.obstacles.build(builder)
        self.hills = Hills(_FIELDS, _SIDE) if self.config.hills > 0.0 else None
        if self.hills is not None:
            self.hills.build(builder)

    def visuals(self, visuals: Visuals) -> None:
        """Pictures of the obstacles, and textured ground."""
        import simwarp as sw
        from simwarp.scenery import ground_texture
        from simwarp.sensors import ImageTexture

        super().visuals(visuals)
        self.obstacles.visuals(visuals)
        self._textures = [
            visuals.texture(ImageTexture(image=ground_texture(kind), metres=(6.0, 6.0))) for kind in GROUND_TEXTURES
        ]
        white = (1.0, 1.0, 1.0)
        if self.hills is None:
            self._ground = visuals.add_plane(
                name="ground", pose=sw.pose(), color=white, texture=self._textures[0], label=1
            )
        else:
            visuals.show(self.hills.shape, color=white, texture=self._textures[0], label=1)
            self._ground = visuals.index_of(self.hills.shape)

    def seen_per_world(self) -> Sequence[str]:
        """Obstacles and textures differ."""
        return (*Obstacles.scene_arrays, "texture")

    def ground(self, model: Model) -> Any:
        """Flat, or hills."""
        return None if self.hills is None else self.hills.terrain(model)

    def setup(self) -> None:
        """Make views and buffers."""
        super().setup()
        model = self.simulation.model
        self.obstacles.bind(model)
        if self.hills is not None:
            self.hills.bind(model)
        worlds = self.num_worlds
        self.goal = torch.zeros(worlds, 2, dtype=torch.float64, device=self.device)
        self._before = torch.zeros(worlds, dtype=torch.float64, device=self.device)
        self._last_action = torch.zeros(worlds, self.action_size, device=self.device)
        self._fan = RangeFan(_RAYS, _FAN, _REACH, self.device)

    def bind_scene(self, scene: Scene) -> None:
        """Make views of obstacles and of the ground's texture."""
        from simwarp import to_torch

        self.obstacles.bind_scene(scene)
        self._texture = to_torch(scene.texture)[:, self._ground]
        self._known_textures = torch.tensor(self._textures, dtype=torch.int32, device=self.device)

    # ---- an episode ----------------------------------------------------------------------------------------------

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Draw start, goal, ground and obstacles."""
        config, random = self.config, self.random
        start_angle = random.uniform("start", -math.pi, math.pi).squeeze(1)
        goal_angle = start_angle + math.pi + random.uniform("goal", -0.5 * math.pi, 0.5 * math.pi).squeeze(1)
        start, goal = (
            config.radius * torch.stack([angle.cos(), angle.sin()], dim=1) for angle in (start_angle, goal_angle)
        )
        self.goal.copy_(torch.where(world_mask.unsqueeze(1), goal.double(), self.goal))
        if self.hills is not None:
            field = random.uniform("hills", 0.0, _FIELDS).squeeze(1).long()
            rise = (2.0 * self.difficulty - 1.0).clamp(0.0, 1.0) * config.hills * config.hill_height
            self.hills.choose(world_mask, field, rise)
        self._place_obstacles(world_mask, start, goal)
        if self._texture is not None:
            chosen = random.uniform("texture", 0.0, len(self._textures)).squeeze(1).long()
            self._texture.copy_(torch.where(world_mask, self._known_textures[chosen], self._texture))
        self._start, self._start_heading = start, start_angle + math.pi

    def start(self, world_mask: torch.Tensor) -> None:
        """On the circle, facing its middle."""
        start, heading = self._start, self._start_heading
        height, normal = torch.zeros_like(heading), None
        if self.hills is not None:
            height, normal = self.hills.height(start.unsqueeze(1)).squeeze(1), self.hills.normal(start)
        self.place_vehicle(world_mask, torch.cat([start, height.unsqueeze(1)], dim=1), heading, normal)
        self._last_action.masked_fill_(world_mask.unsqueeze(1), 0.0)

    def _place_obstacles(self, world_mask: torch.Tensor, start: torch.Tensor, goal: torch.Tensor) -> None:
        """Anywhere in the square, but far enough from start and goal: the first of some tries that is."""
        config, random, count = self.config, self.random, self.obstacles.count
        kind, scale = self.obstacles.draw_kinds(random)
        scale = scale * config.obstacle_scale
        tries = random.uniform("places", -config.half, config.half, count * _TRIES * 2)
        tries = tries.view(self.num_worlds, count, _TRIES, 2)
        clear = config.clearance + self.obstacles.reach(kind, scale).unsqueeze(2)
        free = torch.ones_like(tries[..., 0], dtype=torch.bool)
        for point in (start, goal):
            free &= (tries - point.view(-1, 1, 1, 2)).norm(dim=3) > clear
        chosen = free.float().argmax(dim=2)
        place = tries.gather(2, chosen.view(*chosen.shape, 1, 1).expand(-1, -1, 1, 2)).squeeze(2)
        wanted = config.obstacles * (2.0 * self.difficulty).clamp(max=1.0)
        present = free.any(dim=2) & (torch.arange(count, device=self.device) < wanted.round().unsqueeze(1))
        height = torch.zeros_like(scale) if self.hills is None else self.hills.height(place)
        sunk = 0.1 * self.obstacles.tallness(kind, scale)
        heading = random.uniform("obstacle headings", -math.pi, math.pi, count)
        self.obstacles.fill(world_mask, place, height - sunk, heading, kind, scale, present)

    def begin_step(self) -> None:
        """Store the distance to the goal and the previous action."""
        super().begin_step()
        self._before.copy_(self._distance())
        self._last_action.copy_(self.action)

    def _distance(self) -> torch.Tensor:
        """(W,) to the goal [m]."""
        point, _ = self.pose()
        return (self.goal - point[:, :2]).norm(dim=1)

    # ---- what a policy sees --------------------------------------------------------------------------------------

    def measured(self) -> torch.Tensor:
        """Return (W, 6): goal, heading and speed by GPS and IMU."""
        assert self.navigation is not None
        return self._goal_seen(*self.navigation.estimate())

    def exact_state(self) -> torch.Tensor:
        """Return goal, heading, motion, tilt, inputs, ranges to obstacles, and the distance to the goal."""
        point, heading = self.pose()
        motion = self.motion()
        goal = self._goal_seen(point[:, :2], heading, motion[:, 0])
        away = self.obstacles.place - point[:, :2].float().unsqueeze(1)
        ranges = self._fan.ranges(to_heading(away, heading), self.obstacles.radius)
        tilt = self.tilt()
        own = torch.cat([goal, motion[:, 1:], tilt, self.action, 1.0 - ranges / _REACH], dim=1)
        return torch.cat([own, (self._distance() / self.config.radius).float().unsqueeze(1)], dim=1)

    def _goal_seen(self, place: torch.Tensor, heading: torch.Tensor, speed: torch.Tensor) -> torch.Tensor:
        """(W, 6): goal (x, y), direction to it, heading (sine, cosine), speed; scaled."""
        away = (self.goal - place).float()
        local = to_heading(away.unsqueeze(1), heading).squeeze(1)
        seen = local if self.config.goal_frame is Frame.VEHICLE else away
        turn = torch.atan2(seen[:, 1], seen[:, 0]) / math.pi
        return torch.cat(
            [
                seen / self.config.radius,
                torch.stack([turn, heading.sin(), heading.cos(), speed / _SPEED], dim=1),
            ],
            dim=1,
        )

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``progress``, ``goal``, ``failure`` and, if it counts, ``change`` of the action."""
        config = self.config
        terms = {
            "progress": (config.progress_weight * (self._before - self._distance())).float(),
            "goal": config.goal_weight * self._at_goal().float(),
            "failure": -config.failure_weight * (self._hit | self._off_map() | self.upset()).float(),
        }
        if config.change_weight > 0.0:
            terms["change"] = -config.change_weight * (self.action - self._last_action).norm(dim=1)
        return terms

    def _at_goal(self) -> torch.Tensor:
        return (self._distance() < self.config.goal_radius) & ~self._hit & ~self.upset()

    def _off_map(self) -> torch.Tensor:
        point, _ = self.pose()
        return (point[:, :2].abs() > self.config.border).any(dim=1)

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``goal``, ``collision`` with an obstacle, ``off_map`` and ``upset``."""
        return {
            "goal": self._at_goal(), "collision": self._hit.clone(), "off_map": self._off_map(), "upset": self.upset(),
        }  # fmt: skip

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the ``distance`` to the goal [m], and how many obstacles there are: the rest found no room."""
        present = (self.obstacles.radius >= 0.0).sum(dim=1)
        return {"distance": self._distance().float(), "obstacles_present": present.float()}

    # ---- pictures ------------------------------------------------------------------------------------------------

    def drawing(self) -> Drawing:
        """Draw obstacles, goal, vehicle and the straight way to the goal, on the ground."""
        point, heading = self.pose()
        angle = torch.linspace(0.0, 2.0 * math.pi, 13, device=self.device)
        ring = torch.stack([angle.cos(), angle.sin()], dim=1)
        goal = self.goal.float().unsqueeze(1) + self.config.goal_radius * ring
        share = torch.linspace(0.0, 1.0, 50, device=self.device).unsqueeze(1)
        way = point[:, None, :2] + share * (self.goal - point[:, :2]).unsqueeze(1)
        lines = [Line(torch.nn.functional.pad(row.float(), (0, 1)), "tab:green") for row in (goal, way)]
        lines += self.obstacles.rings()
        lines.append(Line(outline(point, heading, self.chassis_half), "tab:orange", 2.0))
        if self.hills is not None:
            for line in lines:
                line.points[..., 2] = self.hills.height(line.points[..., :2].double()).float()
        side = self.config.border
        return Drawing(tuple(lines), ((-side, side), (-side, side)))
