"""A task as the ``VecEnv`` of Stable-Baselines3; needs ``simwarp[sb3]``.

    from stable_baselines3 import PPO
    from simwarp.tasks.adapters.sb3_adapter import SB3VecEnv

    PPO("MlpPolicy", SB3VecEnv("pendulum", 64)).learn(100_000)

Where an episode ended, the world's info holds what Stable-Baselines3 looks for: ``terminal_observation``, the true last
observation; ``TimeLimit.truncated``, whether the future is unknown and not empty; ``episode`` with return and length,
so that no ``VecMonitor`` is needed; and ``is_success``.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv

from ..framework.errors import InputError
from ..framework.task import Task
from .gym_env import Observation, TaskVectorEnv

__all__ = ["SB3VecEnv"]

Indices = None | int | Iterable[int]


class SB3VecEnv(VecEnv):
    """All worlds of a task, with same-step auto-reset; what it returns are copies.

    Args:
        task: name of a registered task, or a task.
        num_envs: number of worlds, for a name.
        device: device of the physics, for a name.
        seed: seed, for a name; ``seed(...)`` before a reset replaces it.
        overrides: fields of the task's configuration, and what :class:`~simwarp.tasks.TaskVectorEnv` takes beside them:
            ``level`` and ``steps_per_iteration`` of the curriculum, ``render_mode`` and ``render_size``.
    """

    def __init__(
        self, task: str | Task[Any], num_envs: int = 1, *, device: str = "cpu", seed: int = 0, **overrides: Any
    ) -> None:
        self.batch = TaskVectorEnv(task, num_envs, device=device, seed=seed, **overrides)
        self.task = self.batch.task
        self._started = time.monotonic()
        self._actions: npt.NDArray[np.float32] | None = None
        super().__init__(self.batch.num_envs, self.batch.single_observation_space, self.batch.single_action_space)
        self.metadata["render_fps"] = self.batch.metadata["render_fps"]  # of films

    def reset(self) -> Observation:
        """Begin new episodes everywhere and return the observations; after ``seed(n)`` the same ones again."""
        observations, _ = self.batch.reset(seed=self._seeds[0])
        self._reset_seeds()
        self._reset_options()
        self.reset_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        return observations

    def step_async(self, actions: npt.NDArray[np.float32]) -> None:
        """Take the (W, A) actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Observation, npt.NDArray[Any], npt.NDArray[Any], list[dict[str, Any]]]:
        """Advance all worlds; return observations, rewards (W,), dones (W,) and one info per world."""
        observations, rewards, terminated, truncated, extra = self.batch.step(self._actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for world in np.flatnonzero(done):
            facts = extra["final_info"]
            infos[world] = {
                "terminal_observation": extra["final_obs"][world],
                "TimeLimit.truncated": bool(truncated[world]),
                "episode": {
                    "r": float(facts["return"][world]),
                    "l": int(facts["length"][world]),
                    "t": round(time.monotonic() - self._started, 6),
                },
                "is_success": bool(facts["success"][world]),
                "end_reason": facts["end_reason"][world],
            }
        return observations, rewards, done, infos

    def set_level(self, level: float | npt.NDArray[Any]) -> None:
        """Hold the curriculum's level from the next episodes on: dimensionless, one number in [0, 1], or (W,)."""
        self.batch.set_level(level)

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """Return a frame, (height, width, 3) uint8 sRGB, of every world; None of each without a render mode.

        ``render()`` tiles them to one picture, and `VecVideoRecorder` writes that as a film.

        Raises:
            InputError: the task has neither bodies nor a drawing.
        """
        frames = self.batch.render()
        return [None] * self.num_envs if frames is None else list(frames)

    def close(self) -> None:
        """Nothing is held open."""

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the batch or of its task, once per world of ``indices``."""
        owner = self.batch if hasattr(self.batch, attr_name) else self.task
        return [getattr(owner, attr_name)] * self._count(indices)

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Refuse: worlds are one batch, and have no attributes of their own."""
        raise InputError(f"worlds have no attribute '{attr_name}' of their own: change the task, SB3VecEnv.task")

    def env_method(self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any) -> list:
        """Call a method of the task, for the whole batch; the result, once per world of ``indices``."""
        return [getattr(self.task, method_name)(*method_args, **method_kwargs)] * self._count(indices)

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Indices = None) -> list[bool]:
        """Return that no world is wrapped."""
        return [False] * self._count(indices)

    def _count(self, indices: Indices) -> int:
        return len(list(self._get_indices(indices)))
