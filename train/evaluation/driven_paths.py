"""The ways that evaluated episodes took, seen from above, and how they ended."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from simwarp.tasks import Task

from .evaluation import EpisodeRecords, EvaluationCallback

Points = npt.NDArray[np.float32]
MAX_PATHS = 256
_TINY = 1e-3


@dataclasses.dataclass(frozen=True)
class DrawnObstacle:
    """One line of a task's drawing at the beginning of the episodes.

    Attributes:
        points: (N, P, 2), of every world [m].
        colour: any matplotlib colour.
    """

    points: Points
    colour: str


@dataclasses.dataclass(frozen=True)
class DrivenPaths:
    """First episodes of the first N worlds, from above.

    Attributes:
        paths: per world (P, 2) positions after each control step, from start to end [m].
        reasons: per world, why its episode ended.
        successes: per world, whether that counts as a success.
        known_reasons: all reasons the task knows, in its order.
        control_dt: between two positions [s].
        surroundings: obstacles and ground; empty where the task draws nothing.
        window: ((x low, high), (y low, high)) [m]; None follows the paths.
    """

    paths: tuple[Points, ...]
    reasons: tuple[str, ...]
    successes: tuple[bool, ...]
    known_reasons: tuple[str, ...]
    control_dt: float
    surroundings: tuple[DrawnObstacle, ...]
    window: tuple[tuple[float, float], tuple[float, float]] | None

    @property
    def flat(self) -> bool:
        """True if nothing leaves a straight line along x or y: a map would show nothing."""
        extents = [np.ptp(path, axis=0).min() for path in self.paths if len(path)]
        return max(extents, default=0.0) < _TINY


class PathRecorder(EvaluationCallback):
    """Recorder of the positions of a task's first worlds, from their start to the end of their first episode.

    Attributes:
        paths_driven: recorded paths; None before the end, and where the task is nowhere.
    """

    def __init__(self) -> None:
        self.paths_driven: DrivenPaths | None = None
        self._task: Task[Any] | None = None
        self._positions: list[torch.Tensor] = []

    def begin(self, task: Task[Any]) -> None:
        """Record the start positions and the surroundings."""
        if task.contract.map_position() is None:
            return
        self._task = task
        self._positions = []
        self._surroundings, self._window = _surroundings(task)
        self._look()
        task.before_reset = self._look

    def _look(self) -> None:
        position = self._task.contract.map_position() if self._task is not None else None
        if self._task is None or position is None:
            return
        if len(self._positions) <= self._task.config.max_episode_steps:
            self._positions.append(position[:MAX_PATHS, :2].to(torch.float32, copy=True))

    def end(self, tally: EpisodeRecords) -> None:
        """Cut the ways where the episodes ended."""
        task = self._task
        if task is None:
            return
        task.before_reset = None
        ways = torch.stack(self._positions, dim=1).cpu().numpy()
        first = tally.first_episodes(len(ways), task.agents)
        paths = [way[: int(length) + 1] for way, length in zip(ways, first["length"], strict=False)]
        self.paths_driven = DrivenPaths(
            paths=tuple(path[np.isfinite(path).all(axis=1)] for path in paths),
            reasons=tuple(task.end_reasons[int(index)] for index in first["reason"]),
            successes=tuple(bool(value) for value in first["success"]),
            known_reasons=tuple(task.end_reasons),
            control_dt=task.config.control_dt,
            surroundings=self._surroundings,
            window=self._window,
        )
        self._task, self._positions = None, []


def _surroundings(
    task: Task[Any],
) -> tuple[tuple[DrawnObstacle, ...], tuple[tuple[float, float], tuple[float, float]] | None]:
    """Lines that a task draws, from above, and the window."""
    drawing = task.contract.drawing()
    lines = (line.points[:MAX_PATHS, :, :2].float().cpu().numpy().copy() for line in drawing.lines)
    return tuple(
        DrawnObstacle(points, line.colour) for points, line in zip(lines, drawing.lines, strict=True)
    ), drawing.window
