"""Cone complementarity problems in float64 NumPy: projections, the natural-map residual and a slow, plain solver.

Independent of the kernels: the joint projection of rolling friction finds the normal impulse by bisection, and the
solver is alternating directions with a fixed penalty and an explicit inverse.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

DATA = Path(__file__).parent / "data" / "ccp"
NAMES = ["ant", "chain20_load", "incline_slip", "incline_stick", "massratio1000", "stack10", "wall20"]


@dataclasses.dataclass
class Block:
    """Rows from `row` on: "free", "box" (1 row), "contact" (3) or "rolling" (6)."""

    kind: str
    row: int
    slopes: tuple[float, ...] = ()
    cohesion: float = 0.0
    bounds: tuple[float, float] = (0.0, np.inf)

    @property
    def rows(self) -> slice:
        return slice(self.row, self.row + {"free": 1, "box": 1, "contact": 3, "rolling": 6}[self.kind])


def groups_of(block: Block) -> list[slice]:
    """The tangential rows of a block that share one slope, counted from its first row."""
    return [slice(1, 3)] if block.kind == "contact" else [slice(1, 3), slice(3, 5), slice(5, 6)]


def project(block: Block, p: np.ndarray) -> np.ndarray:
    """The point of the block's set nearest to p."""
    if block.kind == "free":
        return p.copy()
    if block.kind == "box":
        return np.clip(p, *block.bounds)
    lengths = [float(np.linalg.norm(p[g])) for g in groups_of(block)]
    n = float(p[0]) + block.cohesion

    def excess(m: float) -> float:
        return m - n - sum(c * max(t - c * m, 0.0) for c, t in zip(block.slopes, lengths, strict=True))

    # excess is increasing in m, and negative at the least candidate.
    low, high = 0.0, max(n, 0.0) + sum(c * t for c, t in zip(block.slopes, lengths, strict=True)) + 1e-300
    if excess(0.0) < 0.0:
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    else:
        high = 0.0
    q = np.zeros_like(p)
    q[0] = high - block.cohesion
    for c, t, g in zip(block.slopes, lengths, groups_of(block), strict=True):
        q[g] = p[g] * (1.0 if t <= c * high else c * high / t)
    return q


def shifted(block: Block, u: np.ndarray) -> np.ndarray:
    """Velocities of a block with De Saxcé's term on the normal row."""
    u = u.copy()
    if block.kind in ("contact", "rolling"):
        u[0] += sum(c * np.linalg.norm(u[g]) for c, g in zip(block.slopes, groups_of(block), strict=True))
    return u


def residual(n: np.ndarray, r: np.ndarray, blocks: list[Block], gamma: np.ndarray, exact: bool) -> float:
    """Greatest residual of the natural map over the blocks [m/s or rad/s]; free rows are left out."""
    u = n @ gamma + r
    worst = 0.0
    for block in blocks:
        rows = block.rows
        mean = np.diag(n)[rows].mean()
        if block.kind != "free" and mean > 0.0:
            v = shifted(block, u[rows]) if exact else u[rows]
            worst = max(worst, mean * float(np.linalg.norm(gamma[rows] - project(block, gamma[rows] - v / mean))))
    return worst


def solve(
    n: np.ndarray, r: np.ndarray, blocks: list[Block], exact: bool, tolerance: float = 1e-10, most: int = 200000
) -> np.ndarray:
    """Impulses by alternating directions; De Saxcé's term follows slowly enough not to disturb them."""
    rows = len(r)
    weight = np.zeros(rows)
    for block in blocks:
        weight[block.rows] = max(np.diag(n)[block.rows].max(), 1e-300)
    penalty = 0.05 * weight
    inverse = np.linalg.inv(n + np.diag(penalty))
    z, y, shift = np.zeros(rows), np.zeros(rows), np.zeros(rows)
    for iteration in range(most):
        x = inverse @ (penalty * z - y - r - shift)
        x = 1.6 * x - 0.6 * z
        target = x + y / penalty
        for block in blocks:
            z[block.rows] = project(block, target[block.rows])
        y = y + penalty * (x - z)
        if iteration % 10 == 9:
            u = n @ z + r
            if exact:
                for block in blocks:
                    shift[block.rows] = shifted(block, u[block.rows]) - u[block.rows]
            if residual(n, r, blocks, z, exact) < tolerance and all(
                abs(u[b.row]) < tolerance for b in blocks if b.kind == "free"
            ):
                break
    return z


