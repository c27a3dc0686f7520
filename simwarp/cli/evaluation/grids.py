"""From ``--grid KEY=a,b,c`` to the configurations it stands for."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeVar

from simwarp.cli import UsageError, shortened
from simwarp.tasks import Range, Sensing, TaskConfig
from simwarp.tasks.framework.config_values import plain_value

if TYPE_CHECKING:
    from simwarp.train.evaluation.grid import GridPoint

ConfigT = TypeVar("ConfigT")

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
        refuse_twice(key, words)
        axes[key] = words
    count = math.prod(map(len, axes.values()))
    if count > MOST_POINTS:
        raise UsageError(f"--grid has {count} points, at most {MOST_POINTS} are evaluated; give fewer values")
    return axes


def refuse_twice(key: str, values: Sequence[str]) -> None:
    """Refuse values of a key that are the same."""
    twice = next((value for value, count in Counter(values).items() if count > 1), None)
    if twice is not None:
        raise UsageError(f"--grid {shortened(key)} has the value {shortened(twice)} twice: leave one away")


def grid_points(
    texts: Sequence[str], base: TaskConfig, parse: Callable[[list[str]], TaskConfig], level: float = 1.0
) -> list[GridPoint]:
    """Return every combination of the values of some grids; one point without values where there are none.

    The key ``level`` stands for the curriculum's, unless the task has a field of that name.

    Args:
        texts: of ``--grid``.
        base: the configuration without them.
        parse: returns the configuration with further words of the command line, so that values are typed and checked
            like those of any other option.
        level: of the curriculum where no grid has it.

    Raises:
        UsageError: a text is wrong, or one of its values.
        InputError: a level is none.
    """
    from simwarp.train.evaluation.grid import LEVEL, GridPoint

    axes = grid_axes(texts)
    if not axes:
        return [GridPoint({}, base, level)]
    keys = list(axes)
    levels = axes.pop(LEVEL, None) if field_of(base, LEVEL) is None else None
    if "obs" in axes:
        raise UsageError("--grid obs: a policy knows one kind of observations; evaluate once per policy, with --obs")
    for key in axes:
        whole = named_of(base, key) and key.count(".") == 1 and not key.startswith("randomise.")
        check_single(key, Sensing() if whole else field_of(base, key))

    def words_of(key: str, word: str) -> list[str]:
        if named_of(base, key):
            return [f"--task.{key}={word}"]  # no option: `with_named` makes one of all of its kind
        return option_words(f"task.{key}", word, field_of(base, key), f"--grid {key}")

    points = combinations(axes, words_of, lambda words: parse(with_named(words, base)), field_of, value_for_json)
    if levels is None:
        return [GridPoint(values, config, level) for values, config in points]
    wanted = [level_of(f"--grid {LEVEL}", word) for word in levels]
    refuse_twice(LEVEL, [f"{each:g}" for each in wanted])
    pairs = [(each, point) for each in wanted for point in points]
    if keys[0] != LEVEL:
        pairs = [(each, point) for point in points for each in wanted]
    return [
        GridPoint({key: each if key == LEVEL else values[key] for key in keys}, config, each)
        for each, (values, config) in pairs
    ]


def level_of(told: str, word: str | float) -> float:
    """Return a level of a curriculum.

    Raises:
        UsageError: it is no number.
        InputError: it is not in [0, 1].
    """
    from simwarp.tasks.framework.argument_checks import checked_level

    try:
        level = float(word)
    except ValueError:
        raise UsageError(f"{told} must be a number in [0, 1], got '{shortened(str(word))}'") from None
    checked_level(told, level)
    return level


def named_of(config: TaskConfig, key: str) -> bool:
    """Return True if a key reaches into settings by name: ``sensing.camera.delay``, ``randomise.body_mass``."""
    field, dot, _ = key.partition(".")
    return bool(dot) and isinstance(getattr(config, field, None), Mapping)


def with_named(words: Sequence[str], base: TaskConfig) -> list[str]:
    """Return words of the command line in which settings by name are one JSON object for each of their fields.

    ``--task.sensing.camera.delay=0 1`` changes one value of what the configuration has; a range without the name of a
    value, ``--task.randomise.body_mass=1.2``, is held at it.

    Args:
        words: of the command line.
        base: the configuration without them.
    """
    usual: list[str] = []
    named: dict[str, dict[str, dict[str, Any]]] = {}
    for word in words:
        key, _, value = word.removeprefix("--task.").partition("=")
        if not named_of(base, key):
            usual.append(word)
            continue
        field, name, *inner = key.split(".", 2)
        settings = named.setdefault(field, plain_value({at: entry_of(it) for at, it in getattr(base, field).items()}))
        entry = settings.setdefault(name, {})
        if inner:
            entry[inner[0]] = _json_value(value)
        else:
            entry |= {"low": _json_value(value), "high": _json_value(value)}
    return usual + [f"--task.{field}={json.dumps(settings)}" for field, settings in named.items()]


def entry_of(settings: Any) -> dict[str, Any]:
    """Return the fields of settings by name."""
    return {field.name: getattr(settings, field.name) for field in dataclasses.fields(settings)}


def _json_value(word: str) -> Any:
    """Return a word as JSON has it: a number, several of them, or text."""
    values: list[Any] = []
    for part in word.split():
        try:
            values.append(json.loads(part))
        except ValueError:
            values.append(part)
    return values[0] if len(values) == 1 else values


def combinations(
    axes: Mapping[str, Sequence[str]],
    words_of: Callable[[str, str], list[str]],
    parse: Callable[[list[str]], ConfigT],
    read: Callable[[ConfigT, str], Any],
    told: Callable[[Any], Any] = plain_value,
) -> list[tuple[dict[str, Any], ConfigT]]:
    """Return the values, as JSON has them, and the configuration of every combination.

    Args:
        axes: words of each key.
        words_of: returns the words of the command line for a key and one of its words.
        parse: returns the configuration with further words of the command line.
        read: returns the value of a key in a configuration.
        told: returns a value as it is told.

    Raises:
        UsageError: a value is wrong, or stands there twice.
    """
    points = []
    for words in itertools.product(*axes.values()):
        found = parse([part for key, word in zip(axes, words, strict=True) for part in words_of(key, word)])
        points.append(({key: told(read(found, key)) for key in axes}, found))
    for index, (key, written) in enumerate(axes.items()):  # 0.1 and 0.10 are two words for one value
        stride = math.prod(len(other) for other in list(axes.values())[index + 1 :])
        refuse_twice(key, [str(values[key]) for values, _ in points[::stride][: len(written)]])
    return points


def value_for_json(value: Any) -> Any:
    """Return a value of a grid's key as JSON has it; several numbers are one text, as on the command line."""
    if isinstance(value, Range):
        return value.low
    return " ".join(map(str, value)) if isinstance(value, tuple) else plain_value(value)


