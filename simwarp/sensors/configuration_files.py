"""Files of sensors: JSON objects to the frozen configurations of the sensors, by the types of their fields."""

from __future__ import annotations

import collections.abc
import dataclasses
import difflib
import functools
import math
import types
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

from simwarp.core.files import FileError, parse_json, read_text
from simwarp.core.renames import RENAMED, with_new_names
from simwarp.core.types import LONGEST_VALUE, ModelError, shown
from simwarp.sensors.cameras.lenses import FishEye, Lens, Pinhole, Radial
from simwarp.sensors.noise import BiasWalk, BoundedDrift, Noise, NormalNoise, Quantisation, Saturation
from simwarp.sensors.ranging.beams import BeamTable, beam_grid

FAMILIES: Final[dict[Any, dict[str, type]]] = {
    Lens: {"pinhole": Pinhole, "fish-eye": FishEye, "radial": Radial},
    Noise: {
        "normal": NormalNoise, "bias-walk": BiasWalk, "bounded-drift": BoundedDrift, "quantisation": Quantisation,
        "saturation": Saturation,
    },
}  # fmt: skip
"""Fields that take one of several classes: the key "kind" chooses."""

GRID: Final = ("columns", "rows", "azimuth", "elevation")


class Place(NamedTuple):
    """Where a value stands: its file and its key path in there."""

    file: str
    keys: str = ""

    def at(self, key: str | int) -> Place:
        """The place of a member or an item of the value."""
        if isinstance(key, int):
            return Place(self.file, f"{self.keys}[{key}]")
        name = key if len(key) <= LONGEST_VALUE else f"{key[:LONGEST_VALUE]}..."
        return Place(self.file, f"{self.keys}.{name}" if self.keys else name)

    def error(self, what: str) -> ModelError:
        """One line: file, key path, what is wrong."""
        return ModelError(f"{self.file}: {self.keys}: {what}" if self.keys else f"{self.file}: {what}")


def nearest(word: object, known: Iterable[str]) -> str:
    """` (did you mean 'x'?)`, or nothing where no known word is near, or it is none."""
    near = difflib.get_close_matches(word, list(known), n=1) if isinstance(word, str) else []
    return f" (did you mean {near[0]!r}?)" if near else ""


def read_object(path: Path) -> dict[str, Any]:
    """The object in a JSON file.

    Raises:
        ModelError: it cannot be read, is broken, or holds something else.
    """
    try:
        value = parse_json(read_text(path), path.name)
    except FileError as error:
        raise ModelError(f"{path}: cannot be read: {error.reason}" if error.reason else str(error)) from None
    return check_object(value, Place(path.name))


def check_object(value: Any, place: Place) -> dict[str, Any]:
    """An object, or a ModelError."""
    if not isinstance(value, dict):
        raise place.error(f"must be an object, got {shown(value)}")
    return value


def check_keys(value: Mapping[str, Any], known: Iterable[str], place: Place) -> None:
    """No key but those known, or a ModelError."""
    names = list(known)
    for key in value:
        if key not in names:
            raise place.at(key).error(f"unknown key{nearest(key, names)}; known: {', '.join(names)}")


def build(hint: Any, value: Any, place: Place) -> Any:
    """The value as its type hint wants it.

    Raises:
        ModelError: it does not fit.
    """
    if hint in FAMILIES:
        return _build_kind(FAMILIES[hint], value, place)
    if hint is BeamTable:
        return _build_beams(value, place)
    if dataclasses.is_dataclass(hint):
        return build_object(hint, check_object(value, place), place)
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        return _build_union(typing.get_args(hint), value, place)
    if origin is Literal:
        if value not in typing.get_args(hint):
            raise place.error(f"must be one of {', '.join(map(repr, typing.get_args(hint)))}, got {shown(value)}")
        return value
    if origin in (tuple, collections.abc.Sequence):
        return _build_list(typing.get_args(hint), value, place)
    return _build_plain(hint, value, place)


def build_object(cls: Any, value: Mapping[str, Any], place: Place) -> Any:
    """A configuration from an object with its fields."""
    hints = _hints(cls)
    value = with_new_names(place.file, value, getattr(cls, RENAMED, {}))
    check_keys(value, hints, place)
    for field in dataclasses.fields(cls):
        needed = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if needed and field.name not in value:
            raise place.at(field.name).error(f"missing; give {_wanted(hints[field.name])}")
    found = {key: build(hints[key], item, place.at(key)) for key, item in value.items()}
    return made(cls, place, **found)


