"""Manoeuvres: what a driver does when, on which ground, and how long a run takes."""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import Annotated, Final, TypeAlias, TypedDict

import numpy as np

from simwarp.core.constraints import Ge, Le, Meaning
from simwarp.core.schema import fault_text
from simwarp.core.wording import suggestions
from simwarp.vehicle.driving.braking_maneuvers import (
    acceleration,
    brake_in_turn,
    braking,
    bump,
    hill_start,
    split_braking,
)
from simwarp.vehicle.driving.drawbar import DrawbarSpec
from simwarp.vehicle.driving.driver_choices import (
    BRAKING_RUN,
    RADIUS,
    needs_axles,
    scripted,
    speed_gains,
    steering_for,
    usual_radius,
    usual_speed,
)
from simwarp.vehicle.driving.drivers import ScriptSpec, read_script
from simwarp.vehicle.driving.handling_maneuvers import (
    fishhook,
    sine_with_dwell,
    slow_steer,
    steady_state_circle,
    step_input,
)
from simwarp.vehicle.driving.lane_courses import double_lane_change_course
from simwarp.vehicle.driving.lane_maneuvers import ISO_3888_1_SPEED, iso_3888_1, iso_3888_2, lane_speed
from simwarp.vehicle.driving.maneuver_spec import SETTLING, Maneuver, after_settling
from simwarp.vehicle.driving.path_tracking import PathTrackingSpec
from simwarp.vehicle.driving.paths import Path, circle
from simwarp.vehicle.driving.reachable_speeds import held_speed
from simwarp.vehicle.driving.track_maneuvers import DRAWBAR_HOLD, DRAWBAR_RAMP, TRACK_MANEUVERS
from simwarp.vehicle.driving.vehicle_outline import outline_of
from simwarp.vehicle.spec.parts import SPECS
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec

SETTLE_BRAKE: Final = after_settling((0.0, 0.0), before=1.0)


def reference_accel(spec: VehicleSpec) -> Maneuver:
    """Full throttle from rest for 20 s."""
    script = ScriptSpec(throttle=after_settling((0.0, 1.0), before=0.0), braking=SETTLE_BRAKE)
    return Maneuver(name="reference-accel", script=script, duration=20.0)


def reference_steer(spec: VehicleSpec) -> Maneuver:
    """Speed held from rest; at 15 s the steering goes to 0.3 in 0.2 s; until 25 s."""
    target = usual_speed(spec)
    script = scripted(
        spec,
        steering=after_settling((15.0, 0.0), (15.2, 0.3), before=0.0),
        braking=SETTLE_BRAKE,
        speed=after_settling((0.0, target), before=-1.0),
    )
    return Maneuver(name="reference-steer", script=script, duration=25.0)


def reference_brake(spec: VehicleSpec) -> Maneuver:
    """Speed held from rest until 20 s, then full brakes for 4 s."""
    target = spec.maneuver_defaults.speed_of_braking_run or held_speed(spec, BRAKING_RUN)
    script = scripted(
        spec,
        braking=(*SETTLE_BRAKE, (SETTLING + 20.0, 0.0), (SETTLING + 20.0, 1.0)),
        speed=after_settling((0.0, target), (20.0, target), (20.0, -1.0), before=-1.0),
    )
    return Maneuver(name="reference-brake", script=script, duration=24.07)


def reference_soil(spec: VehicleSpec) -> Maneuver:
    """Dropped onto the ground, a second of rest without brakes, then throttle to 0.7 within 0.2 s; until 5 s."""
    script = ScriptSpec(throttle=after_settling((0.0, 0.0), (0.2, 0.7), before=0.0))
    height = spec.start_height + 0.1
    return Maneuver(name="reference-soil", script=script, duration=5.0, place=(-15.0, 0.0, height))


STEP: Final = 15.0
"""Start time of the steering of step-steer and sine-sweep [s]: by then the speed is held."""


def step_steer(
    spec: VehicleSpec, *, speed: float | None = None, steering: float = 0.3, duration: float = 25.0
) -> Maneuver:
    """A speed [m/s] held from rest; at 15 s the steering goes to its value (-1..1) in 0.2 s."""
    target = usual_speed(spec) if speed is None else speed
    if duration <= STEP:
        raise SpecError(f"duration: must be above {STEP:g} s, where the step begins, got {duration!r}")
    script = scripted(
        spec,
        steering=after_settling((STEP, 0.0), (STEP + 0.2, steering), before=0.0),
        braking=SETTLE_BRAKE,
        speed=after_settling((0.0, target), before=-1.0),
    )
    return Maneuver(name="step-steer", script=script, duration=duration)


SWEEP: Final = (0.2, 3.0)
"""First and last frequency of the sweep [Hz]."""
LONGEST_SWEEP: Final = 3600.0
"""[s]: it is a table with two hundred points a second."""


