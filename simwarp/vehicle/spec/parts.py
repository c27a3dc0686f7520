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
from collections.abc import Mapping, Sequence
from typing import ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
Vec3: TypeAlias = tuple[float, float, float]
Points: TypeAlias = tuple[tuple[float, float], ...]
"""(x, y) pairs with increasing x of a piecewise linear function."""

DamperMap: TypeAlias = tuple[tuple[float, ...], tuple[float, ...], tuple[tuple[float, ...], ...]]
"""Lengths [m], rates [m/s], forces [N]: forces[i][j] at rates[i] and lengths[j], bilinear, constant beyond the ends."""

ZERO: Vec3 = (0.0, 0.0, 0.0)
COINCIDENT = 1.0e-6
"""Points nearer than this are one [m]."""


class SpecError(ValueError):
    """A vehicle that cannot be built: names the file, the key, the rule, the value received and the remedy."""


def refuse(key: str, rule: str, value: object, remedy: str = "") -> SpecError:
    """The error for the value of a key."""
    return SpecError(f"{key}: must be {rule}, got {told(value)}" + (f"; {remedy}" if remedy else ""))


def told(value: object) -> str:
    """A value in an error: its beginning, if it is long."""
    text = repr(value)
    return text if len(text) <= 100 else f"{text[:90]} ..."


@dataclasses.dataclass(frozen=True, kw_only=True)
class Spec:
    """Base of all descriptions: checks its numbers by the names in the class attributes."""

    POSITIVE: ClassVar[frozenset[str]] = frozenset()
    NOT_NEGATIVE: ClassVar[frozenset[str]] = frozenset()
    CURVES: ClassVar[frozenset[str]] = frozenset()
    ANGLES: ClassVar[Mapping[str, float]] = {
        "camber": 0.25 * math.pi, "toe": 0.25 * math.pi, "max_angle": 0.5 * math.pi, "camber_limit": 0.5 * math.pi,
    }  # fmt: skip
    """Largest size of the fields of these names [rad]: what is beyond are degrees."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            check_finite(field.name, value)
            if value is None:
                continue
            if field.name in self.POSITIVE and value == ():
                raise refuse(field.name, "one or more numbers", value)
            if field.name in self.POSITIVE and not all(v > 0.0 for v in _numbers(value)):
                raise refuse(field.name, "positive", value)
            if field.name in self.NOT_NEGATIVE and not all(v >= 0.0 for v in _numbers(value)):
                raise refuse(field.name, "zero or positive", value)
            if field.name in self.CURVES:
                check_curve(field.name, value)
            if field.name in self.ANGLES:
                check_angle(field.name, value, self.ANGLES[field.name])
        self.check()

    def check(self) -> None:
        """Rules between the fields of one description."""


def _numbers(value: object) -> list[float]:
    if isinstance(value, (int, float)):
        return [float(value)]
    return [float(v) for v in value] if isinstance(value, tuple) else []


LARGEST = 1.0e15
"""Of numbers of any unit: squares of larger ones are beyond single precision."""


def check_finite(key: str, value: object) -> None:
    """Refuse infinite, undefined and immense numbers at any depth."""
    if isinstance(value, float) and not math.isfinite(value):
        raise refuse(key, "a finite number", value)
    if isinstance(value, (int, float)) and abs(value) > LARGEST:
        raise refuse(key, f"below {LARGEST:g}", value)
    if isinstance(value, tuple):
        for item in value:
            check_finite(key, item)


def check_angle(key: str, value: float, largest: float) -> None:
    """An angle in radians of a sensible size."""
    if abs(value) > largest:
        remedy = f"if these are degrees, they are {math.radians(value):.4g} rad"
        raise refuse(key, f"within ±{largest:.4g} rad ({math.degrees(largest):.0f}°)", value, remedy)


def check_curve(key: str, points: Sequence[tuple[float, float]]) -> None:
    """At least two points with increasing abscissae."""
    rule = "two or more (x, y) pairs with increasing x"
    if len(points) < 2:
        raise refuse(key, rule, points)
    for index, (a, b) in enumerate(itertools.pairwise(points), start=1):
        if b[0] <= a[0]:
            raise SpecError(f"{key}: must be {rule}, got x = {b[0]:g} in [{index}] after {a[0]:g}; sort them by x")


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


def check_direction(spec: Spec, *names: str) -> None:
    """Axes with a length."""
    for name in names:
        if math.hypot(*getattr(spec, name)) < COINCIDENT:
            raise refuse(name, "a direction", getattr(spec, name))


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

    POSITIVE: ClassVar = frozenset({"mass", "inertia"})

    mass: float
    com: Vec3 = ZERO
    inertia: Vec3
    products: Vec3 = ZERO
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

    POSITIVE: ClassVar = frozenset({"rest_length", "min_length", "max_length"})
    NOT_NEGATIVE: ClassVar = frozenset({"stiffness", "damping"})
    CURVES: ClassVar = frozenset({"spring_curve", "damper_curve", "bump_curve"})

    chassis_point: Vec3
    arm_point: Vec3
    rest_length: float | None = None
    """None: its length as built."""
    preload: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    spring_curve: Points | None = None
    damper_curve: Points | None = None
    damper_map: DamperMap | None = None
    """Takes the place of `damper_curve`, which may stand beside it for models that know one curve only."""
    min_length: float | None = None
    max_length: float | None = None
    bump_curve: Points | None = None

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

    NOT_NEGATIVE: ClassVar = frozenset(
        {"stiffness_linear", "damping_linear", "stiffness_rotational", "damping_rotational"}
    )

    stiffness_linear: float
    damping_linear: float = 0.0
    stiffness_rotational: float = 0.0
    damping_rotational: float = 0.0
