"""Encoders of observations by their kind: images, sequences and clouds of points become rows of numbers.

Images are (N, H, W, C), channels last, as cameras and lidars write them; uint8 ones become numbers here. Kernels are no
larger than what they go over: an image may have any size, down to a single row.
"""

from __future__ import annotations

from typing import Final

import torch
from torch import nn

from ..config import Precision

_NATURE: Final = ((32, 8, 4), (64, 4, 2), (64, 3, 1))
"""Channels, kernel and stride of the three convolutions (Mnih et al. 2015)."""
_POINT_LAYERS: Final = (64, 64, 128)
"""Units of the layers that all points share."""


def convolution_size(side: int, kernel: int, stride: int, padding: int = 0) -> int:
    """Return how many windows of ``kernel`` numbers there are along a side of ``side`` numbers.

    Equation 3.17 of the thesis, ceil((I - K + 2 P) / S), is the same number where the division leaves a remainder;
    where it leaves none, one window less.
    """
    return (side - kernel + 2 * padding) // stride + 1


def nature_size(height: int, width: int) -> int:
    """Return the size of the output of the three convolutions over an image; 45 x 80 gives 768."""
    for _, kernel, stride in _NATURE:
        height, width = (convolution_size(side, min(kernel, side), stride) for side in (height, width))
    return _NATURE[-1][0] * height * width


def _drawn(convolution: nn.Conv1d | nn.Conv2d) -> nn.Conv1d | nn.Conv2d:
    """Return a convolution with weights by Glorot and Bengio, and biases of zero."""
    nn.init.xavier_normal_(convolution.weight)
    if convolution.bias is not None:
        nn.init.zeros_(convolution.bias)
    return convolution


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
        self.size = nature_size(height, width)
        layers: list[nn.Module] = []
        for filters, kernel, stride in _NATURE:
            window = (min(kernel, height), min(kernel, width))
            layers += [_drawn(nn.Conv2d(channels, filters, window, stride)), nn.ReLU(inplace=True)]
            channels = filters
            height, width = (convolution_size(*one, stride) for one in zip((height, width), window, strict=True))
        # The last non-linearity comes after the flattening, which changes no number: gradients of plain rows go
        # backwards through it at once, those of channels last only one by one
        layers.insert(-1, nn.Flatten())
        self.layers = nn.Sequential(*layers)

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


class SequenceEncoder(nn.Module):
    """Three convolutions along (N, T, C) sequences, flattened to (N, ``size``).

    Zeros before the oldest entry let the last window of each layer end at the newest one.

    Args:
        shape: length and channels of a sequence.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        super().__init__()
        length, channels = shape
        layers: list[nn.Module] = []
        for filters, kernel, stride in _NATURE:
            window = min(kernel, length)
            before = (window - length) % stride
            layers += [
                nn.ConstantPad1d((before, 0), 0.0), _drawn(nn.Conv1d(channels, filters, window, stride)),
                nn.ReLU(inplace=True),
            ]  # fmt: skip
            channels, length = filters, convolution_size(length + before, window, stride)
        self.layers = nn.Sequential(*layers, nn.Flatten())
        self.size = channels * length

    def forward(self, sequence: torch.Tensor) -> torch.Tensor:
        """Return the features of float32 sequences."""
        features: torch.Tensor = self.layers(sequence.movedim(-1, -2))
        return features


class PointEncoder(nn.Module):
    """PointNet (Qi et al. 2017) without its rotations: layers that all points share, then the largest of each feature.

    What comes out, (N, ``size``), does not depend on the order of the points.

    Args:
        channels: numbers of a point.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for units in _POINT_LAYERS:
            layers += [nn.Linear(channels, units), nn.ReLU(inplace=True)]
            channels = units
        self.layers = nn.Sequential(*layers)
        self.size = channels

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return the features of float32 clouds (N, ..., channels)."""
        return self.layers(points.flatten(1, -2)).amax(dim=1)
