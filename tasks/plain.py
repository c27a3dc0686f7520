"""Configurations as plain values, as JSON and checkpoints keep them, and back: every value held to its field's type."""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal, TypeVar

import numpy as np

from simwarp.core.files import FLOAT32_MAX
from simwarp.core.renames import RENAMED, with_new_names
from simwarp.core.types import shown

from .errors import InputError, near_names

KindT = TypeVar("KindT")

LONGEST_TEXT: Final = 1000
"""Letters of the longest text of a configuration."""


def config_to_plain(config: Any) -> dict[str, Any]:
    """Return a configuration as JSON-ready values; enums become their values."""
    return {key: plain_value(value) for key, value in dataclasses.asdict(config).items()}


def plain_value(value: Any) -> Any:
    """Return a value as JSON has it: enums as their values, tuples as lists."""
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, Mapping):
        return {key: plain_value(item) for key, item in value.items()}
    return [plain_value(item) for item in value] if isinstance(value, list | tuple) else value


def config_from_plain(kind: type[KindT], plain: object, where: str = "") -> KindT:
    """Return the configuration that :func:`config_to_plain` wrote; fields that are left away keep their default.

    Args:
        kind: a dataclass; the annotations of its fields say what is allowed.
        plain: what was read: it may hold anything.
        where: where it stood: the errors begin with it.

    Raises:
        InputError: a name is unknown, or a value is of a wrong type or breaks its field's rule.
    """
    try:
        return _dataclass(kind, plain, "", None)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise InputError(f"{where}: {error}" if where else str(error)) from None


def typed(hint: Any, value: object, name: str) -> Any:
    """Return a plain value as the type that an annotation names.

    Args:
        hint: numbers, text, enumerations, dataclasses, lists, tuples, mappings and choices of these; a value of any
            other class must be an instance of it.
        value: what was read.
        name: what the errors call it.

    Raises:
        InputError: it is not of that type.
    """
    return _typed(hint, value, name, None)


def hold_fields(config: Any) -> None:
    """Hold the numbers, texts, choices and tuples in a frozen configuration to their fields' annotations.

    Nested configurations and mappings check themselves.

    Raises:
        InputError: a value is not of its field's type.
    """
    owner: Any = type(config)
    for name, hint in _hints(owner).items():
        value = getattr(config, name)
        plain = hint if typing.get_origin(hint) is not Annotated else typing.get_args(hint)[0]
        kind = typing.get_origin(plain) or plain
        if dataclasses.is_dataclass(plain) or (isinstance(kind, type) and issubclass(kind, Mapping)):
            continue
        value = value.item() if isinstance(value, np.generic) else value
        object.__setattr__(config, name, _typed(hint, value, name.replace("_", "-"), None))


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    """Return the annotations of a dataclass's fields."""
    hints = typing.get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


def _typed(hint: Any, value: object, name: str, like: object) -> Any:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value
    if origin is Annotated:
        return _typed(arguments[0], value, name, like)
    if origin in (typing.Union, types.UnionType):
        return _one_of(hint, value, name, like)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return _dataclass(hint, value, name, like)
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return choice(name, hint, value)
    kind = origin or hint
    if kind in _SIMPLE:
        right, make = _SIMPLE[kind]
        if not right(value):
            raise _refuse(hint, value, name)
        return make(value)
    if kind in (list, tuple, Sequence):
        return _entries(hint, value, name)
    if isinstance(kind, type) and issubclass(kind, Mapping):
        return _members(hint, value, name)
    if (origin is Literal and value not in arguments) or (isinstance(kind, type) and not isinstance(value, kind)):
        raise _refuse(hint, value, name)
    return value


def _is_number(value: Any) -> bool:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    return abs(value) <= FLOAT32_MAX and math.isfinite(value)


_SIMPLE: Final[Mapping[Any, tuple[Any, Any]]] = {
    type(None): (lambda value: value is None, lambda value: None),
    bool: (lambda value: isinstance(value, bool), bool),
    int: (lambda value: type(value) is int and -(2**63) <= value < 2**63, int),
    float: (_is_number, float),
    str: (lambda value: isinstance(value, str) and len(value) <= LONGEST_TEXT, str),
}
"""Type -> whether a value is of it, and what makes the value from it. True and False are no numbers."""


