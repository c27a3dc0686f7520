"""Valid words of a command line, by the types of their options: numbers of arrays, names of file systems."""

from __future__ import annotations

import enum
import os
import typing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import tyro

from simwarp.cli import UsageError, shortened
from simwarp.core.files import FLOAT32_MAX, LONGEST_INTEGER, LONGEST_NAME

SMALLEST: Final = 1.1754943508222875e-38
"""Smallest number above zero of single precision."""

LARGEST_COUNT: Final = 2**31 - 1
"""Largest whole number of the arrays."""

LARGEST_SEED: Final = 2**63 - 1

LONGEST_PATH: Final = 4095
"""Bytes of a path that Linux takes."""

SEED: Final = "seed"
"""Last word of options that take whole numbers of 63 bits, none of them negative."""


def check_option(option: str, hint: Any, words: Sequence[str]) -> None:
    """Refuse words that an option of this type cannot have.

    Args:
        option: its name.
        hint: its type, which may be annotated.
        words: that follow it; one that it has no use for is left to the parser.

    Raises:
        UsageError: names the option, the rule and the word.
    """
    parts = _parts(hint)
    if len(parts) == 1 and isinstance(parts[0], type) and issubclass(parts[0], enum.Enum):
        choices = [str(member.value) for member in parts[0]]
        if words and words[0] not in choices:
            raise UsageError(f"{option} must be one of {', '.join(choices)}, got '{shortened(words[0])}'")
        return
    words_of_it = [part for part in parts if isinstance(part, str)]  # of a Literal
    if words_of_it and words and words[0] not in words_of_it:
        raise UsageError(f"{option} must be {' or '.join(words_of_it)}, got '{shortened(words[0])}'")
    if set(parts) == {bool, type(None)} and words and words[0] not in ("True", "False", "None"):
        raise UsageError(f"{option} must be True, False or None, got '{shortened(words[0])}'")
    unit = "".join(f" [{note.metavar}]" for note in _notes(hint) if getattr(note, "metavar", None))
    kinds = _kinds(hint)
    if len(kinds) != 1 or (type(None) in parts and list(words[:1]) == ["None"]):
        return
    for word in words if _has_tuple(hint) else words[:1]:
        rule = RULES[kinds[0]](word, option.rpartition(".")[2].endswith(SEED))
        if rule:
            raise UsageError(f"{option} must be {rule.replace(' [unit]', unit)}, got '{shortened(word)}'")


def is_flag(hint: Any) -> bool:
    """Return True if an option of this type stands alone: its name is its value."""
    return _parts(hint) == [bool]


def may_repeat(hint: Any) -> bool:
    """Return True if an option of this type may be given more than once: flags, and those that collect values."""
    return bool in _parts(hint) or any(note is tyro.conf.UseAppendAction for note in _notes(hint))


def _whole_number(word: str, seed: bool) -> str:
    """Return the rule that a whole number breaks, if it does."""
    digits = word.removeprefix("-").removeprefix("+")
    if not (digits.isascii() and digits.isdigit()):
        return "a whole number [unit]"
    least, most = (0, LARGEST_SEED) if seed else (-LARGEST_COUNT, LARGEST_COUNT)
    if len(digits.lstrip("0")) > LONGEST_INTEGER or not least <= int(word) <= most:
        return f"a whole number from {least} to {most}"
    return ""


def _number(word: str, seed: bool) -> str:
    """Return the rule that a number breaks, if it does."""
    try:
        value = float(word)
    except ValueError:
        return "a number [unit]"
    if "_" in word or not word.isascii():
        return "a number [unit]"
    if not abs(value) <= FLOAT32_MAX:
        return "a finite number of at most 3.4e38"
    return "zero, or a number above 1.2e-38" if 0.0 < abs(value) < SMALLEST else ""


def _path(word: str, seed: bool) -> str:
    """Return the rule that a path breaks, if it does."""
    if any(len(os.fsencode(part)) > LONGEST_NAME for part in word.split("/")):
        return f"a path whose names have at most {LONGEST_NAME} bytes"
    return _text(word, seed)


def _text(word: str, seed: bool) -> str:
    """Return the rule that a text breaks, if it does."""
    return f"at most {LONGEST_PATH} bytes long" if len(os.fsencode(word)) > LONGEST_PATH else ""


RULES: Final[dict[Any, Callable[[str, bool], str]]] = {int: _whole_number, float: _number, Path: _path, str: _text}
"""Type -> function that returns the rule that a word breaks, of an option that is a seed or is not."""


def _notes(hint: Any) -> tuple[Any, ...]:
    """Return the annotations of an annotated type."""
    return getattr(hint, "__metadata__", ())


def _parts(hint: Any) -> list[Any]:
    """Return the plain types that make up a type hint."""
    inner = typing.get_args(hint)[:1] if _notes(hint) else typing.get_args(hint)
    return [part for item in inner for part in _parts(item)] if inner else [hint]


def _kinds(hint: Any) -> list[Any]:
    """Return those that have rules; none where another type is among them, which the parser has to judge."""
    found = {part for part in _parts(hint) if part not in (type(None), Ellipsis)}
    return list(found) if found <= RULES.keys() else []


def _has_tuple(hint: Any) -> bool:
    """Return True if a tuple is among the types."""
    return typing.get_origin(hint) is tuple or any(_has_tuple(item) for item in typing.get_args(hint))
