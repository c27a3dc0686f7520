"""Words for errors, and the error of wrong input: near names, and long names made short. Light to import."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

LONGEST_WORD: Final = 255
"""Letters of a name that are compared with those there are."""
LONGEST_PATH: Final = 200
MOST_LISTED: Final = 24
"""Names that an error lists."""


class InputError(ValueError):
    """The user asked for something impossible; the message names it, the rule and the remedy.

    The command line prints the message in one line and exits with code 2.
    """


def close_names(word: object, known: Iterable[str], count: int = 1, cutoff: float = 0.6) -> list[str]:
    """The known names that are nearest to a word, at most `count` of them; none where it is no text."""
    if not isinstance(word, str):
        return []
    return difflib.get_close_matches(word[:LONGEST_WORD], list(known), n=count, cutoff=cutoff)


def nearest(word: object, known: Iterable[object]) -> str:
    """` (did you mean 'x'?)`, or nothing where no known name is near."""
    near = close_names(word, [name for name in known if isinstance(name, str)])
    return f" (did you mean {near[0]!r}?)" if near else ""


def suggestion(word: object, known: Iterable[str], otherwise: str) -> str:
    """`did you mean 'x'?`, or what a message says otherwise, where no known name is near."""
    near = close_names(word, known)
    return f"did you mean '{near[0]}'?" if near else otherwise


def suggestions(word: object, known: Iterable[str], otherwise: str, *, count: int = 3, cutoff: float = 0.5) -> str:
    """`did you mean x or y?` with at most `count` names, or what a message says otherwise."""
    close = close_names(word, known, count, cutoff)
    return f"did you mean {' or '.join(close)}?" if close else otherwise


def near_names(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean A or B?"`` for names close to ``name``, else ``"; known: ..."``."""
    known = sorted(known)
    more = ", ..." if len(known) > MOST_LISTED else ""
    hint = suggestions(name, known, f"known: {', '.join(known[:MOST_LISTED])}{more}")
    return f"; {hint}" if known else ""


def option_word(field: str) -> str:
    """The name of a field as an option: an underscore at its end keeps it from a keyword, and is no part of it."""
    return field.removesuffix("_").replace("_", "-")


def shortened(text: str | Path) -> str:
    """A path or a key: its beginning, if it is long."""
    return str(text) if len(str(text)) <= LONGEST_PATH else f"{str(text)[:100]}..."
