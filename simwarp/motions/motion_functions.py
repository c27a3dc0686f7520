"""Motion functions of time: value, rate and acceleration, with numbers that may differ per world."""

from __future__ import annotations

import abc
import dataclasses
import functools
from collections.abc import Sequence
from enum import IntEnum
from typing import Annotated, Any, Final, Literal, TypeAlias

import numpy as np

from simwarp.core.constraints import Parsed, RuleError
from simwarp.core.types import ModelError, formatted, numbers
from simwarp.model.rules import Configuration, instance_of, word_of
from simwarp.motions.motion_tape import Array, MotionValues, Numbers, TapeWriter, evaluated
from simwarp.motions.motions_kernels import CONSTANT_ACCELERATION, LINEAR, POLYNOMIAL_345, SAMPLES, SINE, SPLINE

JOIN_TOLERANCE: Final = 1.0e-6
"""Largest jump that counts as none, as a share of the largest value on both sides."""
JOIN_POINTS: Final = 33
"""At which that is sought, over a part."""


class Smoothness(IntEnum):
    """How many derivatives of a function are continuous, counting the value; each holds those before it."""

    JUMPS = 0
    VALUE = 1
    """The value is continuous, the rate jumps."""
    RATE = 2
    """The rate is continuous: there is an acceleration, which may jump."""
    ACCELERATION = 3


def _read_numbers(positive: bool, value: Any) -> Any:
    array = numbers(value)
    good = array.ndim <= 1 and array.size > 0 and bool(np.isfinite(array).all())
    if not good or (positive and not bool((array > 0.0).all())):
        rule = "a positive number" if positive else "a finite number"
        raise RuleError(f"{rule}, or a list of them, one for each world", "pass a number")
    return float(array) if array.ndim == 0 else _frozen(array)


def _frozen(array: Array) -> Array:
    array = array.copy()
    array.flags.writeable = False
    return array


def _read_knots(value: Any) -> Array:
    array = numbers(value)
    if array.ndim != 1 or len(array) < 2 or not np.isfinite(array).all() or not (np.diff(array) > 0.0).all():
        raise RuleError("two or more increasing times [s]", "sort them, and leave out doubles")
    return _frozen(array)


def _read_values(value: Any) -> Array:
    array = numbers(value)
    if array.ndim not in (1, 2) or array.shape[-1] < 2 or not np.isfinite(array).all():
        raise RuleError("two or more finite values, or a row of them for each world", "pass a list")
    return _frozen(array)


Varied: TypeAlias = Annotated[Numbers, Parsed(functools.partial(_read_numbers, False))]
"""A number, or one for each world."""
VariedPositive: TypeAlias = Annotated[Numbers, Parsed(functools.partial(_read_numbers, True))]


class MotionFunction(Configuration, abc.ABC):
    """Base of functions of time; `+` and `*` make sums and products of them and of numbers.

    Every number of a function may be a list of one for each world.
    """

    @property
    @abc.abstractmethod
    def smoothness(self) -> Smoothness:
        """Its derivatives that are continuous, in all worlds and at all times."""

    @abc.abstractmethod
    def write(self, tape: TapeWriter, name: str) -> None:
        """Writes it onto a tape; `name` begins the names of its numbers."""

    def evaluate(self, times: Any) -> MotionValues:
        """Value, rate and acceleration.

        Args:
            times: (), (n,) for all worlds, or (W, n) [s].

        Returns:
            Float64 arrays of the shape of `times` [unit of the function, per s, per s²], with a first axis of worlds
            where numbers differ per world.

        Raises:
            ModelError: times are not finite, or numbers of different worlds do not fit together.
        """
        return evaluated(lambda tape: self.write(tape, type(self).__name__), times)

    def __add__(self, other: MotionFunction | float) -> Sum:
        return Sum(parts=(self, _function(other)))

    def __mul__(self, other: MotionFunction | float) -> Product:
        return Product(parts=(self, _function(other)))

    __radd__ = __add__
    __rmul__ = __mul__


def _function(value: Any) -> MotionFunction:
    return value if isinstance(value, MotionFunction) else Constant(value=value)