def sine_sweep(
    spec: VehicleSpec, *, speed: float | None = None, steering: float = 0.1, duration: float = 50.0
) -> Maneuver:
    """A speed [m/s] held; from 15 s on the steering swings by its amplitude (0..1), from 0.2 to 3 Hz at the end."""
    target = usual_speed(spec) if speed is None else speed
    if duration <= STEP:
        raise SpecError(f"duration: must be above {STEP:g} s, where the sweep begins, got {duration!r}")
    if duration > LONGEST_SWEEP:
        raise SpecError(f"duration: must be at most {LONGEST_SWEEP:g} s of a sweep, got {duration!r}")
    time = np.arange(0.0, duration - STEP, 0.005)
    growth = math.log(SWEEP[1] / SWEEP[0]) / (duration - STEP)
    # the frequency grows by the same share every second
    phase = 2.0 * math.pi * SWEEP[0] * np.expm1(growth * time) / growth
    swing = zip((STEP + time).tolist(), (steering * np.sin(phase)).tolist(), strict=True)
    script = scripted(
        spec,
        steering=after_settling(*swing, before=0.0),
        braking=SETTLE_BRAKE,
        speed=after_settling((0.0, target), before=-1.0),
    )
    return Maneuver(name="sine-sweep", script=script, duration=duration)


SLOWEST: Final = 0.01
FASTEST: Final = 1000.0
"""Speeds that a manoeuvre can hold [m/s]."""
SHORTEST: Final = 0.01
"""A row of the record [s]."""


def constant_radius(
    spec: VehicleSpec, *, speed: float | None = None, radius: float | None = None, duration: float = 40.0
) -> Maneuver:
    """A path tracker on a circle [m], to the left (to the right for a negative radius), at a speed reached in 10 s."""
    needs_axles(spec)
    turn = usual_radius(spec, spec.maneuver_defaults.radius, RADIUS) if radius is None else radius
    # 4 m/s² across: well below what a dry road takes
    target = min(usual_speed(spec), math.sqrt(4.0 * abs(turn))) if speed is None else speed
    follow = PathTrackingSpec(
        paths=(circle(turn),), speed=target, steering=steering_for(spec), speed_gains=speed_gains(spec),
        start=SETTLING, ramp=10.0,
    )  # fmt: skip
    return Maneuver(name="constant-radius", follow=follow, duration=duration)


LANE_CHANGE: Final = (15.0, 45.0, 70.0, 95.0, 125.0)
"""ISO 3888-1: length along the course where its sections meet [m]. 15 m straight, 30 m across, 25 m in the other lane,
25 m back, 30 m straight.
"""


def lane_change_path(approach: float, middles: tuple[float, float] = (3.5, 0.0)) -> Path:
    """The middle of the double lane change's course, `approach` metres ahead; between lanes without a jerk's jump.

    Args:
        approach: length before the first lane, whose middle is y = 0 [m].
        middles: y of the second and the third lane's middles [m].
    """
    second, third = middles
    corners = list(zip((0.0, *LANE_CHANGE), (0.0, 0.0, second, second, third, third), strict=True))
    points = [(0.0, 0.0), (approach, 0.0)]
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        part = np.linspace(0.0, 1.0, 2 if y0 == y1 else 61)[1:]
        blend = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
        points += zip((approach + x0 + part * (x1 - x0)).tolist(), (y0 + blend * (y1 - y0)).tolist(), strict=True)
    return Path(np.array(points))


def double_lane_change(spec: VehicleSpec, *, speed: float | None = None, duration: float | None = None) -> Maneuver:
    """A path tracker from rest along the lanes' middles of ISO 3888-1 at a speed [m/s], after ten seconds of approach.

    `iso_3888_1` begins in motion and takes the line of least curvature.
    """
    target = lane_speed(spec, ISO_3888_1_SPEED) if speed is None else speed
    needs_axles(spec)
    approach = 10.0 * target
    course = double_lane_change_course(outline_of(spec), approach)
    _, second, third = course.lanes
    follow = PathTrackingSpec(
        paths=(lane_change_path(approach, (second.middle, third.middle)),), speed=target,
        steering=steering_for(spec, 0.5, target), speed_gains=speed_gains(spec), start=SETTLING,
    )  # fmt: skip
    # a quarter more than at full speed: it starts from rest
    total = 1.25 * (approach + LANE_CHANGE[-1]) / target + 3.0 if duration is None else duration
    return Maneuver(name="double-lane-change", follow=follow, duration=total, course=course)


def slope_hold(spec: VehicleSpec, *, slope: float = 0.2, duration: float = 60.0) -> Maneuver:
    """Uphill on a slope (rise per run) with full brakes and a free engine."""
    return Maneuver(name="slope-hold", script=ScriptSpec(braking=((0.0, 1.0),)), duration=duration, slope=slope)


PULLING_SPEED: Final = 1.0
"""Of the drawbar test: a creep, at which the soil's damping adds little [m/s]."""


