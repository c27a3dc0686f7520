"""Pacejka 2002 and MF-Tyre 5.2 tires from the keys of a property file (.tir of Adams/Tire)."""

from __future__ import annotations

import math

import numpy as np

from simwarp.core.types import formatted
from simwarp.vehicle.spec.vehicle_spec import Spec, SpecError, Tire
from simwarp.vehicle.tires.common_parameters import THIRD, Vector, common_vector
from simwarp.vehicle.tires.parameter_vector_kernels import PAC02_SIZE, Common, Pac02
from simwarp.vehicle.tires.tire_file_rules import (
    check_file,
    check_slopes,
    is_mf52,
    number,
    range_of,
    refuse_key,
    side_of,
    use_mode,
)
from simwarp.vehicle.tires.tire_file_units import in_si_units
from simwarp.vehicle.tires.tire_parameters import CommonParameters, Pacejka2002Parameters

FREE = 1.0e30
GRAVITY = 9.81
STEEPEST_ANGLE = 0.5 * math.pi - 0.01
"""Largest slip angle [rad]."""

ASYMMETRIC = (
    "RHX1", "QSX1", "PEY3", "PHY1", "PHY2", "PVY1", "PVY2", "RBY3", "RVY1", "RVY2", "QBZ4", "QDZ3", "QDZ6", "QDZ7",
    "QEZ4", "QHZ1", "QHZ2", "SSZ1",
)  # fmt: skip
"""Coefficients that differ between left and right: with all of them zero, -a and -g give -F_y, -M_x and -M_z (conicity
and plysteer are gone). With the other signs of all, they are those of the mirror image.
"""
WEIGHTS = ("RBX1", "RCX1", "RBY1", "RCY1")
"""Coefficients without which combined slip has no weights."""
TRANSIENT = ("PTX1", "PTY1", "PTY2")
"""Coefficients of the relaxation lengths."""


def measured_side(common: CommonParameters, part: Spec) -> str | None:
    """Side of the vehicle on which a tire is not mirrored; None: neither."""
    if common.measured_side is not None or not isinstance(part, Pacejka2002Parameters):
        return None if common.measured_side == "either" else common.measured_side
    return side_of(part.tir) if use_mode(part)[0] >= 0.0 and side_of(part.tir) != "symmetric" else None


def default_of(key: str) -> float:
    """1 for scaling factors, whose names begin with L, 0 for coefficients."""
    return 1.0 if key.startswith("L") else 0.0


def pressure_factors(tir: dict[str, float | str]) -> dict[str, float]:
    """Factors of the inflation pressure over the nominal one; 1 without [TIRE_CONDITIONS]."""
    nominal = number(tir, "IP_NOM", 0.0) * number(tir, "LIP", 1.0)
    inflation = number(tir, "IP", 0.0)
    p = inflation / nominal - 1.0 if nominal > 0.0 and inflation > 0.0 else 0.0

    def value(key: str) -> float:
        return number(tir, key, 0.0)

    return {
        "STIFFNESS": 1.0 + value("QPFZ1") * p,
        "KX": 1.0 + value("PPX1") * p + value("PPX2") * p * p,
        "MUX": 1.0 + value("PPX3") * p + value("PPX4") * p * p,
        "KY": 1.0 + value("PPY1") * p,
        "PKY2": 1.0 + value("PPY2") * p,
        "MUY": 1.0 + value("PPY3") * p + value("PPY4") * p * p,
        "TRAIL": 1.0 - value("QPZ1") * p,
        "RESIDUAL": 1.0 + value("QPZ2") * p,
        "MX": 1.0 + value("QPX1") * p,
        "MY": (1.0 + p) ** value("QSY8"),
    }


def fill_pacejka2002(tire: Tire, common: CommonParameters, given: Pacejka2002Parameters) -> Vector:
    """Vector of a Pacejka 2002 or MF-Tyre 5.2 tire.

    Raises:
        SpecError: a key that is missing or no number, breaks a rule of the format or asks for what is not there, or
            another radius.
    """
    tir = in_si_units(given.tir)
    check_file(tire, tir)
    vector = common_vector(tire, common, PAC02_SIZE, camber=3.0, share=THIRD)
    factors = pressure_factors(tir)
    for entry in Pac02:
        name = entry.name
        if name.startswith("AT_PRESSURE_"):
            vector[entry] = factors[name.removeprefix("AT_PRESSURE_")]
        else:
            vector[entry] = number(tir, name, default_of(name))
    if "LKYG" not in tir:
        vector[Pac02.LKYG] = number(tir, "LKG", 1.0)
    if common.rolling_resistance is not None:
        vector[Pac02.QSY1] = common.rolling_resistance
    fill_side(vector, given)
    fill_format(vector, tire, tir, given)
    fill_mode(vector, tir, given)
    fill_ranges(vector, tir, common)
    fill_vertical(vector, tire, tir, factors["STIFFNESS"])
    return vector


