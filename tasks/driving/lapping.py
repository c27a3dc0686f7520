"""Base of tasks on closed tracks: a lane, the vehicle's position on it, and laps."""

from __future__ import annotations

import dataclasses
import enum
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, TypeVar

import torch

from simwarp.tasks import Ge, Gt, Le, Positive, Whole

from ..framework.drawing import Drawing, Line
from ..framework.frames import to_heading
from .base import DrivingConfig, DrivingTask, outline
from .routes import Routes

if TYPE_CHECKING:
    from simwarp.scenery import Track, VisualMesh
    from simwarp.sensors import Scene, Visuals

PREVIEW = 5
"""Number of points of the lane ahead in exact observations."""


class Start(enum.Enum):
    """Start position of an episode on a track."""

    TURN = "turn"
    STRAIGHT = "straight"
    ANYWHERE = "anywhere"


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
    progress_weight: float = 0.1
    """Reward per metre along the lane."""
    failure_weight: float = 5.0
    """Taken for leaving the lane."""
    lap_weight: float = 5.0
    """Reward for a full lap, which ends the episode."""

    def validate(self) -> None:
        """Check sizes."""
        super().validate()


LappingT = TypeVar("LappingT", bound=LappingConfig)


class LappingTask(DrivingTask[LappingT]):
    """A task on closed tracks; a subclass says what the tracks are, and how wide a lane is."""

    success_reasons: ClassVar[frozenset[str]] = frozenset({"lap"})
    course_label: ClassVar[int] = 0
    """Semantic class of what is beside the lane."""
    preview: ClassVar[float] = 1.0
    """Distance of the points ahead in exact observations [m]."""

    _shown: torch.Tensor | None = None

    @abstractmethod
    def make_track(self, number: int) -> Track:
        """Return one of the tracks."""

    @property
    @abstractmethod
    def lane_half(self) -> float:
        """Largest distance of the vehicle's reference point from the middle of the lane [m]."""

    @abstractmethod
    def course_mesh(self, track: Track, number: int) -> VisualMesh:
        """Return the visual of a track: both of its sides, and its ground."""

    def make_tracks(self) -> list[Track]:
        """Return all tracks of the configuration."""
        return [self.make_track(self.config.first_track + index) for index in range(self.config.tracks)]

    def visuals(self, visuals: Visuals) -> None:
        """Show the car, and the course of the track that a world has."""
        import simwarp as sw

        super().visuals(visuals)
        meshes = [self.course_mesh(track, number) for number, track in enumerate(self.make_tracks())]
        self._courses = [visuals.add_mesh_asset(mesh) for mesh in meshes]
        self._course = visuals.add_mesh_instance(sw.WORLD, self._courses[0], name="course", label=self.course_label)

    def seen_per_world(self) -> Sequence[str]:
        """The course differs, if there are several."""
        return ("asset",) if self.config.tracks > 1 else ()

    def setup(self) -> None:
        """Make paths and buffers."""
        super().setup()
        self.tracks = self.make_tracks()
        self.routes = Routes([track.path for track in self.tracks], self.preview / 8.0, self.device)
        starts = [track.arc[track.starts(self.config.start.value)] for track in self.tracks]
        self._starts = torch.zeros(len(starts), max(map(len, starts)), device=self.device)
        for row, arcs in zip(self._starts, starts, strict=True):
            row[: len(arcs)] = torch.as_tensor(arcs, dtype=torch.float32)
        self._start_counts = torch.tensor([len(arcs) for arcs in starts], device=self.device)
        worlds = self.num_worlds
        self.route = torch.zeros(worlds, dtype=torch.int64, device=self.device)
        self.begun = torch.zeros(worlds, device=self.device)
        self.progress = torch.zeros(worlds, device=self.device)
        self._gain = torch.zeros(worlds, device=self.device)
        self._arc = torch.zeros(worlds, device=self.device)

    def bind_scene(self, scene: Scene) -> None:
        """Make a view of the course that each world shows."""
        from simwarp import to_torch

        if self.config.tracks > 1:
            self._shown = to_torch(scene.asset)[:, self._course]
            self._known = torch.tensor(self._courses, dtype=torch.int32, device=self.device)

    def draw_world(self, world_mask: torch.Tensor) -> None:
        """Draw track and start."""
        route = self.random.uniform("track", 0.0, len(self.tracks)).squeeze(1).long()
        chance = self.random.uniform("begin").squeeze(1)
        begun = self._starts[route, (chance * self._start_counts[route]).long()]
        self.route.copy_(torch.where(world_mask, route, self.route))
        self.begun.copy_(torch.where(world_mask, begun, self.begun))
        if self._shown is not None:
            self._shown.copy_(self._known[self.route])

    def start(self, world_mask: torch.Tensor) -> None:
        """In the middle of the lane, along it."""
        at = self.routes.at(self.route, self.begun.unsqueeze(1)).squeeze(1)
        self.place_vehicle(world_mask, torch.nn.functional.pad(at[:, :2], (0, 1)), at[:, 2])
        self._arc.copy_(torch.where(world_mask, self.begun, self._arc))
        for passed in (self.progress, self._gain):
            passed.masked_fill_(world_mask, 0.0)

    def end_step(self) -> None:
        """See how far the vehicle has come."""
        point, _ = self.pose()
        arc, _ = self.routes.locate(self.route, point[:, :2])
        length = self.routes.length[self.route]
        gain = arc - self._arc
        gain -= length * (gain / length).round()
        self._gain.copy_(gain)
        self.progress += gain
        self._arc.copy_(arc)

    def extra_state(self) -> dict[str, torch.Tensor]:
        """Return the progress of the vehicles."""
        return super().extra_state() | {"progress": self.progress, "arc": self._arc}

    def load_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Take it back."""
        super().load_extra_state(state)
        self.progress.copy_(state["progress"])
        self._arc.copy_(state["arc"])

    # ---- what a policy sees and is paid for ----------------------------------------------------------------------

    def lane(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the vehicle's pose in the lane: (W,) aside of its middle [m] and heading off it [rad]; and (W, 5, 2)
        points of the middle ahead, in axes of the vehicle [m].
        """
        point, heading = self.pose()
        arc, aside = self.routes.locate(self.route, point[:, :2])
        ahead = self.preview * torch.arange(PREVIEW + 1, device=self.device)
        at = self.routes.at(self.route, arc.unsqueeze(1) + ahead)
        turn = heading - at[:, 0, 2]
        return (
            aside,
            torch.atan2(turn.sin(), turn.cos()),
            to_heading(at[:, 1:, :2] - point[:, :2].float().unsqueeze(1), heading),
        )

    def measured(self) -> torch.Tensor:
        """Return (W, 3): speed, yaw rate, steering."""
        motion = self._scaled_motion()
        return torch.stack([motion[:, 0], motion[:, 2], self.action[:, 0]], dim=1)

    def exact_state(self) -> torch.Tensor:
        """Return the place in the lane, points of the lane ahead, motion and inputs."""
        aside, turn, ahead = self.lane()
        place = torch.stack([aside / self.lane_half, turn.sin(), turn.cos()], dim=1)
        points = (ahead / (PREVIEW * self.preview)).flatten(1)
        return torch.cat([place, points, self._scaled_motion(), self.action], dim=1)

    def _scaled_motion(self) -> torch.Tensor:
        """(W, 3) float32: speeds ahead and aside over the target speed, and the yaw rate."""
        motion = self.motion()
        motion[:, :2] /= self.config.speed
        return motion

    def outside(self) -> torch.Tensor:
        """Return (W,) bool: the vehicle has left its lane."""
        point, _ = self.pose()
        _, aside = self.routes.locate(self.route, point[:, :2])
        return aside.abs() > self.lane_half

    def _lapped(self) -> torch.Tensor:
        return (self.progress >= self.routes.length[self.route]) & ~self.outside() & ~self.upset()

    def rewards(self) -> dict[str, torch.Tensor]:
        """Return ``progress``, ``lap`` and ``failure``."""
        config = self.config
        return {
            "progress": config.progress_weight * self._gain,
            "lap": config.lap_weight * self._lapped().float(),
            "failure": -config.failure_weight * (self.outside() | self.upset()).float(),
        }

    def terminations(self) -> dict[str, torch.Tensor]:
        """Return ``off_lane``, ``upset`` and ``lap``."""
        return {"off_lane": self.outside(), "upset": self.upset(), "lap": self._lapped()}

    def step_limit(self) -> torch.Tensor:
        """Return (W,) int64, what a lap may take: the lesser of both limits."""
        return self._lap_limit().clamp(max=self.config.max_episode_steps)

    def _lap_limit(self) -> torch.Tensor:
        """(W,) int64 [control steps]."""
        time = self.config.patience * self.routes.length[self.route] / self.config.speed
        return (time / self.config.control_dt).ceil().long()

    def truncations(self) -> dict[str, torch.Tensor]:
        """Return ``too_slow``: the time for a lap is over."""
        return {"too_slow": self.episode_clock >= self._lap_limit()}

    def metrics(self) -> dict[str, torch.Tensor]:
        """Return the share of the lap and the distance from the middle of the lane [m]."""
        aside, _, _ = self.lane()
        return {"laps": self.progress / self.routes.length[self.route], "aside": aside.abs()}

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
        lines.append(Line(outline(point, heading, self.chassis_half), "tab:orange", 2.0))
        reach = max(float(abs(track.points).max()) for track in self.tracks) + 2.0 * self.lane_half
        return Drawing(tuple(lines), ((-reach, reach), (-reach, reach)))
