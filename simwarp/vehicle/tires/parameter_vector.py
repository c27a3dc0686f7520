"""From `spec.Tire` to the vectors that the kernels read (parameter_vector_kernels.py)."""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from simwarp.core.types import formatted
from simwarp.core.wording import nearest, shortened
from simwarp.vehicle.spec.parts import SPECS, Spec, SpecError, refuse
from simwarp.vehicle.spec.vehicle_parts import Tire
from simwarp.vehicle.tires.common_parameters import THIRD, Vector, common_vector, missing
from simwarp.vehicle.tires.flexible_tires import TEMPLATE as FLEXIBLE, flexible_parameters
from simwarp.vehicle.tires.parameter_vector_kernels import (
    BRISTLE_STATES,
    FIALA_SIZE,
    LAGGED_STATES,
    LUGRE_SIZE,
    PAC89_SIZE,
    TMEASY_SIZE,
    TMSIMPLE_SIZE,
    Common,
    Fiala,
    Lugre,
    Pac02,
    Pac89,
    TireContact,
    TireModel,
    Tmeasy,
    Tmsimple,
)
from simwarp.vehicle.tires.rigid_tires import TEMPLATE as RIGID, rigid_parameters
from simwarp.vehicle.tires.soil_tires import TEMPLATE as SOIL_RIGID, soil_rigid_parameters
from simwarp.vehicle.tires.tire_files import PropertyFileError, TirValues
from simwarp.vehicle.tires.tire_parameters import (
    CommonParameters,
    FialaParameters,
    LugreParameters,
    Pacejka89Parameters,
    Pacejka2002Parameters,
    RatedParameters,
    TmeasyParameters,
    TmsimpleParameters,
    VerticalParameters,
)
from simwarp.vehicle.tires.tire_properties import fill_pacejka2002, measured_side

GRAVITY = 9.81

# Of load indices 0, 1, ...: the mass that a tire bears [kg]; from ten to ten.
BEARABLE_MASS = (
    45, 46.5, 47.5, 48.7, 50, 51.5, 53, 54.5, 56, 58,
    60, 61.5, 63, 65, 67, 69, 71, 73, 75, 77.5,
    80, 82.5, 85, 87.5, 90, 92.5, 95, 97.5, 100, 103,
    106, 109, 112, 115, 118, 121, 125, 128, 132, 136,
    140, 145, 150, 155, 160, 165, 170, 175, 180, 185,
    190, 195, 200, 206, 212, 218, 224, 230, 236, 243,
    250, 257, 265, 272, 280, 290, 300, 307, 315, 325,
    335, 345, 355, 365, 375, 387, 400, 412, 425, 437,
    450, 462, 475, 487, 500, 515, 530, 545, 560, 580,
    600, 615, 630, 650, 670, 690, 710, 730, 750, 775,
    800, 825, 850, 875, 900, 925, 950, 975, 1000, 1030,
    1060, 1090, 1120, 1150, 1180, 1215, 1250, 1285, 1320, 1360,
    1400, 1450, 1500, 1550, 1600, 1650, 1700, 1750, 1800, 1850,
    1900, 1950, 2000, 2060, 2120, 2180, 2240, 2300, 2360, 2430,
    2500, 2575, 2650, 2725, 2800, 2900, 3000, 3075, 3150, 3250,
    3350, 3450, 3550, 3650, 3750, 3875, 4000, 4125, 4250, 4375,
    4500, 4625, 4750, 4875, 5000, 5150, 5300, 5450, 5600, 5850,
    6000, 6150, 6300, 6500, 6700, 6900, 7100, 7300, 7500, 7750,
    8000, 8250, 8500, 8750, 9000, 9250, 9500, 9750, 10000, 10300,
    10600, 10900, 11200, 11500, 11800, 12150, 12500, 12850, 13200, 13600,
    14000, 14500, 15000, 15550, 16000, 16500, 17000, 17500, 18000, 18500,
    19000, 19500, 20000, 20600, 21200, 21800, 22400, 23000, 23600, 24300,
    25000, 25750, 26500, 27250, 28000, 29000, 30000, 30750, 31500, 32500,
    33500, 34500, 35500, 36500, 37500, 38750, 40000, 41250, 42500, 43750,
    45000, 46250, 47500, 48750, 50000, 51500, 53000, 54500, 56000, 58000,
    60000, 61500, 63000, 65000, 67000, 69000, 71000, 73000, 75000, 77500,
    80000, 82500, 85000, 87500, 90000, 92500, 95000, 97500, 100000, 103000,
    106000, 109000, 112000, 115000, 118000, 121000, 125000, 128500, 132000, 136000,
)  # fmt: skip

