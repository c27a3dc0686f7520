"""``simwarp rig suspension`` and ``simwarp rig steering``."""

from __future__ import annotations

import dataclasses
import time
from typing import Annotated

import tyro
from rich.console import Console

from simwarp.cli.options import parse_options
from simwarp.cli.rig.rig_options import RigOptions, finish, print_values, progress_bar, wheeled_vehicle
from simwarp.vehicle.rigs.compliance_rig import WheelForce, run_compliance_rig
from simwarp.vehicle.rigs.rig_plots import draw_steering, draw_suspension
from simwarp.vehicle.rigs.steering_rig import run_steering_rig
from simwarp.vehicle.rigs.suspension_curves import SuspensionReference, SuspensionRun
from simwarp.vehicle.rigs.suspension_meanings import suspension_meanings
from simwarp.vehicle.rigs.suspension_rig import run_suspension_rig


@dataclasses.dataclass(frozen=True)
class SuspensionOptions(RigOptions):
    """Kinematics of an axle in parallel and opposite wheel travel and over the steering, and the rates of its springs.

    Travel counts from the state in which the vehicle stands. The table is of the left wheel there.
    """

    axle: int = 0
    """From the front."""
    travel: Annotated[
        float | None, tyro.conf.arg(metavar="m", help_behavior_hint="(default: 17 % of the tire's radius)")
    ] = None
    """Largest travel up and down."""
    points: int = 41
    """Of each motion, an odd number."""
    reference: SuspensionReference = SuspensionReference.STANDING
    """State from which travel counts: that of the standing vehicle, or that as built."""
    loaded_radius: Annotated[
        float | None, tyro.conf.arg(metavar="m", help_behavior_hint="(default: under the standing vehicle)")
    ] = None
    """From a wheel's centre down to the ground."""
    force: Annotated[float | None, tyro.conf.arg(metavar="N", help_behavior_hint="(default: none)")] = None
    """Also pushes the wheels aside, backwards and forwards by up to this force: what bushings give."""


def run_suspension(target: str, arguments: list[str]) -> int:
    """Measure a suspension and write what was asked for."""
    options = parse_options(SuspensionOptions, arguments, f"simwarp rig suspension {target or 'NAME'}")
    options.refuse(target)
    spec = wheeled_vehicle(target, "suspension")
    begin = time.perf_counter()
    with options.shared(), progress_bar(f"{spec.name}, axle {options.axle}") as progress:
        found = run_suspension_rig(
            spec, options.axle, travel=options.travel, points=options.points, reference=options.reference,
            loaded_radius=options.loaded_radius, device=options.device_name, progress=progress,
        )  # fmt: skip
        pushed = [] if options.force is None else [
            run_compliance_rig(
                spec, options.axle, kind, force=options.force, reference=options.reference, device=options.device_name
            )
            for kind in WheelForce
        ]  # fmt: skip
    wall, console = time.perf_counter() - begin, options.console()
    parameters = found.parameters()
    for curve in pushed:
        parameters |= curve.parameters()
    template = spec.all_axles[options.axle].suspension.template
    console.print(f"{spec.name}, axle {options.axle}: {template}", style="bold", highlight=False, soft_wrap=True)
    print_values(console, parameters, suspension_meanings(parameters, front=found.front))
    _print_stops(console, found)
    if options.plot is not None:
        draw_suspension(found, options.plot, f"{spec.name}, axle {options.axle}: {template}")
        console.print(f"wrote {options.plot}", highlight=False, soft_wrap=True)
    content = {
        "rig": "suspension", "target": target, "axle": options.axle, "parameters": parameters,
        "compliance": {curve.kind.value: curve.rows().as_json() for curve in pushed},
    }  # fmt: skip
    return finish(
        console, options, found.rows(), content, interrupted=found.interrupted, wall=wall,
        beside=[curve.rows() for curve in pushed],
    )  # fmt: skip


def _print_stops(console: Console, found: SuspensionRun) -> None:
    """Where springs run into their stops, in one line for each motion."""
    for motion, curve in found.curves.items():
        names = curve.stop_names(0)
        for name in ("rebound", "bump"):
            travel = 1e3 * curve.travel[names == name, 0]
            if len(travel):
                console.print(
                    f"{motion.value}: the left wheel is on its {name} stop from {travel.min():.1f} to "
                    f"{travel.max():.1f} mm ({len(travel)} of {len(names)} states; column stop_L)",
                    highlight=False, soft_wrap=True,
                )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class SteeringOptions(RigOptions):
    """Angles of the road wheels from lock to lock, ratio, Ackermann's percentage, turning circle."""

    axle: Annotated[int | None, tyro.conf.arg(metavar="N", help_behavior_hint="(default: the first steered one)")] = (
        None
    )
    """From the front."""
    points: int = 61
    """From lock to lock."""
    box_ratio: float = 1.0
    """Angle of the handwheel per angle of the steering's arm or pinion."""


def run_steering(target: str, arguments: list[str]) -> int:
    """Measure a steering and write what was asked for."""
    options = parse_options(SteeringOptions, arguments, f"simwarp rig steering {target or 'NAME'}")
    options.refuse(target)
    spec = wheeled_vehicle(target, "steering")
    begin = time.perf_counter()
    with options.shared(), progress_bar(f"{spec.name}, steering"):
        found = run_steering_rig(
            spec, options.axle, points=options.points, box_ratio=options.box_ratio, device=options.device_name
        )
    wall, console = time.perf_counter() - begin, options.console()
    console.print(f"{spec.name}, steering of axle {found.axle}", style="bold", highlight=False, soft_wrap=True)
    print_values(console, found.parameters())
    if options.plot is not None:
        draw_steering(found, options.plot, f"{spec.name}, steering of axle {found.axle}")
        console.print(f"wrote {options.plot}", highlight=False, soft_wrap=True)
    content = {"rig": "steering", "target": target, "axle": found.axle, "parameters": found.parameters()}
    return finish(console, options, found.rows(), content, interrupted=False, wall=wall)