FunctionField: TypeAlias = Annotated[
    MotionFunction, instance_of(MotionFunction, "write a motion function, such as Sine(...)")
]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Constant(MotionFunction):
    """One value at all times."""

    value: Varied
    smoothness = Smoothness.ACCELERATION

    def write(self, tape: TapeWriter, name: str) -> None:
        """The value, with a rate of zero."""
        tape.leaf(LINEAR, 0, [(f"{name}.value", self.value), ("", 0.0)])


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Ramp(MotionFunction):
    """`start` + `rate` × t."""

    rate: Varied
    start: Varied = 0.0
    smoothness = Smoothness.ACCELERATION

    def write(self, tape: TapeWriter, name: str) -> None:
        """Both numbers."""
        tape.leaf(LINEAR, 0, [(f"{name}.start", self.start), (f"{name}.rate", self.rate)])


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Sine(MotionFunction):
    """`amplitude` × sin(2π `frequency` t + `phase`), with a frequency in Hz and a phase in rad."""

    amplitude: Varied
    frequency: VariedPositive
    phase: Varied = 0.0
    smoothness = Smoothness.ACCELERATION

    def write(self, tape: TapeWriter, name: str) -> None:
        """The three numbers."""
        tape.leaf(SINE, 0, [(f"{name}.{key}", getattr(self, key)) for key in ("amplitude", "frequency", "phase")])


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ConstantAcceleration(MotionFunction):
    """From 0 to `rise` in `duration` [s]: a constant acceleration, a constant rate, a constant deceleration.

    `speeding_up` and `slowing_down` are their shares of the duration, which sum to 1 at most.
    """

    rise: Varied
    duration: VariedPositive
    speeding_up: VariedPositive = 0.5
    slowing_down: VariedPositive = 0.5
    smoothness = Smoothness.RATE

    def check(self) -> None:
        """Both shares fit into the duration.

        Raises:
            ModelError: they do not.
        """
        total = np.asarray(self.speeding_up) + np.asarray(self.slowing_down)
        if (total > 1.0 + 1.0e-9).any():
            raise ModelError(
                "ConstantAcceleration: speeding_up + slowing_down must be at most 1, the whole duration, "
                f"got {formatted(total.max())}; lower one"
            )

    def write(self, tape: TapeWriter, name: str) -> None:
        """The four numbers."""
        keys = ("rise", "duration", "speeding_up", "slowing_down")
        tape.leaf(CONSTANT_ACCELERATION, 0, [(f"{name}.{key}", getattr(self, key)) for key in keys])


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Polynomial345(MotionFunction):
    """From 0 to `rise` in `duration` [s], at rest and without acceleration at both ends.

    With x = t / duration it is rise × (10 x³ - 15 x⁴ + 6 x⁵), the 3-4-5 polynomial of cams: its rate has a peak of
    1.875 rise / duration, its acceleration one of 10 / √3 rise / duration².
    """

    rise: Varied
    duration: VariedPositive
    smoothness = Smoothness.ACCELERATION

    def write(self, tape: TapeWriter, name: str) -> None:
        """Both numbers."""
        tape.leaf(POLYNOMIAL_345, 0, [(f"{name}.rise", self.rise), (f"{name}.duration", self.duration)])


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class CubicSpline(MotionFunction):
    """Cubic spline through points, straight on beyond its ends.

    Attributes:
        times: (n,) [s], increasing.
        values: (n,), or (W, n) a row for each world.
        ends: "natural" has no acceleration at the ends, "clamped" no rate there; "periodic" has equal rates and
            accelerations at both ends, whose values are equal, for a `Repeat`.
    """

    times: Annotated[Sequence[float] | Array, Parsed(_read_knots)]
    values: Annotated[Sequence[float] | Array, Parsed(_read_values)]
    ends: Annotated[Literal["natural", "clamped", "periodic"], word_of("natural", "clamped", "periodic")] = "natural"

    def check(self) -> None:
        """There are as many values as times, and equal ones at the ends of a periodic spline.

        Raises:
            ModelError: they are not.
        """
        times, values = np.asarray(self.times), np.asarray(self.values)
        if values.shape[-1] != len(times):
            raise ModelError(
                f"CubicSpline: values must be one for each of {len(times)} times, got {values.shape[-1]}; "
                "leave some out, or give more"
            )
        if self.ends == "periodic" and not np.allclose(values[..., 0], values[..., -1], rtol=1e-12, atol=1e-15):
            raise ModelError(
                "CubicSpline: the first and the last value must be equal where ends are periodic, "
                f"got {formatted(values[..., 0])} and {formatted(values[..., -1])}; repeat the first one"
            )

    @property
    def smoothness(self) -> Smoothness:
        """The acceleration jumps to zero at ends that are not natural."""
        return Smoothness.ACCELERATION if self.ends == "natural" else Smoothness.RATE

    def write(self, tape: TapeWriter, name: str) -> None:
        """Times, and the coefficients of each piece."""
        from scipy import interpolate

        times, values = np.asarray(self.times), np.array(self.values)
        if self.ends == "periodic":
            values[..., -1] = values[..., 0]  # to the last bit
        pieces = interpolate.CubicSpline(times, values, axis=-1, bc_type=self.ends).c  # (4, pieces, ...)
        numbers = [("", knot) for knot in times]
        numbers += [("", coefficient) for piece in np.moveaxis(pieces, 1, 0) for coefficient in piece]
        tape.leaf(SPLINE, len(times), numbers)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Samples(MotionFunction):
    """Values at equal intervals, as a recording has them: linear between, constant beyond the ends.

    Attributes:
        values: (n,), or (W, n) a row for each world.
        interval: between two of them [s].
        start: time of the first one [s].
    """

    values: Annotated[Sequence[float] | Array, Parsed(_read_values)]
    interval: VariedPositive
    start: Varied = 0.0
    smoothness = Smoothness.VALUE

    def write(self, tape: TapeWriter, name: str) -> None:
        """Start, interval and all values."""
        values = np.asarray(self.values)
        given = [(f"{name}.values[{k}]", values[..., k]) for k in range(values.shape[-1])]
        clock = [(f"{name}.start", self.start), (f"{name}.interval", self.interval)]
        tape.leaf(SAMPLES, values.shape[-1], [*clock, *given])


