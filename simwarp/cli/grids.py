"""From ``--grid KEY=a,b,c`` to the configurations it stands for."""

from __future__ import annotations

import enum
import functools
import itertools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from simwarp.cli import UsageError
from simwarp.tasks import TaskConfig

if TYPE_CHECKING:
    from simwarp.train.grid import GridPoint

_YES_NO = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


def grid_axes(texts: Sequence[str]) -> dict[str, list[str]]:
    """Return the words of each key of ``KEY=a,b,c`` texts.

    Raises:
        UsageError: a text is no such thing, or a key or a value stands there twice.
    """
    axes: dict[str, list[str]] = {}
    for text in texts:
        key, equals, values = text.partition("=")
        key = key.strip().replace("-", "_")
        words = [word.strip() for word in values.split(",")]
        if not (equals and key and all(words)):
            raise UsageError(f"--grid wants KEY=a,b,c, got '{text}'")
        if key in axes:
            raise UsageError(f"--grid has the key {key} twice: give all its values at once, {key}=a,b,c")
        twice = next((word for word in words if words.count(word) > 1), None)
        if twice is not None:
            raise UsageError(f"--grid {key} has the value {twice} twice: leave one away")
        axes[key] = words
    return axes


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
    from simwarp.train.grid import GridPoint

    axes = grid_axes(texts)
    if not axes:
        return [GridPoint({}, base)]
    if "obs" in axes:
        raise UsageError("--grid obs: a policy knows one kind of observations; evaluate once per policy, with --obs")
    points = []
    for words in itertools.product(*axes.values()):
        config = parse([_option(key, word, base) for key, word in zip(axes, words, strict=True)])
        points.append(GridPoint({key: _plain(_field(config, key)) for key in axes}, config))
    return points


def _option(key: str, word: str, base: TaskConfig) -> str:
    """Return the word that gives a field of the task its value; a field that is on or off takes none."""
    *owners, name = ["task", *key.replace("_", "-").split(".")]
    owner = ".".join(owners)
    if not isinstance(_field(base, key), bool):
        return f"--{owner}.{name}={word}"
    if word.lower() not in _YES_NO:
        raise UsageError(f"--grid {key} must be true or false, got '{word}'")
    return f"--{owner}.{name}" if _YES_NO[word.lower()] else f"--{owner}.no-{name}"


def _field(config: Any, key: str) -> Any:
    """Return a field, ``curriculum.up`` reaching into another; None if there is none."""
    return functools.reduce(lambda owner, part: getattr(owner, part, None), key.split("."), config)


def _plain(value: Any) -> Any:
    return value.value if isinstance(value, enum.Enum) else value
