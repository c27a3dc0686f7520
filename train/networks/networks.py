"""Actor and critic networks: perceptrons, a recurrent one, three that see images, and one with an encoder per group.

All derive from rsl-rl's models, so that its PPO trains them. Image groups are (W, H, W', C), channels last, as cameras
write them; uint8 stays uint8 in the rollout storage and becomes a number here, in the network. Vector groups are
concatenated and, where asked for, normalised by their running mean and deviation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from rsl_rl.models import MLPModel, RNNModel
from torch import nn

from simwarp.tasks import InputError

from ..config import InitialWeights, Precision
from .encoders import NatureEncoder

_UNITS_PER_SIGNAL = 10
_FIRST_WEIGHTS = 0.01
"""Of those drawn: the actor's last layer, where its mean action is given."""
ACTIVATIONS: Mapping[str, type[nn.Module]] = {"elu": nn.ELU, "relu": nn.ReLU, "tanh": nn.Tanh}

Observations = Mapping[str, torch.Tensor]


def thesis_sizes(inputs: int, outputs: int) -> list[int]:
    """Return the three hidden layers of the sizing rule: ten per input, ten per output, their geometric mean between.

    30 observations and 8 actions give 300, 154, 80.
    """
    first, last = _UNITS_PER_SIGNAL * inputs, _UNITS_PER_SIGNAL * outputs
    return [first, math.isqrt(first * last), last]


_NORMAL_WEIGHTS = 0.1
"""Standard deviation of normal weights, and value of the biases beside them."""


def finish(
    model: MLPModel, tanh_output: bool = False, init_mean: Sequence[float] | None = None,
    init_weights: str = InitialWeights.LAYERS.value,
) -> None:  # fmt: skip
    """Draw the weights of a network that is built, let an actor begin with a mean action, and bound its results.

    With a last layer as drawn a policy begins with a bias that hangs on the seed: a vehicle whose brake it holds gets
    nowhere, and learns nothing. Small last weights: Andrychowicz et al. 2021, What matters for on-policy deep
    actor-critic methods, section 3.2.

    Args:
        model: its last layer is the last linear one of ``model.mlp``.
        tanh_output: bound the mean action to (-1, 1).
        init_mean: mean action at the start; None or empty: that of the layers as drawn.
        init_weights: value of an :class:`~simwarp.train.config.InitialWeights`.

    Raises:
        InputError: a mean is given, and there is no linear layer that ends in as many numbers.
    """
    mlp = model.mlp
    if init_weights == InitialWeights.NORMAL.value:
        _draw_normal(model)
    if init_mean:
        last = next((layer for layer in reversed(list(mlp.modules())) if isinstance(layer, nn.Linear)), None)
        if last is None or last.bias is None or last.out_features != len(init_mean):
            raise InputError(
                f"--network.init-mean needs a network whose last linear layer has {len(init_mean)} outputs and a bias;"
                " give --network.init-mean without a number"
            )
        mean = torch.tensor(init_mean, dtype=last.bias.dtype)
        with torch.no_grad():
            last.weight.mul_(_FIRST_WEIGHTS)
            last.bias.copy_(torch.atanh(mean) if tanh_output else mean)
    if tanh_output:
        mlp.add_module(str(len(mlp)), nn.Tanh())


def _draw_normal(model: nn.Module) -> None:
    """Draw all weights of linear, convolutional and recurrent layers from N(0, 0.1), and set their biases to 0.1."""
    for layer in model.modules():
        if isinstance(layer, nn.Linear | nn.Conv1d | nn.Conv2d | nn.RNNBase):
            for name, parameter in layer.named_parameters(recurse=False):
                if name.startswith("bias"):
                    nn.init.constant_(parameter, _NORMAL_WEIGHTS)
                else:
                    nn.init.normal_(parameter, 0.0, _NORMAL_WEIGHTS)


