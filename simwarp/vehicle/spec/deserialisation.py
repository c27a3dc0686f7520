"""JSON to the descriptions of `simwarp.vehicle.spec` and back.

A file mirrors the dataclasses: their field names are the keys, tuples are lists, and where several templates are
possible the key "template" chooses. Any value may be `{"file": "other.json"}`, relative to the file it stands in
(a .tir file gives the object of its keys). Every mistake is one `SpecError` that names file and key.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import json
import math
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Literal, TypeAlias, TypeVar

from simwarp.core import files
from simwarp.vehicle.spec.parts import LARGEST, Spec, SpecError, told
from simwarp.vehicle.tires.tire_files import TirValues, parse_tir

MOST_FILES: Final = 100
"""Files that one vehicle may be made of: a few that name each other many times would never come to an end."""

S = TypeVar("S", bound=Spec)
Check: TypeAlias = "Callable[[Any, SourceLocation], None]"


@dataclasses.dataclass(frozen=True)
class SourceLocation:
    """Where a value stands.

    Attributes:
        file: its file.
        keys: its key path in there.
        chain: files that led to it.
        opened: all files that the reading has opened so far; its places share them.
        checks: what else to hold a description to once it is made, by its class.
    """

    file: Path
    keys: str = ""
    chain: tuple[Path, ...] = ()
    opened: list[Path] = dataclasses.field(default_factory=list, compare=False)
    checks: Mapping[Any, Check] = dataclasses.field(default_factory=dict, compare=False)

    def at(self, key: str | int) -> SourceLocation:
        """The place of a member or an item of the value."""
        if isinstance(key, int):
            return dataclasses.replace(self, keys=f"{self.keys}[{key}]")
        name = told_path(key)
        return dataclasses.replace(self, keys=f"{self.keys}.{name}" if self.keys else name)

    def error(self, what: str) -> SpecError:
        """One line: file, key path, what is wrong."""
        where = f"{self.file.name}: {self.keys}" if self.keys else self.file.name
        return SpecError(f"{where}: {what}")


def nearest(word: str, known: Iterable[str]) -> str:
    """` (did you mean 'x'?)`, or nothing where no known word is near."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""


def told_path(text: str | Path) -> str:
    """A path or a key in an error: its beginning, if it is long."""
    return str(text) if len(str(text)) <= 200 else f"{str(text)[:100]}..."


# ---- files -----------------------------------------------------------------------------------------------------------


def read_text(path: Path) -> str:
    """The text of a file, or an error that says why not."""
    try:
        return files.read_text(path)
    except files.FileError as error:
        raise SpecError(f"{told_path(path)}: cannot be read: {error.reason}") from None


def parse_json(text: str, name: str) -> Any:
    """The value of a JSON text; errors name line and column."""
    try:
        return files.parse_json(text, name)
    except files.FileError as error:
        raise SpecError(str(error)) from None


def read_json(path: Path) -> Any:
    """The value in a JSON file, or the keys of a .tir file."""
    text = read_text(path)
    return parse_tir(text, path.name) if path.suffix == ".tir" else parse_json(text, path.name)


def follow(value: Any, place: SourceLocation) -> tuple[Any, SourceLocation]:
    """The value that `{"file": ...}` stands for, and its place."""
    while isinstance(value, dict) and set(value) == {"file"}:
        if not isinstance(value["file"], str):
            raise place.at("file").error(f"must be the path of a file, got {told(value['file'])}")
        path = place.file.parent / value["file"]
        try:
            resolved = files.check_input(path).resolve()
        except files.FileError as error:
            rule = f"must be a file beside {place.file.name}, found none at {told(value['file'])}: {error.reason}"
            raise place.at("file").error(rule) from None
        if resolved in place.chain:
            raise place.at("file").error(f"must not lead back to a file that led here, got {told(value['file'])}")
        place.opened.append(resolved)
        if len(place.opened) > MOST_FILES:
            raise place.at("file").error(f"must not lead to more than {MOST_FILES} files in all; write values out")
        place = dataclasses.replace(place, file=path, keys="", chain=(*place.chain, resolved))
        value = read_json(path)
    return value, place


# ---- from JSON -------------------------------------------------------------------------------------------------------


