"""How good a policy is: statistics over fresh worlds."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import torch
from simwarp.tasks import InputError, StepResult, Task, TaskConfig, make

from .policies import Policy, forget, random_policy, zero_policy

_MAX_WORLDS = 4096
_CHECK_INTERVAL = 25


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Statistics of some episodes.

    Attributes:
        episodes: how many there were.
        mean_return: mean of the summed rewards.
        std_return: its standard deviation over episodes.
        mean_episode_length: [control steps].
        min_episode_length: the shortest [control steps].
        success_rate: share of successes.
        success_ci95: Wilson interval of that share at 95 %.
        end_reasons: how many episodes ended for each reason that occurred.
        metrics: means of the task's own metrics at the end of the episodes.
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

    def as_json(self) -> dict[str, Any]:
        """Return plain values; the task's own metrics stand beside the others."""
        plain = dataclasses.asdict(self)
        own = plain.pop("metrics")
        plain["success_ci95"] = list(self.success_ci95)
        return plain | {name: value for name, value in own.items() if name not in plain}


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Return the Wilson score interval of a proportion (Wilson 1927); z = 1.96 gives 95 %."""
    if trials < 1:
        raise ValueError(f"trials must be at least 1, got {trials}")
    share, square = successes / trials, z * z
    centre = (share + square / (2 * trials)) / (1 + square / trials)
    half = z / (1 + square / trials) * math.sqrt(share * (1 - share) / trials + square / (4 * trials * trials))
    return max(0.0, centre - half), min(1.0, centre + half)


class _Tally:
    """Records of the episodes that count: the first so many of each world.

    Taking whichever episodes end first would favour short ones.
    """

    def __init__(self, task: Task[Any], episodes: int) -> None:
        worlds, device = task.num_worlds, task.device
        rounds = -(-episodes // worlds)
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
        self._rounds = rounds
        self._round = torch.arange(rounds, device=device)

    def add(self, result: StepResult) -> None:
        """Take in one step; reads nothing on the host."""
        ended = result.terminated | result.truncated
        self.total += result.rewards
        self.length += 1
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
        """Whether every world has played its share; reads the device."""
        return bool((self.done >= self.quota).all())

    def evaluation(self, reasons: list[str]) -> Evaluation:
        """Return the statistics."""
        counted = self._round < self.quota.unsqueeze(1)
        columns = {name: record[counted].cpu() for name, record in self.records.items()}
        episodes = int(counted.sum())
        ends = columns["reason"].to(torch.int64).bincount(minlength=len(reasons)).tolist()
        successes = int(columns["success"].sum())
        return Evaluation(
            episodes=episodes,
            mean_return=float(columns["return"].mean()),
            std_return=float(columns["return"].std(unbiased=False)),
            mean_episode_length=float(columns["length"].mean()),
            min_episode_length=int(columns["length"].min()),
            success_rate=successes / episodes,
            success_ci95=wilson_interval(successes, episodes),
            end_reasons={name: count for name, count in zip(reasons, ends, strict=True) if count},
            metrics={
                name.removeprefix("metric "): float(column.mean())
                for name, column in columns.items()
                if name.startswith("metric ") and name != "metric success"
            },
        )


def evaluate(task: Task[Any], policy: Policy, episodes: int, seed: int) -> Evaluation:
    """Run exactly ``episodes`` episodes from a fresh start and return their statistics."""
    if episodes < 1:
        raise InputError(f"episodes must be at least 1, got {episodes}")
    task.keep_final_observations = False
    observations = task.restart(seed=seed)
    forget(policy)
    tally = _Tally(task, episodes)
    step = 0
    # Waiting for the device in every step would slow it down; a few steps too many change nothing
    while step % _CHECK_INTERVAL or not tally.finished():
        result = task.step(policy(observations))
        observations = result.observations
        forget(policy, result.terminated | result.truncated)
        tally.add(result)
        step += 1
    task.drain_statistics()
    return tally.evaluation(task.end_reasons)


def evaluate_with_baselines(
    task_name: str,
    make_policy: Callable[[Task[Any]], Policy],
    *,
    config: TaskConfig,
    episodes: int,
    seed: int,
    device: str = "cpu",
    num_envs: int | None = None,
) -> dict[str, Evaluation]:
    """Evaluate a policy and, on the same worlds, the one that does nothing and the random one.

    Returns:
        Evaluations named ``policy``, ``zero`` and ``random``.
    """
    if episodes < 1:
        raise InputError(f"episodes must be at least 1, got {episodes}")
    worlds = min(episodes, _MAX_WORLDS if num_envs is None else num_envs)
    task = make(task_name, worlds, device=device, seed=seed, config=config)
    policies = {"policy": make_policy(task), "zero": zero_policy(task), "random": random_policy(task)}
    return {name: evaluate(task, policy, episodes, seed) for name, policy in policies.items()}
