"""Rows of a rig's sweep: how each of them ended, and their columns as a CSV file or as JSON."""

from __future__ import annotations

import csv
import dataclasses
import enum
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.files import replacing
from simwarp.core.object_repr import Names, Readable, Row, plural
from simwarp.vehicle.spec.parts import Array

Progress: TypeAlias = Callable[[float], None]
"""Called with the share of a rig's work that is done, 0 to 1."""

Statuses: TypeAlias = npt.NDArray[np.int8]
Reasons: TypeAlias = npt.NDArray[Any]
"""(n,) texts: why a row is DIVERGED or TIPPED; empty of others."""


class RowStatus(enum.IntEnum):
    """How a row of a sweep ended."""

    DONE = 0
    UNFINISHED = 1
    """The run was interrupted before it was there."""
    DIVERGED = 2
    """A value of its world is not finite, it does not come to rest, or its mechanism does not reach the state."""
    TIPPED = 3
    """The vehicle does not stand on its wheels any more: what a tilt table is to find."""


def no_reasons(count: int) -> Reasons:
    """(n,) empty texts."""
    return np.full(count, "", dtype=object)


def count_of(status: Statuses, kind: RowStatus) -> int:
    """How many rows ended so."""
    return int((status == kind).sum())


@dataclasses.dataclass(frozen=True, repr=False)
class RigRows(Readable):
    """Columns of a sweep, one row for each of its n worlds.

    Attributes:
        columns: (n,) by their names, which end in their units; text or numbers.
        status: (n,) `RowStatus`; numbers of rows that are not DONE are NaN, but for what was asked of them.
        reason: (n,) why a row did not end well; None: nothing is known.
        asked: columns that were asked of a row.
    """

    columns: Mapping[str, npt.NDArray[Any]]
    status: Statuses
    reason: Reasons | None = None
    asked: tuple[str, ...] = ()

    def _readable_title(self) -> str:
        return f": {plural(len(self.status), 'row')}"

    def _readable_rows(self) -> Mapping[str, Row]:
        return {"columns": Names(len(self.columns), iter(self.columns))}

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """(n,) a column, of the unit that its name ends in."""
        return self.columns[name]

    def count(self, kind: RowStatus) -> int:
        """How many rows ended so."""
        return count_of(self.status, kind)

    def write(self, path: str | Path) -> None:
        """Writes a CSV file with a header; the last columns are the status and the reason of rows that diverged.

        Raises:
            FileError: the path cannot be written to.
            OutputError: the disk did not take it.
        """
        names = [RowStatus(code).name.lower() for code in self.status]
        with replacing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*self.columns, "status", "reason"])
            for *row, name, reason in zip(*self.columns.values(), names, self.reasons(), strict=True):
                writer.writerow([*map(_text, row), name, reason])

    def as_json(self) -> dict[str, list[Any]]:
        """Lists by column, with the status and the reason."""
        found = {name: values.tolist() for name, values in self.columns.items()}
        return found | {"status": [RowStatus(code).name.lower() for code in self.status], "reason": self.reasons()}

    def reasons(self) -> list[str]:
        """Why rows did not end well; empty of others."""
        return [""] * len(self.status) if self.reason is None else [str(text) for text in self.reason]

    def divergences(self) -> list[str]:
        """A line for each row that diverged: what was asked of it, and the reason."""
        texts = self.reasons()
        return [
            f"{', '.join(f'{name} {_text(self.columns[name][row])}' for name in self.asked)}: {texts[row]}"
            for row in np.flatnonzero(self.status == RowStatus.DIVERGED).tolist()
        ]


def _text(value: Any) -> str:
    return str(value) if isinstance(value, str) else f"{value:.9g}"


def joined_rows(parts: list[RigRows]) -> RigRows:
    """Rows of several sweeps with the same columns, one after the other."""
    names = parts[0].columns
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in names}
    reason = np.concatenate([np.array(part.reasons(), dtype=object) for part in parts])
    return RigRows(columns, np.concatenate([part.status for part in parts]), reason, parts[0].asked)


def slopes(values: Array, abscissae: Array, done: npt.NDArray[np.bool_]) -> Array:
    """(n,) slopes of values (n,), of second order up to the ends of what is done; NaN elsewhere, and of fewer than
    three states.
    """
    found = np.full(len(values), np.nan)
    if done.sum() >= 3:
        found[done] = np.gradient(values[done], abscissae[done], edge_order=2)
    return found
