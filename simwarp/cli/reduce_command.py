"""``simwarp reduce VEHICLE``."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Annotated

import tyro
from rich.box import SIMPLE_HEAD
from rich.table import Table

from simwarp.cli import DONE, UsageError
from simwarp.cli.options import CommonOptions, parse_options, require_subject, split_subject
from simwarp.model.model import resolve_device
from simwarp.vehicle.reduced.reduced_construction import tables_of
from simwarp.vehicle.reduced.reduction import COLUMNS, ROWS, reduce_vehicle
from simwarp.vehicle.spec.parts import SpecError, merged
from simwarp.vehicle.spec.tabulated_suspension import REDUCED
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import save_vehicle, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.tracks.tracked_files import load_any_vehicle


@dataclasses.dataclass(frozen=True)
class ReduceOptions(CommonOptions):
    """Measures the suspensions of a vehicle and writes a reduced one of fourteen degrees of freedom.

    Its chassis moves on four wheels by tables of their places, angles, springs and dampers over travel and steering.
    """

    output: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint=f"(default: VEHICLE{REDUCED}.json)")
    ] = None
    """Writes the reduced vehicle to this file, .json; also -o."""
    rows: int = ROWS
    """Travels of the tables, at least 3."""
    columns: int = COLUMNS
    """Steerings of the tables, an odd number from 3 on."""
    powertrain: str | None = None
    """Another one of the vehicle's options, or a JSON file."""
    driveline: str | None = None
    """Another one of the vehicle's options, or a JSON file."""
    tire: str | None = None
    """Another one of the vehicle's options, or a JSON file."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""


def run(arguments: list[str]) -> int:
    """Reduce as the arguments say."""
    known, usage = vehicle_names(), "usage: simwarp reduce VEHICLE [options]"
    vehicles = f"vehicles: {', '.join(known)}"
    overview = f"{usage}\n\n{vehicles}, or a JSON file\n\n`simwarp reduce VEHICLE --help` lists the options."
    word, rest = split_subject(arguments, known.__contains__)
    name = require_subject(word, arguments, overview, f"which vehicle? {usage}; {vehicles}")
    options = parse_options(ReduceOptions, ["--output" if w == "-o" else w for w in rest], f"simwarp reduce {name}")
    if options.output is not None and options.output.suffix != ".json":
        raise UsageError(f"--output must end in .json, got '{options.output}'")
    options.check(*([name] if name.endswith(".json") else []), output=options.output)
    spec = load_any_vehicle(name)
    if isinstance(spec, TrackedVehicleSpec):
        raise SpecError(f"'{spec.name}' has tracks, and no suspensions that are reduced; take a vehicle on wheels")
    spec = with_options(spec, tire=options.tire, powertrain=options.powertrain, driveline=options.driveline)
    device = str(resolve_device(None if options.device == "auto" else options.device))
    begin = time.perf_counter()
    reduced = reduce_vehicle(spec, rows=options.rows, columns=options.columns, device=device)
    output = Path(f"{reduced.name}.json") if options.output is None else options.output
    save_vehicle(reduced, output)
    console = options.console()
    parameters = summary(reduced)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading in ("", "front", "rear"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for key in parameters[0]:
        table.add_row(key, *(f"{axle[key]:.4g}" for axle in parameters))
    console.print(f"{reduced.name}: {whole_mass(reduced):.5g} kg", style="bold", highlight=False, soft_wrap=True)
    console.print(table)
    console.print(f"wrote {output}", highlight=False, markup=False, soft_wrap=True)
    options.emit(
        {
            "vehicle": spec.name, "reduced": reduced.name, "file": str(output), "mass_kg": whole_mass(reduced),
            "parameters": parameters, "wall_s": time.perf_counter() - begin,
        }
    )  # fmt: skip
    return DONE


def whole_mass(reduced: VehicleSpec) -> float:
    """Of the vehicle with its tires [kg]."""
    mass, _, _ = merged(reduced.chassis.components)
    return mass + sum(2.0 * axle.tire.mass for axle in reduced.axles)


def summary(reduced: VehicleSpec) -> list[dict[str, float]]:
    """Of each axle what its tables begin and end with."""
    axles = []
    for axle in reduced.axles:
        suspension, tire = tables_of(axle), axle.tire
        middle, straight = len(suspension.travel) // 2, len(suspension.steering) // 2
        load = [row[straight] for row in suspension.left.spring_load]
        step = suspension.travel[middle + 1] - suspension.travel[middle - 1]
        axles.append(
            {
                "standing travel [mm]": 1e3 * suspension.standing,
                "travel down [mm]": 1e3 * (suspension.travel[0] - suspension.standing),
                "travel up [mm]": 1e3 * (suspension.travel[-1] - suspension.standing),
                "spring load [N]": load[middle],
                "wheel rate [N/mm]": 1e-3 * (load[middle + 1] - load[middle - 1]) / step,
                "moving mass [kg]": suspension.left.mass + tire.mass,
                "anti-roll bar [N·m/rad]": suspension.bar_stiffness,
            }
        )
    return axles
