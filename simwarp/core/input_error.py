"""The error about what a user asked for, light: commands refuse words before they import what they compute with."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from simwarp.core.wording import suggestions

MOST_LISTED: Final = 24
"""Names that an error lists."""


class InputError(ValueError):
    """The user asked for something impossible; the message names it, the rule and the remedy.

    The command line prints the message in one line and exits with code 2.
    """


def near_names(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean A or B?"`` for names close to ``name``, else ``"; known: ..."``."""
    known = sorted(known)
    more = ", ..." if len(known) > MOST_LISTED else ""
    hint = suggestions(name, known, f"known: {', '.join(known[:MOST_LISTED])}{more}")
    return f"; {hint}" if known else ""
