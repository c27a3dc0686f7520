"""Gymnasium over a task: a batched ``VectorEnv`` and a single-world ``Env``.

Ids are ``simwarp/Pendulum-v0``, of a variant ``simwarp/AntThesis-v0``, and so on; importing ``simwarp.tasks`` registers
them. Both return NumPy copies, so that nothing a user keeps changes under them.
"""

from __future__ import annotations

import contextlib
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from simwarp.core.types import host_values

from ..framework.agent_rows import refuse_agents
from ..framework.registry import make, task_names, variant_names
from ..framework.task import StepResult, Task
from .iterations import Iterations
from .rendering import RENDER_MODES, RENDER_SIZE, Frames, TaskRenderer, check_rendering, metadata_of

Observation = Any
"""One array where the only group is ``policy``, else a dict of arrays."""


_NO_AGENTS = "and Gymnasium knows none that is done and waits for others"
_PARALLEL = "use simwarp.tasks.adapters.parallel_env.TaskParallelEnv"


def _box(shape: tuple[int, ...], dtype: torch.dtype) -> gym.spaces.Box:
    numpy_dtype = np.dtype(str(dtype).removeprefix("torch."))
    if dtype == torch.bool:
        return gym.spaces.Box(0, 1, shape, np.bool_)  # type: ignore[arg-type]
    if dtype.is_floating_point:
        return gym.spaces.Box(-np.inf, np.inf, shape, numpy_dtype.type)
    limits = np.iinfo(numpy_dtype)
    return gym.spaces.Box(limits.min, limits.max, shape, numpy_dtype.type)


def observation_boxes(task: Task[Any]) -> dict[str, gym.Space[Any]]:
    """Return the space of each observation group of one world."""
    return {name: _box(shape, task.observation_dtypes[name]) for name, shape in task.observation_shapes.items()}


def observation_space(task: Task[Any]) -> gym.Space[Any]:
    """Return the space of one world's observation: a Box for ``policy`` alone, else a Dict."""
    boxes = observation_boxes(task)
    return boxes["policy"] if list(boxes) == ["policy"] else gym.spaces.Dict(boxes)


def action_space(task: Task[Any]) -> gym.spaces.Box:
    """Return the space of one world's action: [-1, 1] per component."""
    return gym.spaces.Box(-1.0, 1.0, (task.action_size,), np.float32)


def to_numpy(groups: dict[str, torch.Tensor]) -> Observation:
    """Copy observation groups to the host."""
    arrays = {name: np.array(group.detach().cpu().numpy()) for name, group in groups.items()}
    return arrays["policy"] if list(arrays) == ["policy"] else arrays


