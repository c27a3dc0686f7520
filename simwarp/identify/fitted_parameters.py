"""Parameters of a fit: from one vector of numbers to changes of a target's document, of columns and of starts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import formatted
from simwarp.identify.document_numbers import (
    Keys,
    is_number,
    is_scalable,
    keys_of,
    matches,
    path_of,
    replaced,
    scaled,
    value_at,
)
from simwarp.identify.fit_config import FitConfig, Meant, Wanted
from simwarp.identify.fit_error import FitError
from simwarp.identify.physical_inertia import inertia_of, numbers_of

Array = npt.NDArray[np.float64]

USUAL_SCALE: Final = 0.1
"""Share of a start, or of the distance between bounds, that counts as a large change."""
INERTIA_SCALE: Final = 0.2
"""Large change of an inertia's six numbers."""
BIAS_SCALE: Final = 0.1
DELAY_SCALE: Final = 0.02
"""[s]."""
LONGEST_DELAY: Final = 1.0
"""That is fitted [s]."""
ENTRIES: Final = ("ln x", "ln y", "ln z", "yx", "zx", "zy")
"""Of an inertia."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Unknown:
    """One number that is fitted.

    Attributes:
        name: in reports.
        start, low, high: where it begins, and its bounds.
        signed: whether a bound of zero is there only to keep its sign.
        scale: a change that is large for it.
        prior: mean and standard deviation known beforehand.
        segment: index of the segment that it is of alone; -1: of all.
        simulated: False of what only changes readings that a simulation has made.
    """

    name: str
    start: float
    low: float = -math.inf
    high: float = math.inf
    signed: bool = False
    scale: float
    prior: tuple[float, float] | None = None
    segment: int = -1
    simulated: bool = True


@dataclasses.dataclass(frozen=True)
class _Place:
    """Where in a document some unknowns act."""

    meant: Meant
    keys: tuple[Keys, ...]
    unknowns: slice


class FittedParameters:
    """All unknowns of a fit, in one order: of the document, then of columns.

    Args:
        config: of the fit.
        document: of the target, as it is before.

    Attributes:
        unknowns: in the order of the vector.
        document: as it was given.

    Raises:
        FitError: a parameter is not there, or its start is outside its bounds.
    """

    def __init__(self, config: FitConfig, document: Any) -> None:
        self.document = document
        self.unknowns: list[Unknown] = []
        self._places: list[_Place] = []
        taken: dict[Keys, str] = {}
        for path, wanted in config.parameters.items():
            self._add(path, wanted)
            for keys in self._places[-1].keys:
                if keys in taken:
                    where = path_of(document, keys)
                    raise FitError(f"parameters: {formatted(path)}: {where} is fitted by {taken[keys]!r} already")
                taken[keys] = path
        self.document_count = len(self.unknowns)
        self._columns: dict[tuple[str, str], int] = {}
        for kind, columns in (("input", config.inputs), ("reading", config.readings)):
            for name, column in columns.items():
                for what in column.fit:
                    self._columns[f"{kind}.{name}", what] = len(self.unknowns)
                    self.unknowns.append(_of_column(f"{kind}.{name}", what, column.delay, kind == "input"))

    def _add(self, path: str, wanted: Wanted) -> None:
        keys = tuple(key for each in (path, *wanted.also) for key in matches(self.document, each))
        for each in keys:
            if not is_scalable(value_at(self.document, each)):
                place = path_of(self.document, each)
                raise FitError(f"parameters: {formatted(path)}: {place} must be a number or a table of numbers")
        meant = wanted.meant or self._usual(keys)
        first = len(self.unknowns)
        match meant:
            case Meant.INERTIA:
                self.unknowns += self._inertia(path, keys, wanted)
            case Meant.VALUE:
                value = value_at(self.document, keys[0])
                if len(keys) > 1 or not is_number(value):
                    raise FitError(
                        f"parameters: {formatted(path)}: a value must be of one number, got {len(keys)} places of "
                        f'{formatted(value)}; take meant = "factor"'
                    )
                self.unknowns.append(_unknown(path, float(value), wanted))
            case Meant.FACTOR:
                if all(not np.any(np.array(_flat(value_at(self.document, each)))) for each in keys):
                    raise FitError(f'parameters: {formatted(path)}: a factor of 0 is 0; take meant = "value"')
                self.unknowns.append(_unknown(path, 1.0, wanted))
        self._places.append(_Place(meant, keys, slice(first, len(self.unknowns))))

    def _usual(self, keys: Sequence[Keys]) -> Meant:
        """What is meant where it is not said: the value of one number, the factor of more or of a table."""
        if len(keys) == 1 and is_number(value_at(self.document, keys[0])):
            return Meant.VALUE
        return Meant.FACTOR

    def _inertia(self, path: str, keys: Sequence[Keys], wanted: Wanted) -> list[Unknown]:
        value = np.asarray(value_at(self.document, keys[0]), float)
        if len(keys) > 1 or value.shape not in ((3,), (3, 3)) or keys_of(path)[-1] != "inertia":
            raise FitError(
                f'parameters: {formatted(path)}: meant = "inertia" must be of the inertia of one body, got '
                f"{formatted(value.tolist())}"
            )
        for key in ("start", "low", "high", "prior"):
            if getattr(wanted, key) is not None:
                raise FitError(f"parameters: {formatted(path)}: {key} must be left out of an inertia's numbers")
        start = numbers_of(value if value.ndim == 2 else np.diag(value), f"parameters: {path}")
        scale = wanted.scale or INERTIA_SCALE
        # three moments alone have no products: a vehicle's file keeps them apart
        count = 3 if value.ndim == 1 and "axles" in self.document else 6
        return [
            Unknown(name=f"{path} {entry}", start=float(number), scale=scale)
            for entry, number in zip(ENTRIES[:count], start[:count], strict=True)
        ]

    @property
    def starts(self) -> Array:
        """(P,) where the fit begins."""
        return np.array([each.start for each in self.unknowns])

    def changed(self, vector: Array) -> Any:
        """The document with the values of a vector."""
        changes: dict[Keys, Any] = {}
        for place in self._places:
            numbers = vector[place.unknowns]
            for keys in place.keys:
                value = value_at(self.document, keys)
                match place.meant:
                    case Meant.VALUE:
                        changes[keys] = float(numbers[0])
                    case Meant.FACTOR:
                        changes[keys] = scaled(value, float(numbers[0]))
                    case Meant.INERTIA:
                        inertia = inertia_of(np.pad(numbers, (0, 6 - len(numbers))))
                        changes[keys] = np.diag(inertia).tolist() if len(numbers) == 3 else inertia.tolist()
        return replaced(self.document, changes)

    def of_column(self, name: str, what: str, vector: Array, otherwise: float) -> float:
        """The delay, bias or gain of a column: fitted, or as it is.

        Args:
            name: `input.NAME` or `reading.NAME`.
            what: `delay`, `bias` or `gain`.
            vector: of all unknowns.
            otherwise: where it is not fitted.
        """
        index = self._columns.get((name, what))
        return otherwise if index is None else float(vector[index])


def _flat(value: Any) -> list[float]:
    return [value] if is_number(value) else [number for item in value for number in _flat(item)]


def _of_column(name: str, what: str, delay: float, is_input: bool) -> Unknown:
    """The unknown of a column."""
    title = f"{name} {what}"
    match what:
        case "delay":
            return Unknown(name=title, start=delay, low=0.0, high=LONGEST_DELAY, scale=DELAY_SCALE, simulated=is_input)
        case "gain":
            return Unknown(name=title, start=1.0, low=0.0, scale=USUAL_SCALE, simulated=is_input)
    return Unknown(name=title, start=0.0, scale=BIAS_SCALE, simulated=is_input)


def _unknown(path: str, value: float, wanted: Wanted) -> Unknown:
    """The unknown of a number or factor, whose sign stays unless bounds say otherwise.

    Raises:
        FitError: its start is outside its bounds.
    """
    start = value if wanted.start is None else wanted.start
    low = wanted.low if wanted.low is not None else (0.0 if start > 0.0 else -math.inf)
    high = wanted.high if wanted.high is not None else (0.0 if start < 0.0 else math.inf)
    if wanted.low is None and wanted.high is not None and wanted.high <= 0.0:
        low = -math.inf
    if wanted.high is None and wanted.low is not None and start <= 0.0:
        high = math.inf
    if not low <= start <= high or not low < high:
        raise FitError(
            f"parameters: {formatted(path)}: the start must be within its bounds {low:g} to {high:g}, got {start:g}; "
            "move them, or give start"
        )
    scale = wanted.scale
    if scale is None:
        width = high - low
        scale = USUAL_SCALE * (abs(start) if start != 0.0 else width if math.isfinite(width) else 1.0)
    signed = start != 0.0 and (wanted.low if start > 0.0 else wanted.high) is None
    return Unknown(name=path, start=start, low=low, high=high, signed=signed, scale=scale, prior=wanted.prior)
