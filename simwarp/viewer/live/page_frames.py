"""Messages of pages: checked against their types before viser reads them; a wrong one is reported in one line."""

from __future__ import annotations

import dataclasses
import functools
import logging
import math
import sys
import threading
import time
import typing
import warnings
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import msgspec
from viser import _messages

# viser's own check of a frame's types; the text has the values, so that each would be printed
warnings.filterwarnings("ignore", r"\[viser\] .* does not match annotation", UserWarning)

LARGEST: Final = 1.0e12
"""Largest number that a page has a use for: places [m], sizes in pixels, counts."""
QUIET: Final = 1.0
"""Least time between two lines about pages [s]."""
MOST_PAGES: Final = 1000
"""Pages that are remembered as told of."""


class Complaints:
    """Lines in the terminal about what pages and others do wrong: one for each page, and at most one a second."""

    def __init__(self) -> None:
        self._reported: dict[str, None] = {}
        self._last = -math.inf
        self._held_back = 0
        self._lock = threading.Lock()  # pages are read in the server's thread, callbacks run in others

    def report(self, who: str, what: str) -> None:
        """Says it, unless this page was told of already or the last line is too new.

        Args:
            who: the page, as an address with its port.
            what: is wrong; of several lines the first counts.
        """
        with self._lock:
            now = time.monotonic()
            if who in self._reported or now - self._last < QUIET:
                self._held_back += 1
                return
            self._reported[who] = None
            while len(self._reported) > MOST_PAGES:
                del self._reported[next(iter(self._reported))]
            more = f" ({self._held_back} more since the last line)" if self._held_back else ""
            self._last, self._held_back = now, 0
        line = " ".join(what.split())[:200]
        print(f"viewer: {who}: {line}{more}", file=sys.stderr, flush=True)


class CheckedConnection:
    """A connection that forwards valid messages only, and drops the rest.

    Args:
        connection: of a page.
        complaints: told of what is dropped.
        elements: of the page that take values, by id.
    """

    def __init__(self, connection: Any, complaints: Complaints, elements: Mapping[str, Any]) -> None:
        self._connection = connection
        self._complaints = complaints
        self._elements = elements

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    async def recv(self, *arguments: Any, **options: Any) -> Any:
        """The next frame that is a message of a page."""
        while True:
            raw = await self._connection.recv(*arguments, **options)
            fault = fault_of(raw, self._elements)
            if fault is None:
                return raw
            self._complaints.report(address_of(self._connection), f"a frame is dropped: {fault}")


def address_of(connection: Any) -> str:
    """Host and port of a page; "a page" where it is gone."""
    address = getattr(connection, "remote_address", None)
    return f"{address[0]}:{address[1]}" if address else "a page"


def fault_of(raw: Any, elements: Mapping[str, Any] = MappingProxyType({})) -> str | None:
    """Why a frame is no message of a page with these elements; None where it is one."""
    if not isinstance(raw, bytes):
        return "it must be binary, got text"
    try:
        message: Any = _messages.Message.deserialize(raw)
    except Exception as error:  # noqa: BLE001  whatever a stranger sends
        return f"it is no message of a page ({type(error).__name__}: {error})"
    kind: Any = type(message)
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if not _finite(value):
            return f"{kind.__name__}: {field.name} must be of finite numbers below {LARGEST:g}"
        try:
            msgspec.convert(value, _types(kind)[field.name])
        except msgspec.ValidationError as error:
            return f"{kind.__name__}: {field.name}: {error}"
        except TypeError:
            continue  # arrays, which only the server sends
    return _out_of_range(message, elements) if kind is _messages.GuiUpdateMessage else None


def _out_of_range(message: Any, elements: Mapping[str, Any]) -> str | None:
    """Why an element cannot have a value that a page gives it: a slider's ends, the choices of a list."""
    if "value" not in message.updates or message.uuid not in elements:
        return None
    element, value = elements[message.uuid], message.updates["value"]
    label = getattr(element, "label", "")
    lower, upper = getattr(element, "min", None), getattr(element, "max", None)
    if isinstance(lower, (int, float)) or isinstance(upper, (int, float)):
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return f"'{label}' must be a number"
        if (lower is not None and value < lower) or (upper is not None and value > upper):
            return f"'{label}' must be in {lower}..{upper}, got {value:g}"
    choices = getattr(element, "options", None)
    if isinstance(choices, (list, tuple)) and value not in choices:
        return f"'{label}' must be one of its choices"
    return None


@functools.cache
def _types(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _finite(value: Any) -> bool:
    """True if all numbers in a value are."""
    if isinstance(value, (int, float)):
        return abs(value) <= LARGEST
    if isinstance(value, dict):
        return all(_finite(each) for each in value.values())
    return all(_finite(each) for each in value) if isinstance(value, (list, tuple)) else True


class OneLine(logging.Filter):
    """Turns what a library logs about pages into complaints.

    Args:
        complaints: that say it.
    """

    def __init__(self, complaints: Complaints) -> None:
        super().__init__()
        self._complaints = complaints

    def filter(self, record: logging.LogRecord) -> bool:
        """False: nothing is logged any more."""
        if record.levelno >= logging.ERROR:
            error = record.exc_info[1] if record.exc_info else None
            told = record.getMessage() + (f" ({type(error).__name__}: {error})" if error is not None else "")
            self._complaints.report("web server", told)
        return False