class Perceptron(MLPModel):
    """Multi-layer perceptron over all vector groups.

    Args:
        obs, obs_groups, obs_set, output_dim: arguments that rsl-rl hands to every model.
        hidden_dims: units of the hidden layers; None takes :func:`thesis_sizes`.
        tanh_output: bound the mean action to (-1, 1).
        init_mean: mean action at the start; None or empty: that of the layers as drawn.
        init_weights: see :func:`finish`.
        options: activation, obs_normalization and distribution_cfg of rsl-rl.
    """

    def __init__(
        self,
        obs: Any,
        obs_groups: dict[str, list[str]],
        obs_set: str,
        output_dim: int,
        hidden_dims: list[int] | None = None,
        tanh_output: bool = False,
        init_mean: Sequence[float] | None = None,
        init_weights: str = InitialWeights.LAYERS.value,
        **options: Any,
    ) -> None:
        if hidden_dims is None:
            hidden_dims = thesis_sizes(sum(obs[group].shape[-1] for group in obs_groups[obs_set]), output_dim)
        super().__init__(obs, obs_groups, obs_set, output_dim, hidden_dims=hidden_dims, **options)
        self._finish(tanh_output=tanh_output, init_mean=init_mean, init_weights=init_weights)

    def _finish(self, **drawn: Any) -> None:
        finish(self, **drawn)


class Recurrent(RNNModel):
    """rsl-rl's GRU or LSTM before a perceptron."""

    def __init__(
        self, *arguments: Any, tanh_output: bool = False, init_mean: Sequence[float] | None = None,
        init_weights: str = InitialWeights.LAYERS.value, **options: Any,
    ) -> None:  # fmt: skip
        super().__init__(*arguments, **options)
        finish(self, tanh_output, init_mean, init_weights)


def linear_layers(sizes: list[int], activation: type[nn.Module], last: bool) -> nn.Sequential:
    """Return linear layers with a non-linearity after each; after the last one only if ``last``."""
    steps: list[nn.Module] = []
    for index in range(len(sizes) - 1):
        steps.append(nn.Linear(sizes[index], sizes[index + 1]))
        if last or index < len(sizes) - 2:
            steps.append(activation())
    return nn.Sequential(*steps)


class ImageModel(MLPModel):
    """Base class of the networks over images: an encoder per image group, a branch of vectors, and a head.

    Args:
        obs, obs_groups, obs_set, output_dim: arguments that rsl-rl hands to every model.
        action_size: number of actions; the sizing rules count in it, the critic's too.
        activation: name of the non-linearity of the linear layers; convolutions have ReLU.
        tanh_output: bound the mean action to (-1, 1).
        init_mean: mean action at the start; None or empty: that of the layers as drawn.
        init_weights: see :func:`finish`.
        precision: value of a :class:`~simwarp.train.config.Precision`, of the convolutions in training mode.
        options: obs_normalization and distribution_cfg of rsl-rl.
    """

    _image_shapes: dict[str, tuple[int, int, int]]

    def __init__(
        self,
        obs: Any,
        obs_groups: dict[str, list[str]],
        obs_set: str,
        output_dim: int,
        action_size: int = 1,
        activation: str = "relu",
        tanh_output: bool = False,
        init_mean: Sequence[float] | None = None,
        init_weights: str = InitialWeights.LAYERS.value,
        obs_normalization: bool = False,
        precision: str = Precision.FLOAT32.value,
        **options: Any,
    ) -> None:
        vectors = any(obs[group].dim() == 2 for group in obs_groups[obs_set])
        super().__init__(
            obs,
            obs_groups,
            obs_set,
            output_dim,
            hidden_dims=[1],
            obs_normalization=obs_normalization and vectors,
            **options,
        )
        self.image_groups = list(self._image_shapes)
        encoders = [NatureEncoder(shape, Precision(precision)) for shape in self._image_shapes.values()]
        self.encoders = nn.ModuleList(encoders)
        features = sum(encoder.size for encoder in encoders)
        outputs = output_dim if self.distribution is None else self.distribution.input_dim
        self.mlp = self.make_layers(features, action_size, outputs, ACTIVATIONS[activation])
        finish(self, tanh_output, init_mean, init_weights)

    def _get_obs_dim(self, obs: Any, obs_groups: dict[str, list[str]], obs_set: str) -> tuple[list[str], int]:
        groups = obs_groups[obs_set]
        self._image_shapes = {group: tuple(obs[group].shape[1:]) for group in groups if obs[group].dim() == 4}
        vectors = [group for group in groups if obs[group].dim() == 2]
        return vectors, sum(obs[group].shape[-1] for group in vectors)

    def _get_latent_dim(self) -> int:
        return 1  # of rsl-rl's own perceptron, which make_layers replaces

    def make_layers(self, features: int, actions: int, outputs: int, activation: type[nn.Module]) -> nn.Sequential:
        """Make the branches, and return the layers after them.

        Args:
            features: numbers that the convolutions leave.
            actions: number of actions.
            outputs: results of the network.
            activation: non-linearity.
        """
        raise NotImplementedError

    def see(self, obs: Observations) -> torch.Tensor:
        """Return the features of all image groups."""
        seen = [encoder(obs[name]) for name, encoder in zip(self.image_groups, self.encoders, strict=True)]
        return torch.cat(seen, dim=-1)

    def feel(self, obs: Observations) -> torch.Tensor:
        """Return the vector groups, concatenated and normalised."""
        vectors: torch.Tensor = self.obs_normalizer(torch.cat([obs[group] for group in self.obs_groups], dim=-1))
        return vectors


