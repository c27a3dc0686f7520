"""PPO on a task, one iteration at a time, with all state in a checkpoint."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import math
import time
from collections import deque
from typing import Any

import torch
from rsl_rl.runners import OnPolicyRunner
from rsl_rl.storage import RolloutStorage
from simwarp.tasks import InputError, Task

from .config import TrainConfig, rsl_rl_config, to_plain
from .vec_env import TaskVecEnv

_WINDOW_EPISODES = 100


class TrainingError(RuntimeError):
    """Learning broke down; the message says where and what to try."""


@dataclasses.dataclass(frozen=True)
class IterationReport:
    """What one training iteration did.

    Attributes:
        iteration: iterations completed, this one included.
        env_steps: control steps of all worlds since the beginning of the run.
        mean_reward: mean return of the last hundred or more episodes; NaN before the first one ended.
        mean_episode_length: mean length of the same episodes [control steps].
        env_steps_per_s: speed of this iteration, learning included.
        collect_s: time in the worlds and the policy [s].
        learn_s: time in the optimiser [s].
        values: further scalars by name: losses, reward terms, end reasons.
    """

    iteration: int
    env_steps: int
    mean_reward: float
    mean_episode_length: float
    env_steps_per_s: float
    collect_s: float
    learn_s: float
    values: dict[str, float]


class Trainer:
    """Worlds, networks and optimiser of one run.

    The loop is written out here, over rsl-rl's PPO, because rsl-rl's own one prints, reads the device in every step
    and can be stopped only by killing it.

    Args:
        task: the worlds.
        config: the training configuration.
    """

    def __init__(self, task: Task[Any], config: TrainConfig) -> None:
        torch.manual_seed(config.seed)
        self.task = task
        self.config = config
        self.device = str(task.device)
        self.env = TaskVecEnv(task)
        _check_groups(task)
        settings = rsl_rl_config(config, list(task.observation_shapes))
        with contextlib.redirect_stdout(io.StringIO()):  # rsl-rl prints both networks
            self.algorithm = OnPolicyRunner(self.env, settings, log_dir=None, device=self.device).alg
        self.iteration = 0
        self._window: deque[tuple[int, float, float]] = deque()
        if config.spread_start:
            clock = torch.randint(0, task.config.max_episode_steps, (task.num_worlds,), device=self.device)
            self.env.episode_length_buf = clock
        self.algorithm.train_mode()

    @property
    def storage(self) -> RolloutStorage:
        """The rollout of the running iteration."""
        return self.algorithm.storage

    @property
    def env_steps(self) -> int:
        """Control steps of all worlds so far."""
        return self.iteration * self.config.steps_per_iteration * self.config.num_envs

    def iterate(self) -> IterationReport:
        """Collect one rollout, learn from it and report.

        Raises:
            TaskError: the task returned NaN or infinity.
            TrainingError: a loss is no longer finite.
        """
        started = time.perf_counter()
        self.task.on_iteration(self.iteration)
        self.collect()
        collected = time.perf_counter()
        summary = self.task.drain_statistics()  # complains about NaN before the optimiser meets it
        losses = self._learn()
        finished = time.perf_counter()
        self.iteration += 1
        self._remember(summary.episodes, summary.return_sum, summary.length_sum)
        episodes, returns, lengths = (sum(column) for column in zip(*self._window, strict=True))
        values = {f"loss/{name}": float(value) for name, value in losses.items()}
        values["learning_rate"] = float(self.algorithm.learning_rate)
        values["action_std"] = float(self.algorithm.get_policy().output_std.detach().mean())
        values["episodes"] = summary.episodes
        ended = max(summary.episodes, 1)
        values |= {f"reward/{name}": value / ended for name, value in summary.terms.items()}
        values |= {f"end/{name}": count for name, count in summary.end_reasons.items()}
        steps = self.config.steps_per_iteration * self.config.num_envs
        return IterationReport(
            iteration=self.iteration,
            env_steps=self.env_steps,
            mean_reward=returns / episodes if episodes else math.nan,
            mean_episode_length=lengths / episodes if episodes else math.nan,
            env_steps_per_s=steps / (finished - started),
            collect_s=collected - started,
            learn_s=finished - collected,
            values=values,
        )

    def collect(self) -> None:
        """Fill the storage with one rollout and compute its returns."""
        with torch.inference_mode():
            observations = self.env.get_observations()
            for _ in range(self.config.steps_per_iteration):
                actions = self.algorithm.act(observations)
                observations, rewards, dones, extras = self.env.step(actions)
                self.algorithm.process_env_step(observations, rewards, dones, extras)
            self.algorithm.compute_returns(observations)

    def _learn(self) -> dict[str, float]:
        diverged = TrainingError(
            f"learning diverged in iteration {self.iteration + 1}; try a lower --ppo.learning-rate"
        )
        try:
            losses: dict[str, float] = self.algorithm.update()
        except (RuntimeError, ValueError) as error:
            # Sampling from a distribution of NaN fails inside the update, with words about its deviation only
            sound = all(bool(tensor.isfinite().all()) for tensor in self.algorithm.get_policy().parameters())
            if sound:
                raise
            raise diverged from error
        if not all(math.isfinite(value) for value in losses.values()):
            raise diverged
        return losses

    def _remember(self, episodes: int, returns: float, lengths: float) -> None:
        self._window.append((episodes, returns, lengths))
        while (
            len(self._window) > 1 and sum(entry[0] for entry in self._window) - self._window[0][0] >= _WINDOW_EPISODES
        ):
            self._window.popleft()

    def checkpoint(self) -> dict[str, Any]:
        """Return everything a resumed run needs, between two iterations."""
        cuda = torch.cuda.get_rng_state(self.device) if self.device.startswith("cuda") else None
        return {
            "task": self.task.name,
            "iteration": self.iteration,
            "train_config": to_plain(self.config),
            "task_config": to_plain(self.task.config),
            **self.algorithm.save(),
            "torch_rng": torch.get_rng_state(),
            "cuda_rng": cuda,
            "window": [list(entry) for entry in self._window],
            "worlds": self.task.state_dict(),
        }

    def load(self, content: dict[str, Any]) -> bool:
        """Go on from a checkpoint; False where its worlds could not be taken over (another number of them).

        Raises:
            InputError: the checkpoint's networks do not fit this task and configuration.
        """
        try:
            self.algorithm.load(content, None, strict=True)
        except (RuntimeError, ValueError, KeyError) as error:
            raise InputError(
                f"checkpoint of task '{content['task']}' has other networks than this configuration: resume with"
                " the same --network options and observations"
            ) from error
        self.iteration = int(content["iteration"])
        self._window = deque((int(entry[0]), float(entry[1]), float(entry[2])) for entry in content["window"])
        same_worlds = len(content["worlds"]["episode_index"]) == self.task.num_worlds
        if same_worlds:
            self.task.load_state_dict(content["worlds"])
            self.env.refresh()
        torch.set_rng_state(content["torch_rng"].cpu())
        if content["cuda_rng"] is not None and self.device.startswith("cuda"):
            torch.cuda.set_rng_state(content["cuda_rng"].cpu(), self.device)
        return same_worlds


def _check_groups(task: Task[Any]) -> None:
    """Multi-layer perceptrons take flat float32 groups only."""
    for name, shape in task.observation_shapes.items():
        if len(shape) != 1 or task.observation_dtypes[name] != torch.float32:
            raise InputError(
                f"observation '{name}' of task '{task.name}' is {shape} {task.observation_dtypes[name]};"
                " the networks here take (N,) float32 groups"
            )
