"""Evaluation of a policy: statistics over fresh worlds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
import warp as wp

from simwarp.core.memory import check_fits
from simwarp.core.object_repr import ReadableFields
from simwarp.statistics.proportions import wilson_interval
from simwarp.tasks import NON_FINITE, InputError, StepResult, Task, TaskConfig, TaskError, make
from simwarp.tasks.framework.agent_rows import Rows
from simwarp.tasks.framework.errors import TaskStepError
from simwarp.tasks.framework.registry import agents_in_world

from ..networks.policies import Policy, bad_actions, random_policy, reset_memory, zero_policy

_MAX_WORLDS = 4096
CHECK_INTERVAL = 25
_RECORD_BYTES = 64
"""Approximate bytes kept of an episode."""


@dataclasses.dataclass(frozen=True)
class Evaluation(ReadableFields):
    """Statistics of some episodes.

    Attributes:
        episodes: number of episodes.
        mean_return: mean of the summed rewards.
        std_return: its standard deviation over episodes.
        mean_episode_length: [control steps].
        min_episode_length: the shortest [control steps].
        success_rate: share of successes.
        success_ci95: Wilson interval of that share at 95 %.
        end_reasons: number of episodes that ended for each reason that occurred.
        metrics: means of the task's own metrics at the end of the episodes.
        bad_actions: number of times that the policy returned NaN or infinity.
        by_model: the same of each model of a mixed batch, by name; empty where there is one model.
    """

    episodes: int
    mean_return: float
    std_return: float
    mean_episode_length: float
    min_episode_length: int
    success_rate: float
    success_ci95: tuple[float, float]
    end_reasons: dict[str, int]
    metrics: dict[str, float]
    bad_actions: int = 0
    by_model: dict[str, Evaluation] = dataclasses.field(default_factory=dict)

    @property
    def problem(self) -> str:
        """Reason why these numbers say nothing about the task; empty if they do."""
        if self.bad_actions:
            return f"the policy returned NaN or infinity {self.bad_actions} times"
        if self.end_reasons.get(NON_FINITE) == self.episodes:
            return f"the physics of all {self.episodes} episodes broke down"
        return ""

    def as_json(self) -> dict[str, Any]:
        """Return plain values; the task's own metrics stand beside the others, each model in ``models``."""
        plain = dataclasses.asdict(self)
        own = plain.pop("metrics")
        del plain["by_model"]
        if self.by_model:
            plain["models"] = {name: each.as_json() for name, each in self.by_model.items()}
        plain["success_ci95"] = list(self.success_ci95)
        return plain | {name: value for name, value in own.items() if name not in plain}