FORCES = ("slope_x", "max_x", "slide_x", "slope_y", "max_y", "slide_y")
"""Given over the load; the other values have no unit."""

TMEASY_PATTERNS: dict[str, dict[str, tuple[float, float]]] = {
    "truck": {
        "slope_x": (17.7764, 14.5301), "max_x": (0.89965, 0.77751), "slide_x": (0.46183, 0.42349),
        "max_slip_x": (0.10811, 0.12389), "slide_slip_x": (0.66667, 0.66667),
        "slope_y": (7.4013, 6.8505), "max_y": (0.75876, 0.72628), "slide_y": (0.68276, 0.65319),
        "max_slip_y": (0.33167, 0.33216), "slide_slip_y": (1.0296, 1.0296),
        "trail": (0.178, 0.19), "trail_zero_slip": (0.36484, 0.36538), "trail_end_slip": (1.0296, 1.0296),
    },
    "car": {
        "slope_x": (18.3741, 19.4669), "max_x": (1.1292, 1.0896), "slide_x": (0.80149, 0.76917),
        "max_slip_x": (0.13913, 0.13913), "slide_slip_x": (0.66667, 0.66667),
        "slope_y": (15.9826, 12.8509), "max_y": (1.0009, 0.91367), "slide_y": (0.8336, 0.77336),
        "max_slip_y": (0.14852, 0.18504), "slide_slip_y": (0.96524, 1.0714),
        "trail": (0.178, 0.19), "trail_zero_slip": (0.16337, 0.20355), "trail_end_slip": (0.96524, 1.0714),
    },
}  # fmt: skip

TMSIMPLE_PATTERNS: dict[str, dict[str, tuple[float, float]]] = {
    "truck": {
        "slope_x": (19.1677, 15.1285), "max_x": (0.91432, 0.79538), "slide_x": (0.52273, 0.48517),
        "slope_y": (6.8392, 6.4235), "max_y": (0.75948, 0.72714), "slide_y": (0.68739, 0.65594),
    },
    "car": {
        "slope_x": (19.9774, 20.8424), "max_x": (1.1404, 1.1045), "slide_x": (0.84482, 0.82041),
        "slope_y": (16.7895, 12.9866), "max_y": (1.0107, 0.91902), "slide_y": (0.84864, 0.78702),
    },
}  # fmt: skip


def bearable_load(index: int) -> float:
    """The load of a load index [N]."""
    if not 0 <= index < len(BEARABLE_MASS):
        raise refuse("load_index", f"from 0 to {len(BEARABLE_MASS) - 1}", index)
    return GRAVITY * BEARABLE_MASS[index]


def rated_load(load: float | None, index: int | None) -> float:
    """The load that a tire is made for [N]; an index counts before a force."""
    if index is not None:
        return bearable_load(index)
    if load is None:
        raise SpecError("load: missing; give the largest load [N], or load_index")
    return load


def vertical_guess(
    load: float, section_height: float, mass: float, pressure_ratio: float, damping_ratio: float
) -> dict[str, float]:
    """Vertical law of a tire that bears `load` [N] at 16 % of its section height; its nominal load is half of that."""
    stiffness = load / (0.16 * section_height)
    nominal = 0.5 * load * pressure_ratio**0.8
    return {
        "nominal_load": nominal,
        "load_limit": 3.5 * nominal,
        "vertical_stiffness": stiffness,
        "vertical_damping": 2.0 * damping_ratio * math.sqrt(stiffness * mass),
    }


