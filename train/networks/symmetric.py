"""A perceptron that acts mirrored on what is mirrored, by construction, whatever its weights.

Its answer is the mean of what its layers say to a state, and of the mirror image of what they say to the mirrored
state: f(s) = (g(s) + M g(M s)) / 2, so that f(M s) = M f(s). A value has no left and right: it is the mean of two.
Nothing has to be learnt twice, and no batch is doubled; each row goes through the layers twice. Abdolhosseini et al.,
"On learning symmetric locomotion", MIG 2019, section 3 compares it with mirrored samples and losses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import nn

from simwarp.tasks import InputError, Task
from simwarp.tasks.framework.mirror import Mirror, Reflection, check_mirror

from ..config import NetworkConfig, TrainConfig, rsl_rl_config
from .networks import Observations, Perceptron

_OPTION = "--network.symmetric"


class Mirrored(nn.Module):
    """Mirror image of rows of numbers.

    Args:
        reflection: of the rows.
    """

    sources: torch.Tensor
    signs: torch.Tensor

    def __init__(self, reflection: Reflection) -> None:
        super().__init__()
        # The task says both, so that no checkpoint holds them
        self.register_buffer("sources", torch.tensor(reflection.sources), persistent=False)
        self.register_buffer("signs", torch.tensor(reflection.signs), persistent=False)

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the mirror image of rows (..., N)."""
        return rows.index_select(-1, self.sources) * self.signs


class MeanOfImages(nn.Module):
    """Mean of the answers to a state and to its mirror image.

    Args:
        reflection: of the answers; None: they are the same in a mirror.
    """

    def __init__(self, reflection: Reflection | None) -> None:
        super().__init__()
        self.mirrored = nn.Identity() if reflection is None else Mirrored(reflection)

    def forward(self, answers: torch.Tensor) -> torch.Tensor:
        """Return (..., N) for answers (..., 2, N): to the state, and to its mirror image."""
        given, imaged = answers.unbind(-2)
        mean: torch.Tensor = 0.5 * (given + self.mirrored(imaged))
        return mean


class SymmetricPerceptron(Perceptron):
    """Perceptron over all vector groups that acts mirrored on what is mirrored.

    Args:
        arguments: see :class:`~simwarp.train.networks.networks.Perceptron`.
        mirror: of the task.
        options: see there.

    Raises:
        InputError: the mean action at the start is not its own mirror image.
    """

    def __init__(self, *arguments: Any, mirror: Mirror, **options: Any) -> None:
        self._mirror = mirror
        super().__init__(*arguments, **options)
        self.image = Mirrored(_joined([mirror.observations[group] for group in self.obs_groups]))

    def _finish(self, **drawn: Any) -> None:
        acts, mean = self.distribution is not None, drawn["init_mean"]
        answers = self._mirror.actions if acts else None
        if answers is not None and mean:
            image = [sign * mean[source] for source, sign in zip(answers.sources, answers.signs, strict=True)]
            wrong = next((k for k, value in enumerate(image) if value != mean[k]), None)
            if wrong is not None:
                raise InputError(
                    f"{_OPTION}: --network.init-mean must be its own mirror image, got {mean[wrong]:g} for action "
                    f"{wrong}, whose image is {image[wrong]:g}; leave one of the two away"
                )
        self.mlp.add_module(str(len(self.mlp)), MeanOfImages(answers))
        super()._finish(**drawn)

    def get_latent(
        self, obs: Observations, masks: torch.Tensor | None = None, hidden_state: Any = None
    ) -> torch.Tensor:
        """Return (N, 2, numbers): all groups, concatenated and normalised, and their mirror images."""
        rows = self._rows(obs)
        latent: torch.Tensor = self.obs_normalizer(torch.stack([rows, self.image(rows)], dim=-2))
        return latent

    def update_normalization(self, obs: Observations) -> None:
        """Let the normaliser see observations (N, ...) and their mirror images."""
        if self.obs_normalization:
            rows = self._rows(obs)
            self.obs_normalizer.update(torch.cat([rows, self.image(rows)]))

    def _rows(self, obs: Observations) -> torch.Tensor:
        return torch.cat([obs[group] for group in self.obs_groups], dim=-1)


def _joined(reflections: list[Reflection]) -> Reflection:
    """Return the reflection of rows that are concatenated."""
    sources: list[int] = []
    signs: list[float] = []
    for one in reflections:
        first = len(sources)
        sources += [first + source for source in one.sources]
        signs += one.signs
    return Reflection(tuple(sources), tuple(signs))


def network_mirror(task: Task[Any], network: NetworkConfig, groups: Mapping[str, tuple[int, ...]]) -> Mirror | None:
    """Return the mirror of a task that its networks are built with; None where they are not symmetric.

    Args:
        task: the task.
        network: of the training.
        groups: that the networks see, name -> shape.

    Raises:
        InputError: the task has none, or it does not fit the groups.
    """
    return check_mirror(task, groups, _OPTION) if network.symmetric else None


def task_settings(
    task: Task[Any], config: TrainConfig, more: Mapping[str, tuple[int, ...]] | None = None
) -> dict[str, Any]:
    """Return the dictionary that rsl-rl wants, for training on a task.

    Args:
        task: the task.
        config: the training configuration.
        more: groups beside the task's own that a network sees, name -> shape.

    Raises:
        InputError: the mean action at the start does not fit the actions, or the task has no mirror that is asked for.
    """
    shapes = task.observation_shapes
    mirror = network_mirror(task, config.network, {**shapes, **(more or {})})
    return rsl_rl_config(config, list(shapes), task.action_size, task.observation_kinds, mirror=mirror)
