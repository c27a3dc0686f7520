"""Lengths of springs and dampers in a simulation, measured between the bodies that they stand on."""

from __future__ import annotations

from typing import Final

import numpy as np

from simwarp.core.rotation import matrix_of, quat_conjugate, rotate
from simwarp.core.types import WORLD, Pose
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.spec.beam_axle_parts import BeamAxle
from simwarp.vehicle.spec.parts import Array, ForceLine
from simwarp.vehicle.spec.vehicle_spec import (
    DoubleWishbone,
    DoubleWishboneReduced,
    MacPhersonStrut,
    MultiLink,
    SingleWishbone,
    SolidAxle,
    Suspension,
    ThreeLink,
    TrailingArm,
)

LOWER_ENDS: Final[dict[type, str]] = {
    DoubleWishbone: "left.lower_arm", DoubleWishboneReduced: "left.upright", SingleWishbone: "left.arm",
    MacPhersonStrut: "left.upright", MultiLink: "left.trailing_link", SolidAxle: "tube", TrailingArm: "left.arm",
    ThreeLink: "left.arm", BeamAxle: "tube",
}  # fmt: skip
"""Body of the left side that holds the lower ends of the lines, behind the axle's name."""


def line_lengths(simulation: Simulation, suspension: Suspension, name: str, chassis: int, origin: Pose) -> Array:
    """Of all lines of the left side of an axle, in every world.

    Args:
        simulation: in which the axle is.
        suspension: of the axle.
        name: of the axle's frame, with which those of its bodies begin.
        chassis: body that holds the upper ends, or WORLD.
        origin: of the axle's frame in the world, as built.

    Returns:
        (W, k) in the order of the description [m]; k = 0 of a suspension without any.
    """
    lines: tuple[ForceLine, ...] = getattr(suspension, "springs", ())
    if not lines:
        return np.zeros((simulation.model.world_count, 0))
    ends = []
    for body, key in ((chassis, "chassis_point"), (_body(simulation, suspension, name), "arm_point")):
        points = np.array([origin.position + rotate(origin.rotation, np.array(getattr(line, key))) for line in lines])
        ends.append(_moved(simulation, body, points))
    return np.asarray(np.linalg.norm(ends[1] - ends[0], axis=2))


def _body(simulation: Simulation, suspension: Suspension, name: str) -> int:
    return simulation.model.body(f"{name}.{LOWER_ENDS[type(suspension)]}")


def _moved(simulation: Simulation, body: int, points: Array) -> Array:
    """(W, k, 3) points (k, 3) that were on a body as it was built [m]."""
    if body == WORLD:
        return np.broadcast_to(points, (simulation.model.world_count, *points.shape))
    built = simulation.model.builder.bodies[body].pose
    local = np.array([rotate(quat_conjugate(built.rotation), point - built.position) for point in points])
    places = np.asarray(simulation.state.body_x.numpy()[:, body], np.float64)
    turns = np.array([matrix_of(q) for q in np.asarray(simulation.state.body_rot.numpy()[:, body], np.float64)])
    return np.asarray(places[:, None] + np.einsum("wij,kj->wki", turns, local))