class NatureCNN(ImageModel):
    """Images alone: three convolutions and one linear layer."""

    def make_layers(self, features: int, actions: int, outputs: int, activation: type[nn.Module]) -> nn.Sequential:
        """Return the linear layer."""
        return nn.Sequential(nn.Linear(features, outputs))

    def get_latent(
        self, obs: Observations, masks: torch.Tensor | None = None, hidden_state: Any = None
    ) -> torch.Tensor:
        """Return the features of the images."""
        return self.see(obs)


class EarlyFusion(ImageModel):
    """``MultiSensorEarlyFusion``: image and vector meet at five units per action each; four layers follow."""

    def make_layers(self, features: int, actions: int, outputs: int, activation: type[nn.Module]) -> nn.Sequential:
        """Make one layer per branch; return those after their meeting."""
        self.image_branch = nn.Linear(features, 5 * actions)
        self.vector_branch = linear_layers([self.obs_dim, 5 * actions], activation, last=True)
        return linear_layers([10 * actions, 20 * actions, 10 * actions, 5 * actions, outputs], activation, last=False)

    def get_latent(
        self, obs: Observations, masks: torch.Tensor | None = None, hidden_state: Any = None
    ) -> torch.Tensor:
        """Return both branches side by side."""
        return torch.cat([self.image_branch(self.see(obs)), self.vector_branch(self.feel(obs))], dim=-1)


class LateFusion(ImageModel):
    """The network that keeps the sensors apart: each branch proposes an output, one linear layer weighs both."""

    def make_layers(self, features: int, actions: int, outputs: int, activation: type[nn.Module]) -> nn.Sequential:
        """Make both branches; return the layer that joins them."""
        inputs = self.obs_dim
        hidden = [5 * inputs, 5 * (actions + inputs), 5 * actions] if self.distribution else [5 * inputs, 5 * inputs, 5]
        self.image_branch = linear_layers([features, outputs], activation, last=True)
        self.vector_branch = linear_layers([inputs, *hidden, outputs], activation, last=True)
        return nn.Sequential(nn.Linear(2 * outputs, outputs))

    def get_latent(
        self, obs: Observations, masks: torch.Tensor | None = None, hidden_state: Any = None
    ) -> torch.Tensor:
        """Return both branches side by side."""
        return torch.cat([self.image_branch(self.see(obs)), self.vector_branch(self.feel(obs))], dim=-1)
