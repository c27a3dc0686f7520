"""A person who drives in a task: in the policy's place in one world, and what they drove as trajectories."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from simwarp.cli.view.task_subject import TaskLoop
from simwarp.tasks import config_to_plain
from simwarp.train.datasets.trajectories import FORMAT, Trajectories, save_trajectories
from simwarp.viewer.live.driving.browser_driving import Wheel
from simwarp.viewer.live.driving.human_driver import Inputs


@dataclasses.dataclass
class _Row:
    """A control step that a person drove."""

    observations: dict[str, np.ndarray[Any, Any]]
    action: np.ndarray[Any, Any]
    reward: float = 0.0
    terminated: bool = False
    truncated: bool = False


class HumanInTask:
    """Replaces the policy's action of one world of a driving task.

    Actions of driving tasks are steering, and one pedal: throttle above 0, brake below; the speed of those with
    steering alone is held by the task.

    Args:
        loop: of the task.
        seed: of the worlds, to be told in the file.
    """

    def __init__(self, loop: TaskLoop, seed: int) -> None:
        self._loop, self._seed = loop, seed
        self._world = -1
        self._action = torch.zeros(loop.task.action_size, device=loop.task.device)
        self._row: _Row | None = None
        self.recording: Callable[[], bool] = lambda: False
        """Whether the step that follows is kept."""
        self._rows: list[_Row] = []
        loop.overrides.append(self._override)
        loop.resetting.append(self._begun_anew)

    def wheel(self) -> Wheel | None:
        """For a page; None where the task drives no vehicle by these actions."""
        vehicle = getattr(self._loop.task, "vehicle", None)
        if vehicle is None or self._loop.task.action_size not in (1, 2):
            return None
        from simwarp.vehicle.vehicle import Vehicle  # all of a vehicle takes a second to import

        if not isinstance(vehicle, Vehicle):
            return None
        return Wheel(vehicle, self.give, self.leave)

    def give(self, world: int, inputs: Inputs) -> None:
        """The action of the step that follows."""
        self._world = world
        action = [inputs.steering, inputs.throttle - inputs.braking]
        self._action[:] = torch.tensor(action[: len(self._action)])

    def leave(self, world: int) -> None:
        """The policy acts again; an episode that a person began is cut off there."""
        self._world = -1
        self._cut()

    def after_step(self) -> None:
        """Keeps the step, if a person drove it."""
        row, self._row = self._row, None
        if row is None:
            return
        result, world = self._loop.result, self._world
        assert result is not None
        row.action = self._loop.actions[world].cpu().numpy().copy()
        row.reward = float(result.rewards[world])
        row.terminated, row.truncated = bool(result.terminated[world]), bool(result.truncated[world])
        self._rows.append(row)

    def _begun_anew(self, mask: Any) -> None:
        """Worlds of a mask begin new episodes: the driven one was cut off."""
        if self._world >= 0 and (mask is None or bool(np.asarray(mask)[self._world])):
            self._cut()

    def _cut(self) -> None:
        if self._rows and not self._rows[-1].terminated:
            self._rows[-1].truncated = True

    def _override(self, actions: torch.Tensor) -> torch.Tensor:
        if self._world < 0:
            return actions
        if self.recording():
            seen: Mapping[str, torch.Tensor] = self._loop.observations()
            self._row = _Row({name: group[self._world].cpu().numpy().copy() for name, group in seen.items()}, _NONE)
        actions = actions.clone()
        actions[self._world] = self._action
        return actions

    def save(self, path: Path) -> int:
        """Writes what was driven, as `simwarp clone` reads it, if there is anything; returns the number of steps."""
        if not self._rows:
            return 0
        self._cut()
        save_trajectories(path, self.trajectories())
        return len(self._rows)

    def trajectories(self) -> Trajectories:
        """What was driven so far, episode after episode."""
        rows, task = self._rows, self._loop.task
        ended = np.array([row.terminated or row.truncated for row in rows])
        about = {"format": FORMAT, "task": task.name, "task_config": config_to_plain(task.config)}
        data = Trajectories(
            {name: np.stack([row.observations[name] for row in rows]) for name in rows[0].observations},
            np.stack([row.action for row in rows]).astype(np.float32),
            np.array([row.reward for row in rows], np.float32),
            np.cumsum(np.concatenate([[False], ended[:-1]])).astype(np.int64),
            np.array([row.terminated for row in rows]), np.array([row.truncated for row in rows]),
            about | {"policy": "human", "seed": self._seed},
        )  # fmt: skip
        data.add_totals()
        return data


_NONE = np.zeros(0, np.float32)
