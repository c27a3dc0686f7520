"""Units that logs may have, as factors to SI."""

from __future__ import annotations

import math
from typing import Final

from simwarp.core.types import formatted
from simwarp.core.wording import suggestions
from simwarp.identify.fit_error import FitError

UNITS: Final[dict[str, float]] = {
    "1": 1.0, "%": 0.01,
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0,
    "m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": 0.3048,
    "m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704, "kn": 1852.0 / 3600.0,
    "m/s2": 1.0, "m/s²": 1.0, "g": 9.80665,
    "rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi,
    "rad/s": 1.0, "deg/s": math.pi / 180.0, "rpm": math.pi / 30.0,
    "N": 1.0, "kN": 1e3, "lbf": 4.4482216152605,
    "N·m": 1.0, "Nm": 1.0, "kN·m": 1e3, "kNm": 1e3,
    "kg": 1.0, "t": 1e3,
}  # fmt: skip
"""Name -> factor to SI."""


def factor_of(unit: str, place: str) -> float:
    """The factor by which numbers of a unit become those of SI.

    Args:
        unit: one of `UNITS`.
        place: what has the unit, for the error.

    Raises:
        FitError: it is none of them.
    """
    if unit not in UNITS:
        hint = suggestions(unit, UNITS, f"units: {', '.join(UNITS)}")
        raise FitError(f"{place}: unit must be one that is known, got {formatted(unit)}; {hint}")
    return UNITS[unit]
