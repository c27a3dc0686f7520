"""Networks that read any observation groups: one with an encoder for each, and those of authors.

The layers are one module, called with the groups by name: float32 ones normalised along their last axis where asked
for, uint8 ones as the task returns them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import torch
from rsl_rl.models import MLPModel
from rsl_rl.modules import EmpiricalNormalization
from torch import nn

from simwarp.tasks.framework.observation_kinds import ObservationKind, kinds_of_groups

from ..config import InitialWeights, Precision
from .encoders import NatureEncoder, PointEncoder, SequenceEncoder
from .networks import ACTIVATIONS, Observations, finish, linear_layers

Shapes = Mapping[str, tuple[int, ...]]
"""Observation group -> shape, without the worlds."""


class GroupModel(MLPModel):
    """Base class of networks whose layers are one module that takes all observation groups.

    Args:
        obs, obs_groups, obs_set, output_dim: arguments that rsl-rl hands to every model.
        obs_normalization: normalise float32 groups by running mean and deviation of each number of their last axis.
        distribution_cfg: of rsl-rl; None: a critic.
        tanh_output, init_mean, init_weights: see :func:`~simwarp.train.networks.networks.finish`.
        prefix: of the groups' names, which the layers do not know.
    """

    def __init__(
        self, obs: Any, obs_groups: dict[str, list[str]], obs_set: str, output_dim: int, *,
        obs_normalization: bool = False, distribution_cfg: dict[str, Any] | None = None, tanh_output: bool = False,
        init_mean: Sequence[float] | None = None, init_weights: str = InitialWeights.LAYERS.value, prefix: str = "",
    ) -> None:  # fmt: skip
        super().__init__(obs, obs_groups, obs_set, output_dim, hidden_dims=[1], distribution_cfg=distribution_cfg)
        self._names = [name.removeprefix(prefix) for name in self.obs_groups]
        shapes = [tuple(obs[name].shape[1:]) for name in self.obs_groups]
        self.obs_normalization = obs_normalization
        self.normalisers = nn.ModuleList(
            EmpiricalNormalization(shape[-1])
            if obs_normalization and shape and obs[name].is_floating_point()
            else nn.Identity()
            for name, shape in zip(self.obs_groups, shapes, strict=True)
        )
        outputs = output_dim if self.distribution is None else self.distribution.input_dim
        self.mlp = nn.Sequential(self.make_layers(dict(zip(self._names, shapes, strict=True)), outputs))
        finish(self, tanh_output, init_mean, init_weights)

    @abstractmethod
    def make_layers(self, shapes: Shapes, outputs: int) -> nn.Module:
        """Return the module that takes groups by name, each (N, ...), and returns (N, ``outputs``)."""

    def _get_obs_dim(self, obs: Any, obs_groups: dict[str, list[str]], obs_set: str) -> tuple[list[str], int]:
        return list(obs_groups[obs_set]), 1

    def get_latent(
        self, obs: Observations, masks: torch.Tensor | None = None, hidden_state: Any = None
    ) -> dict[str, torch.Tensor]:
        """Return the groups by name, normalised."""
        groups = zip(self._names, self.obs_groups, self.normalisers, strict=True)
        return {name: normaliser(obs[group]) for name, group, normaliser in groups}

    def update_normalization(self, obs: Observations) -> None:
        """Let the normalisers see observations (N, ...)."""
        for name, normaliser in zip(self.obs_groups, self.normalisers, strict=True):
            if isinstance(normaliser, EmpiricalNormalization):
                normaliser.update(obs[name].flatten(0, -2))


class EncodedGroups(nn.Module):
    """An encoder and a linear layer for each group that is no vector; a perceptron over all features and vectors.

    Args:
        kinds: group -> kind.
        shapes: group -> shape, without the worlds.
        sizes: units of the perceptron's hidden layers, and its outputs.
        features: numbers that are left of a group.
        activation: non-linearity of the linear layers.
        precision: of convolutions over images in training mode.
    """

    def __init__(
        self, kinds: Mapping[str, ObservationKind | None], shapes: Shapes, sizes: Iterable[int], *, features: int,
        activation: type[nn.Module], precision: Precision,
    ) -> None:  # fmt: skip
        super().__init__()
        self._vectors = [name for name, kind in kinds.items() if kind is ObservationKind.VECTOR]
        self._encoded = [name for name in kinds if name not in self._vectors]
        make: Mapping[ObservationKind | None, Callable[[Any], Any]] = {
            ObservationKind.IMAGE: lambda shape: NatureEncoder(shape, precision),
            ObservationKind.SEQUENCE: SequenceEncoder,
            ObservationKind.POINTS: lambda shape: PointEncoder(shape[-1]),
        }
        self.encoders = nn.ModuleList()
        for name in self._encoded:
            encoder = make[kinds[name]](shapes[name])
            self.encoders.append(nn.Sequential(encoder, nn.Linear(encoder.size, features), activation()))
        inputs = sum(shapes[name][0] for name in self._vectors) + features * len(self._encoded)
        self.head = linear_layers([inputs, *sizes], activation, last=False)

    def forward(self, groups: Observations) -> torch.Tensor:
        """Return (N, outputs) for groups by name, each (N, ...)."""
        seen = [encoder(groups[name]) for name, encoder in zip(self._encoded, self.encoders, strict=True)]
        results: torch.Tensor = self.head(torch.cat([*(groups[name] for name in self._vectors), *seen], dim=-1))
        return results


class MultiInput(GroupModel):
    """Any mixture of vectors, images, clouds of points and sequences.

    Args:
        arguments: see :class:`GroupModel`.
        kinds: group -> value of its kind, where that is not the one of its shape.
        hidden_dims: units of the hidden layers behind the encoders.
        features: numbers that each encoder leaves.
        activation: name of the non-linearity of the linear layers; convolutions and layers of points have ReLU.
        precision: value of a :class:`~simwarp.train.config.Precision`.
        options: see :class:`GroupModel`.
    """

    def __init__(
        self, *arguments: Any, kinds: Mapping[str, str], hidden_dims: Sequence[int], features: int, activation: str,
        precision: str = Precision.FLOAT32.value, **options: Any,
    ) -> None:  # fmt: skip
        self._settings = (dict(kinds), list(hidden_dims), features, activation, Precision(precision))
        super().__init__(*arguments, **options)

    def make_layers(self, shapes: Shapes, outputs: int) -> nn.Module:
        """Return the encoders and the perceptron behind them."""
        kinds, hidden, features, activation, precision = self._settings
        return EncodedGroups(
            kinds_of_groups(shapes, kinds), shapes, [*hidden, outputs], features=features,
            activation=ACTIVATIONS[activation], precision=precision,
        )  # fmt: skip
