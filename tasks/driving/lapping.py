"""Base of tasks on closed tracks: a lane, the vehicle's position on it, and laps."""

from __future__ import annotations

import dataclasses
import enum
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, TypeVar

import numpy as np
import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import Ge, Gt, Le, Positive, Whole

from ..framework.config import RewardWeights
from ..framework.drawing import Drawing, Line
from ..framework.recorded_launches import ComputedRows, NamedRows, TensorFunction, fill, filled, launch_over, zeros_of
from .base import DrivingTask
from .driving_config import DrivingConfig
from .lapping_kernels import (
    PREVIEW,
    Course,
    Lap,
    advance_lap,
    compute_lap_rewards,
    draw_lap,
    end_lap,
    find_lane_departures,
    find_slow,
    measure_lane,
    measure_lap,
    observe_lap,
    start_lap,
    write_lap_metrics,
)
from .outlines import outline
from .routes import Routes


class Start(enum.Enum):
    """Start position of an episode on a track."""

    TURN = "turn"
    STRAIGHT = "straight"
    ANYWHERE = "anywhere"


@dataclasses.dataclass(frozen=True)
class LappingRewards(RewardWeights):
    """Weights of the reward."""

    progress: float = 0.1
    """Per metre along the lane."""
    lap: float = 5.0
    """A full lap, which ends the episode."""
    failure: float = -5.0
    """Leaving the lane, or turning over."""


@dataclasses.dataclass(frozen=True)
class LappingConfig(DrivingConfig):
    """Fields of tasks on closed tracks."""

    tracks: Annotated[int, Ge(1), Le(64)] = 1
    """Number of tracks; every episode is driven on one of them."""
    first_track: Whole = 0
    """Number of the first one: others than those of training show what a policy makes of a new one."""
    start: Start = Start.TURN
    """Start position of an episode. On a straight, going straight on looks good for too long."""
    speed: Positive = 1.0
    """At which a lap is driven: held by a controller, or aimed at [m/s]."""
    patience: Annotated[float, Gt(1.0)] = 1.5
    """An episode is cut off after this many times the time of a lap at ``speed``."""
    rewards: LappingRewards = LappingRewards()
    """Weights of the reward."""


LappingT = TypeVar("LappingT", bound=LappingConfig)


