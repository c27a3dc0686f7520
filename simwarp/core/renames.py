"""Fields and options that have a new name: the old one is read for one release, with one warning."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeVar

from simwarp.core.types import ModelError

ClassT = TypeVar("ClassT", bound=type)
CallT = TypeVar("CallT", bound=Callable[..., Any])

RENAMED: Final = "_renamed_fields"
"""Attribute of a class: its old names and the new ones, for readers of files."""

_told: Final[set[tuple[str, str]]] = set()


def warn_renamed(thing: str, old: str, new: str, *, stacklevel: int = 3) -> None:
    """Warn once per process that a name has changed.

    Args:
        thing: class, module or other thing that carries the name.
        old: the name that was used.
        new: the name to use.
        stacklevel: of the caller to blame, as in `warnings.warn`.
    """
    if (thing, old) not in _told:
        _told.add((thing, old))
        text = f"{thing}: {old} is now called {new}; the old name goes with the next release"
        warnings.warn(text, FutureWarning, stacklevel=stacklevel)


def with_new_names(thing: str, given: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Named values with old names turned into new ones.

    Args:
        thing: class or function that they are given to.
        given: the values by name.
        names: old names and the new ones.

    Raises:
        ModelError: a value is given under both names.
    """
    found = dict(given)
    for old in given.keys() & names.keys():
        new = names[old]
        if new in given:
            raise ModelError(f"{thing}: {old} is the old name of {new}, got both; give {new} alone")
        warn_renamed(thing, old, new, stacklevel=4)
        found[new] = found.pop(old)
    return found


def renamed_options(**names: str) -> Callable[[CallT], CallT]:
    """A decorator of a function whose keyword options have new names (old=new)."""

    def decorate(function: CallT) -> CallT:
        @functools.wraps(function)
        def call(*args: Any, **options: Any) -> Any:
            if options.keys() & names.keys():
                options = with_new_names(function.__name__, options, names)
            return function(*args, **options)

        return call  # type: ignore[return-value]

    return decorate


def renamed_fields(**names: str) -> Callable[[ClassT], ClassT]:
    """A decorator of a class whose fields have new names (old=new): they are read as arguments and as attributes.

    Raises:
        AttributeError: (of the decorated class) neither an old nor a new name is asked for.
    """

    def decorate(cls: ClassT) -> ClassT:
        made = cls.__init__  # type: ignore[misc]

        @functools.wraps(made)
        def init(self: Any, *args: Any, **options: Any) -> None:
            if options.keys() & names.keys():
                options = with_new_names(cls.__name__, options, names)
            made(self, *args, **options)

        def missing(self: Any, name: str) -> Any:
            if name not in names:
                raise AttributeError(f"{cls.__name__!r} object has no attribute {name!r}", name=name, obj=self)
            warn_renamed(cls.__name__, name, names[name])
            return getattr(self, names[name])

        cls.__init__ = init  # type: ignore[misc]
        cls.__getattr__ = missing  # type: ignore[attr-defined]
        setattr(cls, RENAMED, dict(names))
        return cls

    return decorate


def renamed_names(module: str, **names: str) -> Callable[[str], Any]:
    """The `__getattr__` of a module some of whose names are new (old=new)."""

    def missing(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}", name=name)
        warn_renamed(module, name, names[name])
        return getattr(sys.modules[module], names[name])

    return missing
