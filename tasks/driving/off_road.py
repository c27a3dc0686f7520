"""Off-road navigation: a utility vehicle drives to a goal across open ground with rocks and trees, or over hills.

After ``off_road_gator-v0`` and ``-v3`` of gym-chrono: start and goal on a circle, ten actions a second, twenty seconds.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar

import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import Ge, Gt, Le, NotNegative

from ..framework.config import RewardWeights, require
from ..framework.drawing import Drawing, Line
from ..framework.recorded_launches import ComputedRows, NamedRows, TensorLaunch, fill, filled, launch_over, zeros_of
from ..framework.registry import register
from ..framework.variants import Variant
from .base import CHASSIS_GROUP, VEHICLE_ARRAYS, DrivingTask
from .driven_vehicles import GATOR, VehicleChoiceConfig
from .driving_config import DrivingConfig, Frame
from .hills import Hills
from .hills_kernels import HillTables
from .obstacles import ObstacleKind, Obstacles
from .off_road_kernels import (
    Ground,
    Trip,
    begin_trip,
    compute_trip_rewards,
    draw_ground,
    draw_obstacles,
    end_trip,
    measure_trip,
    observe_trip,
    start_trip,
    write_trip_metrics,
)
from .outlines import outline
from .ranging import RangeFan
from .training_defaults import PEDALS_BY_CAMERA

FIELDS = 8
"""Of hills, of which each episode shows one."""
SIDE = 160.0
"""Of each of them [m]."""
_REACH = 20.0
_RAYS = 25
_FAN = math.radians(240.0)
_POLE = 8.0
"""Height of the pole that shows where the goal is [m]."""
TERMS = ("progress", "goal", "failure", "change", "timeout")
OPTIONAL = ("change", "timeout")
"""Terms of the reward that are only there where they count."""
GROUND_TEXTURES = ("grass", "dirt", "gravel", "sand")


@dataclasses.dataclass(frozen=True)
class OffRoadRewards(RewardWeights):
    """Weights of the reward."""

    progress: float = 0.1
    """Per metre nearer to the goal."""
    goal: float = 5.0
    """At the goal. The original has 1 per metre, 2500 at the goal, and -250 for a failure."""
    failure: float = -5.0
    """Touching an obstacle, leaving the map or turning over."""
    change: float = 0.0
    """Per change of the action; 0: there is no such term. The original's later version has half its metre."""
    timeout: float = 0.0
    """Running out of time, which then ends the episode; 0: it is cut off, and there is no such term."""


@dataclasses.dataclass(frozen=True)
class OffRoadConfig(VehicleChoiceConfig):
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
    varied: bool = False
    """Every episode has a number of obstacles and a height of hills of its own, uniform from none up to these."""
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
    raw: bool = False
    """By camera observe five numbers [m, rad, m/s], the heading as an angle, in place of six of the order of 1."""
    any_heading: bool = False
    """Start with any heading, not towards the middle."""
    rewards: OffRoadRewards = OffRoadRewards()
    """Weights of the reward."""
    variant: Variant = Variant.SIMWARP
    """thesis: observations, starts, rewards and ends as in the thesis."""

    VARIANTS: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {
            "raw": True,
            "any_heading": True,
            "action_rise_time": (0.75, 0.5),
            "rewards.progress": 10.0,  # the way over the time of a control step, 0.1 s
            "rewards.goal": 2500.0,
            "rewards.failure": -250.0,  # this and the next of the code
            "rewards.timeout": -400.0,
        }
    }

    def validate(self) -> None:
        """Check sizes."""
        super().validate()
        require(self.hills * self.hill_height <= 10.0, self, "hills", "at most 10 m / hill_height")
        require(0.0 < self.radius < self.border <= 0.45 * SIDE, self, "border", f"in (radius, {0.45 * SIDE:g}] m")
        require(0.0 < self.half <= self.border, self, "half", "in (0, border]")
        require(0.0 < self.goal_radius < self.radius, self, "goal_radius", "in (0, radius)")
        require(2.0 <= self.clearance < self.radius, self, "clearance", "in [2, radius) m")


