"""A double wishbone with its spring on the lower arm: levers and rates from the loop equations in NumPy, float64.

Nothing here knows how simwarp measures them: derivatives are central differences of closed linkages, loads follow from
virtual work.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from tests.reference.suspension_kinematics import (
    Geometry,
    Motion,
    exponential,
    free_upright,
    newton,
    path,
    turning,
    wheel,
)

Array = npt.NDArray[np.float64]
STEP = 1.0e-4
"""Travel to either side between which rates are taken [m]."""


@dataclasses.dataclass(frozen=True)
class Corner:
    """The left wheel at a travel: angles [rad], lengths [m], forces [N], rates [N/m]; points in the vehicle's frame."""

    toe: float
    camber: float
    contact: Array
    slope: Array
    """(3,) path of the contact point, which moves with the upright, over the travel."""
    center_slope: Array
    """(3,) the same of the wheel's centre."""
    caster: float
    kingpin_inclination: float
    scrub_radius: float
    trail: float
    motion_ratio: Array
    load: float

    @property
    def roll_centre(self) -> float:
        """Height above the ground where the normal of the contact point's path meets the middle plane."""
        return float(self.contact[1] * self.slope[1] / self.slope[2])


class LeftWheel:
    """The left side of an axle whose tie rod stands still.

    Args:
        suspension: description.
        location: of the axle.
        radius: from the wheel's centre to the ground.
        force: (line, length, length as built) -> force that pushes a spring's ends apart.
    """

    def __init__(
        self, suspension: Any, location: Any, radius: float, force: Callable[[Any, float, float], float]
    ) -> None:
        self.lines, self.radius, self.force = suspension.springs, radius, force
        self.geometry = Geometry(vars(suspension), np.array(location, float), 1.0, 0.0)
        still = Motion(np.zeros(3), np.zeros(3), np.eye(3))
        self.linkage, self.size = free_upright(self.geometry, still)

    def upright(self, travel: float) -> Motion:
        found = np.zeros(self.size)
        center = self.geometry.center
        for height in path(travel):

            def residual(x: Array, height: float = float(height)) -> Array:
                equations, moved = self.linkage(x)
                return np.append(equations, moved(center)[2] - center[2] - height)

            found = newton(residual, found)
        return self.linkage(found)[1]

    def lower_arm(self, upright: Motion) -> Motion:
        """The turn about the line of its pivots that takes its ball to the upright's."""
        front, back = self.geometry.at("lower_arm_front"), self.geometry.at("lower_arm_back")
        axis = (front - back) / np.linalg.norm(front - back)
        ball = self.geometry.at("lower_arm_upright")
        old, after = ball - back, upright(ball) - back
        old, after = old - (old @ axis) * axis, after - (after @ axis) * axis
        return turning(back, axis, float(np.arctan2(np.cross(old, after) @ axis, old @ after)))

    def lengths(self, upright: Motion) -> Array:
        arm, place = self.lower_arm(upright), self.geometry.location
        return np.array(
            [np.linalg.norm(arm(place + line.arm_point) - (place + line.chassis_point)) for line in self.lines]
        )

    def built_lengths(self) -> Array:
        return np.array([np.linalg.norm(np.subtract(line.arm_point, line.chassis_point)) for line in self.lines])

    def contact(self, upright: Motion) -> Array:
        axis = upright.rotation @ self.geometry.axis
        up = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
        return upright(self.geometry.center) - self.radius * up / np.linalg.norm(up)

    def at(self, travel: float) -> Corner:
        here, above, below = (self.upright(travel + way * STEP) for way in (0.0, 1.0, -1.0))
        contact, center = self.contact(here), self.geometry.center
        # the point of the upright that touches now
        built = here.pivot + here.rotation.T @ (contact - here.pivot - here.shift)
        slope = (above(built) - below(built)) / (2.0 * STEP)
        ratio = -(self.lengths(above) - self.lengths(below)) / (2.0 * STEP)
        forces = [
            self.force(line, float(length), float(rest))
            for line, length, rest in zip(self.lines, self.lengths(here), self.built_lengths(), strict=True)
        ]
        low, high = (here(self.geometry.at(f"{name}_arm_upright")) for name in ("lower", "upper"))
        kingpin = (high - low) / np.linalg.norm(high - low)
        pierced = low + kingpin * ((contact[2] - low[2]) / kingpin[2])
        axis = here.rotation @ self.geometry.axis
        outwards = np.array([axis[0], axis[1], 0.0]) / np.hypot(axis[0], axis[1])
        forward = np.array([outwards[1], -outwards[0], 0.0])
        angles = wheel(self.geometry, here)
        return Corner(
            -angles.steer, angles.camber, contact, slope, (above(center) - below(center)) / (2.0 * STEP),
            float(np.arctan2(-kingpin[0], kingpin[2])), float(np.arctan2(-kingpin[1], kingpin[2])),
            float((contact - pierced) @ outwards), float((pierced - contact) @ forward), ratio,
            float(np.dot(forces, ratio)),
        )  # fmt: skip


def four_bar(
    lower: tuple[Array, Array], upper: tuple[Array, Array], center: Array, travel: float
) -> tuple[float, Array, Array]:
    """A planar double wishbone in front view (y, z): arms from hinge to ball, the upright between the balls.

    Returns:
        The upright's turn, the centre's place, and the instant centre, where the lines of both arms meet.
    """

    def placed(angle: float) -> tuple[float, Array, Array, Array]:
        arm = exponential(np.array([angle, 0.0, 0.0]))[1:, 1:]
        ball = lower[0] + arm @ (lower[1] - lower[0])
        length, reach = np.linalg.norm(upper[1] - upper[0]), np.linalg.norm(upper[1] - lower[1])
        # the upper ball: where two circles meet, on the side where it was built
        away = upper[0] - ball
        distance = float(np.linalg.norm(away))
        along = (reach**2 - length**2 + distance**2) / (2.0 * distance)
        across = np.sqrt(reach**2 - along**2)
        unit = away / distance
        normal = np.array([-unit[1], unit[0]])
        options = [ball + along * unit + way * across * normal for way in (1.0, -1.0)]
        top = min(options, key=lambda p: float(np.linalg.norm(p - upper[1])))
        old, new = upper[1] - lower[1], top - ball
        turn = float(np.arctan2(old[0] * new[1] - old[1] * new[0], old @ new))
        rotation = exponential(np.array([turn, 0.0, 0.0]))[1:, 1:]
        return turn, ball + rotation @ (center - lower[1]), ball, top

    found = newton(lambda x: np.array([placed(float(x[0]))[1][1] - center[1] - travel]), np.zeros(1))
    turn, place, ball, top = placed(float(found[0]))
    first, second = ball - lower[0], top - upper[0]
    share = np.linalg.solve(np.stack([first, -second], axis=1), upper[0] - lower[0])
    return turn, place, lower[0] + share[0] * first
