"""Speeds and radii at which a vehicle is tested where nothing else is asked for, as its description gives them."""

from __future__ import annotations

import dataclasses
from typing import Final

from simwarp.core.constraints import Positive
from simwarp.vehicle.spec.parts import Spec


@dataclasses.dataclass(frozen=True, kw_only=True)
class ManeuverDefaults(Spec):
    """Defaults of manoeuvres for one vehicle, which a changed copy inherits; what is left out follows from the
    vehicle's top speed and wheelbase (`simwarp.vehicle.driving.driver_choices`).
    """

    speed_of_steering_run: Positive | None = None
    """Of step-steer, sine-sweep, constant-radius and the recorded steering run [m/s]."""
    speed_of_braking_run: Positive | None = None
    """Of the recorded braking run [m/s]."""
    radius: Positive | None = None
    """Of constant-radius [m]."""
    speed_in_lanes: Positive | None = None
    """Through lanes between cones [m/s]."""
    speed_of_handling: Positive | None = None
    """Of slow-steer, step-input, sine-with-dwell and fishhook [m/s]."""
    handling_steering: Positive | None = None
    """Steering input that makes 0.3 g at `speed_of_handling`, as slow-steer finds it, 0 to 1."""
    radius_of_circle: Positive | None = None
    """Of steady-state-circle and brake-in-turn [m]."""
    speed_on_circle: Positive | None = None
    """At the end of steady-state-circle [m/s]."""
    speed_of_stops: Positive | None = None
    """From which braking stops [m/s]."""
    speed_over_bump: Positive | None = None
    """[m/s]."""
    speed_of_pull: Positive | None = None
    """Of drawbar [m/s]."""


NONE_GIVEN: Final = ManeuverDefaults()
"""Of a vehicle whose description has none."""
