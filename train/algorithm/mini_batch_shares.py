"""Shares of a mini-batch: what a thread learns from at a time, cut from the rollout only then.

Samples of feed-forward networks may be cut anywhere, those of recurrent ones between worlds.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator
from typing import Any, Final

import torch
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

MOST_NUMBERS: Final = 3 * 2**20
"""Observed numbers of a share, at most: what comes of them then stays near the processor, in memory that is there.

2048 images of 45 x 80 pixels take nine times as long to become float32 at once as in shares of 256.
"""
MOST_SAMPLES: Final = 8192
LEAST_WORK: Final = 2**24
"""Samples of a share times parameters of the networks, at least: below, another thread costs more than it does."""
LEAST_NUMBERS: Final = 2**16
"""Observed numbers of a share that are enough as well: convolutions use a parameter many times."""


@dataclasses.dataclass(frozen=True)
class Share:
    """Part of a mini-batch.

    Attributes:
        weight: its samples over those of the mini-batch; those of all shares add up to 1.
        take: function that cuts it from the rollout.
    """

    weight: float
    take: Callable[[], RolloutStorage.Batch]


def share_count(samples: int, numbers: int, parameters: int, threads: int) -> int:
    """Return how many shares a batch has: one for each thread, several where they are large, fewer where small.

    Args:
        samples: samples of the batch.
        numbers: observed numbers of a sample.
        parameters: parameters of the networks.
        threads: number of threads.
    """
    most = max(1, min(MOST_SAMPLES, MOST_NUMBERS // numbers))
    least = min(math.ceil(LEAST_WORK / parameters), math.ceil(LEAST_NUMBERS / numbers))
    return max(1, min(math.ceil(samples / (most * threads)) * threads, samples // least))


def mini_batches_in_shares(
    storage: RolloutStorage, mini_batches: int, epochs: int, count: int, *, recurrent: bool
) -> Iterator[list[Share]]:
    """Yield the shares of each mini-batch; mini-batches are drawn as rsl-rl draws them.

    Args:
        storage: the rollout.
        mini_batches: number of mini-batches in it.
        epochs: passes over it.
        count: number of shares of each.
        recurrent: draw whole worlds, for networks that remember.
    """
    if recurrent:
        for batch in storage.recurrent_mini_batch_generator(mini_batches, epochs):
            yield _cut_between_worlds(batch, count)
    else:
        yield from _cut_anywhere(storage, mini_batches, epochs, count)


def share_bounds(rows: int, count: int) -> tuple[list[int], list[int]]:
    """Return the first rows of all shares, and those behind their last."""
    edges = [index * rows // count for index in range(count + 1)]
    return edges[:-1], edges[1:]


def _cut_anywhere(storage: RolloutStorage, mini_batches: int, epochs: int, count: int) -> Iterator[list[Share]]:
    rows = storage.num_envs * storage.num_transitions_per_env // mini_batches
    order = torch.randperm(mini_batches * rows, device=storage.device)
    flat = _flat(storage)
    for _ in range(epochs):
        for chosen in order.split(rows):
            yield [
                Share((end - first) / rows, functools.partial(_picked, flat, chosen[first:end]))
                for first, end in zip(*share_bounds(rows, count), strict=True)
            ]


def _flat(storage: RolloutStorage) -> RolloutStorage.Batch:
    """Return all samples of a rollout, one step after the other."""
    observations = storage.observations.flatten(0, 1)
    if storage.training_type == "distillation":
        told = storage.privileged_actions.flatten(0, 1)
        return RolloutStorage.Batch(observations=observations, privileged_actions=told)
    return RolloutStorage.Batch(
        observations=observations,
        actions=storage.actions.flatten(0, 1),
        values=storage.values.flatten(0, 1),
        advantages=storage.advantages.flatten(0, 1),
        returns=storage.returns.flatten(0, 1),
        old_actions_log_prob=storage.actions_log_prob.flatten(0, 1),
        old_distribution_params=tuple(one.flatten(0, 1) for one in storage.distribution_params or ()),
    )


def _picked(flat: RolloutStorage.Batch, rows: torch.Tensor) -> RolloutStorage.Batch:
    """Return a copy of some rows of all samples."""

    def pick(column: Any) -> Any:
        if isinstance(column, TensorDict):
            groups = {name: pick(group) for name, group in column.items()}
            return TensorDict(groups, batch_size=[len(rows)])
        if isinstance(column, tuple):
            return tuple(pick(one) for one in column)
        return None if column is None else column.index_select(0, rows)

    return RolloutStorage.Batch(**{name: pick(column) for name, column in vars(flat).items()})


def _cut_between_worlds(batch: Any, count: int) -> list[Share]:
    steps, worlds = batch.actions.shape[:2]
    # Tracks are the pieces of episodes, world by world: those of one fill all its steps
    last = (batch.masks.sum(dim=0).cumsum(dim=0) % steps == 0).nonzero().flatten().tolist()
    tracks = [0, *(track + 1 for track in last)]
    return [
        Share((end - first) / worlds, functools.partial(_of_worlds, batch, first, end, tracks[first], tracks[end]))
        for first, end in zip(*share_bounds(worlds, min(count, worlds)), strict=True)
    ]


def _of_worlds(batch: Any, first: int, end: int, first_track: int, end_track: int) -> RolloutStorage.Batch:
    """Return the part of a mini-batch that belongs to the worlds from ``first`` to ``end``, and so do the tracks."""

    def cut(column: torch.Tensor) -> torch.Tensor:
        # A copy: the rollout was made in inference mode, of which autograd keeps nothing
        return column[:, first:end].clone()

    def memory(cells: Any) -> Any:
        if isinstance(cells, tuple):
            return tuple(memory(cell) for cell in cells)
        return None if cells is None else cells[:, first_track:end_track].contiguous()

    return RolloutStorage.Batch(
        observations=batch.observations[:, first_track:end_track],
        actions=cut(batch.actions),
        values=cut(batch.values),
        advantages=cut(batch.advantages),
        returns=cut(batch.returns),
        old_actions_log_prob=cut(batch.old_actions_log_prob),
        old_distribution_params=tuple(cut(parameter) for parameter in batch.old_distribution_params),
        hidden_states=(memory(batch.hidden_states[0]), memory(batch.hidden_states[1])),
        masks=batch.masks[:, first_track:end_track],
    )