class EpisodeRecords:
    """Records of the episodes that count: the first so many of each world; of each agent, where it has several.

    Taking whichever episodes end first would favour short ones.
    """

    def __init__(self, task: Task[Any], episodes: int) -> None:
        worlds, device = task.num_worlds * task.agents, task.device
        rounds = -(-episodes // worlds)
        needed = _RECORD_BYTES * worlds * rounds
        check_fits(f"records of {episodes} episodes", needed, wp.get_device(str(device)), "evaluate fewer")
        extra = episodes - (rounds - 1) * worlds
        self.quota = torch.full((worlds,), rounds - 1, device=device)
        self.quota[:extra] += 1
        self.done = torch.zeros(worlds, dtype=torch.int64, device=device)
        self.total = torch.zeros(worlds, dtype=torch.float64, device=device)
        self.length = torch.zeros(worlds, dtype=torch.int64, device=device)
        self.records: dict[str, torch.Tensor] = {
            "return": torch.zeros(worlds, rounds, dtype=torch.float64, device=device),
            "length": torch.zeros(worlds, rounds, dtype=torch.float64, device=device),
            "reason": torch.zeros(worlds, rounds, dtype=torch.float64, device=device),
            "success": torch.zeros(worlds, rounds, dtype=torch.float64, device=device),
        }
        self._round = torch.arange(rounds, device=device)

    def add(self, result: StepResult) -> None:
        """Take in one step; reads nothing on the host."""
        ended = result.terminated | result.truncated
        self.total += result.rewards
        self.length += 1 if result.acting is None else result.acting
        values = {
            "return": self.total,
            "length": self.length,
            "reason": result.end_reason,
            "success": result.success,
            **{f"metric {name}": value for name, value in result.metrics.items()},
        }
        slot = (self._round == self.done.unsqueeze(1)) & (ended & (self.done < self.quota)).unsqueeze(1)
        for name, value in values.items():
            if name not in self.records:
                self.records[name] = torch.zeros_like(self.records["return"])
            record = self.records[name]
            record.copy_(torch.where(slot, value.to(torch.float64).unsqueeze(1), record))
        self.done += ended
        self.total.masked_fill_(ended, 0.0)
        self.length.masked_fill_(ended, 0)

    def finished(self) -> bool:
        """True if every world has completed its share of episodes; reads the device."""
        return bool((self.done >= self.quota).all())

    def ended(self) -> int:
        """Return the number of the episodes that count and are over; reads the device."""
        return int(torch.minimum(self.done, self.quota).sum())

    def reasons_so_far(self, reasons: list[str]) -> dict[str, int]:
        """Return the end reasons of finished episodes; reads the device. Short ones come first: no statistics."""
        over = self._round < torch.minimum(self.done, self.quota).unsqueeze(1)
        return _counts(self.records["reason"][over].cpu(), reasons)

    def first_episodes(self, worlds: int, agents: int = 1) -> dict[str, list[float]]:
        """Return ``length``, ``reason`` and ``success`` of the first episode of the first worlds; reads the device.

        Of several agents in a world, that of the one which was done last. Worlds that are not counted are left out.

        Args:
            worlds: of them at most.
            agents: in each world.
        """
        counted = max(1, int((self.quota > 0).sum()) // agents)
        names = ("length", "reason", "success")
        columns = {name: self.records[name][: min(worlds, counted) * agents, 0].view(-1, agents) for name in names}
        last = columns["length"].argmax(dim=1, keepdim=True)
        return {name: column.gather(1, last).squeeze(1).tolist() for name, column in columns.items()}

    def evaluation(self, reasons: list[str], rows: slice = slice(None)) -> Evaluation:
        """Return the statistics.

        Args:
            reasons: all that the task knows.
            rows: of the worlds, or agents, that are meant; by default all.
        """
        counted = self._round < self.quota[rows].unsqueeze(1)
        columns = {name: record[rows][counted].cpu() for name, record in self.records.items()}
        episodes = int(counted.sum())
        successes = int(columns["success"].sum())
        return Evaluation(
            episodes=episodes,
            mean_return=float(columns["return"].mean()),
            std_return=float(columns["return"].std(unbiased=False)),
            mean_episode_length=float(columns["length"].mean()),
            min_episode_length=int(columns["length"].min()),
            success_rate=successes / episodes,
            success_ci95=wilson_interval(successes, episodes),
            end_reasons=_counts(columns["reason"], reasons),
            metrics={
                name.removeprefix("metric "): float(column.mean())
                for name, column in columns.items()
                if name.startswith("metric ") and name != "metric success"
            },
        )


def _counts(column: torch.Tensor, reasons: list[str]) -> dict[str, int]:
    """Return the count of each reason in a column of indices, if it occurs."""
    counts = column.to(torch.int64).bincount(minlength=len(reasons)).tolist()
    return {name: count for name, count in zip(reasons, counts, strict=True) if count}


class EvaluationCallback:
    """Observer of an evaluation; this base class does nothing."""

    def begin(self, task: Task[Any]) -> None:
        """Called when all worlds are at the beginning of their first episode."""

    def step(self, step: int, tally: EpisodeRecords) -> None:
        """Called with the number of control steps done. An exception stops the evaluation."""

    def warn(self, text: str) -> None:
        """Called when something is wrong with the policy."""

    def end(self, tally: EpisodeRecords) -> None:
        """Called when all episodes are over."""


def evaluate(
    task: Task[Any], policy: Policy, episodes: int, seed: int, *, watcher: EvaluationCallback | None = None,
    level: float | None = None,
) -> Evaluation:  # fmt: skip
    """Run exactly ``episodes`` episodes, of agents, from a fresh start and return their statistics.

    Args:
        task: its worlds.
        policy: that acts.
        episodes: that count.
        seed: of the worlds.
        watcher: who looks on.
        level: of the curriculum, dimensionless, held from here on; None: as it is, which is 1 outside training.
    """
    _check_episodes(episodes)
    if level is not None:
        task.set_level(level)
    task.keep_final_observations = False
    rows = Rows(task)
    observations = rows.restart(seed)
    reset_memory(policy)
    tally = EpisodeRecords(task, episodes)
    watcher = watcher or EvaluationCallback()
    watcher.begin(task)
    step, warned = 0, False
    bad = torch.zeros((), dtype=torch.int64, device=task.device)
    # Waiting for the device in every step would slow it down; a few steps too many change nothing
    while step % CHECK_INTERVAL or not tally.finished():
        actions = policy(observations)
        bad += bad_actions(actions)
        result = rows.step(actions)
        observations = result.observations
        reset_memory(policy, result.terminated | result.truncated)
        tally.add(result)
        step += 1
        watcher.step(step, tally)
        if step % CHECK_INTERVAL == 0 and not warned and int(bad):
            warned = True
            watcher.warn(f"the policy returns NaN or infinity, since step {step} or before")
    watcher.end(tally)
    try:
        task.drain_statistics()
    except TaskError:
        # What follows from such actions is not the task's fault, unless they follow from what it shows
        if not int(bad) or _acts_well(policy, observations):
            raise
    evaluation = dataclasses.replace(
        tally.evaluation(task.end_reasons), bad_actions=int(bad), by_model=_by_model(task, tally)
    )
    if evaluation.problem and not warned:
        watcher.warn(evaluation.problem)
    return evaluation


def _by_model(task: Task[Any], tally: EpisodeRecords) -> dict[str, Evaluation]:
    """Return the statistics of each model of a mixed batch that has episodes which count."""
    found = {}
    for group in task.model_groups if len(task.model_groups) > 1 else ():
        rows = slice(group.rows.start * task.agents, group.rows.stop * task.agents)
        if int(tally.quota[rows].sum()):
            found[group.name] = tally.evaluation(task.end_reasons, rows)
    return found


def _acts_well(policy: Policy, observations: dict[str, torch.Tensor]) -> bool:
    """Whether a policy returns finite actions for observations (W, ...) once these are finite."""
    reset_memory(policy)
    finite = {name: group.nan_to_num(0.0, 0.0, 0.0) for name, group in observations.items()}
    return not int(bad_actions(policy(finite)))


def _check_episodes(episodes: int) -> None:
    if episodes < 1:
        raise InputError(f"episodes must be at least 1, got {episodes}")


def evaluate_policies(
    task_name: str,
    make_policy: Callable[[Task[Any]], Policy],
    *,
    config: TaskConfig,
    episodes: int,
    seed: int,
    device: str = "cpu",
    num_envs: int | None = None,
    baselines: bool = True,
    capture: bool = True,
    watch: Callable[[str], EvaluationCallback] | None = None,
    kept: Path | None = None,
    level: float | None = None,
) -> Iterator[tuple[str, Evaluation]]:
    """Evaluate a policy and then, on the same worlds, the one that does nothing and the random one.

    Args:
        task_name: a registered task.
        make_policy: builds the policy for a task.
        config: configuration of the task.
        episodes: of each policy.
        seed: of the worlds.
        device: canonical device name.
        num_envs: worlds stepped together; by default as many as the episodes fill, at most 4096.
        baselines: True if the other two are evaluated at all.
        capture: capture control steps into a CUDA graph, where there is a CUDA device.
        watch: given a name, returns who looks on.
        kept: file for the steps that led to a value of the task that is not finite; None keeps none.
        level: of the curriculum in [0, 1]; None: 1.

    Raises:
        TaskStepError: the task broke its contract.

    Yields:
        Name (``policy``, ``zero`` or ``random``) and evaluation, as soon as it is known.
    """
    _check_episodes(episodes)
    # A world has the episodes of all of its agents; any more worlds would be built and never counted
    needed = -(-episodes // agents_in_world(task_name, config))
    worlds = min(needed, _MAX_WORLDS if num_envs is None else num_envs)
    task = make(task_name, worlds, device=device, seed=seed, config=config, capture=capture)
    policies = {"policy": make_policy(task)}
    if baselines:
        policies |= {"zero": zero_policy(task), "random": random_policy(task)}
    for name, policy in policies.items():
        watcher = EvaluationCallback() if watch is None else watch(name)
        try:
            evaluation = evaluate(task, policy, episodes, seed, watcher=watcher, level=level)
        except TaskStepError:
            guards = [group.task.guard for group in task.model_groups if group.task.guard is not None]
            broken = next((guard for guard in guards if guard.dump is not None), None)
            if kept is not None and broken is not None:
                watcher.warn(f"`simwarp replay {broken.write(kept)}` repeats what led to the error")
            raise
        yield name, evaluation
