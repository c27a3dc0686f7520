"""Units of a tire property file: its [UNITS] block, and the values of a file in SI units."""

from __future__ import annotations

from typing import Final

from simwarp.core.types import formatted
from simwarp.vehicle.spec.vehicle_spec import SpecError

LENGTHS: Final = {"meter": 1.0, "m": 1.0, "mm": 1.0e-3, "cm": 1.0e-2, "km": 1.0e3, "inch": 0.0254, "foot": 0.3048}
FORCES: Final = {
    "newton": 1.0, "n": 1.0, "knewton": 1.0e3, "kn": 1.0e3, "pound_force": 4.4482216152605, "kilogram_force": 9.80665,
}  # fmt: skip
TIMES: Final = {"second": 1.0, "sec": 1.0, "s": 1.0, "millisecond": 1.0e-3, "minute": 60.0, "hour": 3600.0}
ANGLES: Final = {"radian": 1.0, "radians": 1.0, "rad": 1.0}
"""Coefficients of camber are per radian in every file, so that one in degrees leaves open which values are."""
UNITS: Final = {"LENGTH": LENGTHS, "FORCE": FORCES, "TIME": TIMES, "ANGLE": ANGLES}
"""Name of each unit and its size in SI units; MASS and PRESSURE stand in no value that is read but their ratios."""

DIMENSIONS: Final = {
    "UNLOADED_RADIUS": (1, 0, 0), "WIDTH": (1, 0, 0), "FNOMIN": (0, 1, 0), "FZMIN": (0, 1, 0), "FZMAX": (0, 1, 0),
    "VERTICAL_STIFFNESS": (-1, 1, 0), "VERTICAL_DAMPING": (-1, 1, 1), "LONGVL": (1, 0, -1), "VXLOW": (1, 0, -1),
}  # fmt: skip
"""Powers of length, force and time of every value that has a unit."""


def in_si_units(tir: dict[str, float | str]) -> dict[str, float | str]:
    """The values of a file in SI units.

    Raises:
        SpecError: a unit is not known.
    """
    sizes = {key: _size(tir, key, known) for key, known in UNITS.items()}
    factors = (sizes["LENGTH"], sizes["FORCE"], sizes["TIME"])
    if factors == (1.0, 1.0, 1.0):
        return tir
    result = dict(tir)
    for key, powers in DIMENSIONS.items():
        value = tir.get(key)
        if isinstance(value, (int, float)):
            for factor, power in zip(factors, powers, strict=True):
                value *= factor**power
            result[key] = value
    return result


def _size(tir: dict[str, float | str], key: str, known: dict[str, float]) -> float:
    """Size of a unit; 1 where the file does not name it."""
    if key not in tir:
        return 1.0
    name = str(tir[key]).strip().lower()
    if name not in known:
        names = ", ".join(map(repr, known))
        raise SpecError(f"tir.{key}: must be one of {names}, got {formatted(tir[key])}; convert the file to SI units")
    return known[name]
