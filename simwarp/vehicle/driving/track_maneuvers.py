"""Manoeuvres of tracked vehicles. Before its zero each one settles on its brakes, until the chains are taut."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from simwarp.vehicle.driving.drawbar import DrawbarSpec
from simwarp.vehicle.driving.drivers import ScriptSpec
from simwarp.vehicle.driving.maneuver_spec import Crossing, CrossingKind, Maneuver, after_settling
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec

TRACK_SETTLING: Final = 2.0
"""Time with full brakes before a manoeuvre begins [s]: the springs' slowest mode takes 1.25 s."""
BRAKES_ON: Final = 6.0
"""Time at which `brake` brakes [s]: by then the speed is held."""
STEERED: Final = 7.0
"""Time at which the steering of `steady-turn` begins [s]."""
CLIMB: Final = 6.0
"""Of `slope` at full throttle, before it is held on the brakes [s]."""
AHEAD: Final = 5.0
"""From the frame of reference to what lies across the way [m]."""
PIVOT_THROTTLE: Final = 0.6


def _points(*points: tuple[float, float], before: float = 0.0) -> tuple[tuple[float, float], ...]:
    return after_settling(*points, before=before, settling=TRACK_SETTLING)


RELEASED: Final = _points((0.0, 0.0), before=1.0)
"""Brakes, until the manoeuvre begins."""


def _held(speed: float) -> tuple[tuple[float, float], ...]:
    """A speed to hold from zero on [m/s]."""
    return _points((0.0, speed), before=-1.0)


def _longer(duration: float, least: float, what: str) -> None:
    if duration <= least:
        raise SpecError(f"duration: must be above {least:g} s, where {what}, got {duration!r}")


def accelerate(spec: TrackedVehicleSpec, *, duration: float = 10.0) -> Maneuver:
    """Full throttle from rest."""
    script = ScriptSpec(throttle=_points((0.0, 1.0)), braking=RELEASED)
    return Maneuver(name="accelerate", script=script, start=TRACK_SETTLING, duration=duration)


def brake(spec: TrackedVehicleSpec, *, speed: float = 4.0) -> Maneuver:
    """A speed [m/s] held from rest for 6 s, then full brakes."""
    braking = (*RELEASED, (TRACK_SETTLING + BRAKES_ON, 0.0), (TRACK_SETTLING + BRAKES_ON, 1.0))
    held = _points((0.0, speed), (BRAKES_ON, speed), (BRAKES_ON, -1.0), before=-1.0)
    script = ScriptSpec(braking=braking, speed=held)
    return Maneuver(name="brake", script=script, start=TRACK_SETTLING, duration=BRAKES_ON + 3.0)


def steady_turn(
    spec: TrackedVehicleSpec, *, speed: float = 4.0, steering: float = 1.0, duration: float = 13.0
) -> Maneuver:
    """A speed [m/s] held from rest; at 7 s the steering goes to its value (-1..1) in 0.2 s."""
    _longer(duration, STEERED, "the turn begins")
    steer = _points((STEERED, 0.0), (STEERED + 0.2, steering))
    script = ScriptSpec(steering=steer, braking=RELEASED, speed=_held(speed))
    return Maneuver(name="steady-turn", script=script, start=TRACK_SETTLING, duration=duration)


def pivot(spec: TrackedVehicleSpec, *, steering: float = 1.0, duration: float = 5.0) -> Maneuver:
    """From rest, steered (-1..1), with the throttle to 0.6 in 0.5 s; a simple driveline in gyration mode."""
    script = ScriptSpec(
        steering=_points((0.0, steering)), throttle=_points((0.0, 0.0), (0.5, PIVOT_THROTTLE)), braking=RELEASED
    )
    return Maneuver(name="pivot", script=script, start=TRACK_SETTLING, duration=duration, gyration=True)


def obstacle(spec: TrackedVehicleSpec, *, speed: float = 2.0, radius: float = 0.2, duration: float = 9.0) -> Maneuver:
    """At a speed [m/s] over a half round of a radius [m] across the way, 5 m ahead."""
    if radius <= 0.0:
        raise SpecError(f"radius: must be above 0 m, of a half round on the ground, got {radius!r}")
    crossing = Crossing(kind=CrossingKind.HALF_ROUND, size=radius, ahead=AHEAD, length=_length(spec))
    return _crossing("obstacle", crossing, speed, duration)


def trench(spec: TrackedVehicleSpec, *, speed: float = 2.0, width: float = 1.2, duration: float = 9.0) -> Maneuver:
    """At a speed [m/s] over a trench of a width [m] across the way, whose near edge is 5 m ahead."""
    crossing = Crossing(kind=CrossingKind.TRENCH, size=width, ahead=AHEAD, length=_length(spec))
    return _crossing("trench", crossing, speed, duration)


def _length(spec: TrackedVehicleSpec) -> float:
    """From the frame of reference to the far side of the last wheel [m]."""
    mounts = (*spec.left.road_wheels, *spec.right.road_wheels)
    return max(mount.suspension.wheel.radius - mount.location[0] for mount in mounts)


def _crossing(name: str, crossing: Crossing, speed: float, duration: float) -> Maneuver:
    script = ScriptSpec(braking=RELEASED, speed=_held(speed))
    return Maneuver(name=name, script=script, start=TRACK_SETTLING, duration=duration, crossing=crossing)


def slope(spec: TrackedVehicleSpec, *, slope: float = 0.3, duration: float = 10.0) -> Maneuver:
    """Up a slope (rise per run) at full throttle for 6 s, then held there on the brakes."""
    _longer(duration, CLIMB, "the brakes hold")
    stop = TRACK_SETTLING + CLIMB
    script = ScriptSpec(
        throttle=_points((0.0, 1.0), (CLIMB, 1.0), (CLIMB, 0.0)), braking=(*RELEASED, (stop, 0.0), (stop, 1.0))
    )
    return Maneuver(name="slope", script=script, start=TRACK_SETTLING, duration=duration, slope=slope)


DRAWBAR_RAMP: Final = 4.0
"""To the speed of the drawbar test [s]."""
DRAWBAR_HOLD: Final = 1.0
"""At the last slip [s]."""


def drawbar(spec: TrackedVehicleSpec, *, speed: float = 1.0, duration: float = 20.0) -> Maneuver:
    """Pull over slip: a carriage holds the vehicle at a speed [m/s] while its tracks' slip goes from 0 to 0.65."""
    _longer(duration, DRAWBAR_RAMP + DRAWBAR_HOLD, "the slip begins to rise")
    sweep = duration - DRAWBAR_RAMP - DRAWBAR_HOLD
    test = DrawbarSpec(speed=speed, start=TRACK_SETTLING, ramp=DRAWBAR_RAMP, sweep=sweep)
    return Maneuver(name="drawbar", drawbar=test, start=TRACK_SETTLING, duration=duration)


TRACK_MANEUVERS: Final[dict[str, Callable[..., Maneuver]]] = {
    "accelerate": accelerate,
    "brake": brake,
    "steady-turn": steady_turn,
    "pivot": pivot,
    "obstacle": obstacle,
    "trench": trench,
    "slope": slope,
    "drawbar": drawbar,
}
"""By name; each takes a vehicle and its own options."""