def horizontal_guess(pattern: dict[str, tuple[float, float]], nominal: float) -> dict[str, tuple[float, float]]:
    """A pattern with its forces in N."""
    return {
        key: (a * nominal, b * 2.0 * nominal) if key in FORCES else (a, b) for key, (a, b) in pattern.items()
    }  # fmt: skip


CONTACTS = {
    "single-point": TireContact.SINGLE_POINT,
    "four-point": TireContact.FOUR_POINT,
    "envelope": TireContact.ENVELOPE,
}
RIM_CLEARANCE = 0.01
"""Height above the rim at which the tire touches it [m]."""
TYPICAL_RESISTANCE = 0.015


@dataclasses.dataclass(frozen=True)
class ParameterVector:
    """A tire as the kernels take it."""

    model: TireModel
    contact: TireContact
    values: Vector
    state_size: int
    measured_side: str | None
    """None: it is mirrored on no side."""


def resistance(common: CommonParameters) -> float:
    """The coefficient that is given, or the typical one."""
    return TYPICAL_RESISTANCE if common.rolling_resistance is None else common.rolling_resistance


# ---- TMeasy and TMsimple ---------------------------------------------------------------------------------------------

Patterns: TypeAlias = dict[str, dict[str, tuple[float, float]]]


def given_values(part: Spec) -> dict[str, Any]:
    """The fields that are not None."""
    return {field.name: v for field in dataclasses.fields(part) if (v := getattr(part, field.name)) is not None}


def rated_values(tire: Tire, rated: RatedParameters, horizontal: Spec, patterns: Patterns) -> dict[str, Any]:
    """All values of a tire: those that are given, over those of its pattern."""
    if rated.rim_radius >= tire.radius:
        raise SpecError(f"rim_radius: must be less than the tire's radius {tire.radius} m, got {rated.rim_radius!r}")
    values: dict[str, Any] = {}
    if rated.pattern is not None:
        section_height = tire.radius - rated.rim_radius
        pressure_ratio = rated.use_pressure / rated.design_pressure
        load = rated_load(rated.load, rated.load_index)
        values |= vertical_guess(load, section_height, tire.mass, pressure_ratio, rated.damping_ratio)
    values |= given_values(rated)
    for key in ("nominal_load", "load_limit", "vertical_stiffness", "vertical_damping"):
        if key not in values:
            raise missing(key, "it, or a pattern and the load that the tire is made for")
    if rated.pattern is not None:
        values |= horizontal_guess(patterns[rated.pattern], values["nominal_load"])
    values |= given_values(horizontal)
    for field in dataclasses.fields(horizontal):
        if field.name not in values:
            raise missing(field.name, "the values at the nominal and at twice the nominal load, or a pattern")
    return values


def rated_vector(tire: Tire, common: CommonParameters, values: dict[str, Any], size: int) -> Vector:
    """A vector with the vertical law of TMeasy and TMsimple."""
    vector = common_vector(tire, common, size, camber=4.0, share=THIRD)
    vector[Common.LOAD_LIMIT] = values["load_limit"]
    vector[Common.STIFFNESS] = values["vertical_stiffness"]
    vector[Common.STIFFNESS_SQUARE] = values["vertical_stiffness_square"]
    vector[Common.DAMPING] = values["vertical_damping"]
    rim = tire.radius - values["rim_radius"] - RIM_CLEARANCE
    vector[Common.BOTTOM_DEFLECTION] = values.get("bottom_deflection", max(rim, 0.0))
    vector[Common.BOTTOM_STIFFNESS] = values.get("bottom_stiffness", 5.0 * values["vertical_stiffness"])
    vector[Common.ROLLING_RESISTANCE] = resistance(common) * tire.radius
    return vector


def fill_rated(
    patterns: Patterns, size: int, entries: type[enum.IntEnum], tire: Tire, common: CommonParameters,
    rated: RatedParameters, curve: TmsimpleParameters,
) -> Vector:  # fmt: skip
    """Vector of a TMeasy or TMsimple tire; the first of its own entries is the nominal load."""
    values = rated_values(tire, rated, curve, patterns)
    vector = rated_vector(tire, common, values, size)
    load, *others = entries
    vector[load] = values["nominal_load"]
    for entry in others:
        vector[entry : entry + 2] = values[entry.name.lower()]
    return vector


