"""Manoeuvres that begin in motion: a driver holds speed and line, until the test takes over."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from simwarp.vehicle.driving.driver_choices import needs_axles, speed_gains, steering_for
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.path_tracking import LookAhead, PathTrackingSpec, PIDGains, Unicycle, full_speed
from simwarp.vehicle.driving.paths import Path
from simwarp.vehicle.spec.vehicle_spec import DifferentialDrive, VehicleSpec

LEAD: Final = 2.0
"""Time in motion before a manoeuvre's zero, in which the vehicle settles on its springs [s]."""
PREVIEW: Final = 0.5
"""Of the driver [s]."""
FIRMNESS: Final = 2.0
"""Pedal per error of the speed [s/m], and per second of it: an error dies out within `LEAD`."""
FIRM_BELOW: Final = 8.0
"""Speed below which the pedals are firmer [m/s]."""


def holding_gains(spec: VehicleSpec, speed: float) -> PIDGains:
    """Of the pedals that hold a speed [m/s] from the first step on.

    They are firmer than those of a start from rest: what holds the speed is found before the test takes over.
    """
    if isinstance(spec.driveline, DifferentialDrive):
        return speed_gains(spec)
    gain = FIRMNESS * max(1.0, FIRM_BELOW / speed)
    return PIDGains(proportional=gain, integral=gain)


def holding_throttle(spec: VehicleSpec, speed: float) -> float:
    """With which a vehicle begins at a speed [m/s]: motors that hold a speed would stop it with none."""
    return min(speed / full_speed(spec), 1.0) if isinstance(spec.driveline, DifferentialDrive) else 0.0


def straight(length: float) -> Path:
    """A path along x, from the origin on [m]."""
    return Path(np.array([(0.0, 0.0), (length, 0.0)]))


def rolling(
    spec: VehicleSpec, name: str, *, speed: float, duration: float, path: Path | None = None, lead: float = LEAD,
    steering: LookAhead | Unicycle | None = None, **rest: Any,
) -> Maneuver:  # fmt: skip
    """A manoeuvre of a vehicle that rolls at a speed from its first step on, with a driver who holds it on a path.

    Args:
        spec: of the vehicle.
        name: of the manoeuvre.
        speed: [m/s].
        duration: from the manoeuvre's zero on [s].
        path: straight ahead when None.
        lead: time before the manoeuvre's zero [s].
        steering: of the driver; `steering_for` with half a second of preview when None.
        rest: further fields of the `Maneuver`.

    Raises:
        SpecError: the vehicle has one axle.
    """
    needs_axles(spec)
    line = straight(2.0 * speed * (lead + duration) + 10.0) if path is None else path
    law = steering_for(spec, PREVIEW, speed) if steering is None else steering
    follow = PathTrackingSpec(
        paths=(line,), speed=speed, steering=law, speed_gains=holding_gains(spec, speed),
        first_throttle=holding_throttle(spec, speed),
    )  # fmt: skip
    return Maneuver(name=name, follow=follow, start=lead, duration=duration, initial_speed=speed, **rest)
