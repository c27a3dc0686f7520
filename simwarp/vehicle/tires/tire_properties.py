"""Pacejka 2002 tires from the keys of a property file (.tir of Adams/Tire)."""

from __future__ import annotations

import numpy as np

from simwarp.core.types import formatted
from simwarp.vehicle.spec.vehicle_spec import SpecError, Tire
from simwarp.vehicle.tires.common_parameters import THIRD, Vector, common_vector
from simwarp.vehicle.tires.parameter_vector_kernels import PAC02_SIZE, Common, Pac02
from simwarp.vehicle.tires.tire_parameters import CommonParameters, Pacejka2002Parameters

UNITS = {"LENGTH": ("meter", "m"), "FORCE": ("newton", "n"), "ANGLE": ("radian", "radians", "rad"), "TIME": ("second",)}
FORMATS = ("PAC2002",)
NEEDED = ("FNOMIN", "PCX1", "PDX1", "PKX1", "PCY1", "PDY1", "PKY1", "PKY2", "VERTICAL_STIFFNESS")
POSITIVE = ("FNOMIN", "LFZO", "VERTICAL_STIFFNESS", "UNLOADED_RADIUS")
MODES = (0, 1, 2, 3, 4)
FREE = 1.0e30


def check_file(tire: Tire, tir: dict[str, float | str]) -> None:
    """Format, units, the needed keys, and the radius."""
    name = tir.get("PROPERTY_FILE_FORMAT", FORMATS[0])
    if str(name).strip().upper() not in FORMATS:
        rule = f"must be {FORMATS[0]!r}, got {formatted(name)}"
        raise SpecError(f"tir.PROPERTY_FILE_FORMAT: {rule}; coefficients of other formulas are not read")
    for key, names in UNITS.items():
        if key in tir and str(tir[key]).strip().lower() not in names:
            raise SpecError(f"tir.{key}: must be {names[0]!r}, got {formatted(tir[key])}; convert the file to SI units")
    for key in NEEDED:
        if key not in tir:
            raise SpecError(f"tir.{key}: missing; a Pacejka 2002 tire needs {', '.join(NEEDED)}")
    for key in POSITIVE:
        if not number(tir, key, 1.0) > 0.0:
            raise SpecError(f"tir.{key}: must be positive, got {formatted(tir[key])}")
    radius = number(tir, "UNLOADED_RADIUS", tire.radius)
    if abs(radius - tire.radius) > 0.02 * radius:
        raise SpecError(f"tir.UNLOADED_RADIUS: must be the tire's radius {tire.radius} m within 2 %, got {radius!r}")


def number(tir: dict[str, float | str], key: str, default: float) -> float:
    """The value of a key."""
    value = tir.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SpecError(f"tir.{key}: must be a number, got {formatted(value)}")
    return float(value)


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
    """Vector of a Pacejka 2002 tire.

    Raises:
        SpecError: a key that is missing or no number, units that are not SI, another radius.
    """
    tir = given.tir
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
    mode = number(tir, "USE_MODE", 4.0) if given.mode is None else float(given.mode)
    if mode not in MODES:
        raise SpecError(f"mode: must be one of {', '.join(map(str, MODES))}, got {mode:g}")
    vector[Pac02.MODE] = mode
    vector[Pac02.ELLIPSE] = float(given.combined == "friction-ellipse")
    vector[Pac02.ARGUMENT_LIMIT] = FREE if given.argument_limit is None else given.argument_limit
    fill_vertical(vector, tire, tir, factors["STIFFNESS"])
    return vector


def fill_vertical(vector: Vector, tire: Tire, tir: dict[str, float | str], pressure: float) -> None:
    """The vertical law: QFZ1 to QFZ3 where the file has them, or the stiffness; and the load to which it is valid."""
    scale = number(tir, "LCZ", 1.0) * pressure
    nominal = vector[Pac02.FNOMIN]
    vector[Common.STIFFNESS] = number(tir, "VERTICAL_STIFFNESS", 0.0) * scale
    if "QFZ1" in tir:
        vector[Common.STIFFNESS] = number(tir, "QFZ1", 0.0) * nominal / tire.radius * scale
        vector[Common.STIFFNESS_SQUARE] = number(tir, "QFZ2", 0.0) * nominal / tire.radius**2 * scale
        vector[Common.STIFFNESS_CAMBER] = number(tir, "QFZ3", 0.0) * nominal / tire.radius * scale
    vector[Common.DAMPING] = number(tir, "VERTICAL_DAMPING", 0.0)
    largest = number(tir, "FZMAX", 0.0)
    vector[Common.LOAD_LIMIT] = largest if largest > 0.0 else np.finfo(np.float32).max
