"""From `spec.Tire` to the rows of numbers that the kernels read (kernels/vehicle/tires/parameter_vector.py)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from simwarp.kernels.vehicle.tires.parameter_vector import (
    BRISTLE_STATES,
    FIALA_SIZE,
    LUGRE_SIZE,
    PAC89_SIZE,
    TMEASY_SIZE,
    TMSIMPLE_SIZE,
    Common,
    Fiala,
    Lugre,
    Pac89,
    TireContact,
    TireModel,
    Tmeasy,
    Tmsimple,
)
from simwarp.vehicle.spec.deserialisation import SourceLocation, build, nearest
from simwarp.vehicle.spec.parts import told
from simwarp.vehicle.spec.vehicle_spec import Spec, SpecError, Tire
from simwarp.vehicle.tires.rigid_tires import TEMPLATE as RIGID
from simwarp.vehicle.tires.rigid_tires import rigid_parameters
from simwarp.vehicle.tires.tire_common import THIRD, Row, common_row, missing
from simwarp.vehicle.tires.tire_files import TirValues
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
from simwarp.vehicle.tires.tire_patterns import (
    TMEASY_PATTERNS,
    TMSIMPLE_PATTERNS,
    horizontal_guess,
    rated_load,
    vertical_guess,
)
from simwarp.vehicle.tires.tire_properties import fill_pacejka2002

CONTACTS = {
    "single-point": TireContact.SINGLE_POINT,
    "four-point": TireContact.FOUR_POINT,
    "envelope": TireContact.ENVELOPE,
}
RIM_CLEARANCE = 0.01
"""Height above the rim at which the tire touches it [m]."""
TYPICAL_RESISTANCE = 0.015


@dataclasses.dataclass(frozen=True)
class TireRow:
    """A tire as the kernels take it."""

    model: TireModel
    contact: TireContact
    values: Row
    state_size: int
    measured_side: str | None


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


def rated_row(tire: Tire, common: CommonParameters, values: dict[str, Any], size: int) -> Row:
    """A row with the vertical law of TMeasy and TMsimple."""
    row = common_row(tire, common, size, camber=4.0, share=THIRD)
    row[Common.LOAD_LIMIT] = values["load_limit"]
    row[Common.STIFFNESS] = values["vertical_stiffness"]
    row[Common.STIFFNESS_SQUARE] = values["vertical_stiffness_square"]
    row[Common.DAMPING] = values["vertical_damping"]
    rim = tire.radius - values["rim_radius"] - RIM_CLEARANCE
    row[Common.BOTTOM_DEFLECTION] = values.get("bottom_deflection", max(rim, 0.0))
    row[Common.BOTTOM_STIFFNESS] = values.get("bottom_stiffness", 5.0 * values["vertical_stiffness"])
    row[Common.ROLLING_RESISTANCE] = resistance(common) * tire.radius
    return row


def fill_tmeasy(tire: Tire, common: CommonParameters, rated: RatedParameters, curve: TmeasyParameters) -> Row:
    """Row of a TMeasy tire."""
    values = rated_values(tire, rated, curve, TMEASY_PATTERNS)
    row = rated_row(tire, common, values, TMEASY_SIZE)
    row[Tmeasy.NOMINAL_LOAD] = values["nominal_load"]
    for entry in list(Tmeasy)[1:]:
        row[entry : entry + 2] = values[entry.name.lower()]
    return row


def fill_tmsimple(tire: Tire, common: CommonParameters, rated: RatedParameters, curve: TmsimpleParameters) -> Row:
    """Row of a TMsimple tire."""
    values = rated_values(tire, rated, curve, TMSIMPLE_PATTERNS)
    row = rated_row(tire, common, values, TMSIMPLE_SIZE)
    row[Tmsimple.NOMINAL_LOAD] = values["nominal_load"]
    for entry in list(Tmsimple)[1:]:
        row[entry : entry + 2] = values[entry.name.lower()]
    return row


# ---- the others ------------------------------------------------------------------------------------------------------


def with_vertical(row: Row, vertical: VerticalParameters) -> Row:
    """The row with its vertical law; a table follows its end."""
    row[Common.STIFFNESS] = vertical.vertical_stiffness or 0.0
    row[Common.DAMPING] = vertical.vertical_damping
    if vertical.load_limit is not None:
        row[Common.LOAD_LIMIT] = vertical.load_limit
    if vertical.vertical_curve is None:
        return row
    row[Common.CURVE_START] = len(row)
    row[Common.CURVE_POINTS] = len(vertical.vertical_curve)
    return np.concatenate([row, np.ravel(vertical.vertical_curve)])


def fill_fiala(tire: Tire, common: CommonParameters, vertical: VerticalParameters, brush: FialaParameters) -> Row:
    """Row of a Fiala tire."""
    row = common_row(tire, common, FIALA_SIZE, camber=3.0, share=1.0)
    row[Common.ROLLING_RESISTANCE] = resistance(common)
    for entry in Fiala:
        row[entry] = getattr(brush, entry.name.lower())
    return with_vertical(row, vertical)


def fill_pacejka89(
    tire: Tire, common: CommonParameters, vertical: VerticalParameters, coefficients: Pacejka89Parameters
) -> Row:
    """Row of a Pacejka 89 tire."""
    row = common_row(tire, common, PAC89_SIZE, camber=3.0, share=1.0)
    row[Common.ROLLING_RESISTANCE] = resistance(common)
    row[Pac89.LATERAL_STIFFNESS] = coefficients.lateral_stiffness
    row[Pac89.A : Pac89.A + 14] = coefficients.lateral
    row[Pac89.B : Pac89.B + 11] = coefficients.longitudinal
    row[Pac89.C : Pac89.C + 18] = coefficients.aligning
    # the largest forces are parabolas of the load that turn down and become negative
    for square, slope in (coefficients.lateral[1:3], coefficients.longitudinal[1:3]):
        if square < 0.0:
            row[Common.LOAD_LIMIT] = min(row[Common.LOAD_LIMIT], -500.0 * slope / square)
    return with_vertical(row, vertical)


def fill_lugre(tire: Tire, common: CommonParameters, vertical: VerticalParameters, lugre: LugreParameters) -> Row:
    """Row of a LuGre tire."""
    row = common_row(tire, common, LUGRE_SIZE, camber=3.0, share=1.0)
    row[Common.ROLLING_RESISTANCE] = resistance(common) * tire.radius
    row[Lugre.BRISTLE_STIFFNESS : Lugre.BRISTLE_STIFFNESS + 2] = lugre.bristle_rate
    row[Lugre.BRISTLE_DAMPING : Lugre.BRISTLE_DAMPING + 2] = lugre.bristle_viscosity
    row[Lugre.VISCOSITY : Lugre.VISCOSITY + 2] = lugre.viscosity
    row[Lugre.KINETIC_FRICTION] = lugre.kinetic_friction
    row[Lugre.STATIC_FRICTION] = lugre.static_friction
    row[Lugre.STRIBECK_SPEED] = lugre.stribeck_speed
    row[Lugre.CARRY_OFF] = lugre.carry_off
    row[Lugre.DISC_COUNT] = lugre.disc_count
    apart = 0.8 * tire.width / max(lugre.disc_count - 1, 1)
    row[Lugre.DISC_SPACING] = apart if lugre.disc_spacing is None else lugre.disc_spacing
    return with_vertical(row, vertical)


# ---- all of them -----------------------------------------------------------------------------------------------------


class Model(NamedTuple):
    """A template: its law, the classes of its parameters beside the common ones, and what makes a row of them."""

    law: TireModel
    parts: tuple[type[Spec], ...]
    fill: Callable[..., Row]


MODELS: dict[str, Model] = {
    "tmeasy": Model(TireModel.TMEASY, (RatedParameters, TmeasyParameters), fill_tmeasy),
    "tmsimple": Model(TireModel.TMSIMPLE, (RatedParameters, TmsimpleParameters), fill_tmsimple),
    "fiala": Model(TireModel.FIALA, (VerticalParameters, FialaParameters), fill_fiala),
    "pacejka89": Model(TireModel.PAC89, (VerticalParameters, Pacejka89Parameters), fill_pacejka89),
    "pacejka2002": Model(TireModel.PAC02, (Pacejka2002Parameters,), fill_pacejka2002),
    "lugre": Model(TireModel.LUGRE, (VerticalParameters, LugreParameters), fill_lugre),
}
"""The templates of force-element tires. A rigid tire is an ordinary shape in contact, and none of them."""


def check_tire(tire: Tire, where: SourceLocation) -> None:
    """Refuse a tire that could not be built, rigid ones too.

    Raises:
        SpecError: as `tire_row` does.
    """
    if tire.template == RIGID:
        try:
            rigid_parameters(tire)
        except SpecError as error:
            key, _, rule = str(error).partition(": ")
            raise where.at(key).error(rule) from None
    else:
        tire_row(tire, where)


def tire_row(tire: Tire, place: str | SourceLocation = "tire") -> TireRow:
    """The row of a tire.

    Args:
        tire: its description.
        place: name in errors.

    Raises:
        SpecError: unknown template or key, or a value that breaks a rule.
    """
    where = place if isinstance(place, SourceLocation) else SourceLocation(Path(place))
    if tire.template not in MODELS:
        names = (*MODELS, RIGID)
        near = nearest(tire.template, names)
        raise where.at("template").error(f"must be one of {', '.join(names)}, got {told(tire.template)}{near}")
    model = MODELS[tire.template]
    where = where.at("parameters")
    parts: tuple[type[Spec], ...] = (CommonParameters, *model.parts)
    keys = [{field.name for field in dataclasses.fields(part)} for part in parts]
    known = sorted(set().union(*keys))
    for key in tire.parameters:
        if key not in known:
            raise where.at(key).error(f"unknown key{nearest(key, known)}; known: {', '.join(known)}")
    built = [
        build(part, {key: v for key, v in tire.parameters.items() if key in own}, where)
        for part, own in zip(parts, keys, strict=True)
    ]
    try:
        values = model.fill(tire, *built)
    except SpecError as error:
        key, _, rule = str(error).partition(": ")
        tir = tire.parameters.get("tir")
        if key.startswith("tir.") and isinstance(tir, TirValues):
            raise tir.error(key.removeprefix("tir."), rule) from None
        raise where.at(key).error(rule) from None
    states = 2 * int(values[Lugre.DISC_COUNT]) if model.law is TireModel.LUGRE else BRISTLE_STATES
    return TireRow(model.law, CONTACTS[built[0].contact], values, states, built[0].measured_side)
