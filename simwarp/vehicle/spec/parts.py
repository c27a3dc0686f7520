"""The base of all descriptions of a vehicle, and the parts that many of them share.

Units are SI. Points and centres of mass of a suspension are those of its LEFT side, in the frame of the axle, which is
parallel to the chassis frame (X forward, Y left, Z up); the right side mirrors y. Moments and products of inertia are
about the centre of mass: in axes of the vehicle, or in those of the arm (x from its back to its front pivot, z normal
to its plane) where `inertia_axes` says "arm".
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import COINCIDENT, Curve, Inertia, NotNegative, Point, Positive, Products
from simwarp.core.object_repr import ReadableFields
from simwarp.core.schema import Schema
from simwarp.core.types import formatted

Array: TypeAlias = npt.NDArray[np.float64]
Vec3: TypeAlias = tuple[float, float, float]
Points: TypeAlias = tuple[tuple[float, float], ...]
"""(x, y) pairs with increasing x of a piecewise linear function."""

DamperMap: TypeAlias = tuple[tuple[float, ...], tuple[float, ...], tuple[tuple[float, ...], ...]]
"""Lengths [m], rates [m/s], forces [N]: forces[i][j] at rates[i] and lengths[j], bilinear, constant beyond the ends."""

ZERO: Vec3 = (0.0, 0.0, 0.0)


class SpecError(ValueError):
    """A vehicle that cannot be built: names the file, the key, the rule, the value received and the remedy."""


def refuse(key: str, rule: str, value: object, remedy: str = "") -> SpecError:
    """The error for the value of a key."""
    return SpecError(f"{key}: must be {rule}, got {formatted(value)}" + (f"; {remedy}" if remedy else ""))


UNITS: Final = {
    "mass": "kg", "radius": "m", "width": "m", "length": "m", "stiffness": "N/m", "damping": "N·s/m", "angle": "rad",
    "torque": "N·m", "limit": "N·m", "speed": "rad/s", "power": "W", "camber": "rad", "toe": "rad", "height": "m",
    "wheelbase": "m", "offset": "m", "inertia": "kg·m²",
}  # fmt: skip
"""By the last word of a key."""

LARGEST: Final = 1.0e15
"""Of numbers of any unit: squares of larger ones are beyond single precision."""

SPECS: Final = Schema(SpecError, largest=LARGEST, unit=lambda key: UNITS.get(key.rsplit("_", 1)[-1], ""))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Spec(ReadableFields):
    """Base of all descriptions: holds its fields to their types."""

    def __post_init__(self) -> None:
        SPECS.hold(self)
        self.check()

    def check(self) -> None:
        """Rules between the fields of one description."""


def check_apart(spec: Spec, *pairs: tuple[str, str]) -> None:
    """Points of these names do not coincide."""
    for first, second in pairs:
        if math.dist(getattr(spec, first), getattr(spec, second)) < COINCIDENT:
            raise refuse(first, f"apart from {second}", getattr(spec, first))


def check_triangle(spec: Spec, first: str, second: str, third: str) -> None:
    """Three points that do not lie on one line."""
    check_apart(spec, (first, second), (second, third), (third, first))
    a, b, c = (getattr(spec, name) for name in (first, second, third))
    x, y, z = (b[i] - a[i] for i in range(3))
    u, v, w = (c[i] - a[i] for i in range(3))
    across = math.hypot(y * w - z * v, z * u - x * w, x * v - y * u)
    if across < COINCIDENT * math.dist(a, b):
        raise refuse(third, f"off the line through {first} and {second}", c)


def check_map(key: str, table: DamperMap) -> None:
    """Increasing lengths and rates, one row of forces per rate."""
    lengths, rates, forces = table
    for name, axis in (("lengths", lengths), ("rates", rates)):
        if len(axis) < 2 or any(b <= a for a, b in itertools.pairwise(axis)):
            raise refuse(f"{key}: {name}", "two or more increasing numbers", axis)
    if len(forces) != len(rates) or any(len(row) != len(lengths) for row in forces):
        shape = (len(forces), sorted({len(row) for row in forces}))
        raise refuse(f"{key}: forces", f"{len(rates)} rows (rates) of {len(lengths)} (lengths)", shape)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RigidPart(Spec):
    """Mass [kg], centre of mass [m], inertia about it [kg·m²]."""

    mass: Positive
    com: Point = ZERO
    inertia: Inertia
    products: Products = ZERO
    """Ixy, Ixz, Iyz."""

    def check(self) -> None:
        """Products that such moments can have."""
        if np.linalg.eigvalsh(inertia_matrix(self))[0] <= 0.0:
            raise refuse("products", f"small beside the moments of inertia {self.inertia}", self.products)


def inertia_matrix(part: RigidPart) -> Array:
    """(3, 3) inertia about the centre of mass in the axes that it was given in [kg·m²]."""
    xy, xz, yz = part.products
    return np.diag(part.inertia) + np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])


def merged(parts: Sequence[RigidPart]) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg·m²] of one body of all parts."""
    mass = sum(part.mass for part in parts)
    com = sum(part.mass * np.array(part.com) for part in parts) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        offset = np.array(part.com) - com
        inertia += inertia_matrix(part) + part.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return float(mass), np.asarray(com), inertia


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForceLine(Spec):
    """A spring, damper or both along the line between two points.

    Force that pushes the ends apart [N]: preload - stiffness (length - rest_length) - damping rate. Tables replace the
    linear laws: (deformation [m], force along it [N]) and (rate [m/s], force [N]), both increasing. Beyond
    `min_length` and `max_length` a bump stop acts with the table `bump_curve` (penetration [m] -> force [N]).
    """

    chassis_point: Point
    arm_point: Point
    rest_length: Positive | None = None
    """None: its length as built."""
    preload: float = 0.0
    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0
    spring_curve: Curve | None = None
    damper_curve: Curve | None = None
    damper_map: DamperMap | None = None
    """Takes the place of `damper_curve`, which may stand beside it for models that know one curve only."""
    min_length: Positive | None = None
    max_length: Positive | None = None
    bump_curve: Curve | None = None

    def check(self) -> None:
        """A line between two points, lengths in order, tables of one shape."""
        check_apart(self, ("chassis_point", "arm_point"))
        for table, linear in (("spring_curve", "stiffness"), ("damper_curve", "damping"), ("damper_map", "damping")):
            if getattr(self, table) is not None and getattr(self, linear) != 0.0:
                rule = f"left out beside {linear} {getattr(self, linear):g}: one law or the other"
                raise SpecError(f"{table}: must be {rule}; leave out one of them")
        if self.damper_map is not None:
            check_map("damper_map", self.damper_map)
        if self.min_length is not None and self.max_length is not None and not self.min_length < self.max_length:
            raise refuse("min_length", f"less than max_length {self.max_length}", self.min_length)


BUMP_STOP: Points = (
    (0.0, 0.0), (2e-3, 200.0), (4e-3, 400.0), (6e-3, 600.0), (8e-3, 800.0), (10e-3, 1000.0), (20e-3, 2500.0),
    (30e-3, 4500.0), (40e-3, 7500.0), (50e-3, 12500.0), (60e-3, 125000.0),
)  # fmt: skip
"""A rubber stop: (penetration [m], force [N])."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bushing(Spec):
    """Compliance of a joint: (N/m, N·s/m, N·m/rad, N·m·s/rad), and the same along the joint's own freedom."""

    stiffness_linear: NotNegative
    damping_linear: NotNegative = 0.0
    stiffness_rotational: NotNegative = 0.0
    damping_rotational: NotNegative = 0.0
