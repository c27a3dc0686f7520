"""Handling tests: ISO 4138, ISO 7401, the sine with dwell and the fishhook."""

from __future__ import annotations

import math
from typing import Final

from simwarp.vehicle.driving.driver_choices import needs_axles, speed_gains, steering_for, usual_radius
from simwarp.vehicle.driving.intervention import Intervention, Pedals
from simwarp.vehicle.driving.maneuver_spec import SETTLING, Maneuver
from simwarp.vehicle.driving.path_tracking import PathTrackingSpec, wheelbase
from simwarp.vehicle.driving.paths import circle
from simwarp.vehicle.driving.reachable_speeds import held_gear, held_speed
from simwarp.vehicle.driving.rolling_start import rolling
from simwarp.vehicle.driving.steering_ratio import angle_per_steering
from simwarp.vehicle.spec.parts import Points
from simwarp.vehicle.spec.vehicle_spec import DifferentialDrive, SpecError, VehicleSpec
from simwarp.vehicle.suspensions.steerings import HANDWHEEL

HANDLING_SPEED: Final = 80.0 / 3.6
"""Of vehicles whose description has no other one."""
CIRCLE: Final = (40.0, 5.0)
"""Radius [m] and last lateral acceleration [m/s²] of the steady-state circle, likewise."""

DWELL_FREQUENCY: Final = 0.7
"""Of the sine with dwell [Hz]."""
DWELL: Final = 0.5
"""At its second peak [s]."""
SINE_END: Final = 1.0 / DWELL_FREQUENCY + DWELL
"""End of the steering since it began [s]."""
USUAL_FACTOR: Final = 5.0
"""Amplitude of the sine with dwell over the steering at 0.3 g, from which on the displacement counts."""
FISHHOOK_FACTOR: Final = 6.5
FISHHOOK_RATE: Final = 720.0 / HANDWHEEL
"""Of the steering input [1/s]."""
FISHHOOK_HOLD: Final = 3.0
FISHHOOK_BACK: Final = 2.0
"""Countersteer held, and back to straight [s]."""


def handling_speed(spec: VehicleSpec) -> float:
    """Of handling tests: 80 km/h, or what suits the vehicle [m/s]."""
    return spec.maneuver_defaults.speed_of_handling or held_speed(spec, HANDLING_SPEED)


def steering_unit(spec: VehicleSpec) -> float:
    """Steering input at 0.3 g and `handling_speed`; NaN of vehicles whose description has none.

    Of `artcar` and `skid-steer`, which do not reach 0.3 g, 6.5 times as much is nearly full steering.
    """
    return spec.maneuver_defaults.handling_steering or math.nan


def _amplitude(spec: VehicleSpec, given: float | None, factor: float) -> float:
    """The steering that is asked for, or a multiple of the unit, at most full steering.

    Raises:
        SpecError: the vehicle has no unit.
    """
    if given is not None:
        return given
    unit = steering_unit(spec)
    if math.isnan(unit):
        rule = f"must be given for '{spec.name}', which has no known steering at 0.3 g"
        raise SpecError(
            f"steering: {rule}; slow-steer finds it, for --steering or the file's maneuver_defaults.handling_steering"
        )
    return min(factor * unit, 1.0)


def released(spec: VehicleSpec) -> Pedals:
    """The throttle released; held by motors that would stop the vehicle at once."""
    return Pedals.HELD if isinstance(spec.driveline, DifferentialDrive) else Pedals.RELEASED


def steady_state_circle(
    spec: VehicleSpec, *, speed: float | None = None, radius: float | None = None, duration: float = 80.0
) -> Maneuver:
    """ISO 4138 on a circle [m], to the left: from rest the speed rises evenly to its last value [m/s].

    Gears that shift by themselves are held, in the one that the last speed asks for.
    """
    needs_axles(spec)
    turn = usual_radius(spec, spec.maneuver_defaults.radius_of_circle, CIRCLE[0])
    last = spec.maneuver_defaults.speed_on_circle or held_speed(spec, math.sqrt(CIRCLE[1] * turn))
    if radius is not None:
        turn, last = radius, min(last, math.sqrt(CIRCLE[1] * abs(radius)))
    follow = PathTrackingSpec(
        paths=(circle(turn),), speed=last if speed is None else speed, steering=steering_for(spec),
        speed_gains=speed_gains(spec), start=SETTLING, ramp=duration,
    )  # fmt: skip
    return Maneuver(
        name="steady-state-circle", follow=follow, duration=duration, wheelbase=wheelbase(spec),
        steering_angle=angle_per_steering(spec), held_gear=held_gear(spec, follow.speed),
    )  # fmt: skip


