"""Manoeuvres: what a driver does when, and how long a run takes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Final

from simwarp.vehicle.drivers import ScriptSpec
from simwarp.vehicle.spec import SpecError, VehicleSpec

SETTLING: Final = 1.0
"""Time with full brakes before a manoeuvre begins [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Maneuver:
    """A script over time from the start of the simulation, and when it ends [s]; `start` is the manoeuvre's zero."""

    name: str
    script: ScriptSpec
    duration: float
    start: float = SETTLING
    slope: float = 0.0
    """Of the ground, rise per run; the vehicle faces uphill."""


SPEEDS: Final = {"gator": (6.0, 7.0), "artcar": (1.5, 1.7)}
"""Speeds of the reference runs that are not the usual 12 and 15 m/s: of the steer and of the brake run [m/s]."""


def _after_settling(*points: tuple[float, float], before: float) -> tuple[tuple[float, float], ...]:
    """Points of the manoeuvre's own time, with a value until it begins."""
    moved = tuple((SETTLING + time, value) for time, value in points)
    return ((0.0, before), (SETTLING, before), *moved)


SETTLE_BRAKE: Final = _after_settling((0.0, 0.0), before=1.0)


def reference_accel(spec: VehicleSpec) -> Maneuver:
    """Full throttle from rest for 20 s."""
    script = ScriptSpec(throttle=_after_settling((0.0, 1.0), before=0.0), braking=SETTLE_BRAKE)
    return Maneuver(name="reference-accel", script=script, duration=20.0)


def reference_steer(spec: VehicleSpec) -> Maneuver:
    """Speed held from rest; at 15 s the steering goes to 0.3 in 0.2 s; until 25 s."""
    target, _ = SPEEDS.get(spec.name, (12.0, 15.0))
    script = ScriptSpec(
        steering=_after_settling((15.0, 0.0), (15.2, 0.3), before=0.0),
        braking=SETTLE_BRAKE,
        speed=_after_settling((0.0, target), before=-1.0),
    )
    return Maneuver(name="reference-steer", script=script, duration=25.0)


def reference_brake(spec: VehicleSpec) -> Maneuver:
    """Speed held from rest until 20 s, then full brakes for 4 s."""
    _, target = SPEEDS.get(spec.name, (12.0, 15.0))
    script = ScriptSpec(
        braking=(*SETTLE_BRAKE, (SETTLING + 20.0, 0.0), (SETTLING + 20.0, 1.0)),
        speed=_after_settling((0.0, target), (20.0, target), (20.0, -1.0), before=-1.0),
    )
    return Maneuver(name="reference-brake", script=script, duration=24.07)


MANEUVERS: Final[dict[str, Callable[[VehicleSpec], Maneuver]]] = {
    "reference-accel": reference_accel,
    "reference-steer": reference_steer,
    "reference-brake": reference_brake,
}


def maneuver(name: str, spec: VehicleSpec) -> Maneuver:
    """The manoeuvre of that name for a vehicle.

    Raises:
        SpecError: there is none.
    """
    if name not in MANEUVERS:
        raise SpecError(f"maneuver '{name}' is not known; choose from {', '.join(MANEUVERS)}")
    return MANEUVERS[name](spec)
