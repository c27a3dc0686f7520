"""Tires that are rigid cylinders in ordinary contact: the ground is whatever shapes the builder has."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Any, Self

import warp as wp

from simwarp.core.arrays import writable_from
from simwarp.core.types import Material, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import Model
from simwarp.simulation.attachments import StepContext
from simwarp.vehicle.spec.parts import SPECS, SpecError
from simwarp.vehicle.spec.vehicle_parts import Tire
from simwarp.vehicle.tires.rigid_tires_kernels import limit_friction, measure_rigid_tires
from simwarp.vehicle.tires.tire_parameters import RigidParameters
from simwarp.vehicle.tires.wheel_reports import WheelReports, parameter_text

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


class RigidTires(WheelReports):
    """The wheels of a vehicle on rigid tires: the outputs of `Tires`, as far as contact yields them.

    Args:
        shapes: of the wheels' cylinders, in the order of the reports.
        bodies: their spindles.
        model: of the vehicle.

    Attributes:
        ground_friction: (1,) or (W,) of the road: a tire grips with the smaller one of this and its own.
        load: (W, wheels) normal force [N]: the vertical part of the contacts' force.
        force_w: (W, wheels) vec3 on each wheel, world [N].
        slip_ratio, slip_angle, camber, deflection, torque_w, state: zeros; contact does not know them.
    """

    def __init__(self, shapes: Sequence[int], bodies: Sequence[int], model: Model) -> None:
        super().__init__(len(shapes), model)
        device = model.device
        self._shapes: wp.array = wp.array(list(shapes), dtype=int, device=device)
        self._bodies: wp.array = wp.array(list(bodies), dtype=int, device=device)
        frictions = model.shape_friction.numpy()
        self._own_friction: wp.array = wp.array(frictions[0, list(shapes)], dtype=float, device=device)
        self.ground_friction = writable_from([float(frictions.max())] * frictions.shape[0], wp.float32, device)

    def missing_ground(self, simulation: StepContext, own: Container[int]) -> str:
        """Return what is missing for the wheels to stand on, in words; empty if nothing is.

        Args:
            simulation: of the vehicle.
            own: bodies of the vehicles, on whose shapes they do not stand.
        """
        model = simulation.model
        bodies = model.topology.shape_body.numpy()[model.shapes_that_meet]
        if any(int(body) not in own for body in bodies):
            return ""
        return "the model has no other shape that could meet their wheels; add one, such as builder.add_shape_plane()"

    def of(self, first: int, count: int) -> Self:
        """`count` wheels of these from number `first` on: views of the same memory."""
        part, wheels = super().of(first, count), slice(first, first + count)
        for name in ("_shapes", "_bodies", "_own_friction"):
            setattr(part, name, getattr(self, name)[wheels])
        return part

    def record(self, simulation: StepContext) -> list[Any]:
        """The launch before a sub-step: the road's friction."""
        friction = simulation.model.shape_friction
        return [
            simulation.shares.record(
                limit_friction, self.shape[1],
                inputs=[self._shapes, self._own_friction, self.ground_friction], outputs=[friction],
            )
        ]  # fmt: skip

    def record_after(self, simulation: StepContext) -> list[Any]:
        """The launch after a sub-step: the loads."""
        return [
            simulation.shares.record(
                measure_rigid_tires, self.shape[1],
                inputs=[self._bodies, simulation.contacts.body_contact_force], outputs=[self.load, self.force_w],
            )
        ]  # fmt: skip
