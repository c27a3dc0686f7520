"""Convoy: a truck follows the last of three leaders along winding paths, past rocks and trees, faster and faster.

After ``convoy-v0`` of gym-chrono: paths, leaders, their speed and the reward's cone are the original's. Leaders are
ghosts: they are seen, they move as the path says, and nothing moves them; or they are vehicles like the truck
(`simwarp.tasks.driving.platoon`).
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import Ge, Gt, Le, Positive

from ..framework.agents import beside, lead_of
from ..framework.config import RewardWeights, require
from ..framework.drawing import Drawing, Line
from ..framework.recorded_launches import (
    ComputedRows,
    NamedRows,
    TensorFunction,
    TensorLaunch,
    WorldLaunch,
    fill,
    filled,
    launch_over,
    share_over,
    zeros_of,
)
from ..framework.registry import register
from ..framework.variants import Variant
from .base import DrivingTask
from .convoy_kernels import (
    BESIDE,
    LEADERS,
    Column,
    Follow,
    Platoon,
    aim_next,
    compute_follower_rewards,
    draw_path,
    draw_roadside,
    drive_on_behind,
    end_followers,
    follow_path,
    measure_follower,
    observe_followers,
    place_leaders,
    show_now,
    start_following,
    write_follower_metrics,
)
from .driven_vehicles import CHASSIS_GROUP, VEHICLE_ARRAYS
from .driving_config import DrivingConfig, Frame, Observing
from .obstacles import ObstacleKind, Obstacles
from .outlines import outline
from .ranging import RangeFan
from .routes import Routes

LARGE = 4
"""Large obstacles that generated paths pass."""
ENDS = ("collision", "bumped", "lost", "upset", "goal")
METRICS = ("distance", "path_deviation", "obstacle_hits")
MAP_HALF = (100.0, 40.0)
"""Half lengths of the rectangle in which scattered obstacles stand [m]. Generated paths end there; the head of a convoy
goes on straight.
"""
LEADER_HALF = (2.45, 1.1, 0.9)
_REACH, _RAYS, _FAN = 20.0, 17, math.radians(200.0)


class Leaders(enum.Enum):
    """What goes ahead of the truck."""

    GHOSTS = "ghosts"
    SIMULATED = "simulated"


@dataclasses.dataclass(frozen=True)
class ConvoyRewards(RewardWeights):
    """Weights of the reward."""

    following: float = 0.1
    """A step in the cone behind the leader and near it. The original has 100."""
    failure: float = -2.0
    """Touching an obstacle or a leader, losing the leader, or turning over."""
    speed: float = 0.0
    """Relative difference of speed; 0: there is no such term, as in the thesis. The original's code has -5 % of
    ``following``."""


@dataclasses.dataclass(frozen=True)
class ConvoyConfig(DrivingConfig):
    """Configuration of :class:`ConvoyTask`."""

    dt: float = 0.0025
    """Physics step [s]."""
    decimation: int = 80
    """Physics steps per control step: five actions a second."""
    max_episode_steps: int = 310
    """Control steps after which an episode is truncated; leaders are at the end of the path before."""
    scattered: Annotated[int, Ge(0), Le(500)] = 0
    """Obstacles of various sizes besides, anywhere on 200 x 80 m where the path leaves room; with ``generated``."""
    drive_on: bool = False
    """A follower that touches something drives on, and touches are counted; with ``leaders`` simulated."""
    latest_start: Annotated[float, Ge(0.0), Le(0.8)] = 0.5
    """The nearest leader starts between 0.05 and this more of its path, as shares."""
    generated: bool = False
    """Paths around four large obstacles, other than the sixteen of training."""
    generated_paths: Annotated[int, Ge(1), Le(1000)] = 16
    """Number of those paths."""
    leaders: Leaders = Leaders.GHOSTS
    """ghosts: pictures that move as the path says; simulated: vehicles as the truck is, in the same world."""
    leading: Annotated[int, Ge(1), Le(8)] = 3
    """Simulated vehicles at the head, which a driver takes along the path; ghosts are always three."""
    followers: Annotated[int, Ge(1), Le(16)] = 1
    """Simulated vehicles behind them, each an agent that follows the one ahead."""
    place_frame: Frame = Frame.VEHICLE
    """Axes in which the leader's place is observed with a camera."""
    raw: bool = False
    """By camera observe five numbers [m, rad, m/s], the heading as an angle, in place of six of the order of 1."""
    cone: Annotated[float, Gt(0.0), Le(math.pi)] = math.pi / 4.0
    """Half angle of the cone behind the leader in which following is rewarded [rad]."""
    near: float = 16.0
    """Distance up to which following is rewarded in full [m]."""
    softness: Positive = 4.0
    """Distance beyond ``near`` at which that reward is halved [m]. The original has 0.2."""
    rewards: ConvoyRewards = ConvoyRewards()
    """Weights of the reward."""
    lost_distance: float = 30.0
    """An episode ends where the leader is farther away [m]."""
    variant: Variant = Variant.SIMWARP
    """thesis: observations, rewards and time as in the thesis."""

    VARIANTS: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {
            "raw": True,
            "place_frame": Frame.WORLD,
            "camera_fov": 0.5 * math.pi,
            "max_episode_steps": 300,
            "action_rise_time": (1.0, 0.5),
            "softness": 0.2,
            "rewards.following": 100.0,  # of the code: 20 m over the distance, at least 0.2 m
            "rewards.failure": -2000.0,  # no source has a number: the ratio is this project's
        }
    }

    def validate(self) -> None:
        """Check sizes."""
        super().validate()
        require(0.0 < self.near < self.lost_distance, self, "near", "in (0, lost_distance)")
        if self.leaders is Leaders.GHOSTS:
            require(self.leading == 3, self, "leading", "3 where leaders are ghosts")
            require(self.followers == 1, self, "followers", "1 where leaders are ghosts")
            require(not self.drive_on, self, "drive_on", "False where leaders are ghosts")
        require(self.generated or not self.scattered, self, "scattered", "0 without generated paths")
        if self.followers > 1:
            require(self.obs is not Observing.LIDAR, self, "obs", "state or camera where there are several followers")

    def chassis_names(self) -> tuple[str, ...]:
        """Return the names of all vehicles' chassis."""
        if self.leaders is Leaders.GHOSTS:
            return super().chassis_names()
        return tuple(f"v{index}_chassis" for index in range(self.leading + self.followers))


