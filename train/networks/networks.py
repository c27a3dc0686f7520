"""Actor and critic networks: perceptrons, a recurrent one, and three that see images.

All derive from rsl-rl's models, so that its PPO trains them. Image groups are (W, H, W', C), channels last, as cameras
write them; uint8 stays uint8 in the rollout storage and becomes a number here, in the network. Vector groups are
concatenated and, where asked for, normalised by their running mean and deviation.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from rsl_rl.models import MLPModel, RNNModel
from torch import nn

from simwarp.tasks import InputError

from ..config import NetworkKind, Precision

_NATURE = ((32, 8, 4), (64, 4, 2), (64, 3, 1))
"""Channels, kernel and stride of the three convolutions (Mnih et al. 2015)."""
_UNITS_PER_SIGNAL = 10
_FIRST_WEIGHTS = 0.01
"""Of those drawn: the actor's last layer, where its mean action is given."""
_SMALLEST_IMAGE = 36
_ACTIVATIONS: Mapping[str, type[nn.Module]] = {"elu": nn.ELU, "relu": nn.ReLU, "tanh": nn.Tanh}

Observations = Mapping[str, torch.Tensor]


def thesis_sizes(inputs: int, outputs: int) -> list[int]:
    """Return the three hidden layers of the sizing rule: ten per input, ten per output, their geometric mean between.

    30 observations and 8 actions give 300, 154, 80.
    """
    first, last = _UNITS_PER_SIGNAL * inputs, _UNITS_PER_SIGNAL * outputs
    return [first, math.isqrt(first * last), last]


