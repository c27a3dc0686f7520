"""Errors of the task and training layers."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """The user asked for something impossible; the message names it, the rule and the remedy.

    The command line prints the message in one line and exits with code 2.
    """


class TaskError(RuntimeError):
    """A task broke its contract (shape, dtype, NaN); the message names the task and the term."""


def near_names(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean A or B?"`` for names close to ``name``, else ``"; known: ..."``."""
    known = sorted(known)
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    if close:
        return f"; did you mean {' or '.join(close)}?"
    return f"; known: {', '.join(known)}" if known else ""