def drawbar(spec: VehicleSpec, *, speed: float | None = None, duration: float = 40.0) -> Maneuver:
    """Pull over slip: a carriage holds the vehicle at a speed [m/s] while its wheels' slip goes from 0 to 0.65."""
    rest = DRAWBAR_RAMP + DRAWBAR_HOLD
    if duration <= rest:
        raise SpecError(f"duration: must be above {rest:g} s of a drawbar test, got {duration!r}")
    usual = spec.maneuver_defaults.speed_of_pull or held_speed(spec, PULLING_SPEED)
    target = usual if speed is None else speed
    test = DrawbarSpec(speed=target, start=SETTLING, ramp=DRAWBAR_RAMP, sweep=duration - rest)
    return Maneuver(name="drawbar", drawbar=test, duration=duration)


MANEUVERS: Final[dict[str, Callable[..., Maneuver]]] = {
    "reference-accel": reference_accel,
    "reference-steer": reference_steer,
    "reference-brake": reference_brake,
    "reference-soil": reference_soil,
    "step-steer": step_steer,
    "double-lane-change": double_lane_change,
    "sine-sweep": sine_sweep,
    "constant-radius": constant_radius,
    "slope-hold": slope_hold,
    "drawbar": drawbar,
    "iso-3888-1": iso_3888_1,
    "iso-3888-2": iso_3888_2,
    "steady-state-circle": steady_state_circle,
    "slow-steer": slow_steer,
    "step-input": step_input,
    "sine-with-dwell": sine_with_dwell,
    "fishhook": fishhook,
    "braking": braking,
    "split-braking": split_braking,
    "brake-in-turn": brake_in_turn,
    "acceleration": acceleration,
    "hill-start": hill_start,
    "bump": bump,
}


class ManeuverOptions(TypedDict, total=False):
    """Options of manoeuvres; each has some of them."""

    speed: Annotated[float, Ge(SLOWEST), Le(FASTEST), Meaning("m/s")]
    duration: Annotated[float, Ge(SHORTEST), Meaning("seconds")]
    steering: Annotated[float, Ge(-1.0), Le(1.0), Meaning("a share of full steering")]
    radius: Annotated[float, Meaning("metres, negative to the right")]
    slope: Annotated[float, Ge(-1.0), Le(1.0), Meaning("rise per run")]
    width: Annotated[float, Ge(SHORTEST), Le(FASTEST), Meaning("metres")]
    brakes: Annotated[float, Ge(0.0), Le(1.0), Meaning("a share of full braking")]
    left: Annotated[float, Ge(0.01), Le(1.0), Meaning("a share of the friction")]
    height: Annotated[float, Ge(0.0), Le(1.0), Meaning("metres")]
    length: Annotated[float, Ge(SHORTEST), Le(100.0), Meaning("metres")]
    dwell: Annotated[float, Ge(0.0), Le(10.0), Meaning("seconds")]


Maneuvers: TypeAlias = Mapping[str, Callable[..., Maneuver]]
"""Functions that make manoeuvres of a vehicle, by name."""


def maneuvers_of(spec: AnyVehicleSpec) -> Maneuvers:
    """Those that a vehicle of this kind can drive: `MANEUVERS` on wheels, `TRACK_MANEUVERS` on tracks."""
    return TRACK_MANEUVERS if isinstance(spec, TrackedVehicleSpec) else MANEUVERS


def maneuver_options(name: str, known: Maneuvers = MANEUVERS) -> list[str]:
    """Names of the options of a manoeuvre."""
    return [key for key in inspect.signature(known[name]).parameters if key != "spec"]


def maneuver(name: str, spec: AnyVehicleSpec, **options: float) -> Maneuver:
    """The manoeuvre of that name for a vehicle, or the script of a CSV file (`read_script`).

    Args:
        name: one of `maneuvers_of(spec)`, or a path that ends in .csv.
        spec: of the vehicle.
        options: those of the manoeuvre's function, such as speed [m/s].

    Raises:
        SpecError: there is no such manoeuvre or option, or a value cannot be used.
    """
    given = {key: options[key] for key in ManeuverOptions.__annotations__ if key in options}
    SPECS.fields(ManeuverOptions, given, fault_text)
    if name.endswith(".csv"):
        if options.keys() - {"duration"}:
            raise SpecError(f"{min(options.keys() - {'duration'})}: no option of a script; it has only duration")
        script, end = read_script(FilePath(name))
        return Maneuver(name=FilePath(name).name, script=script, start=0.0, duration=options.get("duration", end))
    known = maneuvers_of(spec)
    if name not in known:
        raise SpecError(_unknown(name, spec, known))
    listed = maneuver_options(name, known)
    for key in options:
        if key not in listed:
            has = f"it has {', '.join(listed)}" if listed else "it has none"
            raise SpecError(f"{key}: no option of the maneuver {name}; {has}")
    return known[name](spec, **options)


def _unknown(name: str, spec: AnyVehicleSpec, known: Maneuvers) -> str:
    """What is wrong with a name that is no manoeuvre of a vehicle."""
    choice = f"choose from {', '.join(known)}"
    if name in MANEUVERS or name in TRACK_MANEUVERS:
        other, own = ("wheels", "tracks") if name in MANEUVERS else ("tracks", "wheels")
        return f"maneuver '{name}' is for vehicles on {other}, got '{spec.name}' on {own}; {choice}"
    return f"maneuver '{name}' is not known; {suggestions(name, known, choice, count=2)}"