FILL_TMEASY = functools.partial(fill_rated, TMEASY_PATTERNS, TMEASY_SIZE, Tmeasy)
FILL_TMSIMPLE = functools.partial(fill_rated, TMSIMPLE_PATTERNS, TMSIMPLE_SIZE, Tmsimple)


# ---- the others ------------------------------------------------------------------------------------------------------


def with_vertical(vector: Vector, vertical: VerticalParameters) -> Vector:
    """The vector with its vertical law; a table follows its end."""
    vector[Common.STIFFNESS] = vertical.vertical_stiffness or 0.0
    vector[Common.DAMPING] = vertical.vertical_damping
    if vertical.load_limit is not None:
        vector[Common.LOAD_LIMIT] = vertical.load_limit
    if vertical.vertical_curve is None:
        return vector
    vector[Common.CURVE_START] = len(vector)
    vector[Common.CURVE_POINTS] = len(vertical.vertical_curve)
    return np.concatenate([vector, np.ravel(vertical.vertical_curve)])


def fill_fiala(tire: Tire, common: CommonParameters, vertical: VerticalParameters, brush: FialaParameters) -> Vector:
    """Vector of a Fiala tire."""
    vector = common_vector(tire, common, FIALA_SIZE, camber=3.0, share=1.0)
    vector[Common.ROLLING_RESISTANCE] = resistance(common)
    for entry in Fiala:
        vector[entry] = getattr(brush, entry.name.lower())
    return with_vertical(vector, vertical)


def fill_pacejka89(
    tire: Tire, common: CommonParameters, vertical: VerticalParameters, coefficients: Pacejka89Parameters
) -> Vector:
    """Vector of a Pacejka 89 tire."""
    vector = common_vector(tire, common, PAC89_SIZE, camber=3.0, share=1.0)
    vector[Common.ROLLING_RESISTANCE] = resistance(common)
    vector[Pac89.LATERAL_STIFFNESS] = coefficients.lateral_stiffness
    vector[Pac89.A : Pac89.A + 14] = coefficients.lateral
    vector[Pac89.B : Pac89.B + 11] = coefficients.longitudinal
    vector[Pac89.C : Pac89.C + 18] = coefficients.aligning
    # the largest forces are parabolas of the load that turn down and become negative
    for square, slope in (coefficients.lateral[1:3], coefficients.longitudinal[1:3]):
        if square < 0.0:
            vector[Common.LOAD_LIMIT] = min(vector[Common.LOAD_LIMIT], -500.0 * slope / square)
    return with_vertical(vector, vertical)


def fill_lugre(tire: Tire, common: CommonParameters, vertical: VerticalParameters, lugre: LugreParameters) -> Vector:
    """Vector of a LuGre tire."""
    if common.relaxation_length is not None:
        given = formatted(list(common.relaxation_length))
        raise SpecError(
            f"relaxation_length: must be absent, got {given}: LuGre's bristles give way over a length of their own;"
            " give bristle_rate"
        )
    vector = common_vector(tire, common, LUGRE_SIZE, camber=3.0, share=1.0)
    vector[Common.ROLLING_RESISTANCE] = resistance(common) * tire.radius
    vector[Lugre.BRISTLE_STIFFNESS : Lugre.BRISTLE_STIFFNESS + 2] = lugre.bristle_rate
    vector[Lugre.BRISTLE_DAMPING : Lugre.BRISTLE_DAMPING + 2] = lugre.bristle_viscosity
    vector[Lugre.VISCOSITY : Lugre.VISCOSITY + 2] = lugre.viscosity
    vector[Lugre.KINETIC_FRICTION] = lugre.kinetic_friction
    vector[Lugre.STATIC_FRICTION] = lugre.static_friction
    vector[Lugre.STRIBECK_SPEED] = lugre.stribeck_speed
    vector[Lugre.CARRY_OFF] = lugre.carry_off
    vector[Lugre.DISC_COUNT] = lugre.disc_count
    apart = 0.8 * tire.width / max(lugre.disc_count - 1, 1)
    vector[Lugre.DISC_SPACING] = apart if lugre.disc_spacing is None else lugre.disc_spacing
    return with_vertical(vector, vertical)