@functools.cache
def hints_of(cls: type) -> dict[str, Any]:
    """Resolved type of every field."""
    hints = typing.get_type_hints(cls)
    return {field.name: hints[field.name] for field in dataclasses.fields(cls)}


def build(hint: Any, value: Any, place: SourceLocation) -> Any:
    """The value as its type hint wants it.

    Raises:
        SpecError: it does not fit.
    """
    value, place = follow(value, place)
    origin = typing.get_origin(hint)
    if isinstance(hint, type) and issubclass(hint, Spec):
        return build_spec(hint, value, place)
    if origin in (typing.Union, types.UnionType):
        return build_union(typing.get_args(hint), value, place)
    if origin is Literal:
        options = typing.get_args(hint)
        if not isinstance(value, str) or value not in options:
            near = nearest(value, map(str, options)) if isinstance(value, str) else ""
            raise place.error(f"must be one of {', '.join(map(repr, options))}, got {told(value)}{near}")
        return value
    if origin is tuple:
        return build_tuple(hint, value, place)
    if origin is dict:
        if not isinstance(value, dict):
            raise place.error(f"must be an object, got {told(value)}")
        return raw(value, place)
    return build_plain(hint, value, place)


def build_spec(cls: type[S], value: Any, place: SourceLocation) -> S:
    """A description from an object with its fields."""
    if not isinstance(value, dict):
        raise place.error(f"must be an object with the keys of {cls.__name__}, got {told(value)}")
    hints = hints_of(cls)  # type: ignore[arg-type]  # a class is hashable
    for key in value:
        if key not in hints:
            raise place.at(key).error(f"unknown key{nearest(key, hints)}; known: {', '.join(hints)}")
    found = {key: build(hints[key], item, place.at(key)) for key, item in value.items()}
    for field in dataclasses.fields(cls):
        needed = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if needed and field.name not in found:
            raise place.at(field.name).error(f"missing; give {wanted(hints[field.name], field.name)}")
    try:
        made = cls(**found)
    except SpecError as error:
        key, _, rule = str(error).partition(": ")
        raise place.at(key).error(rule) from None
    check = place.checks.get(cls)
    if check is not None:
        check(made, place)
    return made


def build_union(options: tuple[Any, ...], value: Any, place: SourceLocation) -> Any:
    """One of several templates by the key "template", or a value that may be null."""
    if value is None and type(None) in options:
        return None
    options = tuple(option for option in options if option is not type(None))
    if len(options) == 1:
        return build(options[0], value, place)
    classes: dict[str, Any] = {template_of(option): option for option in options}
    if not isinstance(value, dict):
        raise place.error(f"must be an object with a template, got {told(value)}; templates: {', '.join(classes)}")
    if "template" not in value:
        raise place.at("template").error(f"missing; give one of {', '.join(classes)}")
    template = value["template"]
    if not isinstance(template, str) or template not in classes:
        near = nearest(template, classes) if isinstance(template, str) else ""
        raise place.at("template").error(f"must be one of {', '.join(classes)}, got {told(template)}{near}")
    return build(classes[template], value, place)


def template_of(cls: type[Spec]) -> str:
    """The name by which files choose a class."""
    return str(next(field.default for field in dataclasses.fields(cls) if field.name == "template"))


def build_tuple(hint: Any, value: Any, place: SourceLocation) -> tuple[Any, ...]:
    """A list as a tuple, of any length or of a fixed one."""
    items = typing.get_args(hint)
    if not isinstance(value, (list, tuple)):
        raise place.error(f"must be {wanted(hint, last_key(place))}, got {told(value)}")
    if len(items) == 2 and items[1] is Ellipsis:
        return tuple(build(items[0], item, place.at(index)) for index, item in enumerate(value))
    if len(value) != len(items):
        raise place.error(f"must be {wanted(hint, last_key(place))}, got {told(value)}")
    return tuple(build(item, v, place.at(index)) for index, (item, v) in enumerate(zip(items, value, strict=True)))


