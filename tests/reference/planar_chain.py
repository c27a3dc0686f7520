"""Pinned and hanging chains of rods in a plane, float64, in maximal coordinates: which stabilisation keeps the energy.

It shares no code with the kernels: rows are those of the rods' ends, solved as one block-tridiagonal system, and a
step's own error of the joints is the difference of their values at two poses.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
from scipy.linalg import solveh_banded

GRAVITY = 9.81

Array = npt.NDArray[np.float64]


def _turned(a: Array) -> Array:
    """Vectors (..., 2) turned by a quarter."""
    return np.stack([-a[..., 1], a[..., 0]], axis=-1)


@dataclasses.dataclass
class PlanarChain:
    """Uniform rods from the origin on; the last one is pinned where it starts, or hangs free.

    Attributes:
        length: of a rod [m].
        mass: of a rod [kg].
        pinned: whether the far end is held.
        angle: (N,) [rad] from X towards Z, at the start.
        share: of the curvature of a step that its rows make up for beforehand, as `curvature_share` of the step.
        passes: of position projection along the rows of the step's start.
    """

    length: float
    mass: float
    pinned: bool
    angle: Array
    share: float = 0.0
    passes: int = 0

    def __post_init__(self) -> None:
        """Places the rods, at rest."""
        self.angle = np.array(self.angle, float)
        self.count = len(self.angle)
        self.inertia = self.mass * self.length**2 / 12.0
        tips = np.cumsum(2.0 * self._arms(self.angle), axis=0)
        self.end = tips[-1].copy()
        self.x = tips - self._arms(self.angle)
        self.v = np.zeros((self.count, 2))
        self.rate = np.zeros(self.count)

    def _arms(self, angle: Array) -> Array:
        return 0.5 * self.length * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def violation(self, x: Array, angle: Array) -> Array:
        """(rows, 2) [m]: start of each rod against the end of the one before, then the pin."""
        arms = self._arms(angle)
        ends = np.vstack([np.zeros(2), x + arms])
        starts = np.vstack([x - arms, self.end]) if self.pinned else x - arms
        return starts - ends[: len(starts)]

    def _row_speeds(self, v: Array, rate: Array) -> Array:
        swing = _turned(self.arms) * rate[:, None]
        ends = np.vstack([np.zeros(2), v + swing])
        starts = np.vstack([v - swing, np.zeros(2)]) if self.pinned else v - swing
        return starts - ends[: len(starts)]

    def _factor(self) -> None:
        self.arms = self._arms(self.angle)
        swing = _turned(self.arms)
        rows = self.count + int(self.pinned)
        own = np.eye(2) / self.mass + swing[:, :, None] * swing[:, None, :] / self.inertia
        diagonal = np.zeros((rows, 2, 2))
        diagonal[: self.count] += own
        diagonal[1:] += own[: rows - 1]
        beside = (swing[:, :, None] * swing[:, None, :] / self.inertia - np.eye(2) / self.mass)[: rows - 1]
        self.band = np.zeros((4, 2 * rows))
        self.band[3, 0::2], self.band[3, 1::2], self.band[2, 1::2] = (
            diagonal[:, 0, 0], diagonal[:, 1, 1], diagonal[:, 0, 1],
        )  # fmt: skip
        self.band[1, 2::2], self.band[2, 2::2] = beside[:, 0, 0], beside[:, 1, 0]
        self.band[0, 3::2], self.band[1, 3::2] = beside[:, 0, 1], beside[:, 1, 1]

    def _constrained(self, v: Array, rate: Array, wanted: Array) -> tuple[Array, Array]:
        """The velocities next to these, in the mass metric, whose rows have the speeds `wanted`."""
        impulse = solveh_banded(self.band, (wanted - self._row_speeds(v, rate)).reshape(-1)).reshape(-1, 2)
        before = impulse[: self.count]
        after = np.zeros((self.count, 2))
        after[: len(impulse) - 1] = impulse[1:]
        swing = _turned(self.arms)
        return (
            v + (before - after) / self.mass,
            rate - np.sum(swing * (before + after), axis=1) / self.inertia,
        )

    def step(self, dt: float) -> None:
        """One step of `dt` [s]."""
        self._factor()
        error = self.violation(self.x, self.angle)
        ahead = self.violation(self.x + dt * self.v, self.angle + dt * self.rate)
        bend = (ahead - error) / dt - self._row_speeds(self.v, self.rate)
        v = self.v - np.array([0.0, dt * GRAVITY])
        v, rate = self._constrained(v, self.rate, -error / dt - self.share * bend)
        for _ in range(self.passes):
            left = self.violation(self.x + dt * v, self.angle + dt * rate)
            change = self._constrained(np.zeros_like(v), np.zeros_like(rate), -left / dt)
            v, rate = v + change[0], rate + change[1]
        self.v, self.rate = v, rate
        self.x = self.x + dt * v
        self.angle = self.angle + dt * rate

    def energy(self, dt: float) -> float:
        """Kinetic and potential energy [J] at one instant: velocities are those of the middle of a step, poses of its
        end, half a step later.
        """
        kinetic = 0.5 * self.mass * np.sum(self.v**2) + 0.5 * self.inertia * np.sum(self.rate**2)
        height = self.x[:, 1] - 0.5 * dt * self.v[:, 1]
        return float(kinetic + self.mass * GRAVITY * np.sum(height))