def made(cls: Any, place: Place, **fields: Any) -> Any:
    """What a class or function makes; its errors get the place in front."""
    try:
        return cls(**fields)
    except ModelError as error:
        raise place.error(str(error)) from None


@functools.cache
def _hints(cls: Any) -> dict[str, Any]:
    """Resolved type of every field."""
    hints = typing.get_type_hints(cls)
    return {field.name: hints[field.name] for field in dataclasses.fields(cls)}


def _build_kind(classes: Mapping[str, type], value: Any, place: Place) -> Any:
    """One of several classes by the key "kind"."""
    members = dict(check_object(value, place))
    if "kind" not in members:
        raise place.at("kind").error(f"missing; give one of {', '.join(classes)}")
    kind = members.pop("kind")
    if not isinstance(kind, str) or kind not in classes:
        raise place.at("kind").error(f"must be one of {', '.join(classes)}, got {shown(kind)}{nearest(kind, classes)}")
    return build_object(classes[kind], members, place)


def _build_beams(value: Any, place: Place) -> BeamTable:
    """A grid of `columns` and `rows` (their ends, or all the rows' elevations), or tables of both angles."""
    members = check_object(value, place)
    if "columns" not in members and "rows" not in members:
        if set(members) == {"azimuth", "elevation"}:
            table: BeamTable = made(BeamTable, place, **members)
            return table
        raise place.error("needs columns, rows and elevation (a grid), or tables of azimuth and elevation")
    check_keys(members, GRID, place)
    for key in ("columns", "rows", "elevation"):
        if key not in members:
            raise place.at(key).error(f"missing; a grid has {', '.join(GRID)}")
    counts = {key: build(int, members[key], place.at(key)) for key in ("columns", "rows")}
    angles = {
        key: build(tuple[float, ...], members[key], place.at(key)) for key in ("azimuth", "elevation") if key in members
    }
    heights = angles["elevation"]
    if len(heights) not in (2, counts["rows"]):
        raise place.at("elevation").error(
            f"must be the first and the last row's, or {counts['rows']} angles [rad], got {len(heights)}"
        )
    angles["elevation"] = heights[0], heights[-1]
    grid: BeamTable = made(beam_grid, place, **counts, **angles)
    return grid if len(heights) == 2 else BeamTable(azimuth=grid.azimuth, elevation=heights)


def _build_union(options: tuple[Any, ...], value: Any, place: Place) -> Any:
    """A number or a list of them, or a value that may be null."""
    if value is None and type(None) in options:
        return None
    lists = [option for option in options if typing.get_origin(option) in (tuple, collections.abc.Sequence)]
    others = [option for option in options if option in (float, str) or dataclasses.is_dataclass(option)]
    if lists and (isinstance(value, list) or not others):
        return build(lists[0], value, place)
    return build(others[0], value, place)


def _build_list(items: tuple[Any, ...], value: Any, place: Place) -> tuple[Any, ...]:
    """A list as a tuple, of any length or of a fixed one."""
    endless = len(items) == 1 or items[-1] is Ellipsis
    if not isinstance(value, list) or not (endless or len(value) == len(items)):
        raise place.error(f"must be a list{'' if endless else f' of {len(items)}'}, got {shown(value)}")
    hints = items[:1] * len(value) if endless else items
    return tuple(build(hint, v, place.at(index)) for index, (hint, v) in enumerate(zip(hints, value, strict=True)))


def _build_plain(hint: Any, value: Any, place: Place) -> Any:
    """A number, a whole number, a text or a truth value."""
    kinds: dict[Any, Any] = {float: (int, float), int: int, str: str, bool: bool}
    if not isinstance(value, kinds[hint]) or (isinstance(value, bool) and hint is not bool):
        raise place.error(f"must be {_wanted(hint)}, got {shown(value)}")
    if hint is float and not math.isfinite(value):
        raise place.error(f"must be a finite number, got {shown(value)}")
    return float(value) if hint is float else value


def _wanted(hint: Any) -> str:
    """What a field wants, in words."""
    keys: Any = _hints
    plain = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
    if hint in plain:
        return plain[hint]
    if hint is BeamTable:
        return f"an object with {', '.join(GRID)}"
    if dataclasses.is_dataclass(hint):
        return f"an object with {', '.join(keys(hint))}"
    return "a number or a list of them" if float in typing.get_args(hint) else "a value"
