"""Tires that are rigid cylinders in ordinary contact: the ground is whatever shapes the builder has."""

from __future__ import annotations

from simwarp.core.types import Material, pose
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.spec.parts import SPECS, SpecError
from simwarp.vehicle.spec.vehicle_parts import Tire
from simwarp.vehicle.tires.tire_parameters import RigidParameters
from simwarp.vehicle.tires.wheel_reports import parameter_text

TEMPLATE = "rigid"
ACROSS = (0.7071067811865476, 0.0, 0.0, -0.7071067811865476)
"""Turns a cylinder's axis, z, into the wheel's, y (xyzw)."""


def rigid_parameters(tire: Tire) -> tuple[float, float]:
    """Friction and restitution of a rigid tire.

    Raises:
        SpecError: another key, or a value that breaks a rule.
    """
    values: RigidParameters = SPECS.load(RigidParameters, tire.parameters, parameter_text)
    return values.friction, values.restitution


def add_rigid_tire(builder: ModelBuilder, name: str, body: int, tire: Tire, key: str = "tire") -> int:
    """The cylinder of a rigid tire on its spindle; returns its shape. Errors name the tire by its `key`."""
    try:
        friction, restitution = rigid_parameters(tire)
    except SpecError as error:
        raise SpecError(f"{key}.{error}") from None
    return builder.add_shape_cylinder(
        body, radius=tire.radius, half_length=0.5 * tire.width, name=name, pose=pose(rotation=ACROSS),
        material=Material(friction=friction, restitution=restitution),
    )  # fmt: skip