# ---- all of them -----------------------------------------------------------------------------------------------------


class Model(NamedTuple):
    """A template: its law, the classes of its parameters beside the common ones, and what makes a vector of them."""

    law: TireModel
    parts: tuple[type[Spec], ...]
    fill: Callable[..., Vector]


MODELS: dict[str, Model] = {
    "tmeasy": Model(
        TireModel.TMEASY,
        (RatedParameters, TmeasyParameters),
        FILL_TMEASY,
    ),
    "tmsimple": Model(
        TireModel.TMSIMPLE,
        (RatedParameters, TmsimpleParameters),
        FILL_TMSIMPLE,
    ),
    "fiala": Model(TireModel.FIALA, (VerticalParameters, FialaParameters), fill_fiala),
    "pacejka89": Model(TireModel.PAC89, (VerticalParameters, Pacejka89Parameters), fill_pacejka89),
    "pacejka2002": Model(TireModel.PAC02, (Pacejka2002Parameters,), fill_pacejka2002),
    "lugre": Model(TireModel.LUGRE, (VerticalParameters, LugreParameters), fill_lugre),
}
"""The templates of force-element tires. A rigid tire is an ordinary shape in contact, and none of them."""


def check_tire(tire: Tire) -> None:
    """Refuse a tire that could not be built, rigid ones too.

    Raises:
        SpecError: unknown template or key, or a value that breaks a rule; it begins with the key.
    """
    if tire.template == RIGID:
        rigid_parameters(tire)
    elif tire.template == FLEXIBLE:
        flexible_parameters(tire)
    elif tire.template == SOIL_RIGID:
        soil_rigid_parameters(tire)
    else:
        _vector(tire)


def tire_vector(tire: Tire, place: str = "tire") -> ParameterVector:
    """The vector of a tire.

    Args:
        tire: its description.
        place: name in errors.

    Raises:
        SpecError: unknown template or key, or a value that breaks a rule.
    """
    try:
        return _vector(tire)
    except PropertyFileError:
        raise
    except SpecError as error:
        raise SpecError(f"{place}.{error}") from None


def _vector(tire: Tire) -> ParameterVector:
    if tire.template not in MODELS:
        names = (*MODELS, RIGID)
        near = nearest(tire.template, names)
        raise SpecError(f"template: must be one of {', '.join(names)}, got {formatted(tire.template)}{near}")
    model = MODELS[tire.template]
    parts: tuple[type[Spec], ...] = (CommonParameters, *model.parts)
    keys = [{field.name for field in dataclasses.fields(part)} for part in parts]
    known = sorted(set().union(*keys))
    for key in tire.parameters:
        if key not in known:
            raise SpecError(f"parameters.{shortened(key)}: unknown key{nearest(key, known)}; known: {', '.join(known)}")
    try:
        built = [
            SPECS.load(part, {key: v for key, v in tire.parameters.items() if key in own})
            for part, own in zip(parts, keys, strict=True)
        ]
        values = model.fill(tire, *built)
    except SpecError as error:
        tir = tire.parameters.get("tir")
        located = tir.located(error) if isinstance(tir, TirValues) else error
        if isinstance(located, PropertyFileError):
            raise located from None
        raise SpecError(f"parameters.{error}") from None
    return ParameterVector(
        model.law, CONTACTS[built[0].contact], values, _state_size(model.law, values), measured_side(*built[:2])
    )


def _state_size(law: TireModel, values: Vector) -> int:
    """Entries of a tire's state row."""
    if law is TireModel.LUGRE:
        return 2 * int(values[Lugre.DISC_COUNT])
    transient = law is TireModel.PAC02 and values[Pac02.TRANSIENT] == 1.0
    return LAGGED_STATES if transient or values[Common.RELAXATION_X] > 0.0 else BRISTLE_STATES
