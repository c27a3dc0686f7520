"""Tires in ordinary contact, rigid or flexible: the ground is whatever shapes the builder has."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Any

import numpy as np
import warp as wp

from simwarp.core.arrays import writable_from
from simwarp.model.model import Model
from simwarp.simulation.attachments import StepContext
from simwarp.vehicle.tires.contact_tires_kernels import limit_friction, measure_contact_tires
from simwarp.vehicle.tires.wheel_reports import WheelReports


class ContactTires(WheelReports):
    """The wheels of a vehicle on tires in ordinary contact, rigid or flexible: the outputs of `Tires`, as far as
    contact yields them.

    Args:
        shapes: of each wheel, in the order of the reports: a rigid tire's cylinder, or the spheres of its nodes.
        bodies: of each wheel, that carry them.
        model: of the vehicle.

    Attributes:
        ground_friction: (1,) or (W,) of the road: a tire grips with the smaller one of this and its own.
        load: (W, wheels) normal force [N]: the vertical part of the contacts' force.
        force_w: (W, wheels) vec3 on each wheel, world [N].
        slip_ratio, slip_angle, camber, deflection, torque_w, state: zeros; contact does not know them.
    """

    def __init__(self, shapes: Sequence[Sequence[int]], bodies: Sequence[Sequence[int]], model: Model) -> None:
        super().__init__(len(shapes), model)
        device, own = model.device, [shape for wheel in shapes for shape in wheel]
        self._shapes: wp.array = wp.array(own, dtype=int, device=device)
        self._bodies: wp.array = wp.array([body for wheel in bodies for body in wheel], dtype=int, device=device)
        self._starts: wp.array = wp.array(np.cumsum([0, *map(len, bodies)]), dtype=int, device=device)
        frictions = model.shape_friction.numpy()
        self._own_friction: wp.array = wp.array(frictions[0, own], dtype=float, device=device)
        self.ground_friction = writable_from([float(frictions.max())] * frictions.shape[0], wp.float32, device)
        self._on_soil = False

    def show(self, soil: Any, first: int) -> None:
        """From now on report what a soil finds of its meshes from number `first` on, and no other contact."""
        self._on_soil = True
        self.show_soil(soil, first)

    def missing_ground(self, simulation: StepContext, own: Container[int]) -> str:
        """Return what is missing for the wheels to stand on, in words; empty if nothing is.

        Args:
            simulation: of the vehicle.
            own: bodies of the vehicles, on whose shapes they do not stand.
        """
        if self._on_soil:
            return ""
        model = simulation.model
        bodies = model.topology.shape_body.numpy()[model.shapes_that_meet]
        if any(int(body) not in own for body in bodies):
            return ""
        return "the model has no other shape that could meet their wheels; add one, such as builder.add_shape_plane()"

    def record(self, simulation: StepContext) -> list[Any]:
        """The launch before a sub-step: the road's friction."""
        friction = simulation.model.shape_friction
        return [
            simulation.shares.record(
                limit_friction, len(self._shapes),
                inputs=[self._shapes, self._own_friction, self.ground_friction], outputs=[friction],
            )
        ]  # fmt: skip

    def record_after(self, simulation: StepContext) -> list[Any]:
        """The launch after a sub-step: the loads; none on soil, which reports them."""
        if self._on_soil:
            return []
        return [
            simulation.shares.record(
                measure_contact_tires, self.shape[1],
                inputs=[self._starts, self._bodies, simulation.contacts.body_contact_force],
                outputs=[self.load, self.force_w],
            )
        ]  # fmt: skip