def standard_blocks(bilateral: int, limits: int, mu: np.ndarray) -> list[Block]:
    """Blocks in the order bilateral | limit | contact."""
    free = [Block("free", i) for i in range(bilateral)]
    boxes = [Block("box", bilateral + i) for i in range(limits)]
    return free + boxes + [Block("contact", bilateral + limits + 3 * i, (float(m),)) for i, m in enumerate(mu)]


@dataclasses.dataclass
class Reference:
    """A stored problem with its solution by several independent solvers (convex law)."""

    n: np.ndarray
    r: np.ndarray
    mu: np.ndarray
    bilateral: int
    limits: int
    jacobian: np.ndarray
    inverse_mass: np.ndarray
    free_velocity: np.ndarray
    gamma: np.ndarray
    velocity: np.ndarray

    @property
    def blocks(self) -> list[Block]:
        return standard_blocks(self.bilateral, self.limits, self.mu)

    @property
    def counts(self) -> dict[str, Any]:
        return {"bilateral_count": self.bilateral, "limit_count": self.limits}

    @property
    def mechanics(self) -> dict[str, Any]:
        return {
            "jacobian": self.jacobian,
            "inverse_mass": self.inverse_mass,
            "free_velocity": self.free_velocity,
        }

    def velocity_of(self, impulse: np.ndarray) -> np.ndarray:
        """v+ of these impulses in float64."""
        return self.free_velocity + self.inverse_mass @ (self.jacobian @ impulse.astype(np.float64))


def load(name: str) -> Reference:
    """One of NAMES."""
    with np.load(DATA / f"{name}.npz") as d:
        return Reference(
            d["N"], d["r"], d["mu"], int(d["nb"]), int(d["nl"]), d["D"], d["Minv"], d["vfree"], d["gamma"], d["v_plus"]
        )


def random_problem(
    rng: np.random.Generator, contacts: int, limits: int = 0, bilateral: int = 0, spread: float = 1.0, bodies: int = 4
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
    """N, r, mu and the mechanics of rows between random rigid bodies and the ground; masses 10^(-spread..spread)."""
    rows = bilateral + limits + 3 * contacts
    mass = 10.0 ** rng.uniform(-spread, spread, bodies)
    inverse_mass = np.diag(np.repeat(1.0 / mass, 6) * np.tile([1.0, 1.0, 1.0, 6.0, 6.0, 6.0], bodies))
    jacobian = np.zeros((6 * bodies, rows))

    def add(row: int, body: int, direction: np.ndarray, arm: np.ndarray, sign: float) -> None:
        jacobian[6 * body : 6 * body + 3, row] += sign * direction
        jacobian[6 * body + 3 : 6 * body + 6, row] += sign * np.cross(arm, direction)

    for row in range(bilateral + limits):
        direction = rng.normal(size=3)
        pair = rng.choice(bodies, 2, replace=False)
        add(row, pair[0], direction / np.linalg.norm(direction), 0.3 * rng.normal(size=3), 1.0)
        add(row, pair[1], direction / np.linalg.norm(direction), 0.3 * rng.normal(size=3), -1.0)
    for contact in range(contacts):
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        body = contact % bodies
        other = rng.integers(bodies + 1)
        arms = 0.3 * rng.normal(size=(2, 3))
        for k in range(3):
            row = bilateral + limits + 3 * contact + k
            add(row, body, frame[:, k], arms[0], 1.0)
            if other not in (body, bodies):
                add(row, int(other), frame[:, k], arms[1], -1.0)
    free_velocity = 0.1 * rng.normal(size=6 * bodies)
    n = jacobian.T @ inverse_mass @ jacobian
    mechanics = {"jacobian": jacobian, "inverse_mass": inverse_mass, "free_velocity": free_velocity}
    return n, jacobian.T @ free_velocity, rng.uniform(0.0, 1.2, contacts), mechanics
