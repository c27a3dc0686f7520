"""The outline of a vehicle seen from above: the rectangle that has to stay between cones."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Outline:
    """A rectangle in the vehicle's frame of reference.

    Attributes:
        front: x of its front edge [m].
        rear: x of its rear edge [m], below `front`.
        width: across, symmetric to the frame's x axis [m].
    """

    front: float
    rear: float
    width: float

    @property
    def length(self) -> float:
        """From the rear edge to the front edge [m]."""
        return self.front - self.rear

    def corners(self, x: Array, y: Array, yaw: Array) -> Array:
        """(n, 4, 2) world [m]: front left, rear left, rear right, front right of a vehicle at (n,) places.

        Args:
            x: of the frame of reference [m].
            y: likewise.
            yaw: heading from the world's +X towards +Y [rad].
        """
        half = 0.5 * self.width
        local = np.array([[self.front, half], [self.rear, half], [self.rear, -half], [self.front, -half]])
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
        return np.asarray(np.einsum("nij,kj->nki", turn, local) + np.stack([x, y], axis=-1)[:, None])


def outline_of(spec: VehicleSpec) -> Outline:
    """The least rectangle around the chassis' box (`chassis.size`) and its tires, straight on, without trailers."""
    size, center = spec.chassis.size, spec.chassis.size_center
    front, rear = center[0] + 0.5 * size[0], center[0] - 0.5 * size[0]
    half = abs(center[1]) + 0.5 * size[1]
    for axle in spec.axles:
        spindle, tire = axle.suspension.spindle.com, axle.tire
        middle = axle.location[0] + spindle[0]
        front, rear = max(front, middle + tire.radius), min(rear, middle - tire.radius)
        half = max(half, abs(spindle[1] + axle.wheel.offset) + 0.5 * tire.width)
    return Outline(front=front, rear=rear, width=2.0 * half)