def _read_parts(value: Any) -> tuple[MotionFunction, ...]:
    some = isinstance(value, Sequence) and not isinstance(value, str) and len(value) > 0
    if not some or not all(isinstance(part, MotionFunction) for part in value):
        raise RuleError("a list of motion functions", "write for example [Sine(...), Constant(...)]")
    return tuple(value)


Parts: TypeAlias = Annotated[Sequence[MotionFunction], Parsed(_read_parts)]


def _combine(parts: Sequence[MotionFunction], tape: TapeWriter, name: str, multiply: bool) -> None:
    for k, part in enumerate(parts):
        part.write(tape, f"{name}.parts[{k}]")
        if k:
            tape.multiply() if multiply else tape.add()


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Sum(MotionFunction):
    """Sum of functions."""

    parts: Parts

    @property
    def smoothness(self) -> Smoothness:
        """The roughest part has it."""
        return min(part.smoothness for part in self.parts)

    def write(self, tape: TapeWriter, name: str) -> None:
        """All parts, and a sum after each."""
        _combine(self.parts, tape, name, multiply=False)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Product(MotionFunction):
    """Product of functions."""

    parts: Parts

    @property
    def smoothness(self) -> Smoothness:
        """The roughest part has it."""
        return min(part.smoothness for part in self.parts)

    def write(self, tape: TapeWriter, name: str) -> None:
        """All parts, and a product after each."""
        _combine(self.parts, tape, name, multiply=True)


def _read_sequence(value: Any) -> tuple[tuple[MotionFunction, Any], ...]:
    some = isinstance(value, Sequence) and not isinstance(value, str) and len(value) > 0
    if not some or not all(isinstance(part, Sequence) and len(part) == 2 for part in value):
        raise RuleError("a list of (function, duration)", "write for example [(Ramp(rate=1.0), 2.0), ...]")
    found = []
    for k, (function, duration) in enumerate(value):
        if not isinstance(function, MotionFunction):
            raise RuleError(f"motion functions with durations; part {k} has none", "write [(Ramp(rate=1.0), 2.0), ...]")
        try:
            found.append((function, _read_numbers(True, duration)))
        except RuleError:
            rule = f"functions with durations > 0 [s]; part {k} has {formatted(duration)}"
            raise RuleError(rule, "give how long each part lasts, not when it ends") from None
    return tuple(found)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MotionSequence(MotionFunction):
    """Functions one after the other, each with a time that begins at 0; the last one goes on for good.

    Attributes:
        parts: (function, duration [s]) of each. Values are as the functions give them: where they do not join, the
            sequence jumps, as `smoothness` says.
    """

    parts: Annotated[Sequence[tuple[MotionFunction, Any]], Parsed(_read_sequence)]

    @property
    def smoothness(self) -> Smoothness:
        """The roughest part or join has it."""
        joins = [
            _join(left, duration, right, after)
            for (left, duration), (right, after) in zip(self.parts, self.parts[1:], strict=False)
        ]
        return min([*(part.smoothness for part, _ in self.parts), *joins])

    def write(self, tape: TapeWriter, name: str) -> None:
        """Durations, and all parts."""
        tape.sequence(
            (f"{name}.parts[{k}].duration", duration, functools.partial(part.write, name=f"{name}.parts[{k}]"))
            for k, (part, duration) in enumerate(self.parts)
        )


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Repeat(MotionFunction):
    """The first `period` [s] of a function again and again, before time 0 too."""

    part: FunctionField
    period: VariedPositive

    @property
    def smoothness(self) -> Smoothness:
        """The part has it, or where its end meets its beginning."""
        return min(self.part.smoothness, _join(self.part, self.period, self.part, self.period))

    def write(self, tape: TapeWriter, name: str) -> None:
        """The period, and the part."""
        tape.repeat(f"{name}.period", self.period, functools.partial(self.part.write, name=f"{name}.part"))


def _join(left: MotionFunction, duration: Any, right: MotionFunction, after: Any) -> Smoothness:
    """How the end of a part that lasts for `duration` joins the beginning of the next, which lasts for `after`."""
    share = np.linspace(0.0, 1.0, JOIN_POINTS)
    before = left.evaluate(np.reshape(duration, (-1, 1)) * share)
    then = right.evaluate(np.reshape(after, (-1, 1)) * share)
    for order, (ends, starts) in enumerate(zip(before, then, strict=True)):
        scale = max(np.abs(ends).max(), np.abs(starts).max())
        if (np.abs(ends[..., -1] - starts[..., 0]) > JOIN_TOLERANCE * scale).any():
            return Smoothness(order)
    return Smoothness.ACCELERATION