@register("convoy")
class ConvoyTask(DrivingTask[ConvoyConfig]):
    """Observations: ``camera`` (W, height, width, 3) uint8 and ``policy`` (W, 6): where the leader is, heading and both
    speeds, as measured; or, with ``obs`` state, ``policy`` (W, 34): exact places, motion, and ranges to obstacles.

    Actions: steering (positive to the left), and throttle (positive) or brake (negative).
    """

    summary: ClassVar[str] = "convoy: a truck follows a leader along winding paths, past rocks and trees"
    instruction: ClassVar[str] = "Follow the leading truck along the path and keep clear of rocks and trees."
    config_type: ClassVar[type[DrivingConfig]] = ConvoyConfig
    per_world: ClassVar[tuple[str, ...]] = (*VEHICLE_ARRAYS, *Obstacles.model_arrays)
    success_reasons: ClassVar[frozenset[str]] = frozenset({"goal"})
    training: ClassVar[Mapping[str, Any]] = {
        "iterations": 180,
        "num_envs": 256,
        "steps_per_iteration": 32,
        "network.init_std": 0.6,
        "ppo.gamma": 0.98,
        "ppo.entropy": 0.002,
    }
    training_by_variant: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "thesis": {"network.critic": "same", "ppo.reward_scale": 0.001}
    }
    distilling: ClassVar[Mapping[str, Any]] = {"iterations": 40}
    # In one set of conditions it learns to drive at the limit of one model: docs/results.md, "The full model"
    trained_in: ClassVar[Mapping[str, Any]] = {"conditions": "random"}
    state_buffers: ClassVar[Mapping[str, str]] = {**DrivingTask.state_buffers, "deviation": "_deviation"}
    navigates: ClassVar[bool] = True
    view_distance: ClassVar[float] = 15.0

    @classmethod
    def played_by(cls, config: ConvoyConfig) -> str | None:
        """Return the task of simulated leaders where there are some."""
        return "simwarp.tasks.driving.platoon:PlatoonTask" if config.leaders is Leaders.SIMULATED else None

    # ---- the world -----------------------------------------------------------------------------------------------

    def build_world(self, builder: sw.ModelBuilder) -> None:
        """Slots for what stands beside the path."""
        kinds = [
            ObstacleKind(sw.scenery.rock(kind, 10 + seed), (0.7, 1.2)) for seed, kind in enumerate(sw.scenery.ROCKS)
        ]
        kinds += [
            ObstacleKind(sw.scenery.bush("round", 1), (0.8, 1.3)),
            ObstacleKind(sw.scenery.tree("oak", 1), (0.7, 1.0)),
            ObstacleKind(sw.scenery.tree("spruce", 1), (0.7, 1.0)),
        ]
        large = LARGE if self.config.generated else 0
        self.obstacles = Obstacles(kinds, BESIDE + large + self.config.scattered, group=1, mask=CHASSIS_GROUP)
        self.obstacles.build(builder)

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show truck, leaders, obstacles, and grass."""
        super().visuals(visuals)
        self.obstacles.visuals(visuals)
        grass = visuals.texture(sw.sensors.ImageTexture(image=sw.scenery.ground_texture("grass"), metres=(8.0, 8.0)))
        visuals.add_plane(name="ground", texture=grass, color=(1.0, 1.0, 1.0), label=1)
        self.show_leading(visuals)

    def show_leading(self, visuals: sw.sensors.Visuals) -> None:
        """Add the leaders to what is seen."""
        leader = sw.scenery.vehicle_visual("hmmwv", color=(0.5, 0.05, 0.03))
        asset = visuals.add_mesh_asset(leader.mesh)
        self._ghosts = [
            visuals.add_mesh_instance(sw.WORLD, asset, name=f"leader_{index}", label=int(leader.label))
            for index in range(LEADERS)
        ]

    def seen_per_world(self) -> Sequence[str]:
        """Obstacles and leaders differ."""
        return Obstacles.scene_arrays

    def setup(self) -> None:
        """Make paths, tables and buffers, and record what a step launches."""
        paths, large = self.ways()
        self.routes = Routes(paths, 0.5, self.device)
        self.column = self._make_column(large)
        self.follow = zeros_of(Follow, self)
        fill(self.follow, steps=self.episode_steps)
        self.route, self._begun = sw.to_torch(self.follow.route), sw.to_torch(self.follow.begun)
        self.obstacles.bind(self.simulation.model, self.random)
        super().setup()
        if self.sensor is not None:
            self.column.frame_steps = math.gcd(self.sensor.frames.steps.period, self.config.decimation)
        self._record_observations()
        self.record_world()

    def _record_observations(self) -> None:
        """Record what writes the observations; the rows stay the same ones."""
        column, routes, follow, platoon = self.column, self.routes.tables, self.follow, self._platoon
        state, shape = self.simulation.state.arrays, (self.num_worlds, self.agents)
        if self.navigation is not None:
            others, width = [self.random.draws, routes, follow, platoon], 5 if self.config.raw else 6
            self._measures = [
                ComputedRows(self, measure_follower, agent, column, state, each.tables, *others, width=width)
                for agent, each in enumerate(self.navigations)
            ]
            self._all_measured = torch.zeros(*shape, width, device=self.device) if self.agents > 1 else None
        seen = [column, state, self.action.view(-1, 2), routes, follow, self.obstacles.slots, platoon]
        self._observe = ComputedRows(
            self, observe_followers, *seen, width=17 + _RAYS, shape=lead_of(self), threads=shape
        )  # fmt: skip

    def _record_vehicle(self) -> None:
        """Record what every driving task launches; the truck is the only vehicle of its platoon."""
        super()._record_vehicle()
        device = str(self.device)
        self._deviation = torch.zeros(self.num_worlds, device=self.device)
        self._platoon = filled(
            Platoon,
            first=-LEADERS,
            chassis=wp.array([self.parts.chassis], dtype=int, device=device),
            shape=wp.array([self.chassis_shape], dtype=int, device=device),
            reference=self._car.reference,
            hit=self.hit.unsqueeze(1),
            deviation=self._deviation.unsqueeze(1),
        )

    @property
    def term_names(self) -> tuple[str, ...]:
        """Names of the reward terms, that of the speed only where it counts."""
        return ("following", "failure", "speed")[: 3 if self.config.rewards.speed != 0.0 else 2]

    def ways(self) -> tuple[list[sw.vehicle.Path], np.ndarray[Any, np.dtype[np.float32]]]:
        """Return K paths, and the obstacles that generated ones pass, (K, L, 3): x, y and radius [m]."""
        if not self.config.generated:
            return [sw.scenery.convoy_path(index) for index in range(sw.scenery.CONVOY_PATHS)], np.zeros(
                (0, LARGE, 3), np.float32
            )
        detours = [sw.scenery.detour(seed, count=LARGE) for seed in range(self.config.generated_paths)]
        return [way.path for way in detours], np.array([way.obstacles for way in detours], np.float32)

    def _make_column(self, large: np.ndarray[Any, np.dtype[np.float32]]) -> Column:
        """Return the numbers of the task, for kernels; ``large`` are the obstacles of generated paths (K, L, 3)."""
        config = self.config
        named = (
            "control_dt", "dt", "latest_start", "cone", "near", "softness", "lost_distance",
        )  # fmt: skip
        purposes = {
            "path": "path", "begin": "begin", "sides": "sides", "gaps": "gaps", "headings": "obstacle headings",
            "scatter": "scattered",
        }  # fmt: skip
        return filled(
            Column,
            own_half=wp.vec2(*self.chassis_half[:2]),
            leader_half=wp.vec2(*LEADER_HALF[:2]),
            in_world_axes=int(config.place_frame is Frame.WORLD),
            raw=int(config.raw),
            drive_on=int(config.drive_on),
            map_half=wp.vec2(*MAP_HALF),
            reach=_REACH,
            direction=RangeFan(_RAYS, _FAN, _REACH, self.device).direction,
            large=wp.array(large, dtype=wp.vec3, device=str(self.device)),
            **{name: getattr(config, name) for name in named},
            **{f"{name}_weight": weight for name, weight in config.reward_weights().items()},
            **{name: self.random.stream(purpose) for name, purpose in purposes.items()},
        )

    def bind_scene(self, scene: sw.sensors.Scene) -> None:
        """Show obstacles and leaders."""
        self.obstacles.bind_scene(scene)
        fill(self.column, ghost=self._ghosts[0], shown_x=scene.x, shown_rot=scene.rot)

    def record_world(self) -> None:
        """Record what a step launches: all of it hangs on what is known of column and scene."""
        self._record_draws()
        self._record_driving()
        column, routes, follow, platoon = self.column, self.routes.tables, self.follow, self._platoon
        where = [column, self.simulation.state.arrays, routes, follow, platoon]
        of_agents: dict[str, Any] = {"shape": lead_of(self), "threads": (self.num_worlds, self.agents)}
        self._compute_rewards = NamedRows(self, compute_follower_rewards, self.term_names, *where, **of_agents)
        self._find_ends = NamedRows(self, end_followers, ENDS, *where, dtype=torch.bool, **of_agents)
        self._measure_metrics = NamedRows(self, write_follower_metrics, METRICS, *where, **of_agents)

    def _record_driving(self) -> None:
        """Record what places the truck, and what is launched while it drives."""
        column, routes, follow, platoon = self.column, self.routes.tables, self.follow, self._platoon
        car, drive, state = self._car, self._drive, self.simulation.state.arrays
        placed = [self._every_world, column, car, self._navigator, state, routes, follow, platoon]
        self._start = launch_over(self, start_following, *placed)
        self._aim_first, self._aim_next = (
            launch_over(self, aim_next, ahead, column, routes, follow, drive) for ahead in (0, 1)
        )
        self._follow_path = launch_over(self, follow_path, car, state, routes, follow, platoon)
        places = [(torch.float32, (LEADERS, 3))]
        self._leaders_at = TensorFunction(place_leaders, [routes, follow], places, self.device)

    def _record_draws(self) -> None:
        """Record what draws paths and what stands beside them, and shows the leaders."""
        column, routes, follow, every = self.column, self.routes.tables, self.follow, self._every_world
        draws = self.random.draws
        self._draw_path = launch_over(self, draw_path, every, column, draws, routes, follow)
        arguments = [every, column, draws, routes, follow, self.obstacles.slots, *self.obstacles.arrays]
        self._draw_roadside = TensorLaunch(draw_roadside, self.obstacles.radius.shape, arguments, self.device)
        self._show = TensorFunction(show_now, [column, routes, follow], [], self.device)

    # ---- an episode ----------------------------------------------------------------------------------------------

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Draw path, start, and what stands beside the path."""
        self._draw_path.on(world_mask)
        self._draw_roadside.on(world_mask)

    def start(self, world_mask: torch.Tensor) -> None:
        """On the path behind the leaders."""
        self._start.on(world_mask)
        self.simulation.measure(world_mask, sensors=False)

    def time(self) -> torch.Tensor:
        """Return (W,) the time since the episode began, at the end of the last control step [s]."""
        return self.episode_steps * self.config.control_dt

    def leaders(self, time: torch.Tensor) -> torch.Tensor:
        """Return (W, 3, 3) places and headings of the leaders at a time (W,), the nearest first [m, rad]."""
        return self._leaders_at(time)[0]

    def show_leaders(self, time: torch.Tensor) -> None:
        """Show the leaders where they are at a time (W,) [s], if there is a scene."""
        self._show(time)

    def physics_launches(self) -> Sequence[WorldLaunch]:
        """Return the action's way, steering and pedals, and the leaders' where an image is taken."""
        path = self._path
        moved = [path.reach, path.request, self.action, self._car, self._drive]
        return [share_over(self.simulation, drive_on_behind, self.column, self.routes.tables, self.follow, *moved)]

    def begin_step(self) -> None:
        """Move the leaders, if there is an image at the end of the first physics step."""
        super().begin_step()
        if self._physics is None:
            self._aim_first.launch()

    def after_physics(self) -> None:
        """Move the leaders, if there is an image at the end of the next physics step."""
        super().after_physics()
        self._aim_next.launch()

    def end_step(self) -> None:
        """Store the truck's distance from the path."""
        self._follow_path.launch()

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Load difficulties and distances from the path, draw the worlds, and show the leaders."""
        super().load_extra_state(state)
        self.show_leaders(self.time())

    # ---- what a policy observes and is rewarded for ------------------------------------------------------------------

    def measured(self) -> torch.Tensor:
        """Return (W, 6), or (W, 5) with ``raw``, (W, N, ...) of several followers: place of the one ahead, heading and
        speed by GPS and IMU, the other's speed; the buffer itself.
        """
        return beside([measure() for measure in self._measures], self._all_measured)

    def exact_state(self) -> torch.Tensor:
        """Return the leaders' places, the first one's heading and speed, motion, tilt, inputs, ranges to obstacles; the
        buffer itself.
        """
        return self._observe()

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``following``, ``failure`` and, if it counts, the difference in ``speed``."""
        return self._compute_rewards()

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``goal``, ``collision`` with an obstacle, ``bumped`` into a leader, ``lost`` it, and ``upset``."""
        return self._find_ends()

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the ``distance`` to the leader, the mean ``path_deviation`` [m] and ``obstacle_hits``."""
        return self._measure_metrics()

    # ---- pictures ------------------------------------------------------------------------------------------------

    def drawing(self) -> Drawing:
        """Draw path, obstacles, leaders and truck from above."""
        worlds = self.num_worlds
        share = torch.linspace(0.0, 1.0, 100, device=self.device).expand(worlds, -1)
        path = self.routes.at(self.route, share * self.routes.length[self.route].unsqueeze(1))
        lines = [Line(torch.nn.functional.pad(path[..., :2], (0, 1)), "0.7", 1.0), *self.obstacles.rings()]
        return Drawing((*lines, *self.vehicle_lines()), ((-110.0, 110.0), (-110.0, 110.0)))

    def vehicle_lines(self) -> list[Line]:
        """Return the outlines of leaders and truck."""
        lines = []
        for index in range(LEADERS):
            leader = self.leaders(self.time())[:, index]
            lines.append(Line(outline(leader.double(), leader[:, 2], LEADER_HALF), "tab:red", 1.5, only_maps=True))
        point, heading = self.pose()
        return [*lines, Line(outline(point, heading, self.chassis_half), "tab:orange", 2.0, only_maps=True)]
