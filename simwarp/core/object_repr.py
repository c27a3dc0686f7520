"""How objects print: one line, or a title with a few rows, of at most 120 columns and 12 lines, and never an error.

Imports nothing of simwarp: kernels and host share it.
"""

from __future__ import annotations

import dataclasses
import enum
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

WIDEST: Final = 120
"""Columns of a line."""
MOST_LINES: Final = 12
LONGEST_COLLECTION: Final = 100
"""Items of a collection that is looked into."""


class Names(NamedTuple):
    """Names in a row of their own: their number, and as many of them as the line holds."""

    total: int
    names: Iterable[str]


Row: TypeAlias = "str | Names"


class Readable:
    """Base of classes that print as a title with rows below it.

    `repr` computes nothing, waits for no device and raises nothing: of an object that is not whole, because its
    construction failed, it gives the class alone. Subclasses override `_readable_title`, and
    `_readable_rows` where a line is too short.
    """

    def _readable_title(self) -> str:
        """What follows the name of the class, as `: 16 worlds on cpu`."""
        return ""

    def _readable_rows(self) -> Mapping[str, Row]:
        """Rows below the title, by label; empty ones are left out."""
        return {}

    def __repr__(self) -> str:
        name = type(self).__name__
        try:
            return _table(f"{name}{self._readable_title()}", self._readable_rows())
        except Exception:  # noqa: BLE001 - whatever a half-built object lacks: debuggers print those, too
            return f"{name} (incomplete)"


class ReadableFields:
    """Base of dataclasses that print like any other, but in lines of 120 columns, and long values by what they are."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__repr__" not in vars(cls) and not issubclass(cls, Readable):
            type.__setattr__(cls, "__repr__", _fields_text)  # of the class itself: `dataclass` leaves that one alone


def plural(count: int, thing: str) -> str:
    """`1 body`, `2 bodies`, `3 meshes`."""
    if count == 1:
        return f"1 {thing}"
    ending = "es" if thing.endswith("sh") else "s"
    return f"{count} {thing[:-1]}ies" if thing.endswith("y") else f"{count} {thing}{ending}"


def bytes_text(count: int) -> str:
    """Bytes as people write them: `1.5 MiB`."""
    if count >= 2**70:
        return "more than 2^40 GiB"
    if count >= 1000 * 2**30:
        return f"{count / 2**30:.0f} GiB"
    for unit, size in (("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10)):
        if count >= size:
            return f"{count / size:.3g} {unit}" if count < 1000 * size else f"{count / size:.0f} {unit}"
    return f"{count} bytes"


def array_text(array: Any) -> str:
    """Shape and type of an array or a tensor: `(16, 2) vec3`."""
    dtype = array.dtype
    return f"{tuple(array.shape)} {getattr(dtype, '__name__', None) or str(dtype).rpartition('.')[2]}"


def _table(title: str, rows: Mapping[str, Row]) -> str:
    shown = {label: row for label, row in rows.items() if (row.total if isinstance(row, Names) else row)}
    width = max((len(label) for label in shown), default=0)
    room = WIDEST - width - 4
    lines = [_cut(title, WIDEST)]
    for label, row in shown.items():
        text = [_listed(row, room)] if isinstance(row, Names) else _packed(row.split(", "), room)
        lines += [f"  {label if index == 0 else '':<{width}}  {line}" for index, line in enumerate(text)]
    return "\n".join(lines if len(lines) <= MOST_LINES else [*lines[: MOST_LINES - 1], "  ..."])


def _listed(row: Names, room: int) -> str:
    """`3: cart, pole, ...` within so many columns; names that do not fit are not computed."""
    text = f"{row.total}:"
    for index, name in enumerate(row.names, 1):
        last = index == row.total
        more = f" {' '.join(name.split())}{'' if last else ','}"
        if len(text) + len(more) + (0 if last else len(" ...")) > room:
            return f"{text} ..."
        text += more
    return text


def _packed(parts: Sequence[str], room: int, end: str = "") -> list[str]:
    """Parts in as few lines as hold them, each with a comma behind it but for the last, which has `end`."""
    lines = [""]
    for index, part in enumerate(parts, 1):
        more = f"{part}{',' if index < len(parts) else end}"
        if lines[-1] and len(lines[-1]) + 1 + len(more) <= room:
            lines[-1] += f" {more}"
        else:
            lines += textwrap.wrap(more, room)
    return lines[1:]


def _cut(text: str, room: int) -> str:
    text = " ".join(text.split())
    return text if len(text) <= room else f"{text[: room - 4]} ..."


def _fields_text(self: Any) -> str:
    """The `repr` of a `ReadableFields`."""
    parts = []
    for field in dataclasses.fields(self) if dataclasses.is_dataclass(self) else ():
        if field.repr:
            room = WIDEST - len(f"    {field.name}=,")
            parts.append(f"{field.name}={_value_text(getattr(self, field.name, '?'), room)}")
    name = type(self).__name__
    text = f"{name}({', '.join(parts)})"
    if len(text) <= WIDEST:
        return text
    lines = [f"    {line}" for line in _packed(parts, WIDEST - 4, ",")]
    return "\n".join(
        [f"{name}(", *(lines if len(lines) <= MOST_LINES - 2 else [*lines[: MOST_LINES - 3], "    ..."]), ")"]
    )


def _value_text(value: Any, room: int) -> str:
    """One value in so many columns: as it is, or its kind and size."""
    if isinstance(value, enum.Enum) and not isinstance(value, enum.Flag):
        return f"{type(value).__name__}.{value.name}"
    kind = type(value).__name__
    if hasattr(value, "dtype") and hasattr(value, "shape") and len(value.shape) > 0:
        small = kind == "ndarray" and value.size <= 6 and value.ndim == 1
        return " ".join(repr(value).split()) if small else f"<{array_text(value)}>"
    sized = isinstance(value, (tuple, list, dict, set, frozenset))
    if sized and len(value) > LONGEST_COLLECTION:
        return f"<{kind} of {len(value)}>"
    if isinstance(value, str) and len(value) > room - 2:
        return f"{value[: room - 6]!r}..."
    try:
        text = " ".join(repr(value).split())
    except Exception:  # noqa: BLE001 - a repr that raises is somebody else's
        return f"<{kind}>"
    if len(text) <= room:
        return text
    return f"<{kind} of {len(value)}>" if sized else f"{kind}(...)"
