"""The page of `simwarp drive --report`: what was driven, with what vehicle, and what came of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from simwarp.cli.view.vehicle_subject import show_body
from simwarp.core.types import ModelError
from simwarp.core.warp_start import report_compiling
from simwarp.exporters.run_report import Report, number_text, write_report
from simwarp.exporters.standing_sheet import standing_notes, standing_sheet
from simwarp.exporters.vehicle_sheet import vehicle_sheet
from simwarp.model.builder import ModelBuilder
from simwarp.scenery.suspension_visuals import add_suspension_visuals
from simwarp.scenery.vehicle_visuals import has_body
from simwarp.sensors.scene import Visuals
from simwarp.vehicle.assessment.verdict import Verdict
from simwarp.vehicle.assessment.verdicts import passed
from simwarp.vehicle.construction import VehicleParts, add_vehicle
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.drive_plot import run_figure
from simwarp.vehicle.results.run_result import Result
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.stances import Stance, stance
from simwarp.vehicle.tracks.tracked_construction import TrackedVehicleParts, add_tracked_vehicle
from simwarp.viewer.portrait import portrait


@dataclasses.dataclass(frozen=True, kw_only=True)
class Driven:
    """A run that a page is about.

    Attributes:
        title: heading.
        vehicle: its description.
        maneuver: that was driven.
        run: recorded.
        results: its numbers.
        verdicts: rules and whether it kept to them.
        options: of the run as they were given or came by default, text by name.
        broken: True if the vehicle broke down.
        interrupted: True if the run was cut short.
    """

    title: str
    vehicle: AnyVehicleSpec
    maneuver: Maneuver
    run: Run
    results: Sequence[Result]
    verdicts: Sequence[Verdict]
    options: Mapping[str, str]
    broken: bool = False
    interrupted: bool = False


def write_drive_report(driven: Driven, path: Path) -> None:
    """Writes the page of a run.

    Raises:
        FileError: the path cannot be written to.
        OutputError: the disk did not take it.
    """
    end = float(driven.run["t_s"][-1])
    notes = [f"The vehicle broke down at t = {end:.2f} s: a value is not finite."] if driven.broken else []
    notes += [f"Interrupted at t = {end:.2f} s."] if driven.interrupted else []
    with report_compiling():
        stands, trouble = _at_rest(driven.vehicle)
        picture = vehicle_picture(driven.vehicle)
    if stands is not None and not isinstance(driven.vehicle, TrackedVehicleSpec):
        notes += standing_notes(driven.vehicle, stands)
        standing = standing_sheet(driven.vehicle, stands)
    else:
        notes, standing = notes + trouble, []
    report = Report(
        title=driven.title, passed=False if driven.broken else passed(driven.verdicts), verdicts=driven.verdicts,
        results=driven.results, parameters={**driven.options, **_parameters(driven.maneuver)},
        vehicle=vehicle_sheet(driven.vehicle, stands), portrait=picture,
        caption=picture_caption(driven.vehicle), standing=standing, figures=_figures(driven), notes=notes,
    )  # fmt: skip
    write_report(report, path)


def vehicle_picture(spec: AnyVehicleSpec) -> npt.NDArray[np.uint8]:
    """(720, 960, 3) picture of a vehicle as built, with its body; of one that has none of its own, with its links."""
    builder = ModelBuilder()
    parts: VehicleParts | TrackedVehicleParts
    if isinstance(spec, TrackedVehicleSpec):
        parts = add_tracked_vehicle(builder, spec)
    else:
        parts = add_vehicle(builder, spec)
    visuals = Visuals(builder)
    show_body(visuals, parts)
    if isinstance(parts, VehicleParts) and not has_body(parts.spec.name):
        add_suspension_visuals(visuals, parts)
    return portrait(visuals)


def picture_caption(spec: AnyVehicleSpec) -> str:
    """What the picture of a vehicle is made of."""
    if isinstance(spec, TrackedVehicleSpec) or has_body(spec.name):
        return "The vehicle as built."
    size = " × ".join(f"{length:g}" for length in spec.chassis.size)
    return (
        f"The vehicle as built, drawn from its description: a box of chassis.size ({size} m), links, springs and "
        "wheels. Only shipped vehicles have a body."
    )


def _at_rest(spec: AnyVehicleSpec) -> tuple[Stance | None, list[str]]:
    """How a vehicle stands on level ground; None with the reason where it cannot be told."""
    if isinstance(spec, TrackedVehicleSpec):
        return None, []
    try:
        return stance(spec), []
    except (SpecError, ModelError) as error:
        return None, [f"How it stands at rest is not known: {error}."]


def _figures(driven: Driven) -> dict[str, Figure]:
    path = None if driven.maneuver.follow is None else driven.maneuver.follow.paths[0]
    return {"Run": run_figure(driven.run, "", (), path, driven.maneuver)}


def _parameters(what: Maneuver) -> dict[str, str]:
    """What a manoeuvre is made of, where it differs from driving on level ground."""
    found = {
        "duration": number_text(what.duration, "s"),
        "settling before": number_text(what.start, "s"),
    }
    if what.initial_speed:
        found["speed at the start"] = number_text(what.initial_speed, "m/s")
    if what.follow is not None:
        found["speed to hold"] = number_text(what.follow.speed, "m/s")
    if what.slope:
        found["slope, rise per run"] = number_text(what.slope)
    if what.course is not None:
        found["course"] = what.course.standard
    if what.bump is not None:
        found["bump"] = f"{what.bump.height:g} m high, {what.bump.length:g} m long"
    for patch in what.patches:
        found["patch of another friction"] = f"{patch.factor:g} of the road's, x {patch.x[0]:g} to {patch.x[1]:g} m"
    if what.crossing is not None:
        found[what.crossing.kind.value] = f"{what.crossing.size:g} m, {what.crossing.ahead:g} m ahead"
    return found