def nature_size(height: int, width: int) -> int:
    """Return the size of the output of the three convolutions over an image; 45 x 80 gives 768."""
    for _, kernel, stride in _NATURE:
        height, width = ((side - kernel) // stride + 1 for side in (height, width))
    return _NATURE[-1][0] * height * width


def _finish(mlp: nn.Sequential, tanh_output: bool, init_mean: Sequence[float] | None) -> None:
    """Let an actor begin with a mean action, and bound its results.

    With a last layer as drawn a policy begins with a bias that hangs on the seed: a vehicle whose brake it holds gets
    nowhere, and learns nothing. Small last weights: Andrychowicz et al. 2021, What matters for on-policy deep
    actor-critic methods, section 3.2.
    """
    if init_mean:
        last = next(layer for layer in reversed(list(mlp.modules())) if isinstance(layer, nn.Linear))
        mean = torch.tensor(init_mean, dtype=last.bias.dtype)
        with torch.no_grad():
            last.weight.mul_(_FIRST_WEIGHTS)
            last.bias.copy_(torch.atanh(mean) if tanh_output else mean)
    if tanh_output:
        mlp.add_module(str(len(mlp)), nn.Tanh())


class Perceptron(MLPModel):
    """Multi-layer perceptron over all vector groups.

    Args:
        obs, obs_groups, obs_set, output_dim: arguments that rsl-rl hands to every model.
        hidden_dims: units of the hidden layers; None takes :func:`thesis_sizes`.
        tanh_output: bound the mean action to (-1, 1).
        init_mean: mean action at the start; None or empty: that of the layers as drawn.
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
        **options: Any,
    ) -> None:
        if hidden_dims is None:
            hidden_dims = thesis_sizes(sum(obs[group].shape[-1] for group in obs_groups[obs_set]), output_dim)
        super().__init__(obs, obs_groups, obs_set, output_dim, hidden_dims=hidden_dims, **options)
        _finish(self.mlp, tanh_output, init_mean)


class Recurrent(RNNModel):
    """rsl-rl's GRU or LSTM before a perceptron."""

    def __init__(
        self, *arguments: Any, tanh_output: bool = False, init_mean: Sequence[float] | None = None, **options: Any
    ) -> None:
        super().__init__(*arguments, **options)
        _finish(self.mlp, tanh_output, init_mean)


class NatureEncoder(nn.Module):
    """Three convolutions over (N, H, W, C) images, flattened to (N, ``size``).

    Args:
        shape: height, width and channels of an image.
        precision: numbers to compute with in training mode; in evaluation mode they are float32, and weights always.
    """

    def __init__(self, shape: tuple[int, int, int], precision: Precision = Precision.FLOAT32) -> None:
        super().__init__()
        self.precision = precision
        height, width, channels = shape
        layers: list[nn.Module] = []
        for filters, kernel, stride in _NATURE:
            convolution = nn.Conv2d(channels, filters, kernel, stride)
            nn.init.xavier_normal_(convolution.weight)
            if convolution.bias is not None:
                nn.init.zeros_(convolution.bias)
            layers += [convolution, nn.ReLU(inplace=True)]
            channels = filters
        # The last non-linearity comes after the flattening, which changes no number: gradients of plain rows go
        # backwards through it at once, those of channels last only one by one
        layers.insert(-1, nn.Flatten())
        self.layers = nn.Sequential(*layers)
        self.size = nature_size(height, width)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Return the features of uint8 images, shifted to about [-0.5, 0.5], or of float ones as they are."""
        if self.training and self.precision is Precision.BFLOAT16:
            return self._in_bfloat16(image)
        # In place: a batch of images as numbers is the largest thing in training, and made anew for each network
        pixels = image.float().sub_(127.0).div_(255.0) if image.dtype == torch.uint8 else image
        features: torch.Tensor = self.layers(pixels.movedim(-1, -3))
        return features.flatten(1)

    def _in_bfloat16(self, image: torch.Tensor) -> torch.Tensor:
        # 0 to 255 less 127 has no rounding error in bfloat16: the division by 255 is the first weights' part
        bytes_in = image.dtype == torch.uint8
        features = image.to(torch.bfloat16)
        features = (features.sub_(127.0) if bytes_in else features).movedim(-1, -3)
        scale = 255.0 if bytes_in else 1.0
        for layer in self.layers:
            if isinstance(layer, nn.Conv2d):
                assert layer.bias is not None
                weight, bias = (layer.weight / scale).bfloat16(), layer.bias.bfloat16()
                features, scale = nn.functional.conv2d(features, weight, bias, layer.stride), 1.0
            else:
                features = layer(features)
        return features.float()


def _layers(sizes: list[int], activation: type[nn.Module], last: bool) -> nn.Sequential:
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
        self.encoders = nn.ModuleList(
            NatureEncoder(shape, Precision(precision)) for shape in self._image_shapes.values()
        )
        features = sum(nature_size(shape[0], shape[1]) for shape in self._image_shapes.values())
        outputs = output_dim if self.distribution is None else self.distribution.input_dim
        self.mlp = self.make_layers(features, action_size, outputs, _ACTIVATIONS[activation])
        _finish(self.mlp, tanh_output, init_mean)

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
        self.vector_branch = _layers([self.obs_dim, 5 * actions], activation, last=True)
        return _layers([10 * actions, 20 * actions, 10 * actions, 5 * actions, outputs], activation, last=False)

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
        self.image_branch = _layers([features, outputs], activation, last=True)
        self.vector_branch = _layers([inputs, *hidden, outputs], activation, last=True)
        return nn.Sequential(nn.Linear(2 * outputs, outputs))

    def get_latent(
        self, obs: Observations, masks: torch.Tensor | None = None, hidden_state: Any = None
    ) -> torch.Tensor:
        """Return both branches side by side."""
        return torch.cat([self.image_branch(self.see(obs)), self.vector_branch(self.feel(obs))], dim=-1)


@dataclasses.dataclass(frozen=True)
class NetworkNeeds:
    """Observations that a kind of network needs."""

    images: bool
    vectors: bool


NEEDS = {
    NetworkKind.MLP: NetworkNeeds(images=False, vectors=True),
    NetworkKind.THESIS_MLP: NetworkNeeds(images=False, vectors=True),
    NetworkKind.RECURRENT: NetworkNeeds(images=False, vectors=True),
    NetworkKind.NATURE_CNN: NetworkNeeds(images=True, vectors=False),
    NetworkKind.EARLY_FUSION: NetworkNeeds(images=True, vectors=True),
    NetworkKind.LATE_FUSION: NetworkNeeds(images=True, vectors=True),
}


def check_groups(
    kind: NetworkKind, task: str, shapes: Mapping[str, tuple[int, ...]], dtypes: Mapping[str, torch.dtype]
) -> None:
    """Check a task's observation groups against the inputs of a network.

    Raises:
        InputError: a group has the wrong shape or dtype, or the network takes no such group.
    """
    needs = NEEDS[kind]
    images = {name for name, shape in shapes.items() if len(shape) == 3}
    for name, shape in shapes.items():
        dtype = dtypes[name]
        flat = len(shape) == 1 and dtype == torch.float32
        seen = name in images and dtype in (torch.uint8, torch.float32) and min(shape[:2]) >= _SMALLEST_IMAGE
        if (flat and needs.vectors) or (seen and needs.images):
            continue
        takes = [f"images (H, W, C) of uint8 or float32, {_SMALLEST_IMAGE} pixels or more each way"] * needs.images
        takes += ["(N,) float32 groups"] * needs.vectors
        others = [other.value for other, wants in NEEDS.items() if wants.images and (wants.vectors or not flat)]
        hint = f"; try --network.kind {others[-1]}" if flat or seen else ""
        raise InputError(
            f"observation '{name}' of task '{task}' is {shape} {dtype}; network '{kind.value}' takes"
            f" {' and '.join(takes)}{hint}"
        )
    for wanted, present, word in (
        (needs.images, images, "an image"),
        (needs.vectors, shapes.keys() - images, "a vector"),
    ):
        if wanted and not present:
            raise InputError(f"network '{kind.value}' needs {word} group; task '{task}' has {', '.join(shapes)}")
