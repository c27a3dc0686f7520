"""Tire property files (.tir of Adams/Tire): their keys and where they stand."""

from __future__ import annotations

import math

from simwarp.core.types import formatted
from simwarp.vehicle.spec.parts import LARGEST, SpecError

TEXT_BEGINS = ("'", '"', "{", "(")
"""Of lines in blocks of comments and of the heads of tables."""


class PropertyFileError(SpecError):
    """A mistake in a .tir file, which the error names itself."""


class TirValues(dict[str, "float | str"]):
    """KEY -> value, and the name of the file and the lines they are from."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name
        self.lines: dict[str, int] = {}

    def error(self, key: str, rule: str) -> PropertyFileError:
        """The error of a key, which may be missing."""
        line = f"line {self.lines[key]}: " if key in self.lines else ""
        return PropertyFileError(f"{self.name}: {line}{key[:60]}: {rule}")

    def located(self, error: SpecError) -> SpecError:
        """An error that begins with tir.KEY, by file and line in the place of tir; any other as it is."""
        key, _, rule = str(error).partition(": ")
        return self.error(key.removeprefix("tir."), rule) if key.startswith("tir.") else error


def parse_tir(text: str, name: str) -> TirValues:
    """The keys of all sections in one; `$` and `!` begin comments, quotes hold text.

    Tables (lines of numbers under a head in braces) and blocks of comments are left out.

    Raises:
        SpecError: a line is none of that; it names the line.
    """
    values = TirValues(name)
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.split("$")[0].split("!")[0].strip()
        if not line or _is_section(line) or line.startswith(TEXT_BEGINS) or _is_row(line):
            continue
        key, equals, value = (part.strip() for part in line.partition("="))
        if not equals or not key or len(key.split()) > 1:
            rule = "must be KEY = value, a [SECTION], a row of numbers or a comment after $"
            raise SpecError(f"{name}: line {number}: {rule}, got {formatted(line)}")
        known, first = values.get(key), values.lines.get(key)
        values.lines[key] = number
        values[key] = value[1:-1] if value.startswith(("'", '"')) else _number(values, key, value)
        if known is not None and values[key] != known:
            both = f"{formatted(known)} in line {first} and {formatted(values[key])} in line {number}"
            raise values.error(key, f"must be given once, got {both}; leave one of them")
    if not values:
        raise SpecError(f"{name}: holds no KEY = value lines; give a tire property file")
    return values


def _is_section(line: str) -> bool:
    return line.startswith("[") and line.endswith("]")


def _is_row(line: str) -> bool:
    """Numbers alone."""
    try:
        return bool([float(word) for word in line.split()])
    except ValueError:
        return False


def _number(values: TirValues, key: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise values.error(key, f"must be a number or quoted text, got {formatted(text)}") from None
    if not math.isfinite(number):
        raise values.error(key, f"must be a finite number, got {text[:60]}")
    if abs(number) > LARGEST:
        raise values.error(key, f"must be below {LARGEST:g}, got {text[:60]}")
    return number
