"""Tracked vehicles from files and by name, and back into files (`simwarp.vehicle.spec.vehicle_files`)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from simwarp.core import files
from simwarp.vehicle.spec.track_parts import TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_files import DATA, read_spec, shipped_or_own, to_json

TRACKED: Final = DATA / "tracked"
"""The shipped tracked vehicles: NAME.json."""


def tracked_vehicle_names() -> list[str]:
    """Names of the shipped tracked vehicles."""
    return sorted(path.stem for path in TRACKED.glob("*.json"))


def load_tracked_vehicle(path_or_name: str | Path) -> TrackedVehicleSpec:
    """The tracked vehicle of a file, or the shipped one of that name.

    Raises:
        SpecError: unknown name, unreadable file, or a value that breaks a rule.
    """
    return read_spec(TrackedVehicleSpec, shipped_or_own("tracked vehicle", TRACKED, path_or_name))


def save_tracked_vehicle(spec: TrackedVehicleSpec, path: str | Path) -> None:
    """Writes a tracked vehicle to one file; `load_tracked_vehicle` gives back an equal one."""
    files.write_file(path, to_json(spec))
