"""Reference of the sensors' random numbers and noise stages: Python integers and float64, one number at a time."""

from __future__ import annotations

import hashlib
import math

GAMMA = 0x9E3779B97F4A7C15
WORD = (1 << 64) - 1


def mix(value: int) -> int:
    """SplitMix64's output function."""
    value &= WORD
    value = ((value ^ (value >> 30)) * 0xBF58476D1CE4E5B9) & WORD
    value = ((value ^ (value >> 27)) * 0x94D049BB133111EB) & WORD
    return value ^ (value >> 31)


def frame_key(seed: int, name: str, world: int, episode: int, frame: int) -> int:
    """The key of one frame."""
    key = int.from_bytes(hashlib.blake2b(f"{seed}/{name}".encode(), digest_size=8).digest(), "little")
    for coordinate in (world, episode, frame):
        key = mix(key + (coordinate + 1) * GAMMA)
    return key


def uniform(key: int, index: int) -> float:
    """In [0, 1)."""
    return (mix(key + (index + 1) * GAMMA) >> 40) / 2**24


def normals(key: int, index: int) -> tuple[float, float]:
    """Two standard normal numbers (Box and Muller)."""
    bits = mix(key + (index + 1) * GAMMA)
    radius = math.sqrt(-2.0 * math.log(min(((bits >> 32) + 0.5) / 2**32, 1.0)))
    angle = 2.0 * math.pi * (bits & 0xFFFFFFFF) / 2**32
    return radius * math.cos(angle), radius * math.sin(angle)


class Stage:
    """One stage on one channel, by its name and two numbers."""

    def __init__(self, kind: str, first: float, second: float = 0.0) -> None:
        self.kind, self.first, self.second, self.bias = kind, first, second, 0.0

    def apply(self, value: float, elapsed: float | None, draw: float) -> float:
        """The value after the stage; `elapsed` is None at the beginning."""
        a, b = self.first, self.second
        if self.kind == "normal":
            return value + a + b * draw
        if self.kind == "quantisation":
            return a * math.floor(value / a + 0.5)
        if self.kind == "saturation":
            return min(max(value, a), b)
        if self.kind == "walk":
            self.bias = b * draw if elapsed is None else self.bias + a * math.sqrt(elapsed) * draw
        else:
            kept = 0.0 if elapsed is None else math.exp(-elapsed / b)
            self.bias = kept * self.bias + a * math.sqrt(1.0 - kept**2) * draw
        return value + self.bias


def allan_deviation(values: list[float], interval: float, lengths: list[int]) -> list[float]:
    """Overlapping Allan deviation of a series at averaging times of `lengths` intervals (IEEE 952-2020, annex C)."""
    phase = [0.0]
    for value in values:
        phase.append(phase[-1] + value * interval)
    found = []
    for m in lengths:
        count = len(phase) - 2 * m
        total = sum((phase[k + 2 * m] - 2.0 * phase[k + m] + phase[k]) ** 2 for k in range(count))
        found.append(math.sqrt(total / (2.0 * (m * interval) ** 2 * count)))
    return found
