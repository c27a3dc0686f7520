"""Numbers in a document of plain values, by paths such as `axles[*].suspension.springs[0].stiffness`.

Items of lists are called by their index, or by their `name` where they have one: `bodies[trunk].mass`. A `*` stands for
any key or item. A table (a list of lists) can be scaled, not set: of pairs (x, y) the second numbers, of a map the last
block.
"""

from __future__ import annotations

import copy
import fnmatch
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, TypeAlias

from simwarp.core.types import formatted
from simwarp.core.wording import suggestions
from simwarp.identify.fit_error import FitError

Keys: TypeAlias = tuple[str | int, ...]

PART: Final = re.compile(r"\.?([^.\[\]]+)|\[([^\[\]]*)\]")
MOST_LISTED: Final = 3
"""Numbers of a list that are listed one by one; longer ones are a table."""


def keys_of(path: str) -> tuple[str, ...]:
    """The words of a path.

    Raises:
        FitError: it is none.
    """
    words, end = [], 0
    while end < len(path):
        found = PART.match(path, end)
        if found is None or (end == 0 and path.startswith(".")):
            raise FitError(f"parameters: {formatted(path)}: must be a path such as bodies[trunk].mass")
        words.append(found[1] if found[1] is not None else found[2])
        end = found.end()
    return tuple(words)


def is_number(value: Any) -> bool:
    """Whether a value is a number of the document."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_scalable(value: Any) -> bool:
    """Whether a value is a number, or a list of nothing but numbers and such lists."""
    if isinstance(value, (list, tuple)):
        return bool(value) and all(map(is_scalable, value))
    return is_number(value)


def numbers_in(document: Any, keys: Keys = ()) -> Iterator[tuple[Keys, Any]]:
    """All numbers, and tables as a whole, with the keys that lead there."""
    if is_number(document) or _is_table(document):
        yield keys, document
    elif isinstance(document, Mapping):
        for key, item in document.items():
            yield from numbers_in(item, (*keys, key))
    elif isinstance(document, (list, tuple)):
        for index, item in enumerate(document):
            yield from numbers_in(item, (*keys, index))


def _is_table(value: Any) -> bool:
    """A list of lists of numbers, or a long list of numbers."""
    if not isinstance(value, (list, tuple)) or not is_scalable(value):
        return False
    return len(value) > MOST_LISTED or any(isinstance(item, (list, tuple)) for item in value)


def path_of(document: Any, keys: Keys) -> str:
    """A path as people write it: items of lists in brackets, by name where no other has it, else by index."""
    text, value = "", document
    for key in keys:
        if isinstance(value, Mapping):
            text += f"{'.' if text else ''}{key}"
        else:
            text += f"[{_called(value, int(key))}]"
        value = value[key]
    return text


def _called(items: Sequence[Any], index: int) -> str:
    names = [_name(item) for item in items]
    name = names[index]
    return name if name and names.count(name) == 1 and not name.isdigit() else str(index)


def _name(item: Any) -> str:
    name = item.get("name") if isinstance(item, Mapping) else None
    return name if isinstance(name, str) else ""


def matches(document: Any, path: str) -> list[Keys]:
    """Keys of everything that a path leads to, in the order of the document.

    Raises:
        FitError: it leads nowhere.
    """
    found: list[tuple[Keys, Any]] = [((), document)]
    for word in keys_of(path):
        found = [picked for keys, value in found for picked in _step(keys, value, word)]
    if not found:
        known = [path_of(document, keys) for keys, _ in numbers_in(document)]
        hint = suggestions(path, known, "`simwarp fit --list TARGET` lists what can be fitted")
        raise FitError(f"parameters: {formatted(path)}: unknown; {hint}")
    return [keys for keys, _ in found]


def _step(keys: Keys, value: Any, word: str) -> list[tuple[Keys, Any]]:
    """Members or items that a word of a path picks."""
    if isinstance(value, Mapping):
        return [((*keys, key), item) for key, item in value.items() if word in (key, "*")]
    if isinstance(value, (list, tuple)):
        return [
            ((*keys, index), item)
            for index, item in enumerate(value)
            if word in ("*", str(index)) or fnmatch.fnmatchcase(_name(item), word)
        ]
    return []


def value_at(document: Any, keys: Keys) -> Any:
    """The value that keys lead to."""
    for key in keys:
        document = document[key]
    return document


def replaced(document: Any, changes: Mapping[Keys, Any]) -> Any:
    """A copy of a document with other values; parts that do not change are the same objects."""
    made = document
    for keys, value in changes.items():
        made = _with(made, keys, value)
    return made


def _with(document: Any, keys: Keys, value: Any) -> Any:
    if not keys:
        return value
    made: Any = copy.copy(document) if isinstance(document, dict) else list(document)
    made[keys[0]] = _with(document[keys[0]], keys[1:], value)
    return made


def scaled(value: Any, factor: float) -> Any:
    """A number, list or table times a factor: of pairs (x, y) the second, of other rows all, of a map the block."""
    if is_number(value):
        return float(value) * factor
    if not any(isinstance(item, (list, tuple)) for item in value):
        return [float(item) * factor for item in value]
    if all(isinstance(item, (list, tuple)) and len(item) == 2 and all(map(is_number, item)) for item in value):
        return [[item[0], float(item[1]) * factor] for item in value]
    if all(isinstance(item, (list, tuple)) and all(map(is_number, item)) for item in value):
        return [[float(number) * factor for number in item] for item in value]
    *places, block = value
    return [*places, [[float(item) * factor for item in row] for row in block]]


def patch_of(before: Any, after: Any) -> Any:
    """What of a document differs from another one, as nested keys; lists that differ are whole."""
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        return {key: patch_of(before.get(key), item) for key, item in after.items() if item != before.get(key)}
    return after
