"""What a tire property file must hold to be read: format, side, mode, ranges, scaling factors."""

from __future__ import annotations

from typing import Final

from simwarp.core.types import formatted
from simwarp.vehicle.spec.vehicle_spec import SpecError, Tire
from simwarp.vehicle.tires.tire_parameters import Pacejka2002Parameters

FORMATS: Final = ("PAC2002", "MF-TYRE", "MF_05")
"""PROPERTY_FILE_FORMAT: the coefficients of Adams/Tire's PAC2002, and two names of MF-Tyre 5.2."""
MF52_FITS: Final = (5, 52)
"""FITTYP of MF-Tyre 5.2."""
NEEDED: Final = ("FNOMIN", "PCX1", "PDX1", "PKX1", "PCY1", "PDY1", "PKY1", "PKY2", "VERTICAL_STIFFNESS")
POSITIVE: Final = ("FNOMIN", "LFZO", "VERTICAL_STIFFNESS", "UNLOADED_RADIUS", "LMUX", "LMUY", "LCX", "LCY")
SLOPES_X: Final = ("PKX1", "LKX")
SLOPES_Y: Final = ("PKY1", "PKY2", "LKY")
"""Without which a force does not grow with its slip: the formulas of combined slip and of M_z divide by that slope."""
SIDES: Final = ("LEFT", "RIGHT", "SYMMETRIC")
OTHER_SCALES: Final = {
    "LMUV": (0.0, "friction that falls with the speed of sliding"),
    "LKYC": (1.0, "a camber stiffness of its own"),
    "LKZC": (1.0, "a camber torque of its own"),
    "LMP": (1.0, "a parking torque"),
}
"""Scaling factors of later formulas: the value at which they do nothing, and what they scale."""
MODES_NOT_THERE: Final = {
    5: "turn slip",
    20: "nonlinear relaxation with a contact mass",
    30: "a belt as a rigid ring",
}
"""Parts of USE_MODE that are refused."""


def number(tir: dict[str, float | str], key: str, default: float) -> float:
    """The value of a key."""
    value = tir.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SpecError(f"tir.{key}: must be a number, got {formatted(value)}")
    return float(value)


def refuse_key(key: str, rule: str, value: object, remedy: str) -> SpecError:
    """The error for a value of the file that breaks a rule."""
    return SpecError(f"tir.{key}: must {rule}, got {formatted(value)}; {remedy}")


def word(tir: dict[str, float | str], key: str, default: str) -> str:
    """A text in capitals."""
    return str(tir.get(key, default)).strip().upper()


def is_mf52(tir: dict[str, float | str]) -> bool:
    """True if the coefficients are those of MF-Tyre 5.2."""
    named = word(tir, "PROPERTY_FILE_FORMAT", "")
    return named != "PAC2002" and (named in FORMATS or tir.get("FITTYP") in MF52_FITS)


def side_of(tir: dict[str, float | str]) -> str | None:
    """TYRESIDE in small letters; None: the file has none.

    Raises:
        SpecError: it is none of `SIDES`.
    """
    if "TYRESIDE" not in tir:
        return None
    side = word(tir, "TYRESIDE", "")
    if side not in SIDES:
        rule = f"be one of {', '.join(map(repr, SIDES))}"
        raise refuse_key("TYRESIDE", rule, tir["TYRESIDE"], "name the side of the measurement, or leave it out")
    return side.lower()


