"""Behavioural cloning: a policy that imitates recorded actions, to be played or trained on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
import torch
from rsl_rl.models import MLPModel
from tensordict import TensorDict
from torch import nn

from simwarp.core.constraints import Count, Ge, Lt, Positive, Whole
from simwarp.core.stopping import StopRequest
from simwarp.core.types import formatted
from simwarp.tasks import InputError, Task, config_to_plain
from simwarp.tasks.framework.config_values import Settings
from simwarp.tasks.framework.registry import origin_of

from ..config import TrainConfig
from ..datasets.trajectories import Trajectories
from ..networks.group_checks import check_groups
from ..networks.policies import build_actor
from ..networks.symmetric import task_settings
from .learner import TrainingError

_LARGEST_BATCH = 65_536


@dataclasses.dataclass(frozen=True)
class CloneConfig(Settings):
    """Hyperparameters of behaviour cloning."""

    epochs: Count = 60
    """Passes over the recorded steps."""
    batch: Count = 256
    """Steps per optimiser step."""
    learning_rate: Positive = 1e-3
    """Step size of Adam at the start; it falls to zero along half a cosine."""
    held_out: Annotated[float, Ge(0.0), Lt(1.0)] = 0.1
    """Share of the episodes that is not learnt from but measured on; at least one where there are two."""
    std: Positive = 0.2
    """Standard deviation of the actions in the policy that is written, for the training that goes on from it."""
    seed: Whole = 0
    """Seed of the network and of the order of the steps."""


@dataclasses.dataclass(frozen=True)
class CloneResult:
    """Result of behaviour cloning.

    Attributes:
        content: a checkpoint of the policy.
        steps: recorded steps learnt from.
        loss: mean squared error of an action component on them.
        held_out_loss: the same on the episodes not learnt from; NaN without any.
        epochs: whole passes over the recorded steps.
    """

    content: dict[str, Any]
    steps: int
    loss: float
    held_out_loss: float
    epochs: int = 0


def _groups(task: Task[Any], data: Trajectories) -> TensorDict:
    """Return the recorded observations, held to what the task observes."""
    shapes, dtypes = task.observation_shapes, task.observation_dtypes
    wanted = {name: f"{shapes[name]} {str(dtypes[name]).removeprefix('torch.')}" for name in shapes}
    found = {name: f"{array.shape[1:]} {array.dtype}" for name, array in data.observations.items()}
    if found != wanted:
        raise InputError(
            f"the trajectories hold observations {formatted(found)}; task '{task.name}' has {formatted(wanted)}"
        )
    tensors = {name: torch.from_numpy(array) for name, array in data.observations.items()}
    if data.actions.shape[1:] != (task.action_size,):
        raise InputError(
            f"the trajectories hold {data.actions.shape[1:]} actions; task '{task.name}' {task.action_size}"
        )
    return TensorDict({name: tensors[name] for name in wanted}, batch_size=[data.steps])


def _split(data: Trajectories, config: CloneConfig) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the rows to learn from, and those of held-out episodes."""
    order = np.random.default_rng(config.seed).permutation(data.episodes)
    count = min(data.episodes - 1, max(1, round(config.held_out * data.episodes))) if config.held_out else 0
    held = np.isin(data.episode, order[:count])
    return torch.from_numpy(np.flatnonzero(~held)), torch.from_numpy(np.flatnonzero(held))


def _loss(actor: MLPModel, groups: TensorDict, actions: torch.Tensor) -> float:
    if len(actions) == 0:
        return float("nan")
    total = 0.0
    with torch.no_grad():
        for start in range(0, len(actions), _LARGEST_BATCH):
            part = slice(start, start + _LARGEST_BATCH)
            total += float((actor(groups[part]) - actions[part]).square().sum())
    return total / actions.numel()


def clone(
    task: Task[Any],
    data: Trajectories,
    config: CloneConfig,
    train_config: TrainConfig,
    report: Callable[[int, float], None] = lambda epoch, loss: None,
    stop: StopRequest | None = None,
) -> CloneResult:
    """Fit the mean action of a policy to recorded actions, in the least squares.

    Args:
        task: says what is observed; on the CPU.
        data: trajectories to imitate.
        config: hyperparameters.
        train_config: its network is built, and is what a later training must have.
        report: called after each epoch with its number and mean loss, a dimensionless squared error of actions.
        stop: request to leave with what is learnt by then.

    Raises:
        InputError: the data does not fit the task, or the network is recurrent.
        TrainingError: the loss is no longer finite.
        KeyboardInterrupt: it was asked to stop within the first epoch.
    """
    stop = stop or StopRequest()
    if train_config.network.recurrent:
        raise InputError(
            "recurrent networks cannot be cloned: steps are learnt in any order; give another network.kind"
        )
    check_groups(
        train_config.network, task.name, task.observation_shapes, task.observation_dtypes, task.observation_kinds
    )
    groups, actions = _groups(task, data), torch.from_numpy(data.actions)
    torch.manual_seed(config.seed)
    actor = build_actor(task_settings(task, train_config), task)
    rows, held = _split(data, config)
    actor.train()
    actor.update_normalization(groups[rows])
    # The deviation of the actions has no part in the squared error, and stays
    optimiser = torch.optim.Adam(actor.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.epochs)
    done = 0
    for epoch in range(config.epochs):
        total = 0.0
        for part in rows[torch.randperm(len(rows))].split(config.batch):
            if stop.requested:
                break
            loss = (actor(groups[part]) - actions[part]).square().mean()
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(actor.parameters(), 1.0)
            optimiser.step()
            total += float(loss.detach()) * len(part)
        else:
            schedule.step()
            done = epoch + 1
        if not np.isfinite(total):
            raise TrainingError(f"cloning diverged in epoch {epoch + 1}; try a lower --learning-rate")
        if done <= epoch:
            break
        report(done, total / len(rows))
    if done == 0:
        raise KeyboardInterrupt
    state = actor.state_dict()
    for name in ("distribution.std_param",):
        state[name] = torch.full_like(state[name], config.std)
    content = {
        **origin_of(task.name),
        "iteration": 0,
        "train_config": config_to_plain(train_config),
        "task_config": config_to_plain(task.config),
        "actor_state_dict": state,
    }
    return CloneResult(
        content, len(rows), _loss(actor, groups[rows], actions[rows]), _loss(actor, groups[held], actions[held]), done
    )
