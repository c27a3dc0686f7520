"""How a run of `simwarp drive` is named: in titles, in files, and in errors of its options."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Protocol

from simwarp.cli import UsageError
from simwarp.cli.drive.drive_road import Patch
from simwarp.vehicle.assessment.entry_speed import asked_speed
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.runs import REFERENCE_DT, REFERENCE_FRICTION
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import SpecError


class RunOptions(Protocol):
    """Options of a run that name it, those of `simwarp drive`."""

    @property
    def chosen(self) -> dict[str, float]:
        """Of the manoeuvre."""

    @property
    def speed(self) -> float | None:
        """To hold [m/s]."""

    @property
    def soil(self) -> str | None:
        """Below the wheels."""

    @property
    def soil_normal(self) -> str | None:
        """Along which it presses."""

    @property
    def friction(self) -> float:
        """Of the ground."""

    @property
    def friction_patch(self) -> tuple[Patch, ...]:
        """Rectangles with another one."""

    @property
    def road(self) -> str | None:
        """In place of a plane."""

    @property
    def dt(self) -> float:
        """Time step [s]."""


UNITS: Final = {
    "speed": " m/s", "steering": "", "radius": " m", "slope": "", "width": " m", "duration": " s", "brakes": "",
    "left": "", "height": " m", "length": " m", "dwell": " s",
}  # fmt: skip
"""Of the options of manoeuvres."""


@contextlib.contextmanager
def named_options() -> Iterator[None]:
    """Errors of an option of manoeuvres name it as it is written.

    Raises:
        UsageError: in place of a `SpecError` that begins with such an option.
    """
    try:
        yield
    except SpecError as error:
        if str(error).partition(":")[0] in UNITS:
            raise UsageError(f"--{error}") from error
        raise


def title_of_run(spec: AnyVehicleSpec, options: RunOptions, what: Maneuver) -> str:
    """Vehicle and manoeuvre with the speed that it asks for, and what is not as usual."""
    parts = [f"{spec.name}, {what.name}"]
    speed = asked_speed(what)
    if speed == speed and options.speed is None:
        parts.append(f"speed {speed:.4g}{UNITS['speed']}")
    parts += [f"{key} {value:g}{UNITS[key]}" for key, value in options.chosen.items()]
    for kind in ("tire", "powertrain", "driveline"):
        value = getattr(options, kind)
        if value is not None:
            parts.append(f"{kind} {Path(value).stem}")
    if options.soil is not None:
        parts.append(f"soil {options.soil}")
    if options.soil_normal is not None:
        parts.append(f"pressure along the {options.soil_normal}")
    if options.road is not None:
        parts.append(f"road {options.road}")
    if options.friction != REFERENCE_FRICTION:
        parts.append(f"friction {options.friction:g}")
    parts += [f"friction {patch[4]:g} on a patch" for patch in options.friction_patch]
    if options.dt != REFERENCE_DT:
        parts.append(f"dt {1e3 * options.dt:g} ms")
    return ", ".join(parts)


def choices_of_run(spec: AnyVehicleSpec, options: RunOptions) -> dict[str, str]:
    """What was chosen, for files: options of the manoeuvre with their units, parts, ground and step."""
    found = {key: f"{value:g}{UNITS[key]}" for key, value in options.chosen.items()}
    for kind in ("tire", "powertrain", "driveline", "soil", "soil_normal", "road"):
        if getattr(options, kind) is not None:
            found[kind] = str(getattr(options, kind))
    if "tire" not in found and not isinstance(spec, TrackedVehicleSpec):
        found["tire"] = spec.axles[0].tire.template
    patches = [" ".join(f"{value:g}" for value in patch) for patch in options.friction_patch]
    found |= {"friction_patch": ", ".join(patches)} if patches else {}
    return found | {"friction": f"{options.friction:g}", "dt": f"{options.dt:g} s"}
