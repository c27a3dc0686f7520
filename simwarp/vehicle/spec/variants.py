"""Other tires, powertrains and drivelines for a vehicle, by name.

They lie beside the shipped vehicles: data/NAME/tires, powertrains and drivelines, one file per option; of those on
tracks, data/tracked/NAME/drivelines. Tires that differ between the axles have a folder for the front, one for the rear
and, for trailers, one of theirs. `hmmwv-reduced` shares those of `hmmwv`: the folder is what stands before the first
dash of a vehicle's name.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, TypeVar

from simwarp.core.types import formatted
from simwarp.core.wording import nearest
from simwarp.vehicle.spec.track_parts import TrackDriveline
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_files import DATA, TRACKED, read_spec, read_value
from simwarp.vehicle.spec.vehicle_spec import Driveline, Engine, Spec, SpecError, Tire, Transmission, VehicleSpec

AnySpec = TypeVar("AnySpec", VehicleSpec, TrackedVehicleSpec)

KINDS = ("tire", "powertrain", "driveline")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Powertrain(Spec):
    """An engine with its transmission: the content of a powertrain's file."""

    engine: Engine
    transmission: Transmission


def folder_of(name: str, kind: str) -> Path:
    """Folder of the options of a kind."""
    family = name.partition("-")[0]
    tracked = TRACKED / family.lower()
    return (tracked if tracked.is_dir() else DATA / family) / f"{kind}s"


def option_names(vehicle: str, kind: str) -> list[str]:
    """Names of the options of a kind ("tire", "powertrain", "driveline") that are shipped for a vehicle."""
    folder = folder_of(vehicle, kind)
    split = folder / "front"
    return sorted(path.stem for path in (split if split.is_dir() else folder).glob("*.json"))


def find(spec: AnySpec, kind: str, option: str, side: str = "") -> Path:
    """The file of an option: one of the shipped, or a path that ends in .json."""
    if option.endswith(".json"):
        return Path(option)
    if option.endswith(".tir"):
        needs = 'template "pacejka2002", mass, inertia, radius, width and "parameters": {"tir": {"file": ...}}'
        raise SpecError(f"{option}: a property file is no whole tire; give a .json file with {needs} that names it")
    known = option_names(spec.name, kind)
    if option not in known:
        listed = ", ".join(known) if known else "none shipped; give the path of a .json file"
        raise SpecError(f"{spec.name}: unknown {kind} {formatted(option)}{nearest(option, known)}; known: {listed}")
    folder = folder_of(spec.name, kind)
    return folder / side / f"{option}.json" if (folder / "front").is_dir() else folder / f"{option}.json"


def with_options(
    spec: AnySpec, *, tire: str | None = None, powertrain: str | None = None, driveline: str | None = None
) -> AnySpec:
    """The vehicle with other parts; each is the name of a shipped option or the path of a .json file.

    Raises:
        SpecError: no such option (the message lists those there are), or a file with a mistake.
    """
    if tire is not None:
        if isinstance(spec, TrackedVehicleSpec):
            raise SpecError(f"tire: '{spec.name}' has tracks and no tires, got {formatted(tire)}; leave it out")
        spec = _with_tires(spec, tire)
    if driveline is not None:
        path = find(spec, "driveline", driveline)
        hint: Any = TrackDriveline if isinstance(spec, TrackedVehicleSpec) else Driveline
        spec = replaced(spec, driveline, driveline=read_value(hint, path))
    if powertrain is not None:
        parts = read_spec(Powertrain, find(spec, "powertrain", powertrain))
        spec = replaced(spec, powertrain, engine=parts.engine, transmission=parts.transmission)
    return spec


def _with_tires(spec: VehicleSpec, tire: str) -> VehicleSpec:
    """Other tires on all axles: those for the front on the first, those for trailers on theirs where there are such."""
    behind = "trailer" if (folder_of(spec.name, "tire") / "trailer").is_dir() else "rear"
    axles = []
    for index, axle in enumerate(spec.all_axles):
        side = behind if index >= len(spec.axles) else "rear" if index else "front"
        axles.append(dataclasses.replace(axle, tire=read_spec(Tire, find(spec, "tire", tire, side))))
    try:
        return spec.with_axles(axles)
    except SpecError as error:
        raise SpecError(f"{Path(tire).name}: {error}") from None


def replaced(spec: AnySpec, option: str, **parts: Any) -> AnySpec:
    """The vehicle with other parts, if they fit; the error names the option that they come from."""
    try:
        return dataclasses.replace(spec, **parts)
    except SpecError as error:
        raise SpecError(f"{Path(option).name}: {error}") from None
