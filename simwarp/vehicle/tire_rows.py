"""From `spec.Tire` to the rows of numbers that the kernels read (kernels/tires/rows.py)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.kernels.tires.rows import BRISTLE_STATES, TMEASY_SIZE, Common, TireContact, TireModel, Tmeasy
from simwarp.vehicle.reading import Place, build, nearest
from simwarp.vehicle.spec import Spec, SpecError, Tire
from simwarp.vehicle.tire_parameters import CommonParameters, TmeasyParameters
from simwarp.vehicle.tire_patterns import TMEASY_PATTERNS, horizontal_guess, rated_load, vertical_guess

Row: TypeAlias = npt.NDArray[np.float64]

CONTACTS = {
    "single-point": TireContact.SINGLE_POINT,
    "four-point": TireContact.FOUR_POINT,
    "envelope": TireContact.ENVELOPE,
}
THIRD = 1.0 / 3.0
"""Rill's estimate: the effective radius is the unloaded one less a third of the deflection."""
NO_BOTTOM = 1.0e6
RIM_CLEARANCE = 0.01


@dataclasses.dataclass(frozen=True)
class TireRow:
    """A tire as the kernels take it."""

    model: TireModel
    contact: TireContact
    values: Row
    state_size: int
    measured_side: str | None


class Model(NamedTuple):
    """A template: its law, its parameters, and what turns them into a row."""

    law: TireModel
    parameters: type[Spec]
    fill: Callable[[Tire, CommonParameters, Any], Row]


def missing(key: str, what: str) -> SpecError:
    """The error for a value that nothing gives."""
    return SpecError(f"{key}: missing; give {what}")


def common_row(tire: Tire, common: CommonParameters, size: int, *, camber: float, share: float) -> Row:
    """A row with the values of every model; `camber` is the usual limit [rad], `share` see `Common.RADIUS_SHARE`."""
    row = np.zeros(size)
    row[Common.RADIUS] = tire.radius
    row[Common.WIDTH] = tire.width
    row[Common.RADIUS_SHARE] = share
    row[Common.REFERENCE_FRICTION] = common.reference_friction
    row[[Common.FRICTION_LOWER, Common.FRICTION_UPPER]] = common.friction_limits
    row[Common.CAMBER_LIMIT] = camber if common.camber_limit is None else common.camber_limit
    row[Common.LOAD_LIMIT] = np.finfo(np.float32).max
    row[Common.BOTTOM_DEFLECTION] = NO_BOTTOM
    row[Common.BRISTLE_STIFFNESS] = common.bristle_stiffness
    row[Common.BRISTLE_DAMPING] = common.bristle_damping
    # what a patch moves at least: the tire alone, turning or carried along
    row[Common.PATCH_MASS_X] = tire.inertia[1] / tire.radius**2
    row[Common.PATCH_MASS_Y] = tire.mass
    row[[Common.BLEND_BEGIN, Common.BLEND_END]] = common.blend
    return row


def pair(row: Row, entry: int, values: tuple[float, float]) -> None:
    """Two values of an entry."""
    row[entry : entry + 2] = values


def guessed(tire: Tire, given: TmeasyParameters, patterns: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The values that are given, over those of the pattern."""
    values: dict[str, Any] = {}
    if given.rim_radius >= tire.radius:
        raise SpecError(f"rim_radius: must be less than the tire's radius {tire.radius} m, got {given.rim_radius!r}")
    if given.pattern is not None:
        values = dict(
            vertical_guess(
                rated_load(given.load, given.load_index),
                tire.radius - given.rim_radius,
                tire.mass,
                given.use_pressure / given.design_pressure,
                given.damping_ratio,
            )
        )
    values.update((key, v) for key, v in vars(given).items() if v is not None and key in ("nominal_load", "load_limit"))
    if given.pattern is not None:
        values |= horizontal_guess(patterns[given.pattern], values["nominal_load"])
    values.update((key, v) for key, v in vars(given).items() if v is not None)
    return values


def vertical_part(row: Row, tire: Tire, values: dict[str, Any]) -> None:
    """Vertical law of TMeasy and TMsimple."""
    for key in ("nominal_load", "load_limit", "vertical_stiffness", "vertical_damping"):
        if values.get(key) is None:
            raise missing(key, "it, or a pattern with the load that the tire is made for")
    row[Common.LOAD_LIMIT] = values["load_limit"]
    row[Common.STIFFNESS] = values["vertical_stiffness"]
    row[Common.STIFFNESS_SQUARE] = values["vertical_stiffness_square"]
    row[Common.DAMPING] = values["vertical_damping"]
    row[Common.BOTTOM_DEFLECTION] = values.get("bottom_deflection", tire.radius - values["rim_radius"] - RIM_CLEARANCE)
    row[Common.BOTTOM_STIFFNESS] = values.get("bottom_stiffness", 5.0 * values["vertical_stiffness"])


def fill_tmeasy(tire: Tire, common: CommonParameters, given: TmeasyParameters) -> Row:
    """Row of a TMeasy tire."""
    row = common_row(tire, common, TMEASY_SIZE, camber=np.deg2rad(4.0), share=THIRD)
    values = guessed(tire, given, TMEASY_PATTERNS)
    vertical_part(row, tire, values)
    resistance = 0.015 if common.rolling_resistance is None else common.rolling_resistance
    row[Common.ROLLING_RESISTANCE] = resistance * tire.radius
    row[Tmeasy.NOMINAL_LOAD] = values["nominal_load"]
    for entry in Tmeasy:
        key = entry.name.lower()
        if entry is not Tmeasy.NOMINAL_LOAD:
            if values.get(key) is None:
                raise missing(key, "the values at the nominal and at twice the nominal load, or a pattern")
            pair(row, entry, values[key])
    return row


MODELS: dict[str, Model] = {
    "tmeasy": Model(TireModel.TMEASY, TmeasyParameters, fill_tmeasy),
}
"""The templates of force-element tires. A rigid tire is an ordinary shape in contact, and none of them."""


def tire_row(tire: Tire, place: str = "tire") -> TireRow:
    """The row of a tire.

    Args:
        tire: its description.
        place: what errors call it.

    Raises:
        SpecError: unknown template or key, or a value that breaks a rule.
    """
    where = Place(Path(place))
    if tire.template not in MODELS:
        near = nearest(tire.template, MODELS)
        raise where.at("template").error(f"must be one of {', '.join(MODELS)}, got {tire.template!r}{near}")
    model = MODELS[tire.template]
    where = where.at("parameters")
    shared = {field.name for field in dataclasses.fields(CommonParameters)}
    known = shared | {field.name for field in dataclasses.fields(model.parameters)}
    for key in tire.parameters:
        if key not in known:
            raise where.at(key).error(f"unknown key{nearest(key, known)}; known: {', '.join(sorted(known))}")
    common = build(CommonParameters, {k: v for k, v in tire.parameters.items() if k in shared}, where)
    given = build(model.parameters, {k: v for k, v in tire.parameters.items() if k not in shared}, where)
    try:
        values = model.fill(tire, common, given)
    except SpecError as error:
        key, _, rule = str(error).partition(": ")
        raise where.at(key).error(rule) from None
    return TireRow(model.law, CONTACTS[common.contact], values, BRISTLE_STATES, common.measured_side)
