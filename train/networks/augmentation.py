"""Images changed at random while a network learns from them: shifted by a few pixels, brighter, of other contrast.

What the network should do stays as it was, so that it learns to look past such changes. Shifts are those of DrQ
(Kostrikov et al. 2021): edges are repeated outwards, and a frame of the old size is cut out anywhere.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import torch
from tensordict import TensorDict

from ..config import AugmentationConfig

USUAL: Final = AugmentationConfig(shift=4, brightness=0.1, contrast=0.2)
"""Shifts as in DrQ, with light and contrast a little different."""
_LARGEST: Final = 255.0


@dataclasses.dataclass(frozen=True)
class ImageChanges:
    """What happens to each of N images.

    Attributes:
        shift: (N, 2) int64, where the cut begins in the widened image [pixels], down and to the right; the middle of
            the range is no shift.
        widened: pixels that were added on each side before the cut.
        tones: (2, N) float32, factor on the differences from the image's mean, and what is added to every number of
            the image, of 255; None: neither.
    """

    shift: torch.Tensor
    widened: int
    tones: torch.Tensor | None = None


def draw_changes(
    count: int, config: AugmentationConfig, generator: torch.Generator | None, device: torch.device | str = "cpu"
) -> ImageChanges:
    """Draw what happens to ``count`` images, each by itself.

    Args:
        count: number of images N.
        config: bounds of what is drawn.
        generator: source of randomness, of the same device; None: torch's own.
        device: where the images are.
    """
    shift = torch.randint(0, 2 * config.shift + 1, (count, 2), generator=generator, device=device)
    if not (config.brightness or config.contrast):
        return ImageChanges(shift, config.shift)
    contrast, light = 2.0 * torch.rand((2, count), generator=generator, device=device) - 1.0
    tones = torch.stack([1.0 + config.contrast * contrast, _LARGEST * config.brightness * light])
    return ImageChanges(shift, config.shift, tones)


def change(images: torch.Tensor, changes: ImageChanges) -> torch.Tensor:
    """Return images (N, H, W, C) uint8 after known changes, of the same shape and dtype.

    Raises:
        ValueError: the images are of another shape or dtype.
    """
    if images.dtype != torch.uint8 or images.dim() != 4:
        raise ValueError(f"images must be (N, H, W, C) uint8, got {tuple(images.shape)} {images.dtype}")
    moved = _cut(_widened(images, changes.widened), changes) if changes.widened else images.clone()
    if changes.tones is None:
        return moved
    numbers = moved.float()
    gain, offset = changes.tones.view(2, -1, 1, 1, 1)
    offset = offset + (1.0 - gain) * numbers.mean(dim=(1, 2, 3), keepdim=True)
    return numbers.mul_(gain).add_(offset).round_().clamp_(0.0, _LARGEST).to(torch.uint8)


def augment(
    images: torch.Tensor, generator: torch.Generator | None = None, *, config: AugmentationConfig = USUAL
) -> torch.Tensor:
    """Return images (N, H, W, C) uint8 changed at random, each by itself; the given ones stay.

    Args:
        images: what a camera wrote.
        generator: source of randomness, of the same device; None: torch's own.
        config: bounds of the changes.

    Raises:
        ValueError: the images are of another shape or dtype.
    """
    return change(images, draw_changes(len(images), config, generator, images.device))


def augment_groups(
    groups: TensorDict, generator: torch.Generator | None = None, *, config: AugmentationConfig = USUAL
) -> TensorDict:
    """Return observation groups with every group of uint8 images (N, H, W, C) augmented; the others are shared."""

    def changed(group: Any) -> Any:
        seen = group.dtype == torch.uint8 and group.dim() == 4
        return augment(group, generator, config=config) if seen else group

    return TensorDict({name: changed(group) for name, group in groups.items()}, batch_size=groups.batch_size)


def _widened(images: torch.Tensor, pixels: int) -> torch.Tensor:
    """Return images with their edges repeated outwards on each side."""
    count, height, width, channels = images.shape
    wide = images.new_empty(count, height + 2 * pixels, width + 2 * pixels, channels)
    middle = slice(pixels, -pixels)
    wide[:, middle, middle] = images
    wide[:, :pixels, middle], wide[:, -pixels:, middle] = images[:, :1], images[:, -1:]
    wide[:, :, :pixels] = wide[:, :, pixels : pixels + 1]
    wide[:, :, -pixels:] = wide[:, :, -pixels - 1 : -pixels]
    return wide


def _cut(wide: torch.Tensor, changes: ImageChanges) -> torch.Tensor:
    """Return frames of the size before, each from its own place."""
    count, height, width, channels = wide.shape
    rows, columns = height - 2 * changes.widened, width - 2 * changes.widened
    # Rows of a frame are runs of bytes: a view holds those that begin at any pixel, and picking copies whole runs
    runs = wide.flatten().unfold(0, columns * channels, channels)
    first = torch.arange(count, device=wide.device).unsqueeze(1) * height + changes.shift[:, :1]
    starts = (first + torch.arange(rows, device=wide.device)) * width + changes.shift[:, 1:]
    return runs[starts].view(count, rows, columns, channels)
