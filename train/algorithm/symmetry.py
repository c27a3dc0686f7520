"""Symmetry in training: mirror images of what was seen and done, as rsl-rl's extension of PPO wants them.

Mittal et al., "Symmetry considerations for learning task symmetric robot policies", ICRA 2024: mini-batches are learned
from together with their mirror images, or the policy is punished where it does not act mirrored on what is mirrored.
"""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict

from simwarp.tasks import Task
from simwarp.tasks.framework.mirror import Mirror, Reflection, check_mirror

from ..config import CRITIC, CriticSees, Symmetry, TrainConfig


class MirrorImages:
    """Appends mirror images: called as rsl-rl calls a ``data_augmentation_func``.

    Args:
        mirror: of the task.
        device: of what is mirrored.
    """

    def __init__(self, mirror: Mirror, device: str) -> None:
        self._groups = {name: _on(one, device) for name, one in mirror.observations.items()}
        self._actions = _on(mirror.actions, device)

    def __call__(
        self, env: Any, obs: TensorDict | None, actions: torch.Tensor | None
    ) -> tuple[TensorDict | None, torch.Tensor | None]:
        """Return observations (2 N, ...) and actions (2 N, A): the given ones, then their mirror images."""
        seen = None
        if obs is not None:
            columns: dict[str, Any] = dict(obs.items())
            groups = {name: torch.cat([group, self.group(name, group)]) for name, group in columns.items()}
            seen = TensorDict(groups, batch_size=[2 * obs.batch_size[0]], device=obs.device)
        return seen, None if actions is None else torch.cat([actions, self.actions(actions)])

    def group(self, name: str, values: torch.Tensor) -> torch.Tensor:
        """Return the mirror image of an observation group (N, ...)."""
        return _mirrored(values, *self._groups[name])

    def actions(self, values: torch.Tensor) -> torch.Tensor:
        """Return the mirror image of actions (N, A)."""
        return _mirrored(values, *self._actions)


def privileged_group(task: Task[Any], config: TrainConfig) -> dict[str, tuple[int, ...]]:
    """Return the group of a privileged critic, name -> shape; none where the critic sees what the actor does."""
    seen = task.observe_privileged() if config.network.critic is CriticSees.PRIVILEGED else None
    return {} if seen is None else {CRITIC: tuple(seen.shape[1:])}


def symmetry_settings(task: Task[Any], config: TrainConfig) -> dict[str, Any] | None:
    """Return rsl-rl's ``symmetry_cfg``; None where no symmetry is used.

    Raises:
        InputError: the task has no mirror, or it does not fit.
    """
    ppo = config.ppo
    if ppo.symmetry is Symmetry.NONE:
        return None
    groups = {**task.observation_shapes, **privileged_group(task, config)}
    mirror = check_mirror(task, groups, f"--ppo.symmetry {ppo.symmetry.value}")
    return {
        "data_augmentation_func": MirrorImages(mirror, str(task.device)),
        "use_data_augmentation": ppo.symmetry is Symmetry.AUGMENT,
        "use_mirror_loss": ppo.symmetry is Symmetry.LOSS,
        "mirror_loss_coeff": ppo.mirror_loss,
    }


def _on(reflection: Reflection, device: str) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.tensor(reflection.sources, device=device), torch.tensor(reflection.signs, device=device)


def _mirrored(values: torch.Tensor, sources: torch.Tensor, signs: torch.Tensor) -> torch.Tensor:
    return values.index_select(-1, sources) * signs
