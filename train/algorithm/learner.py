"""Learning on a task, one iteration at a time, with all state in a checkpoint: what all ways of learning share."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import math
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, Final

import torch
import warp as wp
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from simwarp.core.files import OutputError
from simwarp.core.memory import check_fits
from simwarp.core.threads import thread_count
from simwarp.tasks import NON_FINITE, EpisodeSummary, InputError, Task, TaskError, config_to_plain
from simwarp.tasks.framework.config_values import typed
from simwarp.tasks.framework.registry import origin_of
from simwarp.tasks.framework.saved_state import check_like
from simwarp.tasks.framework.saved_task import NEW_STATE

from ..config import TrainConfig, train_config_from_plain
from ..runs.checkpoint import check_members
from ..runs.progress_table import BY_MODEL, LOGGED, PHASE, SUCCESS
from ..runs.saved_state import check_memories, check_optimizer
from .distributed import Processes
from .learner_thread_pool import LearnerThreads
from .phase_sample import LEARN, UNTIMED, TimedStep
from .vec_env import TaskVecEnv

_WINDOW_EPISODES = 100
_FLOAT_BYTES = 4
_SAVED: Final[Mapping[str, Any]] = {"optimizer_state_dict": dict, "window": list}
"""Entries beside the networks of a checkpoint that can be resumed, and their types."""
_SAVED_BY_EACH: Final[Mapping[str, Any]] = {
    "torch_rng": torch.Tensor,
    "cuda_rng": torch.Tensor | None,
    "worlds": dict,
}
"""Entries for each process."""


class TrainingError(RuntimeError):
    """Learning broke down; the message says where and what to try."""


class IterationLeftError(Exception):
    """An iteration was left in the middle: what the worlds did in it is lost."""


class OtherNetworksError(InputError):
    """A checkpoint's networks are not those of the configuration."""


@dataclasses.dataclass(frozen=True)
class IterationReport:
    """Report of one training iteration.

    Attributes:
        iteration: iterations completed, this one included.
        env_steps: control steps of all worlds since the beginning of the run.
        mean_reward: mean return of the last hundred or more episodes; NaN before the first one ended.
        mean_episode_length: mean length of the same episodes [control steps].
        env_steps_per_s: speed of this iteration, learning included.
        collect_s: time in the worlds and the policy [s].
        learn_s: time in the optimiser [s].
        values: further scalars by name: losses, reward terms, end reasons.
        all_broken: the physics of every world broke down, and no episode ended otherwise.
    """

    iteration: int
    env_steps: int
    mean_reward: float
    mean_episode_length: float
    env_steps_per_s: float
    collect_s: float
    learn_s: float
    values: dict[str, float]
    all_broken: bool = False


