"""Vehicles from files and by name, and back into files."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

from simwarp.core import files
from simwarp.vehicle.spec.deserialisation import SourceLocation, build, nearest, read_json, to_json
from simwarp.vehicle.spec.parts import Spec, SpecError, told
from simwarp.vehicle.spec.vehicle_spec import Tire, VehicleSpec
from simwarp.vehicle.tires.parameter_vector import check_tire

DATA = Path(__file__).parents[1] / "data"
"""The shipped vehicles: NAME.json, with their options in folders of the same name."""

S = TypeVar("S", bound=Spec)


def vehicle_names() -> list[str]:
    """Names of the shipped vehicles."""
    return sorted(path.stem for path in DATA.glob("*.json"))


def load_vehicle(path_or_name: str | Path) -> VehicleSpec:
    """The vehicle of a file, or the shipped one of that name.

    Raises:
        SpecError: unknown name, unreadable file, or a value that breaks a rule.
    """
    text = str(path_or_name)
    if isinstance(path_or_name, str) and not text.endswith(".json") and "/" not in text and "\\" not in text:
        names = vehicle_names()
        if text not in names:
            raise SpecError(f"vehicle {told(text)}: not shipped{nearest(text, names)}; known: {', '.join(names)}")
        path_or_name = DATA / f"{text}.json"
    return read_spec(VehicleSpec, path_or_name)


def read_spec(cls: type[S], path: str | Path) -> S:
    """The description of type `cls` in a file."""
    return build(cls, *first_value(path))


def read_value(hint: Any, path: str | Path) -> Any:
    """A value of any hint (a union of templates, say) in a file."""
    return build(hint, *first_value(path))


def first_value(path: str | Path) -> tuple[Any, SourceLocation]:
    """The value in a file that is read by itself, and its place."""
    value = read_json(Path(path))
    checks = {Tire: check_tire}
    return value, SourceLocation(Path(path), chain=(Path(path).resolve(),), checks=checks)


def save_vehicle(spec: VehicleSpec, path: str | Path) -> None:
    """Write a vehicle to one file; `load_vehicle` gives back an equal one."""
    files.write_file(path, to_json(spec))
