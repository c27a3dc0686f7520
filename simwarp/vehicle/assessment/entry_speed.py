"""The speed at which a vehicle comes into a test, beside the one that was asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.run_result import Result

HELD_WITHIN: Final = 0.01
"""Of the speed asked for: half of the 2 km/h in 80 that FMVSS 126 allows a driver, and less."""
ENTRY: Final = "entry_speed"
"""Key of the result."""


def asked_speed(maneuver: Maneuver) -> float:
    """That the driver of a path is to hold, at the end of a ramp [m/s]; NaN without one."""
    return math.nan if maneuver.follow is None else maneuver.follow.speed


def entry_results(run: Run, maneuver: Maneuver) -> list[Result]:
    """The speed at the manoeuvre's zero, of one that begins in motion and has no lanes; their own results tell it.

    Args:
        run: from the manoeuvre's zero on.
        maneuver: that was driven.
    """
    if maneuver.initial_speed <= 0.0 or maneuver.course is not None:
        return []
    return [Result(ENTRY, "speed at the start of the test", float(np.interp(0.0, run["t_s"], run["speed_mps"])), "m/s")]


def shortfall(found: Sequence[Result], maneuver: Maneuver) -> list[Result]:
    """The speed asked for, and how far the entry is from it where that was not held within `HELD_WITHIN`.

    Args:
        found: results of the run so far.
        maneuver: that was driven.
    """
    asked = asked_speed(maneuver)
    if math.isnan(asked):
        return []
    told = [Result("asked_speed", "speed asked for", asked, "m/s")]
    if not is_held(found, maneuver):
        off = 100.0 * (next(item.value for item in found if item.key == ENTRY) / asked - 1.0)
        told.append(Result("entry_error", "speed not held: entry off it by", off, "%", "entry not reached"))
    return told


def is_held(found: Sequence[Result], maneuver: Maneuver) -> bool:
    """Whether a vehicle that began in motion came into the test at the speed asked for; True of others."""
    entry = next((item.value for item in found if item.key == ENTRY), None)
    if entry is None or maneuver.initial_speed <= 0.0:
        return True
    return abs(entry / asked_speed(maneuver) - 1.0) <= HELD_WITHIN
