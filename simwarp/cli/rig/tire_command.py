"""``simwarp rig tire``."""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path
from typing import Annotated, Any, Final

import tyro

from simwarp.cli import UsageError
from simwarp.cli.options import parse_options
from simwarp.cli.rig.rig_options import RigOptions, finish, print_table, progress_bar, wheeled_vehicle
from simwarp.core.files import read_json
from simwarp.vehicle.rigs.rig_plots import draw_tires
from simwarp.vehicle.rigs.rig_rows import RigRows, joined_rows
from simwarp.vehicle.rigs.standing_loads import standing_loads
from simwarp.vehicle.rigs.suspension_rig import checked_axle
from simwarp.vehicle.rigs.tire_rig import TireCurves, TireSweep, rig_vector, run_tire_rig
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import read_spec
from simwarp.vehicle.spec.vehicle_spec import Tire

SHARES: Final = (0.5, 1.0, 1.5)
"""Of the load of the standing vehicle's wheel: usual loads."""


@dataclasses.dataclass(frozen=True)
class TireOptions(RigOptions):
    """Forces of one or several tires on a flat road, of a vehicle's axle or of a tire's JSON file.

    Axes are those of ISO 8855 at the contact point: X ahead, Y to the left, Z upwards, forces of the road on the tire.
    """

    tires: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...", help_behavior_hint="(default: its own)")] = ()
    """Tires over each other: names that are shipped for the vehicle, or JSON files."""
    axle: int = 0
    """Of the vehicle, from the front."""
    loads: Annotated[
        tuple[float, ...], tyro.conf.arg(metavar="N ...", help_behavior_hint="(default: 0.5, 1, 1.5 of the standing)")
    ] = ()
    """Vertical forces."""
    inclinations: Annotated[tuple[float, ...], tyro.conf.arg(metavar="deg ...")] = (0.0,)
    """Positive where the wheel's top leans to the right."""
    speeds: Annotated[tuple[float, ...], tyro.conf.arg(metavar="m/s ...")] = (20.0,)
    """Of the wheel's centre."""
    slip: float = 0.6
    """Largest slip ratio, in both directions."""
    angle: Annotated[float, tyro.conf.arg(metavar="deg")] = 15.0
    """Largest slip angle, in both directions."""
    combined: Annotated[tuple[float, ...], tyro.conf.arg(metavar="deg ...")] = (2.0, 6.0)
    """Slip angles of further sweeps of the slip ratio."""
    points: int = 61
    """Of each curve."""
    friction: Annotated[
        float | None, tyro.conf.arg(help_behavior_hint="(default: that on which each tire was measured)")
    ] = None
    """Of the road."""


def run_tire(target: str, arguments: list[str]) -> int:
    """Measure tires and write what was asked for."""
    options = parse_options(TireOptions, arguments, f"simwarp rig tire {target or 'NAME'}")
    options.refuse(target, *options.tires)
    if options.friction is not None and not options.friction > 0.0:
        raise UsageError(f"friction must be > 0, got {options.friction:g}")
    tires, loads = _tires(target, options)
    sweep = TireSweep(
        loads=loads, inclinations=tuple(map(math.radians, options.inclinations)), speeds=options.speeds,
        slip=options.slip, angle=math.radians(options.angle), points=options.points,
        combined_angles=tuple(map(math.radians, options.combined)), friction=options.friction,
    )  # fmt: skip
    sweep.check()
    for tire in tires.values():
        rig_vector(tire)
    console = options.console()
    begin, curves, interrupted = time.perf_counter(), dict[str, TireCurves](), False
    try:
        for name, tire in tires.items():
            with options.shared(), progress_bar(f"tire {name}") as progress:
                curves[name] = run_tire_rig(tire, sweep, device=options.device_name, progress=progress)
            if curves[name].interrupted:
                interrupted = True
                break
    except KeyboardInterrupt:
        if not curves:
            raise
        interrupted = True
    wall = time.perf_counter() - begin
    parameters = [{"tire": name, **entry} for name, found in curves.items() for entry in found.parameters()]
    _print(console, parameters)
    if options.plot is not None:
        draw_tires(curves, options.plot, f"tires of {target}")
        console.print(f"wrote {options.plot}", highlight=False, soft_wrap=True)
    rows = joined_rows([_rows(name, found) for name, found in curves.items()])
    content = {"rig": "tire", "target": target, "parameters": parameters}
    return finish(console, options, rows, content, interrupted=interrupted, wall=wall)


def _rows(name: str, curves: TireCurves) -> RigRows:
    return joined_rows([curves.longitudinal.rows(name), curves.lateral.rows(name)])


def _tires(target: str, options: TireOptions) -> tuple[dict[str, Tire], tuple[float, ...]]:
    """Tires by name, and loads.

    Raises:
        UsageError: a file of a tire comes without loads.
        SpecError: there is no such vehicle, tire or axle.
    """
    if _is_tire(target):
        files = (target, *(name for name in options.tires if name != target))
        if not options.loads:
            raise UsageError(
                "--loads must be given with the file of a tire, which has no load of its own, such as --loads 4000"
            )
        return {Path(name).stem: read_spec(Tire, name) for name in files}, options.loads
    spec = wheeled_vehicle(target, "tire")
    own = checked_axle(spec, options.axle).tire
    tires = {name: with_options(spec, tire=name).all_axles[options.axle].tire for name in options.tires}
    found = {Path(name).stem: tire for name, tire in tires.items()} or {own.template: own}
    if options.loads:
        return found, options.loads
    spec.require_linkages("the load of its standing wheels, in the place of --loads,")
    with progress_bar(f"{spec.name} at rest"):
        standing = float(standing_loads(spec, device=options.device_name).wheel_load[options.axle])
    return found, tuple(share * standing for share in SHARES)


def _is_tire(target: str) -> bool:
    """Whether a word is the file of a tire, not of a vehicle."""
    if not target.endswith(".json") or not Path(target).is_file():
        return False
    content = read_json(target, target)
    return isinstance(content, dict) and "axles" not in content and "radius" in content


def _print(console: Any, parameters: list[dict[str, Any]]) -> None:
    """A table for every tire, with a column for every load, inclination and speed."""
    for tire in dict.fromkeys(entry["tire"] for entry in parameters):
        entries = [entry for entry in parameters if entry["tire"] == tire]
        rows = [
            [key, *(f"{entry[key]:.4g}" for entry in entries)] for key in entries[0] if key not in ("tire", "load_N")
        ]
        print_table(console, [tire, *(f"{entry['load_N']:.5g} N" for entry in entries)], rows)