class Learner(ABC):
    """Worlds, networks and optimiser of one run.

    The loop is written out here, over an algorithm of rsl-rl, because rsl-rl's own one prints, reads the device in
    every step and can be stopped only by killing it.

    Args:
        task: the worlds of this process.
        config: the training configuration.
        env: the task as rsl-rl steps it.
        group: the processes that train together; this one alone by default. They must be connected.
    """

    rate_option: ClassVar[str]
    """Option of the step size."""
    algorithm: Any
    """rsl-rl's algorithm: its networks, optimiser and rollout."""

    def __init__(self, task: Task[Any], config: TrainConfig, env: TaskVecEnv, group: Processes | None = None) -> None:
        self.task = task
        self.config = config
        self.env = env
        self.group = group or Processes()
        self.device = str(task.device)
        self._check_rollout()
        with contextlib.redirect_stdout(io.StringIO()):  # rsl-rl prints the networks
            self.algorithm = self._make_algorithm(self.env.get_observations())
        count = thread_count(config.threads) if task.device.type == "cpu" else 1
        self.threads = LearnerThreads(count) if count > 1 else None
        """Threads that learn; None where there is only the caller's."""
        self.algorithm.threads = self.threads
        if self.group.several:
            self.algorithm.broadcast_parameters()
            torch.manual_seed(config.seed + self.group.rank)  # exploration differs
        self.iteration = 0
        self.env_steps = 0
        """Control steps of all worlds since the beginning of the run."""
        self.interlude: Callable[[], bool] = lambda: False
        """Called between two control steps and, in a single process, between two mini-batches: all of the learner's
        state is whole there. True leaves the iteration."""
        if not self.group.several:  # several must take as many steps of the optimiser
            self.algorithm.optimizer.register_step_post_hook(self._between_batches)
        self._window: deque[tuple[int, float, float]] = deque()
        self._timed_step = TimedStep(task)
        if config.spread_start:
            chance = torch.rand(task.num_worlds, device=self.device)
            self.env.episode_length_buf = (chance * task.contract.step_limit()).long().repeat_interleave(task.agents)
        self.algorithm.train_mode()

    @abstractmethod
    def _make_algorithm(self, observations: TensorDict) -> Any:
        """Return rsl-rl's algorithm.

        Args:
            observations: an example of them.
        """

    @property
    @abstractmethod
    def networks(self) -> Mapping[str, MLPModel]:
        """Networks by name; ``actor`` is the one that acts. A checkpoint has the state of each as NAME_state_dict."""

    @abstractmethod
    def _learn(self) -> dict[str, float]:
        """Learn from the rollout in the storage, clear it, and return the mean losses."""

    def close(self) -> None:
        """End the threads that learn."""
        if self.threads is not None:
            self.threads.close()

    def _check_rollout(self) -> None:
        """Refuse a rollout that does not fit into memory, before it is allocated.

        Raises:
            ModelError: it does not.
        """
        groups: dict[str, torch.Tensor] = dict(self.env.get_observations())
        step = sum(group[0].numel() * group.element_size() for group in groups.values())
        steps, worlds = self.config.steps_per_iteration, self.env.num_envs
        needed = steps * worlds * (step + _FLOAT_BYTES * (4 * self.task.action_size + 6))
        what = f"{steps} control steps of {self.config.num_envs} worlds per iteration"
        check_fits(what, needed, wp.get_device(self.device), "take a smaller --steps-per-iteration or --num-envs")

    @property
    def storage(self) -> RolloutStorage:
        """The rollout of the running iteration."""
        return self.algorithm.storage

    @property
    def steps_per_iteration(self) -> int:
        """Control steps of all worlds of all processes per iteration."""
        return self.config.steps_per_iteration * self.config.num_envs * self.group.count

    def iterate(self) -> IterationReport:
        """Collect one rollout, learn from it and report.

        Raises:
            TaskError: the task returned NaN or infinity.
            TrainingError: a loss is no longer finite.
            IterationLeftError: :attr:`interlude` of any process asked for it.
        """
        started = time.perf_counter()
        logged = self.task.contract.on_iteration(self.iteration)
        means = {LOGGED + name: float(each.float().mean()) for name, each in logged.items()}
        means = self.group.sums(means, self.device)
        with self._watched():
            self.collect()
            collected = time.perf_counter()
            summary = self._totals(self.task.drain_statistics())  # complains about NaN before the optimiser meets it
            losses = self._learn()
            if not all(math.isfinite(value) for value in losses.values()):
                raise self._diverged()
        finished = time.perf_counter()
        self.iteration += 1
        self.env_steps += self.steps_per_iteration
        self._remember(summary.episodes, summary.return_sum, summary.length_sum)
        episodes, returns, lengths = (sum(column) for column in zip(*self._window, strict=True))
        values = {f"loss/{name}": float(value) for name, value in losses.items()}
        values["learning_rate"] = float(self.algorithm.learning_rate)
        values["action_std"] = float(self.algorithm.get_policy().output_std.detach().mean())
        values |= _of_episodes(summary)
        for name, each in summary.by_model.items():
            values |= {f"{BY_MODEL}{name}/{key}": value for key, value in _of_episodes(each).items()}
            values[f"{BY_MODEL}{name}/return"] = each.mean_return
        worlds = self.group.sums({"broken": float(self.env.broken.sum())}, self.device)["broken"]
        everywhere = worlds == self.env.num_envs * self.group.count
        values |= {name: value / self.group.count for name, value in means.items()}
        values |= self._phase_seconds(collected - started, finished - collected)
        return IterationReport(
            iteration=self.iteration,
            env_steps=self.env_steps,
            mean_reward=returns / episodes if episodes else math.nan,
            mean_episode_length=lengths / episodes if episodes else math.nan,
            env_steps_per_s=self.steps_per_iteration / (finished - started),
            collect_s=collected - started,
            learn_s=finished - collected,
            values=values,
            all_broken=summary.episodes == summary.end_reasons.get(NON_FINITE, 0) and everywhere,
        )

    def collect(self) -> None:
        """Fill the storage with one rollout and compute its returns.

        Raises:
            IterationLeftError: :attr:`interlude` of any process asked for it.
        """
        self.env.broken = torch.zeros_like(self.env.broken)
        left = False
        with torch.inference_mode():
            observations = self.env.get_observations()
            self._timed_step = TimedStep(self.task)
            timed = self.iteration % self.config.steps_per_iteration
            for step in range(self.config.steps_per_iteration):
                part = self._timed_step if step == timed else UNTIMED
                with part.policy():
                    actions = self.algorithm.act(observations)
                with part.worlds():
                    observations, rewards, dones, extras = self.env.step(actions)
                self._after_step(step)
                with part.policy():
                    self.algorithm.process_env_step(observations, rewards, dones, extras)
                left = self.interlude()
                if left:
                    break
            # The others may have filled theirs
            if self.group.sums({"left": float(left)}, self.device)["left"] > 0.0:
                raise IterationLeftError
            self.algorithm.compute_returns(observations)

    def _phase_seconds(self, collect_s: float, learn_s: float) -> dict[str, float]:
        """Return the time of an iteration by phase [s]: that of the rollout divided like its timed step."""
        seconds = {name: share * collect_s for name, share in self._timed_step.shares().items()}
        return {f"{PHASE}{name}": value for name, value in {**seconds, LEARN: learn_s}.items()}

    def _between_batches(self, *_: object) -> None:
        """Called by the optimiser after each of its steps."""
        if self.interlude():
            raise IterationLeftError

    def _after_step(self, step: int) -> None:  # noqa: B027 (what most need not write)
        """Called after each control step of a rollout, before it is stored. Optional."""

    @contextlib.contextmanager
    def _watched(self) -> Iterator[None]:
        """Tell errors caused by a policy of NaN or of no deviation from mistakes of a task or of ours."""
        try:
            yield
        except OutputError:
            raise
        except (RuntimeError, ValueError) as error:
            # Sampling from such a distribution fails with words about its deviation only, a task with its own
            if self._is_sound():
                if not isinstance(error, TaskError):
                    self.task.check_values()  # a sound policy cannot act on observations that are not finite
                raise
            raise self._diverged() from error

    def _is_sound(self) -> bool:
        """True if the policy is made of finite numbers, and its standard deviation is positive."""
        named = dict(self.algorithm.get_policy().named_parameters())
        sure = all(bool((value > 0.0).all()) for name, value in named.items() if name.endswith("std_param"))
        return sure and all(bool(value.isfinite().all()) for value in named.values())

    def _diverged(self) -> TrainingError:
        return TrainingError(f"learning diverged in iteration {self.iteration + 1}; try a lower --{self.rate_option}")

    def _totals(self, summary: EpisodeSummary) -> EpisodeSummary:
        """Return the statistics of all processes."""
        if not self.group.several:
            return summary
        mine: dict[str, float] = {"episodes": summary.episodes, "returns": summary.return_sum}
        mine |= {"lengths": summary.length_sum, "successes": summary.successes}
        mine |= {f"term {name}": value for name, value in summary.terms.items()}
        mine |= {f"end {name}": value for name, value in summary.end_reasons.items()}
        total = self.group.sums(mine, self.device)
        return EpisodeSummary(
            episodes=round(total["episodes"]),
            return_sum=total["returns"],
            length_sum=total["lengths"],
            terms={name: total[f"term {name}"] for name in summary.terms},
            end_reasons={name: round(total[f"end {name}"]) for name in summary.end_reasons},
            successes=round(total["successes"]),
            bad_values={},
            by_model={name: self._totals(each) for name, each in summary.by_model.items()},
        )

    def warm_start(self, content: dict[str, Any]) -> None:
        """Take the actor of a checkpoint, its normaliser included; the critic stays as it is.

        Raises:
            InputError: its network does not fit this task and configuration.
        """
        policy = self.algorithm.get_policy()
        try:
            check_like(policy.state_dict(), content["actor_state_dict"], "actor_state_dict")
        except InputError as error:
            raise InputError(
                f"the policy to start from, of task '{content['task']}', has another network than this configuration:"
                f" give the same --network options ({error})"
            ) from error
        policy.load_state_dict(content["actor_state_dict"], strict=True)

    def _remember(self, episodes: int, returns: float, lengths: float) -> None:
        self._window.append((episodes, returns, lengths))
        while (
            len(self._window) > 1 and sum(entry[0] for entry in self._window) - self._window[0][0] >= _WINDOW_EPISODES
        ):
            self._window.popleft()

    @property
    def _remembering(self) -> Sequence[MLPModel]:
        """Networks whose memories a checkpoint keeps, if they have any."""
        return tuple(self.networks.values())

    def checkpoint(self) -> dict[str, Any]:
        """Return everything a resumed run needs, between two iterations. All processes must call this together."""
        first, *others = self.group.gather(self._own_state())
        return {
            **origin_of(self.task.name),
            "iteration": self.iteration,
            "env_steps": self.env_steps,
            "train_config": config_to_plain(self.config),
            "task_config": config_to_plain(self.task.config),
            **self.algorithm.save(),
            **first,
            "other_processes": others,
            "window": [list(entry) for entry in self._window],
        }

    def checkpoint_of_policy(self) -> dict[str, Any]:
        """Return what playing needs of a checkpoint, a copy. Each process may call this alone."""
        return {
            **origin_of(self.task.name),
            "iteration": self.iteration,
            "train_config": config_to_plain(self.config),
            "task_config": config_to_plain(self.task.config),
            "actor_state_dict": {
                name: value.detach().clone() for name, value in self.algorithm.get_policy().state_dict().items()
            },
        }

    def _own_state(self) -> dict[str, Any]:
        """Return the state of each process: random numbers, worlds, and hidden states of recurrent networks."""
        cuda = torch.cuda.get_rng_state(self.device) if self.device.startswith("cuda") else None
        memories = [model.get_hidden_state() for model in self._remembering]
        return {
            "torch_rng": torch.get_rng_state(),
            "cuda_rng": cuda,
            "worlds": self.task.state_dict(),
            "memories": [_cells(memory) for memory in memories],
        }

    def load(self, content: dict[str, Any], where: str = "checkpoint") -> bool:
        """Go on from a checkpoint; False where its worlds could not be taken over (another number of them).

        Args:
            content: result of :meth:`checkpoint`, once; it may hold anything.
            where: the errors begin with it.

        Raises:
            InputError: it is damaged, or its worlds do not fit this task and configuration.
            OtherNetworksError: its networks do not.
        """
        check_members(content, {f"{name}_state_dict": dict for name in self.networks} | dict(_SAVED), where)
        self._load_networks(content, where)
        self.iteration = content["iteration"]
        self.env_steps = _steps_before(content, where)
        self._window = deque(typed(list[tuple[int, float, float]], content["window"], f"{where}: window"))
        owns = [content, *typed(list[dict], content.get("other_processes", []), f"{where}: other_processes")]
        if len(owns) != self.group.count:
            return False
        own = owns[self.group.rank]
        check_members(own, _SAVED_BY_EACH, where)
        same_worlds = self._load_worlds(own, where)
        self._load_generators(own, where)
        return same_worlds

    def _load_networks(self, content: dict[str, Any], where: str) -> None:
        """Take over networks and optimiser."""
        try:
            for name, module in self.networks.items():
                check_like(module.state_dict(), content[f"{name}_state_dict"], f"{name}_state_dict")
            check_optimizer(self.algorithm.optimizer, content["optimizer_state_dict"], "optimizer_state_dict")
            self.algorithm.load(content, None, strict=True)
        except (RuntimeError, ValueError, KeyError, TypeError) as error:
            raise OtherNetworksError(
                f"{where} of task '{self.task.name}' has other networks than this configuration: resume with the same"
                f" --network options and observations ({error})"
            ) from error

    def _load_worlds(self, own: dict[str, Any], where: str) -> bool:
        """Load the worlds and the hidden states of recurrent networks; False if there are more or fewer worlds."""
        saved, models = own["worlds"], self._remembering
        check_members(saved, {"episode_index": torch.Tensor}, f"{where}: worlds")
        if saved["episode_index"].dim() == 1 and len(saved["episode_index"]) != self.task.num_worlds:
            return False
        like = {name: value for name, value in self.task.state_dict().items() if name in saved or name not in NEW_STATE}
        check_like(like, saved, f"{where}: worlds")
        memories = own.get("memories", [[] for _ in models])
        check_memories(models, memories, self.env.num_envs, f"{where}: memories")
        self.task.load_state_dict(saved)
        self.env.refresh()
        for model, cells in zip(models, memories, strict=True):
            if cells:
                copies = tuple(cell.to(self.device) for cell in cells)
                model.reset(hidden_state=copies if len(copies) > 1 else copies[0])
        return True

    def _load_generators(self, own: dict[str, Any], where: str) -> None:
        """Take over the state of torch's random numbers."""
        check_like(torch.get_rng_state(), own["torch_rng"], f"{where}: torch_rng")
        try:
            torch.set_rng_state(own["torch_rng"].cpu())
            if own["cuda_rng"] is not None and self.device.startswith("cuda"):
                torch.cuda.set_rng_state(own["cuda_rng"].cpu(), self.device)
        except (RuntimeError, TypeError) as error:
            raise InputError(f"{where}: its state of random numbers is none: {error}") from error


