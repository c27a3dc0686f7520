"""A task as the ``VecEnv`` that rsl-rl steps."""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from simwarp.tasks import InputError, Task
from simwarp.tasks.framework.agent_rows import Rows

from ..config import CRITIC

TEACHER = "teacher "
"""Before the names of the observation groups of a teacher."""


class TaskVecEnv(VecEnv):
    """rsl-rl's view of a task: a row for each agent of each world.

    rsl-rl keeps the observations it is handed by reference and copies them only after the next step. A task may
    return its own buffers, which that step overwrites: every group is therefore cloned on the way out, here
    and nowhere else.

    Args:
        task: the worlds.
        privileged: add the group ``critic``: the exact state that only the critic sees.
        teacher: add the groups of a teacher, each as ``teacher NAME``, that was trained on these observations; "" of a
            task without a choice.
        reward_scale: factor of the rewards that are handed out; terms and statistics are without it.

    Raises:
        InputError: a privileged critic or a teacher was asked for, and the task has nothing for it.
    """

    def __init__(
        self, task: Task[Any], *, privileged: bool = False, teacher: str | None = None, reward_scale: float = 1.0
    ) -> None:
        self.task = task
        self._reward_scale = reward_scale
        # rsl-rl bootstraps time-outs with the value before the step and never looks at the final observation
        task.keep_final_observations = False
        self.rows = Rows(task)
        self.num_envs = self.rows.count
        self.num_actions = task.action_size
        self.max_episode_length = task.config.max_episode_steps
        self.device = str(task.device)
        self.cfg: Any = task.config
        if privileged and task.observe_privileged() is None:
            raise InputError(
                f"--network.critic privileged: task '{task.name}' keeps nothing from the actor in this configuration;"
                " use --network.critic same"
            )
        self.broken = torch.zeros(self.num_envs, dtype=torch.bool, device=self.device)
        """(rows,) bool: rows whose physics broke down since this was cleared."""
        self.acting: torch.Tensor | None = None
        """(rows,) bool: rows that took part in the last step; None where every row always does."""
        self._privileged = privileged
        self._teacher = teacher
        self._groups = self.rows.restart()

    def __repr__(self) -> str:
        return f"TaskVecEnv of task '{self.task.name}': {self.num_envs} worlds on {self.device}"

    @property
    def episode_length_buf(self) -> torch.Tensor:
        """(rows,) int64: the clock that the step limit looks at."""
        clock = self.task.episode_clock
        return clock if self.task.agents == 1 else clock.repeat_interleave(self.task.agents)

    @episode_length_buf.setter
    def episode_length_buf(self, value: torch.Tensor) -> None:
        # rsl-rl rebinds this attribute to spread the first time-outs; the task must go on counting in its own buffer
        # where agents of a world share one, that of the first
        self.task.episode_clock.copy_(value[:: self.task.agents])

    def hand_out(self, groups: dict[str, torch.Tensor]) -> TensorDict:
        """Return a copy of observation groups, name -> (rows, ...), that no later step changes."""
        if self._privileged:
            exact = self.task.observe_privileged()
            assert exact is not None  # it was not when this was made
            groups = {**groups, **self.rows.flat({CRITIC: exact})}
        if self._teacher is not None:
            seen = self.rows.flat(self.task.observe_as(self._teacher or None))
            groups = {**groups, **{f"{TEACHER}{name}": group for name, group in seen.items()}}
        copies = {name: group.clone() for name, group in groups.items()}
        return TensorDict(copies, batch_size=[self.num_envs], device=self.device)

    def get_observations(self) -> TensorDict:
        """Return a copy of the current observations, group name -> (rows, ...)."""
        return self.hand_out(self._groups)

    def refresh(self) -> None:
        """Observe again, after the task's state was replaced from outside."""
        self._groups = self.rows.flat(self.task.observe())

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Advance all worlds; see rsl-rl's ``VecEnv.step`` for what comes back."""
        result = self.rows.step(actions)
        self.acting = result.acting
        self._groups = result.observations
        self.broken = self.broken | result.non_finite
        means = result.reward_terms.mean(dim=0)
        extras: dict[str, Any] = {
            "time_outs": result.truncated,
            # Kept by reference until the iteration ends: new tensors in every step
            "log": {f"/reward/{name}": means[index] for index, name in enumerate(self.task.reward_terms)},
        }
        rewards = result.rewards if self._reward_scale == 1.0 else self._reward_scale * result.rewards
        return self.hand_out(result.observations), rewards, result.terminated | result.truncated, extras
