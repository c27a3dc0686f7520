"""``simwarp trim VEHICLE``."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import tyro
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from simwarp.cli import DONE, UsageError, shortened
from simwarp.cli.options import CommonOptions, parse_options, require_subject, split_subject
from simwarp.model.model import resolve_device
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_files import save_vehicle, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.stances import ROLLING_SPEED, AxleStance, Stance, stance
from simwarp.vehicle.suspensions.alignment import free_length, tierod_length
from simwarp.vehicle.tracks.tracked_files import load_any_vehicle
from simwarp.vehicle.trimming import DESIGN, LARGEST_ANGLE, STOP_KEYS, trim

KEEP: Final = "keep"
"""In a list, of an axle that is to stay as it is."""
AS_IT_IS: Final = "(default: as it is)"
NO_FILE: Final = "(default: none is written)"
NEGATIVE: Final = re.compile(r"-[\d.]")
ANGLES: Final = ("toe", "camber")


@dataclasses.dataclass(frozen=True)
class TrimOptions(CommonOptions):
    """Shows how a vehicle stands and rolls; with a wish, finds springs and tie rods for it and writes a new vehicle.

    A value is for all axles that can be adjusted; or one per axle from the front, with commas between, `keep` for an
    axle that is to stay as it is, such as `--toe 0.1,keep`. Every wheel stands on a plate that slides freely.
    """

    ride_height: Annotated[str | None, tyro.conf.arg(metavar="m[,m]", help_behavior_hint=AS_IT_IS)] = None
    """Of the vehicle's frame of reference above the ground at the wheels; `design`: where the wheels stand as they are
    built. Sets the free lengths of springs."""
    toe: Annotated[str | None, tyro.conf.arg(metavar="deg[,deg]", help_behavior_hint=AS_IT_IS)] = None
    """Positive where the wheels' fronts point inwards. Sets the lengths of tie rods."""
    camber: Annotated[str | None, tyro.conf.arg(metavar="deg[,deg]", help_behavior_hint=AS_IT_IS)] = None
    """Positive where the wheels' tops lean outwards. Sets the seats of the spindles in the uprights."""
    move_stops: tyro.conf.FlagCreatePairsOff[bool] = False
    """Moves stops of springs (min_length, max_length) that are in the way of the ride height asked for."""
    output: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint=NO_FILE)] = None
    """Writes the trimmed vehicle to this file, .json; also -o."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""

    @property
    def wishes(self) -> dict[str, str]:
        """What is asked for, as it was written."""
        values = {key: getattr(self, key) for key in ("ride_height", *ANGLES)}
        return {key: value for key, value in values.items() if value is not None}


def run(arguments: list[str]) -> int:
    """Show or trim as the arguments say."""
    known, usage = vehicle_names(), "usage: simwarp trim VEHICLE [options]"
    vehicles = f"vehicles: {', '.join(known)}"
    overview = f"{usage}\n\n{vehicles}, or a JSON file\n\n`simwarp trim VEHICLE --help` lists the options."
    word, rest = split_subject(arguments, known.__contains__)
    name = require_subject(word, arguments, overview, f"which vehicle? {usage}; {vehicles}")
    options = parse_options(TrimOptions, _plain(rest), f"simwarp trim {name}")
    wishes = {key: _values(key, text) for key, text in options.wishes.items()}
    _check(name, options)
    device = str(resolve_device(None if options.device == "auto" else options.device))
    spec = _vehicle(name)
    console = options.table_console()
    trimmed = trim(spec, **wishes, move_stops=options.move_stops, device=device) if wishes else spec
    before = _states(spec, device)
    if not wishes:
        _print_states(console, spec, [before])
        options.emit({"vehicle": spec.name, "before": _content(before), "after": None, "parameters": [], "file": None})
        return DONE
    after = _states(trimmed, device)
    parameters = changed(spec, trimmed)
    _print_states(console, trimmed, [before, after])
    _print_parameters(console, parameters)
    if options.output is not None:
        save_vehicle(trimmed, options.output)
        console.print(f"wrote {options.output}", highlight=False, markup=False, soft_wrap=True)
    file = None if options.output is None else str(options.output)
    options.emit(
        {
            "vehicle": spec.name, "before": _content(before), "after": _content(after), "parameters": parameters,
            "file": file,
        }
    )  # fmt: skip
    return DONE


def changed(before: VehicleSpec, after: VehicleSpec) -> list[dict[str, Any]]:
    """Parameters of the axles that a trim changed: axle, name, value before and after, unit."""
    found = []
    for index, (old, new) in enumerate(zip(before.all_axles, after.all_axles, strict=True)):
        rows: list[tuple[str, float | None, float | None, str]] = [
            ("tie rod", tierod_length(old.suspension), tierod_length(new.suspension), "m")
        ]
        springs = (getattr(old.suspension, "springs", ()), getattr(new.suspension, "springs", ()))
        lines = list(zip(*springs, strict=True))
        rows += [
            (f"free length of spring {number}", free_length(line), free_length(other), "m")
            for number, (line, other) in enumerate(lines)
        ]
        rows += [
            (f"{key} of spring {number}", getattr(line, key), getattr(other, key), "m")
            for number, (line, other) in enumerate(lines)
            for key in STOP_KEYS.values()
        ]
        for key in ANGLES:
            values = [math.degrees(getattr(axle.suspension, key, 0.0)) for axle in (old, new)]
            rows.append((f"{key} as built", values[0], values[1], "deg"))
        found += [
            {"axle": index, "name": name, "before": value, "after": other, "unit": unit}
            for name, value, other, unit in rows
            if value is not None and value != other
        ]
    return found


def _plain(arguments: Sequence[str]) -> list[str]:
    """Arguments with -o as --output, and with values that begin with a minus sign held to their options."""
    words: list[str] = []
    for word in arguments:
        if words and words[-1] in ("--toe", "--camber", "--ride-height") and NEGATIVE.match(word):
            words[-1] = f"{words[-1]}={word}"
        else:
            words.append("--output" if word == "-o" else word)
    return words


def _values(key: str, text: str) -> Any:
    """One value for all axles, or a list; angles in radians.

    Raises:
        UsageError: one is no number.
    """
    parts = text.split(",")
    found = [_value(key, part.strip()) for part in parts]
    if len(parts) > 1:
        return found
    if found[0] is None:
        raise UsageError(f"{_option(key)} must not be '{KEEP}' alone, which changes nothing; leave it away")
    return found[0]


def _value(key: str, word: str) -> float | str | None:
    if word == KEEP:
        return None
    if word == DESIGN and key not in ANGLES:
        return word
    try:
        number = float(word)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        kinds = f"an angle [deg] or '{KEEP}'" if key in ANGLES else f"a height [m], '{DESIGN}' or '{KEEP}'"
        raise UsageError(f"{_option(key)} must be {kinds}, got '{shortened(word)}'")
    if key not in ANGLES:
        return number
    if abs(number) > math.degrees(LARGEST_ANGLE):
        raise UsageError(f"{_option(key)} must be within {math.degrees(LARGEST_ANGLE):.3g} degrees, got {word}")
    return math.radians(number)


def _option(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def _check(name: str, options: TrimOptions) -> None:
    """Refuse what cannot work, before any work is done."""
    options.check(*([name] if name.endswith(".json") else []), output=options.output)
    if options.move_stops and options.ride_height is None:
        raise UsageError("--move-stops needs a height to move them for: give --ride-height")
    if options.output is None:
        return
    if options.output.suffix != ".json":
        raise UsageError(f"--output must end in .json, got '{options.output}'")
    if not options.wishes:
        raise UsageError("--output needs something to trim: give --ride-height, --toe or --camber")


def _vehicle(name: str) -> VehicleSpec:
    """A vehicle on wheels."""
    spec = load_any_vehicle(name)
    if isinstance(spec, TrackedVehicleSpec):
        raise SpecError(f"'{spec.name}' has tracks, and no toe or camber to trim; take a vehicle on wheels")
    return spec


def _states(spec: VehicleSpec, device: str) -> tuple[Stance, Stance]:
    """Standing and rolling."""
    return stance(spec, device=device), stance(spec, speed=ROLLING_SPEED, device=device)


def _print_states(console: Console, spec: VehicleSpec, states: Sequence[tuple[Stance, Stance]]) -> None:
    """A column per axle; where there are two states, one before and one after."""
    console.print(spec.name, style="bold", highlight=False, soft_wrap=True)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("", no_wrap=True)
    columns = []
    for index in range(len(spec.all_axles)):
        for (standing, rolling), when in zip(states, ("before", "after"), strict=False):
            heading = f"axle {index}" if len(states) == 1 else f"axle {index}\n{when}"
            table.add_column(heading, justify="right")
            columns.append(_column(standing.axles[index], rolling.axles[index]))
    for row in zip(*(column.items() for column in columns), strict=True):
        table.add_row(row[0][0], *(value for _, value in row))
    console.print(table)


def _column(standing: AxleStance, rolling: AxleStance) -> dict[str, str]:
    """What is printed of an axle."""
    return {
        "ride height [m]": f"{standing.ride_height:.4f}",
        "wheels over design [mm]": _number(1e3 * standing.travel, 1),
        "springs [mm]": _springs(standing),
        "  of free length [mm]": _free(standing),
        "stops": _stops(standing),
        "toe [deg]": _number(math.degrees(standing.toe), 3),
        "camber [deg]": _number(math.degrees(standing.camber), 3),
        "wheel load [N]": f"{standing.load:.0f}",
        "rolling: toe [deg]": _number(math.degrees(rolling.toe), 3),
        "rolling: force inwards [N]": _number(rolling.side_force, 0),
    }


def _number(value: float, digits: int) -> str:
    """A number without the sign of a zero."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def _springs(axle: AxleStance) -> str:
    return ", ".join(f"{1e3 * line.length:.1f}" for line in axle.lines if line.free_length) or "none"