def _of_episodes(summary: EpisodeSummary) -> dict[str, float]:
    """Return what is recorded of the episodes of an iteration: their number, success, mean reward terms, ends."""
    ended = max(summary.episodes, 1)
    values: dict[str, float] = {"episodes": summary.episodes}
    values[SUCCESS] = summary.successes / summary.episodes if summary.episodes else math.nan
    values |= {f"reward/{name}": value / ended for name, value in summary.terms.items()}
    return values | {f"end/{name}": count for name, count in summary.end_reasons.items()}


def _cells(memory: torch.Tensor | tuple[torch.Tensor, ...] | None) -> list[torch.Tensor]:
    """Return copies of the hidden state of a recurrent network: nothing, one tensor of a GRU, or two of an LSTM."""
    if memory is None:
        return []
    return [cell.detach().clone() for cell in (memory if isinstance(memory, tuple) else (memory,))]


def _steps_before(content: Mapping[str, Any], where: str) -> int:
    """Return the control steps of all worlds before a checkpoint; older ones do not tell, but how they were trained."""
    if "env_steps" in content:
        return typed(int, content["env_steps"], f"{where}: env_steps")
    made = train_config_from_plain(content["train_config"], f"{where}: train_config")
    processes = 1 + len(content.get("other_processes", ()))
    return int(content["iteration"]) * made.num_envs * made.steps_per_iteration * processes
