"""What became of every element of an imported file: held as it is, held nearly, or refused."""

from __future__ import annotations

import dataclasses
import enum
import warnings
from collections.abc import Collection, Mapping
from typing import Any, Final

from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError, formatted
from simwarp.core.wording import suggestion

MOST_NAMED: Final = 8
"""Names of one element that a warning or an error lists; the report has all of them."""
MOST_LETTERS: Final = 60
"""Letters after which such a list stops, with two names at least."""


class ImportedWarning(UserWarning):
    """A part of a file is imported with other equations than those of its own program, or dropped on request."""


class Fate(enum.StrEnum):
    """What became of an element."""

    HELD = "held"
    """The same equations."""
    NEAR = "near"
    """Other equations; the reason tells which."""
    REFUSED = "refused"
    """Nothing stands for it."""


@dataclasses.dataclass(frozen=True)
class ReportLine:
    """One element of a file.

    Attributes:
        fate: what became of it.
        element: its kind, such as "joint hinge" or "muscle": the word that `allow` takes where it is refused.
        name: its name in the file; empty where the whole kind is meant.
        reason: the equations in its place, or why there are none.
    """

    fate: Fate
    element: str
    name: str
    reason: str


class ImportReport(Readable):
    """Lines about a file's elements, in the order in which they were read.

    Args:
        source: the file, for messages.
        refusable: kinds of elements that the reader refuses, with the reason.
        allow: those of them to drop with a warning instead.

    Raises:
        ModelError: `allow` names a kind that this reader never refuses.
    """

    def __init__(self, source: str, refusable: Mapping[str, str], allow: Collection[str] = ()) -> None:
        self.source = source
        self.lines: list[ReportLine] = []
        self._refusable = refusable
        if isinstance(allow, str):
            raise ModelError(
                f"{source}: allow must be a list of kinds, got {formatted(allow)}; write [{formatted(allow)}]"
            )
        self._allowed = frozenset(allow)
        for kind in sorted(self._allowed - set(refusable), key=str):
            hint = suggestion(str(kind), list(refusable), f"known: {', '.join(refusable)}")
            raise ModelError(f"{source}: allow names {formatted(kind)}, which is never refused; {hint}")

    def hold(self, element: str, name: str = "", note: str = "") -> None:
        """An element that is simulated with the same equations."""
        self._add(Fate.HELD, element, name, note)

    def approximate(self, element: str, name: str, reason: str) -> None:
        """An element that is simulated with other equations: the reason says which."""
        self._add(Fate.NEAR, element, name, reason)

    def refuse(self, element: str, name: str, reason: str = "") -> None:
        """An element that cannot be simulated, of a kind in `refusable`; `finish` raises the error."""
        self._add(Fate.REFUSED, element, name, reason or self._refusable[element])

    def is_allowed(self, element: str) -> bool:
        """True where `allow` drops this kind."""
        return element in self._allowed

    def of(self, fate: Fate) -> list[ReportLine]:
        """The lines of one fate."""
        return [line for line in self.lines if line.fate is fate]

    @property
    def held(self) -> list[ReportLine]:
        """What is simulated with the same equations."""
        return self.of(Fate.HELD)

    @property
    def near(self) -> list[ReportLine]:
        """What is simulated with other equations."""
        return self.of(Fate.NEAR)

    @property
    def refused(self) -> list[ReportLine]:
        """What was dropped, since `allow` says so."""
        return self.of(Fate.REFUSED)

    def check(self) -> None:
        """Stop at what is refused.

        Raises:
            ModelError: something is refused that `allow` does not drop: one line that names all of it.
        """
        stopping = [line for line in self.refused if line.element not in self._allowed]
        if stopping:
            kinds = list(dict.fromkeys(line.element for line in stopping))
            told = "; ".join(f"{_names(stopping, kind)}: {_reason(stopping, kind)}" for kind in kinds)
            raise ModelError(f"{self.source}: refused {told}; change the file, or drop them with allow={kinds!r}")

    def finish(self, *, stacklevel: int = 3) -> None:
        """Stop at what is refused, and warn once for each kind of what is near or dropped.

        Raises:
            ModelError: as `check`.
        """
        self.check()
        for line in _first_of_kinds([*self.near, *self.refused]):
            same = [one for one in self.lines if _kind(one) == _kind(line)]
            what = "dropped " if line.fate is Fate.REFUSED else ""
            text = f"{self.source}: {what}{_names(same, line.element)}: {line.reason}"
            warnings.warn(text, ImportedWarning, stacklevel=stacklevel)

    def to_json(self) -> dict[str, list[dict[str, str]]]:
        """Lists of `{element, name, reason}` under the fates."""
        return {
            fate.value: [{"element": one.element, "name": one.name, "reason": one.reason} for one in self.of(fate)]
            for fate in Fate
        }

    def _readable_title(self) -> str:
        counts = ", ".join(f"{len(self.of(fate))} {fate.value}" for fate in Fate)
        return f" of '{self.source}': {counts}; print(report) lists them"

    def __str__(self) -> str:
        """A table: fate, element, how many, names and reason."""
        rows = []
        for line in _first_of_kinds(self.lines):
            same = [one for one in self.lines if _kind(one) == _kind(line)]
            names = _listed([one.name for one in same if one.name])
            rows.append(f"{line.fate.value:<8} {line.element:<24} {len(same):>4}  {line.reason or names}")
        return "\n".join(rows)

    def _add(self, fate: Fate, element: str, name: str, reason: str) -> None:
        line = ReportLine(fate, element, name, reason)
        if line not in self.lines:
            self.lines.append(line)


def _kind(line: ReportLine) -> tuple[Any, ...]:
    return line.fate, line.element, line.reason


def _first_of_kinds(lines: list[ReportLine]) -> list[ReportLine]:
    return list({_kind(line): line for line in reversed(lines)}.values())[::-1]


def _reason(lines: list[ReportLine], element: str) -> str:
    return next(line.reason for line in lines if line.element == element)


def _names(lines: list[ReportLine], element: str) -> str:
    names = [line.name for line in lines if line.element == element and line.name]
    return f"{element} {_listed(names)}" if names else element


def _listed(names: list[str]) -> str:
    told = names[:MOST_NAMED]
    while len(told) > 2 and sum(map(len, told)) > MOST_LETTERS:
        told.pop()
    more = f" and {len(names) - len(told)} more" if len(names) > len(told) else ""
    return ", ".join(f"'{name}'" for name in told) + more
