"""What options the commands have: found by asking each command, so that new ones are attacked by themselves."""

import dataclasses
import functools
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any
from unittest import mock

import tyro

from simwarp.cli import COMMANDS
from simwarp.cli.options import FLAT


class Option(typing.NamedTuple):
    """One option: its words on the command line, the type of its value, and its default."""

    name: str
    kind: Any
    default: Any

    @property
    def word(self) -> str:
        """The last part of its name, which an error must name."""
        return self.name.lstrip("-").rpartition(".")[2]


class _AskedError(BaseException):
    """Carries the dataclass that a command was about to parse its arguments into."""


def _ask(kind: Any, *_: Any, **__: Any) -> None:
    raise _AskedError(kind)


def options_class(command: str, arguments: tuple[str, ...]) -> type | None:
    """The dataclass a command parses arguments into; None where it does not get that far."""
    with mock.patch.object(tyro, "cli", _ask):
        try:
            COMMANDS[command].load()(list(arguments))
        except _AskedError as asked:
            kind: type = asked.args[0]
            return kind
        except Exception:  # noqa: BLE001 - a command that wants other arguments is attacked without its options
            return None
    return None


def walk(kind: Any, prefix: str = "") -> Iterator[Option]:
    """The options of a dataclass, nested ones included."""
    hints = typing.get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        marks = getattr(hints[field.name], "__metadata__", ())
        inner = typing.get_args(hints[field.name])[0] if marks else hints[field.name]
        word = field.name.replace("_", "-")
        if dataclasses.is_dataclass(inner):
            yield from walk(inner, prefix if FLAT in marks else f"{prefix}{word}.")
        elif tyro.conf.Positional not in marks:
            yield Option(f"--{prefix}{word}", inner, field.default)


@functools.cache
def options_of(command: str, arguments: tuple[str, ...]) -> tuple[Option, ...]:
    """The options of a command with these arguments."""
    kind = options_class(command, arguments)
    return () if kind is None else tuple(walk(kind))


def kinds_of(option: Option) -> tuple[Any, ...]:
    """The types that an option takes, without None."""
    origin = typing.get_origin(option.kind)
    members = typing.get_args(option.kind) if origin in (typing.Union, types.UnionType) else (option.kind,)
    return tuple(member for member in members if member is not type(None))


def is_mapping(kind: Any) -> bool:
    """Whether an option is one JSON object."""
    origin = typing.get_origin(kind)
    return isinstance(origin, type) and issubclass(origin, Mapping)