def _free(axle: AxleStance) -> str:
    return ", ".join(f"{1e3 * line.free_length:.1f}" for line in axle.lines if line.free_length) or "-"


def _stops(axle: AxleStance) -> str:
    """Stops that are run into, and how far."""
    return ", ".join(f"{line.stop} {1e3 * line.into_stop:.1f} mm" for line in axle.lines if line.stop) or "free"


def _print_parameters(console: Console, parameters: Sequence[dict[str, Any]]) -> None:
    if not parameters:
        console.print("it stands as asked for: nothing is changed", highlight=False, soft_wrap=True)
        return
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for column in ("axle", "changed", "before", "after", "unit"):
        table.add_column(column, justify="left" if column in ("changed", "unit") else "right")
    for row in parameters:
        table.add_row(str(row["axle"]), row["name"], f"{row['before']:.6f}", f"{row['after']:.6f}", row["unit"])
    console.print(table)


def _content(states: tuple[Stance, Stance]) -> list[dict[str, Any]]:
    """For scripts: a row per axle; lengths in m, angles in degrees, forces in N."""
    standing, rolling = states
    return [
        {
            "axle": index, "ride_height": at_rest.ride_height, "travel": at_rest.travel,
            "toe": math.degrees(at_rest.toe), "camber": math.degrees(at_rest.camber), "load": at_rest.load,
            "tierod": at_rest.tierod, "lines": [dataclasses.asdict(line) for line in at_rest.lines],
            "rolling": {
                "ride_height": on_the_road.ride_height, "toe": math.degrees(on_the_road.toe),
                "camber": math.degrees(on_the_road.camber), "side_force": on_the_road.side_force,
            },
        }
        for index, (at_rest, on_the_road) in enumerate(zip(standing.axles, rolling.axles, strict=True))
    ]  # fmt: skip
