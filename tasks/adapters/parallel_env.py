"""A world of several agents as a parallel environment, with the interface of PettingZoo's ``ParallelEnv``.

    env = TaskParallelEnv("convoy", leaders="simulated", followers=3)
    observations, infos = env.reset(seed=1)
    while env.agents:
        actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        observations, rewards, terminations, truncations, infos = env.step(actions)

PettingZoo is not needed; where it is installed, the class is one of its own.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch

from simwarp.core.types import formatted, numbers

from ..framework.errors import InputError
from ..framework.registry import make
from ..framework.task import Task
from .gym_env import Observation, action_space, env_id, observation_space, to_numpy
from .rendering import RENDER_MODES, RENDER_SIZE, Frames, TaskRenderer, check_rendering, metadata_of

try:
    from pettingzoo import ParallelEnv as _Base  # type: ignore[import-not-found,unused-ignore]
except ImportError:
    _Base = object

Values = dict[str, Any]


class TaskParallelEnv(_Base):  # type: ignore[misc,unused-ignore]
    """One world of a task; each of its agents has a name, ``agent_0`` and so on.

    An agent whose episode is over is gone from ``agents`` from then on and rests in the world, which ends with its last
    agent. What is returned are copies.

    Args:
        task: name of a registered task, or a task of one world.
        device: device, for a name.
        seed: seed, for a name; ``reset(seed=...)`` replaces it.
        render_mode: ``rgb_array``: :meth:`render` returns frames; None: it does not.
        render_size: width and height of a frame [pixels], even.
        overrides: fields of the task's configuration.

    Attributes:
        possible_agents: names of all agents.
        agents: names of those that are not done.
        num_agents, max_num_agents: number of both.

    Raises:
        InputError: there is no such task, device or render mode, a field or size is wrong, or there are several worlds.
    """

    metadata: dict[str, Any] = {"render_modes": [*RENDER_MODES], "is_parallelizable": True}  # noqa: RUF012 - as PettingZoo

    def __init__(
        self,
        task: str | Task[Any],
        *,
        device: str = "cpu",
        seed: int = 0,
        render_mode: str | None = None,
        render_size: tuple[int, int] = RENDER_SIZE,
        **overrides: Any,
    ) -> None:
        check_rendering(render_mode, render_size)
        self.task = make(task, 1, device=device, seed=seed, **overrides) if isinstance(task, str) else task
        if self.task.num_worlds != 1:
            raise InputError(f"task '{self.task.name}' has {self.task.num_worlds} worlds; make it with num_worlds=1")
        self.task.keep_final_observations = True
        self.metadata = {**metadata_of(self.task), "name": self.task.name, "is_parallelizable": True}
        self.render_mode = render_mode
        self.possible_agents = [f"agent_{index}" for index in range(self.task.agents)]
        self.agents: list[str] = []
        self.observation_spaces = {agent: observation_space(self.task) for agent in self.possible_agents}
        self.action_spaces = {agent: action_space(self.task) for agent in self.possible_agents}
        self._renderer = TaskRenderer(self.task, render_mode, render_size)

    def __repr__(self) -> str:
        return f"TaskParallelEnv of task '{self.task.name}': {self.max_num_agents} agents on {self.task.device}"

    @property
    def num_agents(self) -> int:
        """Number of agents that are not done."""
        return len(self.agents)

    @property
    def max_num_agents(self) -> int:
        """Number of all agents."""
        return len(self.possible_agents)

    @property
    def unwrapped(self) -> TaskParallelEnv:
        """The environment itself."""
        return self

    def observation_space(self, agent: str) -> gym.Space[Any]:
        """Return the space of an agent's observation, the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gym.spaces.Box:
        """Return the space of an agent's action, the same object each time: [-1, 1] per component."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Values, Values]:
        """Begin a new episode, with a seed the same one again; return observations and infos by agent."""
        groups = self.task.restart(seed=seed)
        self.task.check_values()
        self.agents = [*self.possible_agents]
        self._renderer.restart()
        return self._by_agent(to_numpy(groups), self.agents), {agent: {} for agent in self.agents}

    def step(self, actions: Values) -> tuple[Values, Values, Values, Values, Values]:
        """Advance the world.

        Args:
            actions: agent -> (A,), each in [-1, 1]; of every agent that is not done.

        Returns:
            Observations, rewards, terminations, truncations and infos of the agents that were not done before.

        Raises:
            InputError: an action is missing, of an agent that is done or none, or no numbers of its space's shape.
        """
        acting = [*self.agents]
        missing = [agent for agent in acting if agent not in actions]
        other = [agent for agent in actions if agent not in acting]
        if missing or other:
            what = f"no action of {missing[0]}" if missing else f"an action of '{other[0]}'"
            raise InputError(f"step needs actions of {', '.join(acting) or 'no agent: call reset()'}, got {what}")
        if not acting:
            return {}, {}, {}, {}, {}
        rows = np.zeros((1, self.task.agents, self.task.action_size), np.float32)
        for agent in acting:
            rows[0, self._index(agent)] = self._numbers(agent, actions[agent])
        batch = torch.as_tensor(rows, device=self.task.device).view(self.task.action.shape)
        result = self.task.step(batch)
        self.task.check_values()
        self._renderer.advance()
        ended = (result.terminated | result.truncated).view(-1).tolist()
        self.agents = [agent for agent in acting if not ended[self._index(agent)]]
        # Once all are done the world has begun anew: what ended is shown
        groups = result.observations if self.agents else result.final_observations
        assert groups is not None
        infos: Values = {}
        for agent in acting:
            reason = int(result.end_reason.view(-1)[self._index(agent)])
            infos[agent] = {} if reason < 0 else {"end_reason": self.task.end_reasons[reason]}
        flags = (result.rewards, result.terminated, result.truncated)
        rewards, terminated, truncated = (
            dict(zip(self.possible_agents, one.view(-1).tolist(), strict=True)) for one in flags
        )
        picked = ({agent: values[agent] for agent in acting} for values in (rewards, terminated, truncated))
        return (self._by_agent(to_numpy(groups), acting), *picked, infos)  # type: ignore[return-value]

    def render(self) -> Frames | None:
        """Return a frame, (height, width, 3) uint8 sRGB, of the world as it is; None without a render mode.

        Raises:
            InputError: the task has neither bodies nor a drawing.
        """
        frames = self._renderer.frames(env_id(self.task.name))
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Nothing is held open."""

    def _numbers(self, agent: str, action: Any) -> np.ndarray[Any, Any]:
        """Return an action as float32 of its space's shape."""
        shape = (self.task.action_size,)
        given = numbers(action)
        if given.shape != shape or np.isnan(given).any():
            raise InputError(f"step: action of {agent} must be {shape} numbers in [-1, 1], got {formatted(action)}")
        return given.astype(np.float32)

    def _index(self, agent: str) -> int:
        return self.possible_agents.index(agent)

    def _by_agent(self, observation: Observation, agents: list[str]) -> Values:
        """Return observations (1, N, ...), or (1, ...) of a single agent, by name."""
        if self.task.agents == 1:
            return {agent: self._of(observation, (0,)) for agent in agents}
        return {agent: self._of(observation, (0, self._index(agent))) for agent in agents}

    @staticmethod
    def _of(observation: Observation, place: tuple[int, ...]) -> Observation:
        if isinstance(observation, dict):
            return {name: np.array(group[place]) for name, group in observation.items()}
        return np.array(observation[place])
