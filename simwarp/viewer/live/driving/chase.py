"""Cameras of a person who drives: behind the vehicle, outside, on the hood. The scene moves, the camera rests."""

from __future__ import annotations

import enum
import math
import time
from typing import TYPE_CHECKING, Final

import numpy as np

from simwarp.vehicle.tracks.shoe_construction import ShoeTrackParts
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle, TrackedVehicle

if TYPE_CHECKING:
    from simwarp.viewer.live.page import Page

LAG: Final = 0.25
"""Time in which the camera behind comes round [s]."""


class Eye(enum.Enum):
    """Where the camera of a driver is."""

    BEHIND = "behind"
    OUTSIDE = "outside"
    HOOD = "hood"

    @property
    def next(self) -> Eye:
        """The one after it."""
        kinds = list(Eye)
        return kinds[(kinds.index(self) + 1) % len(kinds)]


def wheel_bodies(vehicle: AnyVehicle) -> tuple[int, ...]:
    """Wheels, or road wheels, left and right beside each other, from front to rear."""
    if not isinstance(vehicle, TrackedVehicle):
        return tuple(side.spindle for side in vehicle.parts.sides)
    joints = vehicle.model.builder.joints  # a belt's wheels are parts of their arms
    left, right = (
        side.road_wheels if isinstance(side, ShoeTrackParts) else [joints[arm].child for arm in side.arms]
        for side in (vehicle.parts.left, vehicle.parts.right)
    )
    return tuple(body for pair in zip(left, right, strict=False) for body in pair)


class Chase:
    """Keeps a vehicle before the camera of a page.

    Args:
        page: its scene is moved.
        vehicle: that is followed.

    Attributes:
        eye: where the camera is.
    """

    def __init__(self, page: Page, vehicle: AnyVehicle) -> None:
        self._page, self._vehicle = page, vehicle
        self.eye = Eye.BEHIND
        self._seen: float | None = None
        self._at = 0.0
        places = page.bodies.positions[page.chosen]
        wheels = places[list(wheel_bodies(vehicle))]
        middle = places[vehicle.parts.chassis]
        self._height = float(np.mean(wheels[:, 2]) - middle[2])
        axles = np.linalg.norm(wheels[:, :2] - wheels[0, :2], axis=1)
        self._length = max(1.5 * float(axles.max()), 0.1)
        self._front = float(np.linalg.norm(np.mean(wheels[:2, :2], axis=0) - middle[:2]))

    def use(self, eye: Eye) -> None:
        """Another camera, for all who look."""
        page, length, wheel = self._page, self._length, self._height
        self.eye, self._seen = eye, None
        page.turning = None if eye is Eye.OUTSIDE else self.heading
        page.follow(True)
        if eye is Eye.BEHIND:
            page.stand_beside(np.array([-1.6, 0.0, 0.65]) * length, np.array([0.6, 0.0, 0.1]) * length)
        elif eye is Eye.OUTSIDE:
            page.stand_beside(np.array([-1.1, -1.5, 0.9]) * length, np.zeros(3))
        else:
            height = wheel + 0.27 * length
            at = np.array([self._front - 0.2 * length, 0.0, height])
            page.stand_beside(at, at + np.array([1.0, 0.0, -0.12]) * length)

    def leave(self) -> None:
        """The scene no longer turns."""
        self._page.turning = None

    def heading(self) -> float:
        """Heading of the vehicle, as the camera comes round to it [rad]."""
        page = self._page
        x, y, z, w = page.bodies.rotations[page.chosen, self._vehicle.parts.chassis]
        true = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        now = time.perf_counter()
        if self._seen is None or self.eye is Eye.HOOD:
            self._seen = true
        off = math.remainder(true - self._seen, math.tau)
        share = 1.0 if abs(off) > 0.5 * math.pi else 1.0 - math.exp(-(now - self._at) / LAG)
        self._seen += share * off
        self._at = now
        return self._seen