def fill_side(vector: Vector, given: Pacejka2002Parameters) -> None:
    """Asymmetries: none of a SYMMETRIC tire, those of the mirror image where USE_MODE is negative."""
    factor = 0.0 if side_of(given.tir) == "symmetric" else math.copysign(1.0, use_mode(given)[0])
    vector[[Pac02[key] for key in ASYMMETRIC]] *= factor


def fill_format(vector: Vector, tire: Tire, tir: dict[str, float | str], given: Pacejka2002Parameters) -> None:
    """Where PAC2002 and MF-Tyre 5.2 differ, and how slips are combined."""
    vector[Pac02.MUY_CAMBER] = -1.0 if is_mf52(tir) else 1.0
    vector[Pac02.REFERENCE_SPEED] = math.sqrt(GRAVITY * tire.radius)
    if is_mf52(tir) and "LONGVL" in tir:
        speed = number(tir, "LONGVL", 0.0)
        if not speed > 0.0:
            raise refuse_key("LONGVL", "be positive", speed, "give the speed of the measurement")
        vector[Pac02.REFERENCE_SPEED] = speed
    weights = given.combined == "weights" or (given.combined is None and all(key in tir for key in WEIGHTS))
    vector[Pac02.ELLIPSE] = float(not weights)
    vector[Pac02.ARGUMENT_LIMIT] = FREE if given.argument_limit is None else given.argument_limit


def fill_mode(vector: Vector, tir: dict[str, float | str], given: Pacejka2002Parameters) -> None:
    """What is found, and whether slips lag."""
    mode, transient = abs(use_mode(given)[0]), use_mode(given)[1]
    vector[Pac02.MODE] = mode
    lengths_given = vector[Common.RELAXATION_X] > 0.0
    check_slopes(tir, mode, lagging=transient or bool(lengths_given))
    vector[Pac02.TRANSIENT] = float(transient and not lengths_given)
    if not transient or lengths_given:
        return
    for key in TRANSIENT:
        if number(tir, key, 0.0) == 0.0:
            place, asked = ("tir.USE_MODE", tir.get("USE_MODE")) if given.mode is None else ("mode", given.mode)
            raise SpecError(
                f"{place}: must be below 10 where {key} is missing or 0, got {formatted(asked)}: it asks for relaxation"
                " lengths; give relaxation_length, or a mode of 0 to 4"
            )


def fill_ranges(vector: Vector, tir: dict[str, float | str], common: CommonParameters) -> None:
    """What slips, camber and load are held to."""
    vector[[Pac02.KPUMIN, Pac02.KPUMAX]] = range_of(tir, "KPUMIN", "KPUMAX", (-1.0, 1.0))
    angles = range_of(tir, "ALPMIN", "ALPMAX", (-STEEPEST_ANGLE, STEEPEST_ANGLE))
    vector[[Pac02.ALPMIN, Pac02.ALPMAX]] = np.clip(angles, -STEEPEST_ANGLE, STEEPEST_ANGLE)
    limit = vector[Common.CAMBER_LIMIT]
    camber = (-limit, limit)
    if common.camber_limit is None:
        camber = range_of(tir, "CAMMIN", "CAMMAX", camber)
        vector[Common.CAMBER_LIMIT] = max(map(abs, camber))
    vector[[Pac02.CAMMIN, Pac02.CAMMAX]] = camber
    least = number(tir, "FZMIN", 0.0)
    largest = number(tir, "FZMAX", 0.0)
    if least < 0.0:
        raise refuse_key("FZMIN", "not be negative", least, "give the least load of the measurement, or leave it out")
    if 0.0 < largest <= least:
        raise refuse_key("FZMAX", f"be above FZMIN {least:g}", largest, "give the largest load of the measurement")
    vector[Pac02.FZMIN] = least
    vector[Common.LOAD_LIMIT] = largest if largest > 0.0 else np.finfo(np.float32).max


def fill_vertical(vector: Vector, tire: Tire, tir: dict[str, float | str], pressure: float) -> None:
    """The vertical law: QFZ1 to QFZ3 where the file has them, or the stiffness."""
    scale = number(tir, "LCZ", 1.0) * pressure
    nominal = vector[Pac02.FNOMIN]
    vector[Common.STIFFNESS] = number(tir, "VERTICAL_STIFFNESS", 0.0) * scale
    if "QFZ1" in tir:
        vector[Common.STIFFNESS] = number(tir, "QFZ1", 0.0) * nominal / tire.radius * scale
        vector[Common.STIFFNESS_SQUARE] = number(tir, "QFZ2", 0.0) * nominal / tire.radius**2 * scale
        vector[Common.STIFFNESS_CAMBER] = number(tir, "QFZ3", 0.0) * nominal / tire.radius * scale
    vector[Common.DAMPING] = number(tir, "VERTICAL_DAMPING", 0.0)