class TaskVectorEnv(VectorEnv[Any, Any, Any]):
    """A task as a Gymnasium ``VectorEnv`` with same-step auto-reset.

    Where an episode ended, ``info["final_obs"]`` holds the true last observation of that world (an object array, as
    Gymnasium's own vector environments have it) and ``info["final_info"]`` its return, length and end reason.

    Args:
        task: name of a registered task, or a task.
        num_envs: number of worlds, for a name.
        device: device, for a name.
        seed: seed, for a name; ``reset(seed=...)`` replaces it.
        max_episode_steps: replaces the task's own limit.
        render_mode: ``rgb_array``: :meth:`render` returns frames; None: it does not.
        render_size: width and height of a frame [pixels], even.
        level: of the curriculum, dimensionless in [0, 1], held until :meth:`set_level`; None: 1, or as
            `steps_per_iteration` moves it.
        steps_per_iteration: control steps after which a training iteration begins, so that the curriculum moves as in
            ``simwarp train``; None: none begins.
        overrides: fields of the task's configuration.

    Raises:
        InputError: there is no such task, device or render mode, or a field, size or level is wrong.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium looks at the class, each environment has its own
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": [*RENDER_MODES],
    }

    def __init__(
        self,
        task: str | Task[Any],
        num_envs: int = 1,
        *,
        device: str = "cpu",
        seed: int = 0,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        render_size: tuple[int, int] = RENDER_SIZE,
        level: float | None = None,
        steps_per_iteration: int | None = None,
        **overrides: Any,
    ) -> None:
        check_rendering(render_mode, render_size)
        if max_episode_steps is not None:
            overrides["max_episode_steps"] = max_episode_steps
        self.task = make(task, num_envs, device=device, seed=seed, **overrides) if isinstance(task, str) else task
        refuse_agents(self.task, _NO_AGENTS, _PARALLEL)
        self.task.keep_final_observations = True
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, **metadata_of(self.task)}
        self.render_mode = render_mode
        self._renderer = TaskRenderer(self.task, render_mode, render_size)
        self.num_envs = self.task.num_worlds
        self.single_observation_space = observation_space(self.task)
        self.single_action_space = action_space(self.task)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, dtype=np.int64)
        self._iterations = Iterations(self.task, level, steps_per_iteration)

    def set_level(self, level: float | Any) -> None:
        """Hold the curriculum's level from the next episodes on: dimensionless, one number in [0, 1], or (W,)."""
        self._iterations.hold(level)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin new episodes everywhere; with a seed the same ones again.

        Args:
            seed: of the episodes; None goes on with that of before.
            options: ``level`` is that of :meth:`set_level`.
        """
        super().reset(seed=seed)
        if options and "level" in options:
            self.set_level(options["level"])
        self._returns[:] = 0.0
        self._lengths[:] = 0
        self._renderer.restart()
        groups = self.task.restart(seed=seed)
        self.task.check_values()
        return to_numpy(groups), {}

    def render(self) -> tuple[Frames, ...] | None:
        """Return a frame, (height, width, 3) uint8 sRGB, of every world; None without a render mode.

        Where an episode has just ended it is the first one of the next, as the observation is.

        Raises:
            InputError: the task has neither bodies nor a drawing.
        """
        frames = self._renderer.frames(env_id(self.task.name))
        return None if frames is None else tuple(frames)

    def step(self, actions: Any) -> tuple[Observation, Any, Any, Any, dict[str, Any]]:
        """Advance all worlds; ``actions`` is (W, A)."""
        self._iterations.advance()
        batch = torch.as_tensor(np.asarray(host_values(actions), dtype=np.float32), device=self.task.device)
        result = self.task.step(batch)
        self.task.check_values()
        self._renderer.advance()
        rewards = result.rewards.cpu().numpy().copy()
        terminated = result.terminated.cpu().numpy().copy()
        truncated = result.truncated.cpu().numpy().copy()
        self._returns += rewards
        self._lengths += 1
        infos = self._final_infos(result, terminated | truncated)
        return to_numpy(result.observations), rewards, terminated, truncated, infos

    def _final_infos(self, result: StepResult, ended: np.ndarray[Any, Any]) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        if not ended.any():
            return infos
        non_finite = result.non_finite.cpu().numpy()
        assert result.final_observations is not None
        final = to_numpy(result.final_observations)
        reason = result.end_reason.cpu().numpy()
        success = result.success.cpu().numpy()
        for world in np.flatnonzero(ended):
            index = int(world)
            last = {key: value[index] for key, value in final.items()} if isinstance(final, dict) else final[index]
            final_info = {
                "return": float(self._returns[index]),
                "length": int(self._lengths[index]),
                "end_reason": self.task.end_reasons[reason[index]],
                "success": bool(success[index]),
                "non_finite": bool(non_finite[index]),
            }
            infos = self._add_info(infos, {"final_obs": last, "final_info": final_info}, index)
        self._returns[ended] = 0.0
        self._lengths[ended] = 0
        return infos


class TaskEnv(gym.Env[Any, Any]):
    """One world of a task as a Gymnasium ``Env``: no auto-reset is visible.

    Args:
        task: name of a registered task.
        device: device name.
        seed: seed; ``reset(seed=...)`` replaces it.
        render_mode: ``rgb_array``: :meth:`render` returns frames; None: it does not.
        render_size: width and height of a frame [pixels], even.
        level: of the curriculum, dimensionless in [0, 1], held until :meth:`set_level`; None: 1, or as
            `steps_per_iteration` moves it.
        steps_per_iteration: control steps after which a training iteration begins, as of a `TaskVectorEnv`.
        overrides: fields of the task's configuration.

    Raises:
        InputError: there is no such task, device or render mode, or a field, size or level is wrong.
    """

    metadata: dict[str, Any] = {"render_modes": [*RENDER_MODES]}  # noqa: RUF012 - as above

    def __init__(
        self,
        task: str,
        *,
        device: str = "cpu",
        seed: int = 0,
        render_mode: str | None = None,
        render_size: tuple[int, int] = RENDER_SIZE,
        level: float | None = None,
        steps_per_iteration: int | None = None,
        **overrides: Any,
    ) -> None:
        check_rendering(render_mode, render_size)
        self.task = make(task, 1, device=device, seed=seed, **overrides)
        refuse_agents(self.task, _NO_AGENTS, _PARALLEL)
        self.metadata = metadata_of(self.task)
        self.render_mode = render_mode
        self._renderer = TaskRenderer(self.task, render_mode, render_size)
        self._last_frame: Frames | None = None
        self.observation_space = observation_space(self.task)
        self.action_space = action_space(self.task)
        self._iterations = Iterations(self.task, level, steps_per_iteration)

    def set_level(self, level: float) -> None:
        """Hold the curriculum's level from the next episode on, dimensionless, in [0, 1]."""
        self._iterations.hold(level)

    def __repr__(self) -> str:
        return f"TaskEnv of task '{self.task.name}' on {self.task.device}, render mode {self.render_mode}"

    def _first(self, observation: Observation) -> Observation:
        return (
            {key: value[0] for key, value in observation.items()} if isinstance(observation, dict) else observation[0]
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a new episode; with a seed the same one again.

        Args:
            seed: of the episode; None goes on with that of before.
            options: ``level`` is that of :meth:`set_level`.
        """
        super().reset(seed=seed)
        if options and "level" in options:
            self.set_level(options["level"])
        self._renderer.restart()
        self._last_frame = None
        groups = self.task.restart(seed=seed)
        self.task.check_values()
        return self._first(to_numpy(groups)), {}

    def render(self) -> Frames | None:
        """Return a frame, (height, width, 3) uint8 sRGB; None without a render mode.

        After the step that ended an episode it shows that end, if a frame was asked for before.

        Raises:
            InputError: the task has neither bodies nor a drawing.
        """
        if self._last_frame is not None:
            return self._last_frame.copy()
        frames = self._renderer.frames(env_id(self.task.name))
        if frames is None:
            return None
        self.task.before_reset = self._keep_last_frame
        return frames[0]

    def _keep_last_frame(self) -> None:
        """Show the end of an episode while the world still is there: the step that ends it also resets it."""
        if self.task._outcome.ended.item():
            frames = self._renderer.frames(env_id(self.task.name))
            self._last_frame = None if frames is None else frames[0]

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance the world; ``action`` is (A,), each in [-1, 1].

        Returns:
            Observation, reward, terminated, truncated and info, as ``gymnasium.Env.step``.
        """
        row = np.asarray(host_values(action), dtype=np.float32)
        batch = torch.as_tensor(row, device=self.task.device).reshape(1, -1)
        self._iterations.advance()
        self._last_frame = None
        self._renderer.advance()
        result = self.task.step(batch)
        self.task.check_values()
        terminated, truncated = bool(result.terminated.item()), bool(result.truncated.item())
        info: dict[str, Any] = {}
        groups = result.observations
        if terminated or truncated:
            # The world has already been reset; what ended is shown, and the caller resets as Gymnasium asks
            assert result.final_observations is not None
            groups = result.final_observations
            info["end_reason"] = self.task.end_reasons[int(result.end_reason.item())]
        return self._first(to_numpy(groups)), float(result.rewards.item()), terminated, truncated, info


def env_id(task_name: str, variant: str = "") -> str:
    """Return the Gymnasium id of a task, or of a variant of it that is not its default.

    ``simwarp/Pendulum-v0`` for ``pendulum``, ``simwarp/AntThesis-v0`` for ``ant`` in its variant ``thesis``.
    """
    return f"simwarp/{''.join(part.capitalize() for part in (*task_name.split('-'), variant))}-v0"


def register_envs() -> None:
    """Register every task and variant with Gymnasium; called when ``simwarp.tasks`` is imported, harmless again."""
    for name in task_names():
        for variant in ("", *variant_names(name)):
            identity = env_id(name, variant)
            if identity in gym.registry:
                continue
            with contextlib.suppress(gym.error.Error):
                gym.register(
                    identity,
                    entry_point="simwarp.tasks.adapters.gym_env:TaskEnv",
                    vector_entry_point="simwarp.tasks.adapters.gym_env:TaskVectorEnv",
                    kwargs={"task": name} | ({"variant": variant} if variant else {}),
                )