def build_plain(hint: Any, value: Any, place: SourceLocation) -> Any:
    """A number, a whole number, a text or a truth value."""
    kinds: dict[Any, Any] = {float: (int, float), int: int, str: str, bool: bool}
    if not isinstance(value, kinds[hint]) or (isinstance(value, bool) and hint is not bool):
        raise place.error(f"must be {wanted(hint, last_key(place))}, got {told(value)}")
    if hint is not float:
        return value
    if not math.isfinite(value):
        raise place.error(f"must be a finite number, got {told(value)}")
    return float(value)


def raw(value: Any, place: SourceLocation) -> Any:
    """A value without a type: lists become tuples, files are followed."""
    value, place = follow(value, place)
    if isinstance(value, TirValues):
        return value
    if isinstance(value, dict):
        return {key: raw(item, place.at(key)) for key, item in value.items()}
    if isinstance(value, list):
        return tuple(raw(item, place.at(index)) for index, item in enumerate(value))
    if isinstance(value, float) and not math.isfinite(value):
        raise place.error(f"must be a finite number, got {told(value)}")
    if isinstance(value, (int, float)) and abs(value) > LARGEST:
        raise place.error(f"must be below {LARGEST:g}, got {told(value)}")
    return value


# ---- words for what is wanted ----------------------------------------------------------------------------------------

UNITS = {
    "mass": "kg", "radius": "m", "width": "m", "length": "m", "stiffness": "N/m", "damping": "N·s/m", "angle": "rad",
    "torque": "N·m", "limit": "N·m", "speed": "rad/s", "power": "W", "camber": "rad", "toe": "rad", "height": "m",
    "wheelbase": "m", "offset": "m",
}  # fmt: skip
"""By the last word of a key."""


def last_key(place: SourceLocation) -> str:
    """The name of the innermost member."""
    return place.keys.rsplit(".", 1)[-1].split("[")[0]


def wanted(hint: Any, key: str) -> str:
    """What a field wants, in words with its unit."""
    args = typing.get_args(hint)
    if typing.get_origin(hint) is tuple and args == (float, float, float):
        if key.endswith("inertia"):
            return "moments of inertia (Ixx, Iyy, Izz) [kg·m²]"
        if key == "products":
            return "products of inertia (Ixy, Ixz, Iyz) [kg·m²]"
        if "axis" in key:
            return "a direction (x, y, z)"
        return "a point (x, y, z) [m]"
    if typing.get_origin(hint) is tuple:
        return f"a list of {len(args)} items" if Ellipsis not in args else "a list"
    if hint is float:
        last = key.rsplit("_", 1)[-1]
        unit = "kg·m²" if last == "inertia" else UNITS.get(last)
        return f"a number [{unit}]" if unit else "a number"
    if isinstance(hint, type) and issubclass(hint, Spec):
        return f"an object with the keys of {hint.__name__}"
    names = {int: "a whole number", str: "a text", bool: "true or false"}
    options = [option for option in args if isinstance(option, type) and issubclass(option, Spec)]
    if options:
        return "an object with a template: " + ", ".join(template_of(option) for option in options)
    return names.get(hint, "a value")


# ---- to JSON ---------------------------------------------------------------------------------------------------------


def to_json(spec: Spec) -> str:
    """The text of a description, without the fields that hold their default."""
    return layout(plain(spec)) + "\n"


def plain(value: Any) -> Any:
    """Dictionaries and lists of a description."""
    if isinstance(value, Spec):
        members = {}
        for field in dataclasses.fields(value):
            item = getattr(value, field.name)
            default = field.default_factory() if callable(field.default_factory) else field.default
            if field.name == "template" or item != default:
                members[field.name] = plain(item)
        return members
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    return value


def layout(value: Any, indent: str = "") -> str:
    """JSON with lists of plain values on one line, for files that people edit."""
    inner = indent + "  "
    short = json.dumps(value, ensure_ascii=False)
    if not isinstance(value, (dict, list)) or (isinstance(value, list) and len(short) + len(inner) <= 116):
        flat = not isinstance(value, list) or not any(isinstance(item, dict) for item in value)
        if flat or not value:
            return short
    if isinstance(value, dict):
        if not value:
            return short
        lines = [f"{inner}{json.dumps(key)}: {layout(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    return "[\n" + ",\n".join(inner + layout(item, inner) for item in value) + f"\n{indent}]"
