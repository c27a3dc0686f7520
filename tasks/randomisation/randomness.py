"""Counter-based random numbers, one stream per (seed, world, episode, purpose).

A draw is a pure function of its coordinates: nothing is advanced, so that world ``k`` sees the same
numbers however many worlds run beside it, in whatever order purposes are asked for, and after a resume.
The hash is SplitMix64 (Steele, Lea, Flood 2014), applied once per coordinate.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import torch
import warp as wp

from simwarp.core.interop import TensorLaunch, from_torch
from simwarp.core.object_repr import Readable, plural

from ..framework.randomness_kernels import Draws, draw_bits, draw_integers, draw_normal, draw_uniform

_GAMMA = 0x9E3779B97F4A7C15
_MIX1 = 0xBF58476D1CE4E5B9
_MIX2 = 0x94D049BB133111EB
_WORD = (1 << 64) - 1


def mix64(value: int) -> int:
    """Return SplitMix64's output function of one 64-bit integer, as the kernels compute it."""
    value &= _WORD
    value = ((value ^ (value >> 30)) * _MIX1) & _WORD
    value = ((value ^ (value >> 27)) * _MIX2) & _WORD
    return value ^ (value >> 31)


class WorldRandom(Readable):
    """Random draws of a batch of worlds.

    Args:
        seed: any integer; different seeds give unrelated streams.
        episode: (W,) int64, the episode each world is in. Read, never written: the owner counts.
        step: (W,) int64, the control step of each world's episode; read by ``per_step`` draws.
        first_world: global index of world 0, for a batch that is one part of a larger one.

    Attributes:
        seed: the present one.
        world: (W,) int64, global index of the world as which each draws: its own, or of a copy that of its source.
        draws: coordinates of the draws, for kernels.
    """

    def __init__(self, seed: int, episode: torch.Tensor, step: torch.Tensor, first_world: int = 0) -> None:
        self.seed = seed
        self._device = episode.device
        self._worlds = len(episode)
        self._first_world = first_world
        self.world = torch.arange(first_world, first_world + self._worlds, device=self._device)
        self.draws = Draws()
        self.draws.world, self.draws.episode, self.draws.step = map(from_torch, (self.world, episode, step))
        self._streams: dict[str, wp.array] = {}
        self._made: dict[tuple[Any, ...], tuple[TensorLaunch, torch.Tensor]] = {}

    def _readable_title(self) -> str:
        return f": seed {self.seed}, {plural(self._worlds, 'world')}"

    def reseed(self, seed: int) -> None:
        """Change the seed, and let each world draw as itself; draws depend on nothing else that is kept here."""
        self.seed = seed
        first = self._first_world
        self.world.copy_(torch.arange(first, first + self._worlds, device=self._device))
        for purpose, stream in self._streams.items():
            stream.assign(self._stream_values(purpose))

    def stream(self, purpose: str) -> wp.array:
        """Return (1,) uint64, the key of a purpose, for kernels that draw by themselves; it follows the seed."""
        if purpose not in self._streams:
            self._streams[purpose] = wp.array(
                self._stream_values(purpose), dtype=wp.uint64, device=str(self._device)
            )  # fmt: skip
        return self._streams[purpose]

    def bits(self, purpose: str, size: int, *, per_step: bool = False) -> torch.Tensor:
        """Return (W, size) int64 with 64 random bits each.

        The same arguments in the same episode (and step, with ``per_step``) give the same bits again:
        use one purpose per quantity.
        """
        return self._draw(draw_bits, torch.int64, purpose, size, per_step)

    def uniform(
        self, purpose: str, low: float = 0.0, high: float = 1.0, size: int = 1, *, per_step: bool = False
    ) -> torch.Tensor:
        """Return (W, size) float32, uniform in [low, high), in the unit of the bounds."""
        # 24 bits: every value is exact in float32, and 1 is never reached
        scale = (high - low) / (1 << 24)
        return self._draw(draw_uniform, torch.float32, purpose, size, per_step, float(low), scale)

    def normal(
        self, purpose: str, mean: float = 0.0, std: float = 1.0, size: int = 1, *, per_step: bool = False
    ) -> torch.Tensor:
        """Return (W, size) float32, normal with the given mean and standard deviation, in the unit of both."""
        return self._draw(draw_normal, torch.float32, purpose, size, per_step, float(mean), float(std))

    def integers(self, purpose: str, low: int, high: int, size: int = 1, *, per_step: bool = False) -> torch.Tensor:
        """Return (W, size) int64, uniform in [low, high); the range must be below 2**31."""
        return self._draw(draw_integers, torch.int64, purpose, size, per_step, int(low), int(high - low))

    def _draw(
        self, kernel: wp.Kernel, dtype: torch.dtype, purpose: str, size: int, per_step: bool, *numbers: float
    ) -> torch.Tensor:
        """Return what a kernel draws, in memory of its own: callers may keep and change it."""
        key = (kernel.key, purpose, size, per_step, numbers)
        if key not in self._made:
            with torch.inference_mode(False):
                values = torch.zeros(self._worlds, size, dtype=dtype, device=self._device)
            arguments = [int(per_step), *numbers, self.stream(purpose), self.draws, values]
            self._made[key] = TensorLaunch(kernel, (self._worlds, size), arguments, self._device), values
        launch, values = self._made[key]
        launch.launch()
        return values.clone()

    def _stream_values(self, purpose: str) -> np.ndarray[Any, np.dtype[np.uint64]]:
        digest = hashlib.blake2b(purpose.encode(), digest_size=8).digest()
        return np.array([mix64(mix64(self.seed * _GAMMA) ^ int.from_bytes(digest, "little"))], np.uint64)