@register("off-road")
class OffRoadTask(DrivingTask[OffRoadConfig]):
    """Observations: ``camera`` (W, height, width, 3) uint8 or, with ``obs`` lidar, ``lidar`` (W, 16, 900, 1) float32,
    and ``policy`` (W, 6): goal, heading and speed as GPS and IMU tell them; or, with ``obs`` state, ``policy`` (W, 38):
    exact goal, motion, tilt, and ranges to obstacles.

    Actions: steering (positive to the left), and throttle (positive) or brake (negative).
    """

    summary: ClassVar[str] = "off-road: a utility vehicle drives to a goal between rocks and trees, over hills"
    instruction: ClassVar[str] = "Drive over the hills to the goal and keep clear of rocks and trees."
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
    # Over hills the goal is 90 steps away: a discount of 0.99 rewards hurry
    training_by_obs: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "state": {**DrivingTask.training_by_obs["state"], "iterations": 600, "ppo.gamma": 0.997},
        "camera": PEDALS_BY_CAMERA,
    }
    training_by_variant: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {"network.critic": "same", "ppo.reward_scale": 0.01}
    }
    distilling: ClassVar[Mapping[str, Any]] = {"iterations": 120}
    trained_in: ClassVar[Mapping[str, Any]] = {"obstacles": 50, "hills": 1.0, "varied": True}
    distilled_in: ClassVar[Mapping[str, Any]] = trained_in
    vehicle_name: ClassVar[str] = GATOR.vehicle_name
    full_name: ClassVar[str] = GATOR.full_name
    tire: ClassVar[str | None] = GATOR.tire
    chassis_half: ClassVar[tuple[float, float, float]] = GATOR.chassis_half
    chassis_place: ClassVar[tuple[float, float, float]] = GATOR.chassis_place
    navigates: ClassVar[bool] = True
    camera_place: ClassVar[tuple[float, float, float]] = GATOR.camera_place

    # ---- the world -----------------------------------------------------------------------------------------------

    def build_world(self, builder: sw.ModelBuilder) -> None:
        """Slots for obstacles; the ground, if it is not flat."""
        kinds = [ObstacleKind(sw.scenery.rock(kind, seed), (0.6, 1.3)) for seed, kind in enumerate(sw.scenery.ROCKS)]
        kinds += [ObstacleKind(sw.scenery.bush("round", 0), (0.7, 1.4))]
        kinds += [ObstacleKind(sw.scenery.tree(kind, 0), (0.6, 1.0)) for kind in ("spruce", "oak")]
        self.obstacles = Obstacles(kinds, max(1, self.config.obstacles), group=1, mask=CHASSIS_GROUP)
        self.obstacles.build(builder)
        self.hills = self.make_hills() if self.config.hills > 0.0 else None
        if self.hills is not None:
            self.hills.build(builder, mask=self.contact_mask if self.stands_on_shapes else 0)

    def make_hills(self) -> Hills:
        """Return the fields that episodes choose from."""
        return Hills(FIELDS, SIDE)

    def add_ground(self, builder: sw.ModelBuilder) -> int:
        """Flat, or the hills, which are there."""
        return super().add_ground(builder) if self.hills is None else self.hills.shape

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Pictures of the obstacles, and textured ground."""
        super().visuals(visuals)
        self.obstacles.visuals(visuals)
        self._textures = [
            visuals.texture(sw.sensors.ImageTexture(image=sw.scenery.ground_texture(kind), metres=(6.0, 6.0)))
            for kind in GROUND_TEXTURES
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

    def ground(self, model: sw.Model) -> Any:
        """Flat, or hills."""
        return None if self.hills is None else self.hills.terrain(model)

    def setup(self) -> None:
        """Make tables and buffers, and record what a step launches."""
        config = self.config
        self.terrain = self._make_ground()
        self.trip = zeros_of(Trip, self, last_action=self.action_size)
        self.goal = sw.to_torch(self.trip.goal)
        self.obstacles.bind(self.simulation.model, self.random)
        self._slopes = HillTables()
        if self.hills is not None:
            self.hills.bind(self.simulation.model)
            self._slopes = self.hills.tables
        super().setup()
        terrain, car, drive, state, trip = self.terrain, self._car, self._drive, self.simulation.state.arrays, self.trip
        weights = config.reward_weights()
        terms = [name for name in TERMS if name not in OPTIONAL or weights[name] != 0.0]
        fill(self.terrain, **{f"{name}_row": terms.index(name) if name in terms else -1 for name in OPTIONAL})
        slots = self.obstacles.slots
        self._start = launch_over(
            self, start_trip, self._every_world, terrain, self.random.draws, self._slopes, car, self._navigator, state,
            trip,
        )  # fmt: skip
        self._begin_trip = launch_over(self, begin_trip, car, state, self.action, trip)
        seen = [terrain, car, state, self.action, slots, trip]
        self._observe = ComputedRows(self, observe_trip, *seen, width=13 + _RAYS)
        if self.navigation is not None:
            estimated = [terrain, self._navigator, self.random.draws, trip]
            self._measure = ComputedRows(self, measure_trip, *estimated, width=5 if config.raw else 6)
        moving = [terrain, car, drive, state]
        self._compute_rewards = NamedRows(self, compute_trip_rewards, terms, *moving, self.action, trip)
        fill(self.trip, steps=self.episode_steps)
        ends = ("goal", "collision", "off_map", "upset", "timeout")[: 5 if "timeout" in terms else 4]
        self._find_ends = NamedRows(self, end_trip, ends, *moving, trip, dtype=torch.bool)
        metrics = ("distance", "obstacles_present")
        self._measure_metrics = NamedRows(self, write_trip_metrics, metrics, car, state, slots, trip)
        self.record_world()

    def _make_ground(self) -> Ground:
        """Return the numbers of the task, for kernels."""
        config = self.config
        named = (
            "obstacles", "obstacle_scale", "hill_height", "hills", "half", "border", "radius", "goal_radius",
            "clearance",
        )  # fmt: skip
        purposes = {
            "start": "start", "target": "goal", "field": "hills", "texture": "texture", "places": "places",
            "headings": "obstacle headings", "share": "shares of obstacles and hills", "facing": "start heading",
        }  # fmt: skip
        return filled(
            Ground,
            in_world_axes=int(config.goal_frame is Frame.WORLD),
            varied=int(config.varied),
            raw=int(config.raw),
            any_heading=int(config.any_heading),
            step_limit=config.max_episode_steps,
            reach=_REACH,
            direction=RangeFan(_RAYS, _FAN, _REACH, self.device).direction,
            **{name: getattr(config, name) for name in named},
            **{f"{name}_weight": weight for name, weight in config.reward_weights().items()},
            **{name: self.random.stream(purpose) for name, purpose in purposes.items()},
        )

    def bind_scene(self, scene: sw.sensors.Scene) -> None:
        """Show obstacles, and the ground's texture."""
        self.obstacles.bind_scene(scene)
        textures: wp.array = wp.array(self._textures, dtype=int, device=str(self.device))
        fill(self.terrain, ground=self._ground, shown=scene.texture, textures=textures)

    # ---- an episode ----------------------------------------------------------------------------------------------

    def record_world(self) -> None:
        """Record the draws of start, goal, ground and obstacles."""
        drawn = [self._every_world, self.terrain, self.random.draws, self._slopes, self._drive]
        self._draw_ground = launch_over(self, draw_ground, *drawn, self.trip)
        arguments = [*drawn, self.obstacles.slots, *self.obstacles.arrays]
        self._draw_obstacles = TensorLaunch(draw_obstacles, self.obstacles.radius.shape, arguments, self.device)

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Draw start, goal, ground and obstacles."""
        self._draw_ground.on(world_mask)
        self._draw_obstacles.on(world_mask)

    def start(self, world_mask: torch.Tensor) -> None:
        """On the circle, facing its middle or, with ``any_heading``, anywhere."""
        self._start.on(world_mask)
        self.simulation.measure(world_mask, sensors=False)

    def begin_step(self) -> None:
        """Store the distance to the goal and the previous action."""
        super().begin_step()
        self._begin_trip.launch()

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """Measurements, or the exact state, component by component; lengths as shares of ``radius`` unless ``raw``."""
        if self.sees_alone:
            return {}
        axes = "xy" if self.config.goal_frame is Frame.WORLD else ("ahead", "left")
        names = [*(f"goal {axis}" for axis in axes), "direction of the goal"]
        raw = self.config.raw and self.sensor is not None
        names += [*(["heading"] if raw else ["sine of heading", "cosine of heading"]), "speed ahead"]
        if self.sensor is None:
            names += ["speed to the left", "yaw rate", "rise ahead", "rise to the left", "steering", "pedals"]
            names += [*(f"nearness {ray}" for ray in range(_RAYS)), "distance of the goal"]
        return {"policy": names}

    # ---- what a policy sees --------------------------------------------------------------------------------------

    def measured(self) -> torch.Tensor:
        """Return (W, 6), or (W, 5) with ``raw``: goal, heading and speed by GPS and IMU; the buffer itself."""
        return self._measure()

    def exact_state(self) -> torch.Tensor:
        """Return goal, heading, motion, tilt, inputs, ranges to obstacles, and the distance to the goal; the buffer
        itself.
        """
        return self._observe()

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``progress``, ``goal``, ``failure`` and, if they count, ``change`` of the action and ``timeout``."""
        return self._compute_rewards()

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``goal``, ``collision`` with an obstacle, ``off_map``, ``upset`` and, if it counts, ``timeout``."""
        return self._find_ends()

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the ``distance`` to the goal [m], and how many obstacles there are: the rest found no room."""
        return self._measure_metrics()

    # ---- pictures ------------------------------------------------------------------------------------------------

    def drawing(self) -> Drawing:
        """Draw obstacles, goal, vehicle and the straight way to the goal, on the ground; a pole stands in the goal."""
        point, heading = self.pose()
        angle = torch.linspace(0.0, 2.0 * math.pi, 13, device=self.device)
        ring = torch.stack([angle.cos(), angle.sin()], dim=1)
        goal = self.goal.float().unsqueeze(1) + self.config.goal_radius * ring
        share = torch.linspace(0.0, 1.0, 50, device=self.device).unsqueeze(1)
        way = point[:, None, :2] + share * (self.goal - point[:, :2]).unsqueeze(1)
        lines = [Line(torch.nn.functional.pad(row.float(), (0, 1)), "tab:green", 2.5) for row in (goal, way)]
        lines += self.obstacles.rings()
        lines.append(Line(outline(point, heading, self.chassis_half), "tab:orange", 2.0, only_maps=True))
        if self.hills is not None:
            for line in lines:
                line.points[..., 2] = self.hills.height(line.points[..., :2].double()).float()
        foot = lines[0].points.mean(dim=1)
        pole = torch.stack([foot, foot + foot.new_tensor([0.0, 0.0, _POLE])], dim=1)
        lines.append(Line(pole, "tab:green", 4.0))
        side = self.config.border
        return Drawing(tuple(lines), ((-side, side), (-side, side)))
