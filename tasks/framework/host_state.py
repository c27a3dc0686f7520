"""What a task keeps in Python from step to step: in a captured step it is as it was when the step was captured."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Any, Final

_PLAIN: Final = (bool, int, float, complex, str, bytes, type(None))
_OPAQUE: Final = ("torch", "numpy", "warp", "builtins")
_NO_STATE: Final = (type, types.ModuleType, types.FunctionType, types.MethodType)
_DEEPEST: Final = 6


def state_of(owner: Any) -> dict[str, Any]:
    """Return what an object keeps, by path: numbers and text as they are, everything else by its identity.

    Containers and objects of Python's own are looked into; tensors and arrays are not: their contents may change, since
    a captured step reads the same memory. Attributes that a class names in ``HOST_STATE`` are left out: they are read
    outside of what is captured.
    """
    found: dict[str, Any] = {}
    _collect(owner, "", found, set(), 0)
    return found


def changed_state(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Return the paths of what differs between two calls of :func:`state_of`."""
    names = [*before, *(name for name in after if name not in before)]
    return [name for name in names if name not in before or name not in after or not _same(before[name], after[name])]


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, _PLAIN) and isinstance(second, _PLAIN):
        return type(first) is type(second) and (first == second or first != first)
    return first is second


def _collect(value: Any, path: str, found: dict[str, Any], seen: set[int], depth: int) -> None:
    if isinstance(value, _PLAIN):
        found[path] = value
        return
    if path and not isinstance(value, tuple):
        found[path] = value  # kept alive, so that its identity stays its own
    if id(value) in seen or depth > _DEEPEST:
        return
    seen.add(id(value))
    if isinstance(value, Mapping):
        parts = {f"{path}[{key!r}]": part for key, part in value.items()}
    elif isinstance(value, list | tuple):
        parts = {f"{path}[{index}]": part for index, part in enumerate(value)}
    elif _is_open(value):
        outside = getattr(value, "HOST_STATE", ())
        kept = {name: part for name, part in vars(value).items() if name not in outside}
        parts = {f"{path}.{name}" if path else name: part for name, part in kept.items()}
    else:
        return
    for name, part in parts.items():
        _collect(part, name, found, seen, depth + 1)


def _is_open(value: Any) -> bool:
    """Whether an object's attributes are state of a task: not functions, classes, tensors and arrays."""
    if isinstance(value, _NO_STATE) or not hasattr(value, "__dict__"):
        return False
    return type(value).__module__.partition(".")[0] not in _OPAQUE
