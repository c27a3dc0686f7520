"""From ``--grid KEY=a,b,c`` to the configurations it stands for."""

from __future__ import annotations

import dataclasses
import enum
import itertools
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from simwarp.cli import UsageError, shortened
from simwarp.core.renames import RENAMED, with_new_names
from simwarp.tasks import TaskConfig

if TYPE_CHECKING:
    from simwarp.train.evaluation.grid import GridPoint

_YES_NO = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


MOST_POINTS: Final = 1000
"""Of a grid: each of them is evaluated."""


def grid_axes(texts: Sequence[str]) -> dict[str, list[str]]:
    """Return the words of each key of ``KEY=a,b,c`` texts.

    Raises:
        UsageError: a text is no such thing, a key or a value stands there twice, or there are too many points.
    """
    axes: dict[str, list[str]] = {}
    for text in texts:
        key, equals, values = text.partition("=")
        key = key.strip().replace("-", "_")
        words = [word.strip() for word in values.split(",")]
        if not (equals and all(part.isidentifier() for part in key.split(".")) and all(words)):
            raise UsageError(f"--grid wants KEY=a,b,c, got '{shortened(text)}'")
        if key in axes:
            raise UsageError(f"--grid has the key {shortened(key)} twice: give all its values at once, KEY=a,b,c")
        _refuse_twice(key, words)
        axes[key] = words
    count = math.prod(map(len, axes.values()))
    if count > MOST_POINTS:
        raise UsageError(f"--grid has {count} points, at most {MOST_POINTS} are evaluated; give fewer values")
    return axes


def _refuse_twice(key: str, values: Sequence[Any]) -> None:
    twice = next((value for value, count in Counter(values).items() if count > 1), None)
    if twice is not None:
        raise UsageError(f"--grid {shortened(key)} has the value {shortened(str(twice))} twice: leave one away")


def grid_points(texts: Sequence[str], base: TaskConfig, parse: Callable[[list[str]], TaskConfig]) -> list[GridPoint]:
    """Return every combination of the values of some grids; one point without values where there are none.

    Args:
        texts: of ``--grid``.
        base: the configuration without them.
        parse: returns the configuration with further words of the command line, so that values are typed and checked
            like those of any other option.

    Raises:
        UsageError: a text is wrong, or one of its values.
    """
    from simwarp.train.evaluation.grid import GridPoint

    axes = with_new_names("--grid", grid_axes(texts), getattr(base, RENAMED, {}))
    if not axes:
        return [GridPoint({}, base)]
    if "obs" in axes:
        raise UsageError("--grid obs: a policy knows one kind of observations; evaluate once per policy, with --obs")
    for key in axes:
        _check_single(key, _field(base, key))
    points = []
    for words in itertools.product(*axes.values()):
        config = parse([_option(key, word, base) for key, word in zip(axes, words, strict=True)])
        points.append(GridPoint({key: _plain(_field(config, key)) for key in axes}, config))
    for index, (key, written) in enumerate(axes.items()):  # 0.1 and 0.10 are two words for one value
        stride = math.prod(len(other) for other in list(axes.values())[index + 1 :])
        _refuse_twice(key, [point.values[key] for point in points[::stride][: len(written)]])
    return points


def _check_single(key: str, value: Any) -> None:
    """Refuse fields that are no number and no word: commas stand between the values of a grid.

    Raises:
        UsageError: it is one.
    """
    if dataclasses.is_dataclass(value):
        inner = ", ".join(f"{key}.{field.name}" for field in dataclasses.fields(value))
        raise UsageError(f"--grid {key}: name one of its fields: {inner}")
    if isinstance(value, Mapping | tuple):
        option = f"--task.{key.replace('_', '-')}"
        raise UsageError(f"--grid {key}: takes fields that are one number or word; evaluate once per value of {option}")


def _option(key: str, word: str, base: TaskConfig) -> str:
    """Return the word that gives a field of the task its value; a field that is on or off takes none."""
    *owners, name = ["task", *key.replace("_", "-").split(".")]
    owner = ".".join(owners)
    if not isinstance(_field(base, key), bool):
        return f"--{owner}.{name}={word}"
    if word.lower() not in _YES_NO:
        raise UsageError(f"--grid {key} must be true or false, got '{shortened(word)}'")
    return f"--{owner}.{name}" if _YES_NO[word.lower()] else f"--{owner}.no-{name}"


def _field(config: Any, key: str) -> Any:
    """Return a field, ``curriculum.up`` reaching into another; None if there is none."""
    for part in key.split("."):
        known = dataclasses.is_dataclass(config) and part in {field.name for field in dataclasses.fields(config)}
        config = getattr(config, part) if known else None
    return config


def _plain(value: Any) -> Any:
    return value.value if isinstance(value, enum.Enum) else value
