"""``simwarp rig full-car``."""

from __future__ import annotations

import dataclasses
import enum
import math
import time
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console

from simwarp.cli import UsageError
from simwarp.cli.options import parse_options
from simwarp.cli.rig.rig_options import (
    RigOptions,
    finish,
    print_table,
    print_values,
    progress_bar,
    wheeled_vehicle,
)
from simwarp.vehicle.rigs.four_post import (
    PostMode,
    RoadSweep,
    SineSweep,
    run_four_post,
    run_four_post_roads,
)
from simwarp.vehicle.rigs.full_car_plots import draw_responses, draw_roads, draw_tilt
from simwarp.vehicle.rigs.post_rig import SLIDING
from simwarp.vehicle.rigs.rig_rows import RigRows, RowStatus, count_of
from simwarp.vehicle.rigs.tilt_table import run_tilt_table
from simwarp.vehicle.roads.road_profiles import ROAD_CLASSES, RoadClass
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec


class FullCarTest(enum.Enum):
    """What is done with the vehicle."""

    SINE = "sine"
    ROAD = "road"
    TILT = "tilt"


@dataclasses.dataclass(frozen=True)
class FullCarOptions(RigOptions):
    """A vehicle on a post for each wheel: sines (transfer functions), roads of ISO 8608, or a tilt table.

    Every frequency, road or angle is a world of one batch.
    """

    test: FullCarTest = FullCarTest.SINE
    """Sines of the posts, roads, or a tilt table."""
    tire: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="(default: the vehicle's own)")] = None
    """Other tires: a name that is shipped for the vehicle, or a JSON file."""
    modes: tuple[PostMode, ...] = (PostMode.HEAVE, PostMode.PITCH)
    """Of the sines: all posts alike, the first axle's against those behind, left against right."""
    low: Annotated[float, tyro.conf.arg(metavar="Hz")] = 0.5
    """Lowest frequency."""
    high: Annotated[float, tyro.conf.arg(metavar="Hz")] = 20.0
    """Highest frequency."""
    points: int = 21
    """Frequencies of a mode, or angles of the table."""
    amplitude: Annotated[float, tyro.conf.arg(metavar="m")] = 0.005
    """Of the sines, as far as 0.1 m/s allow."""
    grip: float = SLIDING
    """Of posts that move, over that of a tire's usual road: little lets patches slide aside as rolling wheels do, much
    holds them."""
    roads: tuple[RoadClass, ...] = ROAD_CLASSES
    """Classes of the roads."""
    speeds: Annotated[tuple[float, ...], tyro.conf.arg(metavar="m/s ...")] = (15.0,)
    """Over the roads."""
    duration: Annotated[float, tyro.conf.arg(metavar="s")] = 20.0
    """Of the drive over a road."""
    seed: int = 0
    """Of the roads."""
    angle: Annotated[
        float | None, tyro.conf.arg(metavar="deg", help_behavior_hint="(default: 115 % of a rigid vehicle's)")
    ] = None
    """Largest angle of the table."""
    dt: Annotated[float, tyro.conf.arg(metavar="s")] = 1.0e-3
    """Time step."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a test of the vehicle gave: rows, parameters, and what draws them."""

    rows: RigRows
    parameters: Any
    draw: Any


def run_full_car(target: str, arguments: list[str]) -> int:
    """Put a vehicle on posts and write what was asked for."""
    options = parse_options(FullCarOptions, arguments, f"simwarp rig full-car {target or 'NAME'}")
    options.refuse(target, *([options.tire] if options.tire else []))
    if options.angle is not None and not 0.0 < options.angle < 80.0:
        raise UsageError(f"--angle must be above 0 and below 80 deg, got {options.angle:g}")
    spec = with_options(wheeled_vehicle(target, "full-car"), tire=options.tire)
    begin, title = time.perf_counter(), f"{spec.name}, {options.test.value}"
    with options.shared(), progress_bar(title) as progress:
        outcome = TESTS[options.test](spec, options, progress)
    wall, console = time.perf_counter() - begin, options.console()
    console.print(title, style="bold", highlight=False, soft_wrap=True)
    _print(console, outcome.parameters)
    if options.plot is not None:
        outcome.draw(options.plot, title)
        console.print(f"wrote {options.plot}", highlight=False, soft_wrap=True)
    content = {"rig": "full-car", "target": target, "test": options.test.value, "parameters": outcome.parameters}
    interrupted = count_of(outcome.rows.status, RowStatus.UNFINISHED) > 0
    return finish(console, options, outcome.rows, content, interrupted=interrupted, wall=wall)


def _sine(spec: VehicleSpec, options: FullCarOptions, progress: Any) -> Outcome:
    sweep = SineSweep(
        modes=options.modes,
        low=options.low,
        high=options.high,
        points=options.points,
        amplitude=options.amplitude,
        grip=options.grip,
    )
    found = run_four_post(spec, sweep, dt=options.dt, device=options.device_name, progress=progress)
    return Outcome(found.rows(), found.parameters(), lambda path, title: draw_responses(found, path, title))


def _road(spec: VehicleSpec, options: FullCarOptions, progress: Any) -> Outcome:
    sweep = RoadSweep(
        roads=options.roads, speeds=options.speeds, duration=options.duration, seed=options.seed, grip=options.grip
    )
    found = run_four_post_roads(spec, sweep, dt=options.dt, device=options.device_name, progress=progress)
    return Outcome(found.rows(), found.parameters(), lambda path, title: draw_roads(found, path, title))


def _tilt(spec: VehicleSpec, options: FullCarOptions, progress: Any) -> Outcome:
    angles = None
    if options.angle is not None:
        angles = np.linspace(0.0, math.radians(options.angle), max(options.points, 0))
    found = run_tilt_table(
        spec, angles=angles, points=options.points, dt=options.dt, device=options.device_name, progress=progress
    )
    return Outcome(found.rows(), found.parameters(), lambda path, title: draw_tilt(found, path, title))


TESTS = {FullCarTest.SINE: _sine, FullCarTest.ROAD: _road, FullCarTest.TILT: _tilt}


def _print(console: Console, parameters: Any) -> None:
    if isinstance(parameters, dict):
        print_values(console, parameters)
        return
    names = list(parameters[0])
    print_table(
        console,
        ["road", *(f"{entry['road']}, {entry['speed_mps']:g} m/s" for entry in parameters)],
        [
            [name, *(f"{entry[name]:.3g}" for entry in parameters)]
            for name in names
            if name not in ("road", "speed_mps")
        ],
    )