def use_mode(given: Pacejka2002Parameters) -> tuple[float, bool]:
    """USE_MODE without its tens, negative for the mirror image; and whether it asks for relaxation lengths.

    Raises:
        SpecError: it is none, or asks for what is not there.
    """
    key = "tir.USE_MODE" if given.mode is None else "mode"
    mode = number(given.tir, "USE_MODE", 4.0) if given.mode is None else float(given.mode)
    remedy = "give 0 (F_z), 1 (F_x), 2 (F_y, M_z), 3 (both) or 4 (combined slip), 10 more with relaxation lengths"
    size = abs(mode)
    if size != round(size) or size >= 1000.0:
        raise SpecError(f"{key}: must be a whole number below 1000, got {mode:g}; {remedy}")
    whole = int(size) % 100  # hundreds name a kind of road
    for part, what in MODES_NOT_THERE.items():
        if whole % 10 == part or 10 * (whole // 10) == part:
            raise SpecError(f"{key}: must not ask for {what}, got {mode:g}; {remedy}")
    if whole % 10 > 4 or whole > 14:
        raise SpecError(f"{key}: must be one of 0, 1, 2, 3, 4 or 10 more, got {mode:g}; {remedy}")
    return (-1.0 if mode < 0.0 else 1.0) * float(whole % 10), whole >= 10


def range_of(tir: dict[str, float | str], low: str, high: str, default: tuple[float, float]) -> tuple[float, float]:
    """A range of the measurement; the default where the file has none.

    Raises:
        SpecError: its ends are not on both sides of zero.
    """
    values = number(tir, low, default[0]), number(tir, high, default[1])
    if values[0] > 0.0:
        raise refuse_key(low, "not be positive", values[0], f"give the least value of the measurement, or no {low}")
    if values[1] < 0.0 or values[1] <= values[0]:
        rule = f"be above {low} {values[0]:g} and not negative"
        raise refuse_key(high, rule, values[1], f"give the largest value of the measurement, or no {high}")
    return values


def check_file(tire: Tire, tir: dict[str, float | str]) -> None:
    """Format, needed keys, signs, scaling factors, and the radius.

    Raises:
        SpecError: one of them breaks its rule.
    """
    _check_format(tir)
    for key in NEEDED:
        if key not in tir:
            raise SpecError(f"tir.{key}: missing; a Pacejka 2002 tire needs {', '.join(NEEDED)}")
    for key in POSITIVE:
        if not number(tir, key, 1.0) > 0.0:
            raise refuse_key(key, "be positive", tir[key], f"give {key} of the measured tire")
    for key, (idle, what) in OTHER_SCALES.items():
        if number(tir, key, idle) != idle:
            raise refuse_key(key, f"be {idle:g}", tir[key], f"it scales {what}, which these formulas do not have")
    radius = number(tir, "UNLOADED_RADIUS", tire.radius)
    if abs(radius - tire.radius) > 0.02 * radius:
        raise SpecError(f"tir.UNLOADED_RADIUS: must be the tire's radius {tire.radius} m within 2 %, got {radius!r}")


def check_slopes(tir: dict[str, float | str], mode: float, *, lagging: bool) -> None:
    """Slopes of the forces that a mode divides by.

    Args:
        tir: KEY -> value.
        mode: 0 to 4.
        lagging: slips follow over relaxation lengths.

    Raises:
        SpecError: one of them is zero.
    """
    keys = (SLOPES_X if mode == 4.0 or (lagging and mode != 0.0) else ()) + (SLOPES_Y if mode >= 2.0 else ())
    for key in keys:
        if number(tir, key, 1.0) == 0.0:
            raise refuse_key(key, "not be 0", tir[key], f"mode {mode:g} divides by that slope; give it or another mode")


def _check_format(tir: dict[str, float | str]) -> None:
    """Refuse coefficients of other formulas."""
    if "PROPERTY_FILE_FORMAT" in tir and word(tir, "PROPERTY_FILE_FORMAT", "") not in FORMATS:
        rule = f"be one of {', '.join(map(repr, FORMATS))}"
        raise refuse_key(
            "PROPERTY_FILE_FORMAT", rule, tir["PROPERTY_FILE_FORMAT"], "coefficients of other formulas are not read"
        )
    if word(tir, "PROPERTY_FILE_FORMAT", "") != "PAC2002" and "FITTYP" in tir and tir["FITTYP"] not in MF52_FITS:
        rule = f"be {' or '.join(map(str, MF52_FITS))}, MF-Tyre 5.2"
        raise refuse_key("FITTYP", rule, tir["FITTYP"], "fit the tire in that version; later ones have other formulas")
