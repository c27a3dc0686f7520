"""Deviations that are known: which quantities miss their tolerance, by how much at most, and where it is explained."""

from __future__ import annotations

import enum
from typing import Final

from simwarp.verify.check_result import CheckResult

EXPLAINED: Final = "docs/decisions.md#vehicles"

_ARTCAR: Final = f"the recorded car spins a wheel and its tires ring from step to step: {EXPLAINED}"
_GATOR: Final = f"the recorded rack steers by itself at full throttle: {EXPLAINED}"
_FIALA: Final = f"the recorded yaw rate falls with the recording's step, and these tires amplify it: {EXPLAINED}"
_SHIFT: Final = f"the record's own gear change moves by 0.1 s with its step: {EXPLAINED}"
_LOAD: Final = f"not explained, the other three loads are within: {EXPLAINED}"

KNOWN: Final = {
    ("vehicles: artcar tmeasy accel", "speed, RMS"): (22.5, _ARTCAR),
    ("vehicles: artcar tmeasy accel", "distance"): (4.5, _ARTCAR),
    ("vehicles: gator tmeasy accel", "yaw rate, RMS"): (0.03, _GATOR),
    ("vehicles: gator tmeasy accel", "v x yaw rate, RMS"): (0.24, _GATOR),
    ("vehicles: hmmwv fiala steer", "yaw rate, RMS"): (5.8, _FIALA),
    ("vehicles: hmmwv fiala steer", "v x yaw rate, RMS"): (5.5, _FIALA),
    ("vehicles: hmmwv fiala steer", "load RL, RMS"): (4.3, _FIALA),
    ("vehicles: hmmwv fiala steer", "load RR, RMS"): (4.4, _FIALA),
    ("vehicles: hmmwv tmeasy brake", "load FL, RMS"): (4.15, _LOAD),
    ("vehicles: hmmwv tmeasy steer 2 ms", "gear change 2 at"): (0.13, _SHIFT),
}
"""(Scene, quantity without its unit) -> largest |got - expected| that is known, and why. Beyond, it got worse."""


class Verdict(enum.Enum):
    """Verdict on a row."""

    PASSED = "pass"
    KNOWN = "known"
    FAILED = "FAIL"
    MENDED = "pass (listed as known)"

    @property
    def good(self) -> bool:
        """True if the answer is within its tolerance."""
        return self in (Verdict.PASSED, Verdict.MENDED)


def reason(row: CheckResult) -> str | None:
    """Known reason why a quantity deviates; None without one."""
    listed = KNOWN.get(_key(row))
    return None if listed is None else listed[1]


def verdict(row: CheckResult) -> Verdict:
    """Verdict on a row: it passed, or misses its tolerance by no more than is known, or failed."""
    listed = KNOWN.get(_key(row))
    if row.passed:
        return Verdict.PASSED if listed is None else Verdict.MENDED
    known = listed is not None and abs(row.got - row.expected) <= listed[0]  # not so NaN
    return Verdict.KNOWN if known else Verdict.FAILED


def _key(row: CheckResult) -> tuple[str, str]:
    return row.scene, row.quantity.partition(" [")[0]
