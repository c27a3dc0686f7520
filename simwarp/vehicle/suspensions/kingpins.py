"""The axis about which a wheel is steered, of every suspension template that has one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeAlias

import numpy as np

from simwarp.vehicle.spec.beam_axle_parts import BeamAxle
from simwarp.vehicle.spec.parts import Array, Vec3
from simwarp.vehicle.spec.vehicle_spec import (
    DoubleWishbone,
    DoubleWishboneReduced,
    MacPhersonStrut,
    MultiLink,
    SingleWishbone,
    SolidAxle,
    Suspension,
)

Placed: TypeAlias = Callable[[Vec3], Array]
"""From a point of the suspension's description to (n, 3) its places."""


def kingpin_axis(
    suspension: Suspension, chassis: Placed, carrier: Placed, turned: Callable[[Vec3], Array], states: int
) -> tuple[Array, Array]:
    """A point of the steering axis (n, 3) [m] and its direction (n, 3), a unit vector upwards; NaN where there is none.

    The axis is that of a wheel which steers while its springs keep their length: the line through both balls of
    wishbones, that of a multi-link suspension with a still upper arm.

    Args:
        suspension: its description.
        chassis: places of points that stand still.
        carrier: places of points of the body that the spindle turns in.
        turned: (n, 3) directions of that body.
        states: n.
    """
    match suspension:
        case DoubleWishbone() | DoubleWishboneReduced() as spec:
            start = carrier(spec.lower_arm_upright)
            direction = carrier(spec.upper_arm_upright) - start
        case SingleWishbone() as spec:
            start, direction = carrier(spec.arm_upright), turned(spec.kingpin_axis)
        case MacPhersonStrut() as spec:
            start = carrier(spec.lower_arm_upright)
            direction = chassis(spec.strut_chassis) - start
        case MultiLink() as spec:
            start, direction = _multi_link_axis(spec, chassis, carrier)
        case SolidAxle() as spec if spec.draglink_chassis is not None:
            start = carrier(spec.knuckle_lower)
            direction = carrier(spec.knuckle_upper) - start
        case BeamAxle(knuckle_lower=lower, knuckle_upper=upper) if lower is not None and upper is not None:
            start = carrier(lower)
            direction = carrier(upper) - start
        case _:
            return np.full((states, 3), np.nan), np.full((states, 3), np.nan)
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return start, direction * np.sign(direction[:, 2:])


_RODS: Final = (("lateral_chassis", "lateral_upright"), ("trailing_link_chassis", "trailing_link_upright"))


def _multi_link_axis(spec: MultiLink, chassis: Placed, carrier: Placed) -> tuple[Array, Array]:
    """The rotations about the upper ball that keep the lengths of both rods: normal to both levers."""
    ball = carrier(spec.upper_arm_upright)
    levers: list[Any] = []
    for root, tip in _RODS:
        end = carrier(getattr(spec, tip))
        levers.append(np.cross(end - ball, end - chassis(getattr(spec, root))))
    return ball, np.cross(levers[0], levers[1])