def slow_steer(
    spec: VehicleSpec, *, speed: float | None = None, steering: float = 0.5, duration: float = 20.0
) -> Maneuver:
    """ISO 4138 at a speed [m/s]: the steering rises evenly from 0 to its value (-1..1) at the end.

    Gears that shift by themselves are held.
    """
    target = handling_speed(spec) if speed is None else speed
    ramp = Intervention(steering=((0.0, 0.0), (duration, 1.0)), amplitude=steering)
    return rolling(
        spec, "slow-steer", speed=target, duration=duration, intervention=ramp, wheelbase=wheelbase(spec),
        steering_angle=angle_per_steering(spec), held_gear=held_gear(spec, target),
    )  # fmt: skip


STEP_TIME: Final = 0.1
"""In which the steering of step-input rises [s]."""
STEP_FACTOR: Final = 1.36
"""4 m/s² over 0.3 g."""


def step_input(
    spec: VehicleSpec, *, speed: float | None = None, steering: float | None = None, duration: float = 6.0
) -> Maneuver:
    """ISO 7401 at a speed [m/s]: the steering steps to its value in 0.1 s, the throttle stays where it was."""
    target = handling_speed(spec) if speed is None else speed
    step = Intervention(
        steering=((0.0, 0.0), (STEP_TIME, 1.0)), amplitude=_amplitude(spec, steering, STEP_FACTOR), pedals=Pedals.HELD
    )
    return rolling(spec, "step-input", speed=target, duration=duration, intervention=step)


def sine_pattern(step: float = 0.005) -> Points:
    """A sine of 0.7 Hz whose second peak lasts for half a second: points (time since it began [s], -1..1)."""
    quarter = 0.75 / DWELL_FREQUENCY
    times = [round(k * step, 9) for k in range(math.floor(SINE_END / step))]
    points = []
    for time in times:
        phase = time if time < quarter else max(quarter, time - DWELL)
        points.append((time, math.sin(2.0 * math.pi * DWELL_FREQUENCY * phase)))
    return (*points, (SINE_END, 0.0))


def sine_with_dwell(
    spec: VehicleSpec, *, speed: float | None = None, steering: float | None = None, duration: float = 6.0
) -> Maneuver:
    """FMVSS 126: a sine of 0.7 Hz with a dwell of 0.5 s, its amplitude (-1..1) five times the steering at 0.3 g.

    The throttle is released when the steering begins.
    """
    if duration <= SINE_END + 1.75:
        raise SpecError(f"duration: must be above {SINE_END + 1.75:.3g} s, where yaw rates are read, got {duration!r}")
    target = handling_speed(spec) if speed is None else speed
    test = Intervention(
        steering=sine_pattern(), amplitude=_amplitude(spec, steering, USUAL_FACTOR), pedals=released(spec)
    )
    return rolling(
        spec, "sine-with-dwell", speed=target, duration=duration, intervention=test, steering_unit=steering_unit(spec)
    )


def fishhook(
    spec: VehicleSpec, *, speed: float | None = None, steering: float | None = None, dwell: float | None = None,
    duration: float = 8.0,
) -> Maneuver:  # fmt: skip
    """Steering to 6.5 times that at 0.3 g, then as far to the other side, for three seconds; the throttle is released.

    The way back begins when the roll rate has fallen below 1.5°/s, or after a dwell [s] if one is given.
    """
    target = handling_speed(spec) if speed is None else speed
    amplitude = _amplitude(spec, steering, FISHHOOK_FACTOR)
    there = abs(amplitude) / FISHHOOK_RATE
    turned = there + (0.0 if dwell is None else dwell)
    other = turned + 2.0 * there
    pattern = (
        (0.0, 0.0), (there, 1.0), (turned, 1.0), (other, -1.0), (other + FISHHOOK_HOLD, -1.0),
        (other + FISHHOOK_HOLD + FISHHOOK_BACK, 0.0),
    )  # fmt: skip
    test = Intervention(
        steering=pattern, amplitude=amplitude, pedals=released(spec), pause=there if dwell is None else None
    )
    return rolling(spec, "fishhook", speed=target, duration=duration, intervention=test)