def check_single(key: str, value: Any) -> None:
    """Refuse fields of the task that are neither numbers nor a word, nor settings of one name.

    Raises:
        UsageError: it is one.
    """
    if isinstance(value, Mapping):
        remedy = f"{key}.NAME.FIELD=a,b,c" + (f" or {key}.NAME=a,b,c" if key == "randomise" else "")
        raise UsageError(f"--grid {key}: takes one value of one of them, {remedy}")
    if not isinstance(value, Range):
        check_field(f"--grid {key}", key, value)


def check_field(told: str, key: str, value: Any) -> None:
    """Refuse a key that stands for several fields.

    Raises:
        UsageError: it does.
    """
    if dataclasses.is_dataclass(value):
        inner = ", ".join(f"{key}.{field.name}" for field in dataclasses.fields(value))
        raise UsageError(f"{told}: name one of its fields: {inner}")


def option_words(name: str, word: str, value: Any, told: str) -> list[str]:
    """Return the words that give an option its value; one that is on or off takes none, a list one word per item.

    Args:
        name: of the field, dots between owners: ``task.hills``.
        word: its value, as it was written.
        value: one that it has, for its type.
        told: what errors call it: ``--grid hills``.

    Raises:
        UsageError: the value of a field that is on or off is neither.
    """
    *owners, last = name.replace("_", "-").split(".")
    prefix = "".join(f"{owner}." for owner in owners)
    if isinstance(value, tuple) or (isinstance(value, int | float) and " " in word):
        return [f"--{prefix}{last}", *word.split()]
    if not isinstance(value, bool):
        return [f"--{prefix}{last}={word}"]
    if word.lower() not in _YES_NO:
        raise UsageError(f"{told} must be true or false, got '{shortened(word)}'")
    return [f"--{prefix}{last}" if _YES_NO[word.lower()] else f"--{prefix}no-{last}"]


def field_of(config: Any, key: str) -> Any:
    """Return a field, ``curriculum.up`` reaching into another; None if there is none."""
    for part in key.split("."):
        if isinstance(config, Mapping):
            config = config.get(part)
            continue
        fields = dataclasses.fields(config) if dataclasses.is_dataclass(config) else ()
        # an underscore at the end of a name keeps it from a keyword
        name = next((field.name for field in fields if field.name.removesuffix("_") == part.removesuffix("_")), None)
        config = None if name is None else getattr(config, name)
    return config