def _one_of(hint: Any, value: object, name: str, like: object) -> Any:
    """Return the value as the first of several types that takes it."""
    for argument in typing.get_args(hint):
        try:
            return _typed(argument, value, name, like)
        except InputError:
            continue
    raise _refuse(hint, value, name)


def _dataclass(kind: type[KindT], value: object, name: str, like: object) -> KindT:
    """Return a dataclass; a field that is left away has the value it has in ``like``."""
    if not isinstance(value, Mapping):
        raise _refuse(kind, value, name or kind.__name__)
    what, prefix = name or kind.__name__, f"{name}." if name else ""
    fields = {field.name: field for field in dataclasses.fields(kind) if field.init}  # type: ignore[arg-type]
    needed: set[str] = set()
    if not isinstance(like, kind):
        needed = {key for key, field in fields.items() if _has_no_default(field)}
        like = None if needed else kind()
    hints = typing.get_type_hints(kind, include_extras=True)
    changes = {}
    for key, item in with_new_names(what, value, getattr(kind, RENAMED, {})).items():
        if key not in fields:
            raise InputError(f"{what} has no field {shown(key)}{near_names(str(key), fields)}")
        changes[key] = _typed(hints[key], item, f"{prefix}{key}".replace("_", "-"), getattr(like, key, None))
    for key in sorted(needed - changes.keys()):
        raise InputError(f"{what} has no '{key}'; give it")
    return kind(**changes) if like is None else dataclasses.replace(like, **changes)  # type: ignore[type-var]


def _has_no_default(field: dataclasses.Field[Any]) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _entries(hint: Any, value: object, name: str) -> Any:
    """Return a list or a tuple, each entry of its type."""
    kind, kinds = typing.get_origin(hint) or hint, typing.get_args(hint)
    if not isinstance(value, list | tuple):
        raise _refuse(hint, value, name)
    fixed = kind is tuple and kinds and kinds[-1] is not Ellipsis
    if fixed and len(value) != len(kinds):
        raise _refuse(hint, value, name)
    each = kinds if fixed else (kinds[:1] or (Any,)) * len(value)
    made = []
    for item, entry in zip(value, each, strict=True):
        try:
            made.append(_typed(entry, item, name, None))
        except InputError:
            raise _refuse(hint, value, name) from None
    return made if kind is list else tuple(made)


def _members(hint: Any, value: object, name: str) -> dict[str, Any]:
    """Return a mapping, each value of its type."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise _refuse(hint, value, name)
    inner = typing.get_args(hint)[1] if typing.get_args(hint) else Any
    if not (dataclasses.is_dataclass(inner) and isinstance(inner, type)):
        return {key: _typed(inner, item, f"{name} {shown(key)}", None) for key, item in value.items()}
    return {key: config_from_plain(inner, item, f"{name} {shown(key)}") for key, item in value.items()}


def _refuse(hint: Any, value: object, name: str) -> InputError:
    return InputError(f"{name} must be {_words(hint)}, got {'null' if value is None else shown(value)}")


def _words(hint: Any) -> str:
    """Return what a type is called in an error."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return _words(arguments[0])
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(map(_words, arguments)))
    if origin is Literal:
        return f"one of {', '.join(map(str, arguments))}"
    kind = origin or hint
    if kind in _WORDS:
        return _WORDS[kind]
    if kind in (list, tuple, Sequence):
        if kind is tuple and arguments and arguments[-1] is not Ellipsis:
            return f"a list of {len(arguments)}: {', '.join(map(_words, arguments))}"
        return "a list" + (f", each entry {_words(arguments[0])}" if arguments else "")
    if dataclasses.is_dataclass(hint) or (isinstance(kind, type) and issubclass(kind, Mapping)):
        return "an object of named values"
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return f"one of {', '.join(str(member.value) for member in kind)}"
    return f"a {getattr(kind, '__name__', kind)}"


_WORDS: Final[Mapping[Any, str]] = {
    type(None): "null",
    bool: "true or false",
    int: "a whole number of 64 bits",
    float: "a number within float32",
    str: "a short text",
}


def choice(field: str, kind: type[enum.Enum], value: Any) -> enum.Enum:
    """Return the member of an enumeration that a field's value is or names, or raise an :class:`InputError`."""
    try:
        return kind(value)
    except ValueError:
        known = ", ".join(str(member.value) for member in kind)
        raise InputError(f"{field.replace('_', '-')} must be one of {known}, got {shown(value)}") from None
