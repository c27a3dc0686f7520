"""Braking and driving straight on: stops, split friction, brakes in a turn, acceleration, hills and bumps."""

from __future__ import annotations

import math
from typing import Final

from simwarp.vehicle.driving.driver_choices import steering_for, usual_radius
from simwarp.vehicle.driving.drivers import HELD, ScriptSpec
from simwarp.vehicle.driving.handling_maneuvers import CIRCLE
from simwarp.vehicle.driving.intervention import Intervention, Pedals
from simwarp.vehicle.driving.maneuver_spec import Bump, FrictionPatch, Maneuver, after_settling
from simwarp.vehicle.driving.path_tracking import PathTrackingSpec, wheelbase
from simwarp.vehicle.driving.paths import circle
from simwarp.vehicle.driving.reachable_speeds import held_speed
from simwarp.vehicle.driving.rolling_start import LEAD, holding_gains, holding_throttle, rolling
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

FULL_SPEED: Final = 100.0 / 3.6
"""Of stops, for vehicles whose description has no other one [m/s]."""
BRAKE_TIME: Final = 0.1
"""In which a foot comes down on the brakes [s]."""
SLIPPERY_ROAD: Final = (-50.0, 950.0)
"""X of a patch of road that stands for one without an end [m], the same at all speeds."""
SLIPPERY_WIDTH: Final = 50.0
"""[m]"""


def braking_speed(spec: VehicleSpec) -> float:
    """Of stops: 100 km/h, or what suits the vehicle [m/s]."""
    return spec.maneuver_defaults.speed_of_stops or held_speed(spec, FULL_SPEED)


def _brakes(share: float) -> Intervention:
    """Throttle released, steering kept, brakes on by a share."""
    return Intervention(
        steering=HELD, pedals=Pedals.RELEASED, braking=((0.0, 0.0), (BRAKE_TIME, 1.0)), brakes=share
    )  # fmt: skip


def _stop_time(speed: float) -> float:
    """Enough to stop with a third of g, and a little [s]."""
    return speed / 3.0 + 2.0


def braking(
    spec: VehicleSpec, *, speed: float | None = None, brakes: float = 0.5, duration: float | None = None
) -> Maneuver:
    """A stop from a speed [m/s], straight on with the steering kept; brakes (0..1) within 0.1 s."""
    target = braking_speed(spec) if speed is None else speed
    total = _stop_time(target) if duration is None else duration
    return rolling(spec, "braking", speed=target, duration=total, intervention=_brakes(brakes))


def split_braking(
    spec: VehicleSpec, *, speed: float | None = None, brakes: float = 0.5, left: float = 0.3,
    duration: float | None = None,
) -> Maneuver:  # fmt: skip
    """A stop (ISO 14512) with the steering kept where the road's left side has a share of the friction."""
    target = 0.75 * braking_speed(spec) if speed is None else speed
    total = 2.0 * _stop_time(target) if duration is None else duration
    patch = FrictionPatch(x=SLIPPERY_ROAD, y=(0.0, SLIPPERY_WIDTH), factor=left)
    return rolling(
        spec, "split-braking", speed=target, duration=total, intervention=_brakes(brakes), patches=(patch,)
    )  # fmt: skip


TURN_SETTLING: Final = 8.0
"""Time on the circle before the brakes [s]."""


def brake_in_turn(
    spec: VehicleSpec, *, speed: float | None = None, radius: float | None = None, brakes: float = 0.5,
    duration: float = 6.0,
) -> Maneuver:  # fmt: skip
    """ISO 7975: on a circle [m] at a speed [m/s], 4 m/s² across; then the steering is kept and the brakes act."""
    turn = usual_radius(spec, spec.maneuver_defaults.radius_of_circle, CIRCLE[0]) if radius is None else radius
    last = spec.maneuver_defaults.speed_on_circle or held_speed(spec, math.inf)
    target = min(last, math.sqrt(4.0 * abs(turn))) if speed is None else speed
    follow = PathTrackingSpec(
        paths=(circle(turn),), speed=target, steering=steering_for(spec), speed_gains=holding_gains(spec, target),
        first_throttle=holding_throttle(spec, target),
    )  # fmt: skip
    return Maneuver(
        name="brake-in-turn", follow=follow, start=TURN_SETTLING, duration=duration, initial_speed=target,
        intervention=_brakes(brakes),
    )  # fmt: skip


def acceleration(spec: VehicleSpec, *, duration: float = 40.0) -> Maneuver:
    """Full throttle from rest: times to 60, 80 and 100 km/h, the quarter mile, and the top speed reached."""
    script = ScriptSpec(throttle=after_settling((0.0, 1.0), before=0.0), braking=after_settling((0.0, 0.0), before=1.0))
    return Maneuver(name="acceleration", script=script, duration=duration)


HOLD: Final = 3.0
"""Of a hill start: time on the brakes [s]."""


def hill_start(spec: VehicleSpec, *, slope: float = 0.15, duration: float = 10.0) -> Maneuver:
    """Uphill (rise per run): three seconds on the brakes, then they open within 0.3 s and the throttle within 0.5 s."""
    script = ScriptSpec(
        braking=after_settling((HOLD, 1.0), (HOLD + 0.3, 0.0), before=1.0),
        throttle=after_settling((HOLD, 0.0), (HOLD + 0.5, 1.0), before=0.0),
    )
    return Maneuver(name="hill-start", script=script, duration=duration, slope=slope)


BUMP_SPEED: Final = 10.0
"""Over the bump, for vehicles whose description has no other one [m/s]."""


def bump(
    spec: VehicleSpec, *, speed: float | None = None, height: float | None = None, length: float | None = None,
    duration: float | None = None,
) -> Maneuver:  # fmt: skip
    """Straight over a bump across the road, half a sine wave of a height and a length [m], at a speed [m/s].

    Without them it is as high as a sixth of a tire's radius and as long as three of them.
    """
    usual = spec.maneuver_defaults.speed_over_bump or held_speed(spec, BUMP_SPEED)
    target = usual if speed is None else speed
    tire = spec.axles[0].tire.radius
    across = Bump(
        start=LEAD * target + wheelbase(spec) + tire, length=3.0 * tire if length is None else length,
        height=tire / 6.0 if height is None else height,
    )  # fmt: skip
    total = (across.start + across.length + 2.0 * wheelbase(spec)) / target - LEAD + 2.0
    return rolling(spec, "bump", speed=target, duration=total if duration is None else duration, bump=across)
