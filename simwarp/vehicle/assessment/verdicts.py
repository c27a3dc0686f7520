"""Verdicts on a recorded run: rules with their limits, and whether the run kept to them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import Any, Final

from simwarp.vehicle.assessment.entry_speed import asked_speed
from simwarp.vehicle.assessment.handling_results import dwell_verdicts, lift_verdicts
from simwarp.vehicle.assessment.lane_verdicts import lane_verdicts
from simwarp.vehicle.assessment.straight_results import braking_verdicts, hill_verdicts
from simwarp.vehicle.assessment.verdict import Verdict
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.run_result import since_zero

__all__ = ["Verdict", "passed", "verdict_rows", "verdicts"]


def verdicts(run: Run, maneuver: Maneuver) -> list[Verdict]:
    """What a manoeuvre asks of a run, with the speed asked for in each rule; nothing where it asks for nothing, or the
    run has no rows after its zero.

    Args:
        run: recorded, with the settling before its zero.
        maneuver: that was driven.
    """
    moving = since_zero(run)
    if len(moving["t_s"]) < 2:
        return []
    rules = _RULES.get(maneuver.name)
    found = [] if rules is None else rules(moving, maneuver)
    if maneuver.course is not None:
        found = lane_verdicts(run, maneuver.course)
    speed = asked_speed(maneuver)
    if math.isnan(speed):
        return found
    return [dataclasses.replace(each, rule=f"{each.rule}, at {speed:.4g} m/s") for each in found]


def passed(found: Iterable[Verdict]) -> bool | None:
    """Whether all rules are kept; None where there is none."""
    kept = [verdict.passed for verdict in found]
    return all(kept) if kept else None


def verdict_rows(found: Iterable[Verdict]) -> list[dict[str, Any]]:
    """For JSON: fields by name; what is not a number is None."""
    return [
        {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in dataclasses.asdict(verdict).items()
        }
        for verdict in found
    ]


_RULES: Final[dict[str, Callable[[Run, Maneuver], list[Verdict]]]] = {
    "sine-with-dwell": dwell_verdicts,
    "fishhook": lift_verdicts,
    "braking": braking_verdicts,
    "split-braking": braking_verdicts,
    "hill-start": hill_verdicts,
}
