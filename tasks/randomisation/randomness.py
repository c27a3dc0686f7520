"""Counter-based random numbers, one stream per (seed, world, episode, purpose).

A draw is a pure function of its coordinates: nothing is advanced, so that world ``k`` sees the same
numbers however many worlds run beside it, in whatever order purposes are asked for, and after a resume.
The hash is SplitMix64 (Steele, Lea, Flood 2014), applied once per coordinate. int64 stands for uint64: torch's
integer products wrap around, and shifts are masked to make them logical.
"""

from __future__ import annotations

import hashlib
import math

import torch

_GAMMA = 0x9E3779B97F4A7C15
_MIX1 = 0xBF58476D1CE4E5B9
_MIX2 = 0x94D049BB133111EB
_WORD = (1 << 64) - 1


def _signed(value: int) -> int:
    """Return the int64 with the bits of a uint64."""
    value &= _WORD
    return value - (1 << 64) if value >> 63 else value


def mix64(value: int) -> int:
    """Return SplitMix64's output function of one 64-bit integer (host reference of :func:`mix64_`)."""
    value &= _WORD
    value = ((value ^ (value >> 30)) * _MIX1) & _WORD
    value = ((value ^ (value >> 27)) * _MIX2) & _WORD
    return value ^ (value >> 31)


def mix64_(value: torch.Tensor) -> torch.Tensor:
    """Apply SplitMix64's output function to an int64 tensor in place and return it."""
    value ^= (value >> 30) & ((1 << 34) - 1)
    value *= _signed(_MIX1)
    value ^= (value >> 27) & ((1 << 37) - 1)
    value *= _signed(_MIX2)
    value ^= (value >> 31) & ((1 << 33) - 1)
    return value


class WorldRandom:
    """Random draws of a batch of worlds.

    Args:
        seed: any integer; different seeds give unrelated streams.
        episode: (W,) int64, the episode each world is in. Read, never written: the owner counts.
        step: (W,) int64, the control step of each world's episode; read by ``per_step`` draws.
        first_world: global index of world 0, for a batch that is one part of a larger one.
    """

    def __init__(self, seed: int, episode: torch.Tensor, step: torch.Tensor, first_world: int = 0) -> None:
        self.seed = seed
        self._episode = episode
        self._step = step
        self._world = torch.arange(first_world, first_world + episode.shape[0], device=episode.device)
        self._world_keys: dict[str, torch.Tensor] = {}
        self._columns: dict[int, torch.Tensor] = {}

    def reseed(self, seed: int) -> None:
        """Change the seed; draws depend on nothing else that is kept here."""
        self.seed = seed
        self._world_keys.clear()

    def bits(self, purpose: str, size: int, *, per_step: bool = False) -> torch.Tensor:
        """Return (W, size) int64 with 64 random bits each.

        The same arguments in the same episode (and step, with ``per_step``) give the same bits again:
        use one purpose per quantity.
        """
        keys = self._world_keys.get(purpose)
        if keys is None:
            digest = hashlib.blake2b(purpose.encode(), digest_size=8).digest()
            stream = mix64(mix64(self.seed * _GAMMA) ^ int.from_bytes(digest, "little"))
            keys = mix64_((self._world + 1) * _signed(_GAMMA) + _signed(stream))
            self._world_keys[purpose] = keys
        column = self._columns.get(size)
        if column is None:
            column = torch.arange(1, size + 1, device=keys.device) * _signed(_GAMMA)
            self._columns[size] = column
        state = mix64_(self._episode * _signed(_GAMMA) + keys)
        if per_step:
            state = mix64_(self._step * _signed(_GAMMA) + state)
        return mix64_(state.unsqueeze(1) + column)

    def uniform(
        self, purpose: str, low: float = 0.0, high: float = 1.0, size: int = 1, *, per_step: bool = False
    ) -> torch.Tensor:
        """Return (W, size) float32, uniform in [low, high), in the unit of the bounds."""
        # 24 bits: every value is exact in float32, and 1 is never reached
        unit = ((self.bits(purpose, size, per_step=per_step) >> 40) & 0xFFFFFF).to(torch.float32)
        return unit.mul_((high - low) / (1 << 24)).add_(low)

    def normal(
        self, purpose: str, mean: float = 0.0, std: float = 1.0, size: int = 1, *, per_step: bool = False
    ) -> torch.Tensor:
        """Return (W, size) float32, normal with the given mean and standard deviation, in the unit of both."""
        bits = self.bits(purpose, size, per_step=per_step)
        # The radius from the upper 32 bits (shifted by half a step, so that the logarithm stays finite)
        radius = (((bits >> 32) & 0xFFFFFFFF).to(torch.float64) + 0.5) / (1 << 32)
        angle = (bits & 0xFFFFFFFF).to(torch.float64) * (2.0 * math.pi / (1 << 32))
        unit = torch.sqrt(-2.0 * torch.log(radius)) * torch.cos(angle)
        return (mean + std * unit).to(torch.float32)

    def integers(self, purpose: str, low: int, high: int, size: int = 1, *, per_step: bool = False) -> torch.Tensor:
        """Return (W, size) int64, uniform in [low, high); the range must be below 2**31."""
        bits = (self.bits(purpose, size, per_step=per_step) >> 32) & 0xFFFFFFFF
        return ((bits * (high - low)) >> 32) + low
