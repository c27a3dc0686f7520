"""Vehicles from files and by name, and back into files.

A file mirrors the dataclasses of `simwarp.vehicle.spec`: their field names are the keys, tuples are lists, and where
several templates are possible the key "template" chooses. Any value may be `{"file": "other.json"}`, relative to the
file it stands in (a .tir file gives the object of its keys). A key "$schema", for editors, is left out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from simwarp.core import files
from simwarp.core.schema import Fault, Keys, Place
from simwarp.core.types import formatted
from simwarp.core.wording import nearest, shortened
from simwarp.vehicle.spec.parts import SPECS, Spec, SpecError
from simwarp.vehicle.spec.vehicle_spec import Tire, VehicleSpec
from simwarp.vehicle.tires.parameter_vector import check_tire
from simwarp.vehicle.tires.tire_files import PropertyFileError, TirValues, parse_tir

DATA: Final = Path(__file__).parents[1] / "data"
"""The shipped vehicles: NAME.json, with their options in folders of the same name."""

TRACKED: Final = DATA / "tracked"
"""The shipped tracked vehicles, likewise."""

REDUCED: Final = DATA / "reduced"
"""The shipped reduced vehicles, likewise."""

MOST_FILES: Final = 100
"""Files that one vehicle may be made of: a few that name each other many times would never come to an end."""

TAGS: Final = ("template", "track")
"""Keys that choose among several classes: they are written though they hold their default."""

S = TypeVar("S", bound=Spec)


def vehicle_names() -> list[str]:
    """Names of the shipped vehicles."""
    return sorted(path.stem for path in DATA.glob("*.json"))


def reduced_vehicle_names() -> list[str]:
    """Names of the shipped reduced vehicles, such as hmmwv-14dof."""
    return sorted(path.stem for path in REDUCED.glob("*.json"))


def load_vehicle(path_or_name: str | Path) -> VehicleSpec:
    """The vehicle of a file, or the shipped one of that name.

    Raises:
        SpecError: unknown name, unreadable file, or a value that breaks a rule.
    """
    names = [*vehicle_names(), *reduced_vehicle_names()]
    if path_or_name in {path.stem for path in TRACKED.glob("*.json")}:
        raise SpecError(f"vehicle {formatted(path_or_name)}: has tracks; load it by load_tracked_vehicle")
    return read_spec(VehicleSpec, shipped_or_own("vehicle", names, path_or_name))


def shipped_or_own(kind: str, names: Sequence[str], path_or_name: str | Path) -> Path:
    """A path, or that of the shipped vehicle of one of the names; `kind` is what errors call it.

    Raises:
        SpecError: there is none of that name.
    """
    text = str(path_or_name)
    if not isinstance(path_or_name, str) or text.endswith(".json") or "/" in text or "\\" in text:
        return Path(path_or_name)
    if text not in names:
        raise SpecError(f"{kind} {formatted(text)}: not shipped{nearest(text, names)}; known: {', '.join(names)}")
    return next(path for path in (folder / f"{text}.json" for folder in (DATA, REDUCED, TRACKED)) if path.is_file())


def read_spec(cls: type[S], path: str | Path) -> S:
    """The description of type `cls` in a file."""
    made: S = read_value(cls, path)
    return made


def read_value(hint: Any, path: str | Path) -> Any:
    """A value of any hint (a union of templates, say) in a file.

    Raises:
        SpecError: it does not fit; names the file, which may be another one that the first led to, and the key.
    """
    source = Source(Path(path))
    made = SPECS.load(hint, source.value, source.line)
    for keys, tire in _tires_in(made):
        try:
            check_tire(tire)
        except PropertyFileError:
            raise
        except SpecError as error:
            raise SpecError(source.line(Fault(keys, str(error), "check"))) from None
    return made


def _tires_in(spec: Any) -> Iterator[tuple[Keys, Tire]]:
    """The tires of a description, and where they stand in it."""
    if isinstance(spec, Tire):
        yield (), spec
    if isinstance(spec, VehicleSpec):
        for index, axle in enumerate(spec.axles):
            yield ("axles", index, "tire"), axle.tire
        for number, trailer in enumerate(spec.trailers):
            for index, axle in enumerate(trailer.axles):
                yield ("trailers", number, "axles", index, "tire"), axle.tire


class Source:
    """A file, and those that it leads to.

    Attributes:
        value: what they hold together.
    """

    def __init__(self, path: Path) -> None:
        self._places: dict[Keys, Place] = {(): Place(path.name, SpecError)}
        self._opened = 0
        self.value = self._followed(read_json(path), path, (), (path.resolve(),))

    def line(self, fault: Fault) -> str:
        """A fault in one line, with the file that its value stands in and the key path in there."""
        start = next(n for n in range(len(fault.keys), -1, -1) if fault.keys[:n] in self._places)
        return self._places[fault.keys[:start]].line(fault._replace(keys=fault.keys[start:]))

    def _error(self, keys: Keys, rule: str) -> SpecError:
        return SpecError(self.line(Fault(keys, rule)))

    def _followed(self, value: Any, path: Path, keys: Keys, chain: tuple[Path, ...]) -> Any:
        """A value with all values in it that stand in other files."""
        while isinstance(value, dict) and set(value) == {"file"}:
            path, chain = self._next(value["file"], path, (*keys, "file"), chain)
            self._places[keys] = Place(path.name, SpecError)
            value = read_json(path)
        if isinstance(value, TirValues):
            return value
        if isinstance(value, dict):
            if keys in self._places:
                value.pop("$schema", None)
            return {key: self._followed(item, path, (*keys, key), chain) for key, item in value.items()}
        if isinstance(value, list):
            return [self._followed(item, path, (*keys, index), chain) for index, item in enumerate(value)]
        return value

    def _next(
        self, name: object, path: Path, keys: Keys, chain: tuple[Path, ...]
    ) -> tuple[Path, tuple[Path, ...]]:  # fmt: skip
        """The file that a value names, and the chain of files that led there."""
        if not isinstance(name, str):
            raise self._error(keys, f"must be the path of a file, got {formatted(name)}")
        beside = path.parent / name
        try:
            resolved = files.check_input(beside).resolve()
        except files.FileError as error:
            rule = f"must be a file beside {path.name}, found none at {formatted(name)}: {error.reason}"
            raise self._error(keys, rule) from None
        if resolved in chain:
            raise self._error(keys, f"must not lead back to a file that led here, got {formatted(name)}")
        self._opened += 1
        if self._opened > MOST_FILES:
            raise self._error(keys, f"must not lead to more than {MOST_FILES} files in all; write values out")
        return beside, (*chain, resolved)


def read_text(path: Path) -> str:
    """The text of a file, or an error that says why not."""
    try:
        return files.read_text(path)
    except files.FileError as error:
        raise SpecError(f"{shortened(path)}: cannot be read: {error.reason}") from None


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


# ---- to JSON ---------------------------------------------------------------------------------------------------------


def save_vehicle(spec: VehicleSpec, path: str | Path) -> None:
    """Write a vehicle to one file; `load_vehicle` gives back an equal one."""
    files.write_file(path, to_json(spec))


def to_json(spec: Spec) -> str:
    """The text of a description, without the fields that hold their default."""
    return files.layout(plain(spec)) + "\n"


def plain(value: Any) -> Any:
    """Dictionaries and lists of a description."""
    if isinstance(value, Spec):
        members = {}
        for field in dataclasses.fields(value):
            item = getattr(value, field.name)
            default = field.default_factory() if callable(field.default_factory) else field.default
            if field.name in TAGS or item != default:
                members[field.name] = plain(item)
        return members
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    return value