class LappingTask(DrivingTask[LappingT]):
    """A task on closed tracks; a subclass says what the tracks are, and how wide a lane is."""

    success_reasons: ClassVar[frozenset[str]] = frozenset({"lap"})
    state_buffers: ClassVar[Mapping[str, str]] = {"difficulty": "difficulty", "progress": "progress", "arc": "_arc"}
    course_label: ClassVar[int] = 0
    """Semantic class of what is beside the lane."""
    preview: ClassVar[float] = 1.0
    """Distance of the points ahead in exact observations [m]."""

    @abstractmethod
    def make_track(self, number: int) -> sw.scenery.Track:
        """Return one of the tracks."""

    @property
    @abstractmethod
    def lane_half(self) -> float:
        """Largest distance of the vehicle's reference point from the middle of the lane [m]."""

    @abstractmethod
    def course_mesh(self, track: sw.scenery.Track, number: int) -> sw.scenery.VisualMesh:
        """Return the visual of a track: both of its sides, and its ground."""

    def make_tracks(self) -> list[sw.scenery.Track]:
        """Return all tracks of the configuration."""
        return [self.make_track(self.config.first_track + index) for index in range(self.config.tracks)]

    def visuals(self, visuals: sw.sensors.Visuals) -> None:
        """Show the car, and the course of the track that a world has."""
        super().visuals(visuals)
        meshes = [self.course_mesh(track, number) for number, track in enumerate(self.make_tracks())]
        self._courses = [visuals.add_mesh_asset(mesh) for mesh in meshes]
        self._course = visuals.add_mesh_instance(sw.WORLD, self._courses[0], name="course", label=self.course_label)

    def seen_per_world(self) -> Sequence[str]:
        """The course differs, if there are several."""
        return ("asset",) if self.config.tracks > 1 else ()

    def setup(self) -> None:
        """Make paths and buffers, and record what a step launches."""
        self.tracks = self.make_tracks()
        self.routes = Routes([track.path for track in self.tracks], self.preview / 8.0, self.device)
        self.course = self._make_course()
        self.lap = zeros_of(Lap, self)
        lap = self.lap
        self.route, self.begun = sw.to_torch(lap.route), sw.to_torch(lap.begun)
        self.progress, self._arc = sw.to_torch(lap.progress), sw.to_torch(lap.arc)
        super().setup()
        car, state, course, routes = self._car, self.simulation.state.arrays, self.course, self.routes.tables
        worlds, device, number = self.num_worlds, self.device, (torch.float32, ())
        width = 3 + 2 * PREVIEW + 3 + self.action_size
        outside = torch.zeros(worlds, dtype=torch.bool, device=device)
        self._start = launch_over(self, start_lap, self._every_world, car, self._navigator, state, routes, lap)
        self._advance_lap = launch_over(self, advance_lap, car, state, routes, lap)
        self._measure = ComputedRows(self, measure_lap, car, state, course, self.action, width=3)
        self._observe = ComputedRows(
            self, observe_lap, car, state, course, routes, lap, self.action, width=width
        )  # fmt: skip
        driven = [outside, car, state, course, routes, lap]
        self._compute_rewards = NamedRows(self, compute_lap_rewards, ("progress", "lap", "failure"), *driven)
        ends, ended = ("off_lane", "upset", "lap"), [outside, car, state, routes, lap]
        self._find_ends = NamedRows(self, end_lap, ends, *ended, dtype=torch.bool)
        timed = [self.episode_clock, course, lap]
        self._find_slow = NamedRows(self, find_slow, ("too_slow",), *timed, dtype=torch.bool)
        self._measure_metrics = NamedRows(self, write_lap_metrics, ("laps", "aside"), car, state, routes, lap)
        fixed = [car, state, course, routes, lap]
        self._measure_lane = TensorFunction(
            measure_lane, fixed, [number, number, (torch.float32, (PREVIEW, 2))], device
        )
        self._find_outside = TensorFunction(find_lane_departures, fixed, [(torch.bool, ())], device)
        self.record_world()

    def _make_course(self) -> Course:
        """Return the numbers of the task, for kernels."""
        config, device = self.config, str(self.device)
        starts = [track.arc[track.starts(config.start.value)] for track in self.tracks]
        table = np.zeros((len(starts), max(map(len, starts))), np.float32)
        for row, arcs in zip(table, starts, strict=True):
            row[: len(arcs)] = arcs
        return filled(
            Course,
            lane_half=self.lane_half,
            preview=self.preview,
            speed=config.speed,
            progress_weight=config.rewards.progress,
            lap_weight=config.rewards.lap,
            failure_weight=config.rewards.failure,
            starts=wp.array(table, dtype=float, device=device),
            start_counts=wp.array([len(arcs) for arcs in starts], dtype=int, device=device),
            limits=wp.array(self._lap_limits().numpy(), dtype=wp.int64, device=device),
            track=self.random.stream("track"),
            begin=self.random.stream("begin"),
        )

    def _lap_limits(self) -> torch.Tensor:
        """(K,) int64, what a lap of each track may take [control steps]."""
        time = self.config.patience * self.routes.length.cpu() / self.config.speed
        return (time / self.config.control_dt).ceil().long()

    def bind_scene(self, scene: sw.sensors.Scene) -> None:
        """Show the course that each world drives on, if there are several."""
        if self.config.tracks > 1:
            known: wp.array = wp.array(self._courses, dtype=int, device=str(self.device))
            fill(self.course, course=self._course, shown=scene.asset, known=known)

    def record_world(self) -> None:
        """Record the draw of track and start."""
        self._draw = launch_over(self, draw_lap, self._every_world, self.course, self.random.draws, self.lap)

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Draw track and start where ``world_mask`` (W,) is true."""
        self._draw.on(world_mask)

    def start(self, world_mask: torch.Tensor) -> None:
        """Put the vehicle in the middle of the lane, along it, where ``world_mask`` (W,) is true."""
        self._start.on(world_mask)
        self.simulation.measure(world_mask, sensors=False)

    def end_step(self) -> None:
        """Measure how far the vehicle has come."""
        self._advance_lap.launch()

    # ---- what a policy observes and is rewarded for ------------------------------------------------------------------

    def lane(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the vehicle's pose in the lane: (W,) aside of its middle [m] and heading off it [rad]; and (W, 5, 2)
        points of the middle ahead, in axes of the vehicle [m].
        """
        aside, turn, ahead = self._measure_lane(shape=(self.num_worlds,))
        return aside, turn, ahead

    @property
    def observation_names(self) -> Mapping[str, Sequence[str]]:
        """Three measurements, or the exact state, component by component."""
        if self.sensor is not None:
            return {} if self.sees_alone else {"policy": ["speed", "yaw rate", "steering"]}
        names = ["aside of the lane", "sine of heading off the lane", "cosine of heading off the lane"]
        names += [f"lane point {point} {axis}" for point in range(PREVIEW) for axis in ("ahead", "left")]
        return {"policy": [*names, "speed ahead", "speed to the left", "yaw rate", *self.action_names]}

    def measured(self) -> torch.Tensor:
        """Return (W, 3): speed, yaw rate, steering; the buffer itself."""
        return self._measure()

    def exact_state(self) -> torch.Tensor:
        """Return (W, N): place in the lane, points of the lane ahead, motion and inputs; the buffer itself."""
        return self._observe()

    def outside(self) -> torch.Tensor:
        """Return (W,) bool: the vehicle has left its lane."""
        return self._find_outside(shape=(self.num_worlds,))[0]

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``progress``, ``lap`` and ``failure``, (W,) each."""
        return self._compute_rewards(self.outside())

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``off_lane``, ``upset`` and ``lap``, (W,) bool each."""
        return self._find_ends(self.outside())

    def step_limit(self) -> torch.Tensor:
        """Return (W,) int64, what a lap may take: the lesser of both limits."""
        limits = self._lap_limits().to(self.device)
        return limits[self.route].clamp(max=self.config.max_episode_steps)

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return ``too_slow`` (W,) bool: the time for a lap is over."""
        return self._find_slow()

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return ``laps`` (W,), the share of the lap, and ``aside`` (W,), the distance from the lane's middle [m]."""
        return self._measure_metrics()

    def drawing(self) -> Drawing:
        """Draw both sides of the lane and the vehicle from above."""
        share = torch.linspace(0.0, 1.0, 200, device=self.device).expand(self.num_worlds, -1)
        at = self.routes.at(self.route, share * self.routes.length[self.route].unsqueeze(1))
        across = torch.stack([-at[..., 2].sin(), at[..., 2].cos()], dim=2)
        lines = [
            Line(torch.nn.functional.pad(at[..., :2] + side * self.lane_half * across, (0, 1)), colour, 1.5)
            for side, colour in ((1.0, "tab:green"), (-1.0, "tab:red"))
        ]
        point, heading = self.pose()
        lines.append(Line(outline(point, heading, self.chassis_half), "tab:orange", 2.0, only_maps=True))
        reach = max(float(abs(track.points).max()) for track in self.tracks) + 2.0 * self.lane_half
        return Drawing(tuple(lines), ((-reach, reach), (-reach, reach)))
