"""``simwarp export-fmu VEHICLE``."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Annotated

import tyro

from simwarp.cli import DONE, UsageError
from simwarp.cli.options import CommonOptions, parse_options, require_subject, split_subject
from simwarp.exporters.vehicle_fmu import fmu_variables, save_fmu
from simwarp.vehicle.results.runs import REFERENCE_DT
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.tracks.tracked_files import all_vehicle_names, load_any_vehicle


@dataclasses.dataclass(frozen=True)
class FmuOptions(CommonOptions):
    """Writes a vehicle as an FMU for co-simulation, FMI 2.0: other tools drive it.

    The machine that imports it needs Python with simwarp; the first run there compiles kernels.
    """

    output: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: VEHICLE.fmu)")
    ] = None  # fmt: skip
    """Writes to this file, .fmu; also -o."""
    tire: str | None = None
    """Another one of the vehicle's options, or a JSON file; force laws on a road."""
    powertrain: str | None = None
    """Another one of the vehicle's options, or a JSON file."""
    driveline: str | None = None
    """Another one of the vehicle's options, or a JSON file."""
    dt: Annotated[float, tyro.conf.arg(metavar="s")] = REFERENCE_DT
    """Time step of the physics; the importing tool may change it."""


def run(arguments: list[str]) -> int:
    """Export as the arguments say."""
    known, usage = all_vehicle_names(), "usage: simwarp export-fmu VEHICLE [options]"
    vehicles = f"vehicles: {', '.join(known)}"
    overview = f"{usage}\n\n{vehicles}, or a JSON file\n\n`simwarp export-fmu VEHICLE --help` lists the options."
    word, rest = split_subject(arguments, known.__contains__)
    name = require_subject(word, arguments, overview, f"which vehicle? {usage}; {vehicles}")
    options = parse_options(FmuOptions, ["--output" if w == "-o" else w for w in rest], f"simwarp export-fmu {name}")
    if options.output is not None and options.output.suffix != ".fmu":
        raise UsageError(f"--output must end in .fmu, got '{options.output}'")
    if not (math.isfinite(options.dt) and 0.0 < options.dt <= 0.05):
        raise UsageError(f"--dt must be above 0 and at most 0.05 s for a vehicle, got {options.dt:g}")
    output = options.output or Path(f"{Path(name).stem}.fmu")
    options.check(*([name] if name.endswith(".json") else []), output=output)
    spec = load_any_vehicle(name)
    if isinstance(spec, VehicleSpec):
        spec = with_options(spec, tire=options.tire, powertrain=options.powertrain, driveline=options.driveline)
        if any(axle.tire.template == "soil-rigid" for axle in spec.all_axles):
            raise UsageError("--tire: must be driven on a road, got tires on soil; leave out --tire soil-rigid")
    else:
        if options.tire is not None:
            raise UsageError(f"--tire: '{spec.name}' has tracks; leave it out")
        spec = with_options(spec, powertrain=options.powertrain, driveline=options.driveline)
    save_fmu(spec, output, dt=options.dt)
    variables = fmu_variables(spec, options.dt)
    named = {kind: [each.name for each in variables if each.causality == kind] for kind in KINDS}
    console = options.console()
    for kind, names in named.items():
        console.print(f"{kind}s: {', '.join(names)}", highlight=False, markup=False, soft_wrap=True)
    console.print(f"wrote {output}", highlight=False, markup=False, soft_wrap=True)
    options.emit({"vehicle": spec.name, "file": str(output), "dt": options.dt, "variables": named})
    return DONE


KINDS = ("input", "parameter", "output")
"""Of variables."""
