"""How a vehicle stands, beside how it is built: lines of a table, and what in it an engineer should not overlook."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np

from simwarp.core.rotation import matrix_of
from simwarp.exporters.vehicle_sheet import line_name
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.parts import Array, ForceLine
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.stances import Stance
from simwarp.vehicle.suspensions.wheel_axes import camber_angles, toe_angles

TOLD: Final = 0.02
"""Distance of a standing vehicle from its design that is told at the top of a page [m]."""
TOLD_SHARE: Final = 0.06
"""The same as a share of the tires' radius, for small vehicles: the smaller of both."""
PLACES: Final = {"m": 4, "mm": 1, "°": 2}
"""Digits behind the point, by unit."""


@dataclasses.dataclass(frozen=True)
class StandingFact:
    """One line: a quantity as the description builds it, and at rest on level ground."""

    label: str
    built: str
    standing: str
    unit: str


def standing_sheet(spec: VehicleSpec, found: Stance) -> list[StandingFact]:
    """Heights, angles and distances of a vehicle as built and at rest.

    As built, the vehicle stands at its design height: the wheels are in the frame of reference where the description
    has them, on tires that bear the loads at rest.

    Args:
        spec: the vehicle.
        found: how it stands, from `simwarp.vehicle.stance`.
    """
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec)
    bodies = [builder.bodies[index] for index in parts.bodies]
    masses = np.array([body.mass for body in bodies])
    com = masses @ np.array([body.pose.position for body in bodies]) / masses.sum()
    com = com - builder.bodies[parts.chassis].pose.position - parts.reference
    centers = np.array([builder.bodies[side.spindle].pose.position for side in parts.sides]).reshape(-1, 2, 3)
    axes = np.array([matrix_of(builder.bodies[side.spindle].pose.rotation)[:, 1] for side in parts.sides])
    x = centers[:, :, 0].mean(axis=1)
    z = centers[:, :, 2].mean(axis=1)
    design = [axle.ride_height + math.cos(found.pitch) * axle.travel for axle in found.axles]
    pitch = _pitch(design[: len(spec.axles)], x[: len(spec.axles)])
    last = len(spec.axles) - 1  # without trailers' ones
    level = np.interp(com[0], x[[last, 0]], [design[last], design[0]]) if x[0] > x[last] else design[0]
    rows = [
        _row(
            "wheelbase", math.cos(pitch) * (x[0] - x[last]) + math.sin(pitch) * (z[0] - z[last]), found.wheelbase, "m"
        ),
        _row("centre of mass above the ground", math.cos(pitch) * com[2] + level, found.com_height, "m"),
        _row("pitch, nose down", math.degrees(pitch), math.degrees(found.pitch), "°"),
    ]
    for index, stands in enumerate(found.axles):
        name, pair = f"axle {index}", axes[2 * index : 2 * index + 2]
        toe, camber = toe_angles(pair, (1.0, -1.0)).mean(), camber_angles(pair, (1.0, -1.0)).mean()
        rows += [
            _row(f"{name}: frame above the ground", design[index], stands.ride_height, "m"),
            _row(f"{name}: wheels above their place in the frame", 0.0, 1e3 * stands.travel, "mm"),
            _row(f"{name}: track", centers[index, 0, 1] - centers[index, 1, 1], stands.track, "m"),
            _row(f"{name}: toe, positive inwards", math.degrees(toe), math.degrees(stands.toe), "°"),
            _row(f"{name}: camber, positive outwards", math.degrees(camber), math.degrees(stands.camber), "°"),
            StandingFact(f"{name}: load on each wheel", "", f"{stands.load:.5g}", "N"),
        ]
    return rows


def standing_notes(spec: VehicleSpec, found: Stance) -> list[str]:
    """Sentences about what of a standing vehicle is far from its design, or on a stop."""
    notes = []
    for index, (axle, stands) in enumerate(zip(spec.all_axles, found.axles, strict=True)):
        if abs(stands.travel) > min(TOLD, TOLD_SHARE * axle.tire.radius):
            side = "lower" if stands.travel > 0.0 else "higher"
            notes.append(
                f"At rest the vehicle stands {1e3 * abs(stands.travel):.0f} mm {side} over axle {index} than its "
                "description builds it; `simwarp trim --ride-height design` finds springs for that height."
            )
        springs: tuple[ForceLine, ...] = getattr(axle.suspension, "springs", ())
        notes += [
            f"At rest {line_name(line, number)} of axle {index} is {1e3 * at_rest.into_stop:.1f} mm in its "
            f"{at_rest.stop} stop."
            for number, (line, at_rest) in enumerate(zip(springs, stands.lines, strict=True))
            if at_rest.stop
        ]
    return notes


def _pitch(design: list[float], x: Array) -> float:
    """Of a frame whose axis is at these heights over its axles, nose down [rad]."""
    return math.asin((design[-1] - design[0]) / (x[0] - x[-1])) if x[0] > x[-1] else 0.0


def _row(label: str, built: float, standing: float, unit: str) -> StandingFact:
    return StandingFact(label, _digits(built, unit), _digits(standing, unit), unit)


def _digits(value: float, unit: str) -> str:
    text = f"{value:.{PLACES[unit]}f}"
    return text[1:] if float(text) == 0.0 and text.startswith("-") else text
