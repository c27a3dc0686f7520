"""Tracked vehicles from files and by name, and back into files (`simwarp.vehicle.spec.vehicle_files`)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from simwarp.core import files
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec, with_belts
from simwarp.vehicle.spec.vehicle_files import (
    TRACKED,
    load_vehicle,
    read_json,
    read_spec,
    reduced_vehicle_names,
    shipped_or_own,
    to_json,
    vehicle_names,
)

SIDES: Final = frozenset({"left", "right"})
"""Keys that only files of tracked vehicles have."""


ON_BELTS: Final = "-belt"
"""Ends the names of shipped vehicles with belts in the place of their chains."""


def tracked_vehicle_names() -> list[str]:
    """Names of the shipped tracked vehicles, shoe by shoe and, with one pin, on belts."""
    shoes = {path.stem: read_json(path)["left"]["shoe"]["template"] for path in TRACKED.glob("*.json")}
    return sorted([*shoes, *(f"{name}{ON_BELTS}" for name, shoe in shoes.items() if shoe == "track-single-pin")])


def load_tracked_vehicle(path_or_name: str | Path) -> TrackedVehicleSpec:
    """The tracked vehicle of a file, or the shipped one of that name, such as m113 or m113-belt.

    Raises:
        SpecError: unknown name, unreadable file, or a value that breaks a rule.
    """
    chains = str(path_or_name).removesuffix(ON_BELTS)
    if isinstance(path_or_name, str) and chains != path_or_name and (TRACKED / f"{chains}.json").is_file():
        return with_belts(load_tracked_vehicle(chains))
    return read_spec(TrackedVehicleSpec, shipped_or_own("tracked vehicle", tracked_vehicle_names(), path_or_name))


def save_tracked_vehicle(spec: TrackedVehicleSpec, path: str | Path) -> None:
    """Writes a tracked vehicle to one file; `load_tracked_vehicle` gives back an equal one."""
    files.write_file(path, to_json(spec))


def all_vehicle_names() -> list[str]:
    """Names of all shipped vehicles, those on wheels first: what `simwarp drive` and `simwarp view` know."""
    return [*vehicle_names(), *reduced_vehicle_names(), *tracked_vehicle_names()]


def load_any_vehicle(path_or_name: str | Path) -> AnyVehicleSpec:
    """The vehicle of a file or name, on wheels or tracks; a file with the keys "left" and "right" has tracks.

    Raises:
        SpecError: unknown name, unreadable file, or a value that breaks a rule.
    """
    if isinstance(path_or_name, str) and path_or_name in tracked_vehicle_names():
        return load_tracked_vehicle(path_or_name)
    path = shipped_or_own("vehicle", all_vehicle_names(), path_or_name)
    return load_tracked_vehicle(path) if is_tracked_file(path) else load_vehicle(path)


def is_tracked_file(path: Path) -> bool:
    """True if a file describes a tracked vehicle; False for one that cannot be read."""
    try:
        content = read_json(path)
    except SpecError:
        return False
    return isinstance(content, dict) and content.keys() >= SIDES
