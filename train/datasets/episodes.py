"""Episodes of a policy, one by one as they end; and all of them in memory, as trajectories."""

from __future__ import annotations

import collections
import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import torch

from simwarp.core.stopping import StopRequest
from simwarp.tasks import InputError, Task, config_to_plain
from simwarp.tasks.framework.agent_rows import refuse_agents

from ..networks.policies import Policy, bad_actions, refuse_bad_actions, reset_memory
from .trajectories import FORMAT, Trajectories

Arrays = dict[str, npt.NDArray[Any]]
Rows = dict[str, Arrays]

_CHECK_INTERVAL = 25
_NEVER: Final = 2**62
"""Row at which the next episode of a world begins that has no more to give."""


@dataclasses.dataclass(frozen=True)
class Episode:
    """A whole episode of one world.

    Attributes:
        world: number of the world.
        number: of the episode in its world, from 0.
        observations: group -> (N, ...), before each action, in the group's own dtype.
        last: group -> (...), after the last action, before the reset; empty unless asked for.
        actions: (N, A) float32 in [-1, 1].
        rewards: (N,) float32.
        terminated: (N,) bool, at most in the last row.
        truncated: (N,) bool, at most in the last row.
    """

    world: int
    number: int
    observations: Arrays
    last: Arrays
    actions: npt.NDArray[np.float32]
    rewards: npt.NDArray[np.float32]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]

    @property
    def steps(self) -> int:
        """Number of rows N."""
        return len(self.actions)


def about_of(task: Task[Any], about: dict[str, Any]) -> dict[str, Any]:
    """Return what is kept beside the episodes of a task."""
    return {"format": FORMAT, "task": task.name, "task_config": config_to_plain(task.config), **about}


def episodes_of(
    task: Task[Any], policy: Policy, episodes: int, seed: int, stop: StopRequest | None = None,
    report: Callable[[int], None] = lambda ended: None, *, last: bool = False, kept: str = "nothing was written",
) -> Iterator[Episode]:  # fmt: skip
    """Yield exactly ``episodes`` whole episodes as they end: the first ones of each world.

    Held at a time: the steps of all worlds since the oldest running episode began.

    Args:
        task: the worlds.
        policy: policy that acts.
        episodes: number of episodes.
        seed: seed of the worlds.
        stop: request to leave with the episodes that have ended by then.
        report: called now and then with the number of episodes that have ended.
        last: also keep the observations after the last action.
        kept: end of the error that a policy without numbers gets: what was written.

    Raises:
        TrainingError: the policy returned NaN or infinity.
        TaskStepError: the task did.
    """
    stop = stop or StopRequest()
    if episodes < 1:
        raise InputError(f"episodes must be at least 1, got {episodes}")
    refuse_agents(task, "and trajectories are of one", "record a task of single agents")
    task.keep_final_observations = last
    worlds = task.num_worlds
    quota = np.full(worlds, episodes // worlds)
    quota[: episodes % worlds] += 1
    done = np.zeros(worlds, np.int64)
    begun = np.where(quota > 0, 0, _NEVER)
    rows: collections.deque[Rows] = collections.deque()
    step = 0
    observations = task.restart(seed=seed)
    reset_memory(policy)
    bad = torch.zeros((), dtype=torch.int64, device=task.device)
    while stop.times == 0 and bool((done < quota).any()):
        if step % _CHECK_INTERVAL == 0:
            report(int(done.sum()))
        actions = policy(observations)
        bad += bad_actions(actions)
        actions = actions.clamp(-1.0, 1.0)
        # A task may hand out its own buffers, which the step overwrites
        seen = {name: _on_host(group) for name, group in observations.items()}
        result = task.step(actions)
        observations = result.observations
        over = result.terminated | result.truncated
        reset_memory(policy, over)
        columns = {
            "actions": _on_host(actions), "rewards": _on_host(result.rewards),
            "terminated": _on_host(result.terminated), "truncated": _on_host(result.truncated),
        }  # fmt: skip
        rows.append({"observations": seen, "columns": columns})
        step += 1
        ended = np.flatnonzero((columns["terminated"] | columns["truncated"]) & (done < quota))
        if not len(ended):
            continue
        refuse_bad_actions(bad, step * worlds, kept)
        task.check_values()
        finals = _last_of(result.final_observations, ended)
        for place, world in enumerate(ended):
            own = [rows[index] for index in range(len(rows) - (step - int(begun[world])), len(rows))]
            final = {name: group[place] for name, group in finals.items()}
            yield _episode(own, int(world), int(done[world]), final)
        done[ended] += 1
        begun[ended] = np.where(done[ended] < quota[ended], step, _NEVER)
        for _ in range(len(rows) - (step - min(int(begun.min()), step))):
            rows.popleft()
    report(int(done.sum()))
    task.drain_statistics()


def _on_host(tensor: torch.Tensor) -> npt.NDArray[Any]:
    array: npt.NDArray[Any] = tensor.detach().to("cpu", copy=True).numpy()
    return array


def _last_of(final: dict[str, torch.Tensor] | None, worlds: npt.NDArray[np.int64]) -> Arrays:
    """Return the observations (K, ...) of K worlds before their reset."""
    return {name: _on_host(group[torch.from_numpy(worlds).to(group.device)]) for name, group in (final or {}).items()}


def _episode(rows: list[Rows], world: int, number: int, last: Arrays) -> Episode:
    groups = {name: np.stack([row["observations"][name][world] for row in rows]) for name in rows[0]["observations"]}
    columns: Any = {name: np.stack([row["columns"][name][world] for row in rows]) for name in rows[0]["columns"]}
    return Episode(world, number, groups, last, **columns)


def record(
    task: Task[Any], policy: Policy, episodes: int, seed: int, about: dict[str, Any],
    stop: StopRequest | None = None, report: Callable[[int], None] = lambda ended: None,
) -> Trajectories:  # fmt: skip
    """Let a policy act for exactly ``episodes`` whole episodes: the first ones of each world, world by world.

    Args:
        task: the worlds.
        policy: policy that acts.
        episodes: number of episodes.
        seed: seed of the worlds.
        about: metadata to keep beside the task and the returns.
        stop: request to leave with the episodes that have ended by then.
        report: called now and then with the number of episodes that have ended.

    Raises:
        TrainingError: the policy returned NaN or infinity.
        KeyboardInterrupt: it was asked to stop before an episode had ended.
    """
    found = sorted(
        episodes_of(task, policy, episodes, seed, stop, report), key=lambda episode: (episode.world, episode.number)
    )
    if not found:
        raise KeyboardInterrupt
    trajectories = Trajectories(
        {name: np.concatenate([one.observations[name] for one in found]) for name in found[0].observations},
        np.concatenate([one.actions for one in found]),
        np.concatenate([one.rewards for one in found]),
        np.repeat(np.arange(len(found)), [one.steps for one in found]),
        np.concatenate([one.terminated for one in found]),
        np.concatenate([one.truncated for one in found]),
        about_of(task, about),
    )
    trajectories.add_totals()
    return trajectories
