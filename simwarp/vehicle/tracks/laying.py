"""How a chain of shoes is laid around sprocket, idler and road wheels: pins in the plane of the track."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.spec.parts import SpecError

Array = npt.NDArray[np.float64]

SHARPEST_FOLD: Final = math.radians(60.0)
"""Least angle between the two last straight runs: shoes of a sharper one lie in each other."""
MOST_SHOES: Final = 2000
"""Of one chain: lengths in millimetres would ask for more."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackCourse:
    """What a chain runs around, in the plane of the track: x forward, z up, in the vehicle's frame of reference [m].

    Attributes:
        sprocket: (x, z) of the sprocket's axis.
        sprocket_radius: of the circle of the pins around it.
        idler: (x, z) of the idler's axis.
        idler_radius: of the circle of the pins around it.
        wheel_front: (x, z) of the axis of the road wheel next to the sprocket.
        wheel_rear: of the one next to the idler.
        wheel_radius: from the wheels' axes down to the pins.
    """

    sprocket: tuple[float, float]
    sprocket_radius: float
    idler: tuple[float, float]
    idler_radius: float
    wheel_front: tuple[float, float]
    wheel_rear: tuple[float, float]
    wheel_radius: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class LaidChain:
    """A closed chain of N shoes. Shoe k reaches from pin k to pin k + 1, the last one to pin 0."""

    pins: Array
    """(N, 2) x, z of the pins, in the frame of the course [m]; pin 0 is straight below the sprocket's axis."""
    angles: Array
    """(N,) direction from a shoe's first pin to its second, from +x towards +z [rad]."""

    @property
    def centres(self) -> Array:
        """(N, 2) middle between the two pins of each shoe [m]."""
        middle: Array = 0.5 * (self.pins + np.roll(self.pins, -1, axis=0))
        return middle


def lay_chain(course: TrackCourse, *, pitch: float, shoes: int) -> LaidChain:
    """Lays a closed chain: from below the sprocket around its far side, straight to the idler, around it, down to the
    nearest road wheel, level below the wheels, and in two straight runs of equally many shoes back to the start.

    A sprocket in front and one behind are mirror images; shoes are numbered from the sprocket's lowest point.

    Args:
        course: what it runs around.
        pitch: distance of the two pins of a shoe [m].
        shoes: how many there are.

    Raises:
        SpecError: the chain does not close, or a shoe is longer than a wheel is wide.
    """
    _check(course, pitch, shoes)
    forward = 1.0 if course.sprocket[0] > course.idler[0] else -1.0
    run = _Run(x=0.0, z=course.sprocket[1] - course.sprocket_radius, pitch=pitch)

    def ahead(point: tuple[float, float]) -> tuple[float, float]:
        """From the sprocket, with the idler on the side of negative x."""
        return forward * (point[0] - course.sprocket[0]), point[1]

    idler, near, far = ahead(course.idler), ahead(course.wheel_front), ahead(course.wheel_rear)
    _around_sprocket(run, course.sprocket_radius)
    top = (course.sprocket[1] + course.sprocket_radius) - (idler[1] + course.idler_radius)
    slope = math.pi + math.atan2(top, -idler[0])
    while run.x > idler[0]:
        run.add(slope)
    turn = 2.0 * math.asin(0.5 * pitch / course.idler_radius)
    angle = slope + turn
    while angle < 2.0 * math.pi:
        run.add(angle)
        angle += turn
    bottom = (idler[1] - course.idler_radius) - (far[1] - course.wheel_radius)
    down = -math.atan2(bottom, far[0] - idler[0])
    while run.x < far[0]:
        run.add(down)
    while run.x < near[0]:
        run.add(0.0)
    if (shoes - run.count) % 2 == 1:
        run.add(0.0)
    _close(run, (0.0, course.sprocket[1] - course.sprocket_radius), shoes)
    pins = np.array(run.pins[:-1])
    angles = np.array(run.angles)
    return LaidChain(
        pins=np.stack([course.sprocket[0] + forward * pins[:, 0], pins[:, 1]], axis=1),
        angles=angles if forward > 0.0 else math.pi - angles,
    )


@dataclasses.dataclass
class _Run:
    """A chain as far as it is laid."""

    x: float
    z: float
    pitch: float
    pins: list[tuple[float, float]] = dataclasses.field(default_factory=list)
    angles: list[float] = dataclasses.field(default_factory=list)

    def __post_init__(self) -> None:
        self.pins.append((self.x, self.z))

    @property
    def count(self) -> int:
        """Shoes laid so far."""
        return len(self.angles)

    def add(self, angle: float) -> None:
        """One more shoe."""
        if self.count == MOST_SHOES:
            raise SpecError(
                f"track: the way around takes more than {MOST_SHOES} shoes of {self.pitch:g} m; give metres"
            )
        self.x += self.pitch * math.cos(angle)
        self.z += self.pitch * math.sin(angle)
        self.angles.append(angle)
        self.pins.append((self.x, self.z))


def _check(course: TrackCourse, pitch: float, shoes: int) -> None:
    if not (math.isfinite(pitch) and pitch > 0.0):
        raise SpecError(f"track: pitch must be > 0 m, got {pitch}; give the distance of a shoe's two pins")
    if isinstance(shoes, bool) or not isinstance(shoes, int) or shoes < 3:
        raise SpecError(f"track: shoes must be a whole number >= 3, got {shoes!r}; fewer do not make a loop")
    for name in ("sprocket_radius", "idler_radius", "wheel_radius"):
        radius = getattr(course, name)
        if not (math.isfinite(radius) and radius > 0.0):
            raise SpecError(f"track: {name} must be > 0 m, got {radius}; give the distance of the pins from the axis")
    for name in ("sprocket_radius", "idler_radius"):
        if pitch >= 2.0 * getattr(course, name):
            raise SpecError(
                f"track: {name} must be more than half the pitch of {pitch} m, got {getattr(course, name)} m; "
                "a shoe does not fit around it"
            )
    for name in ("sprocket", "idler", "wheel_front", "wheel_rear"):
        point = getattr(course, name)
        if not all(map(math.isfinite, point)):
            raise SpecError(f"track: {name} must be two finite numbers [m], got {point}")
    if course.sprocket[0] == course.idler[0]:
        raise SpecError(f"track: sprocket and idler must not have the same x, got {course.idler[0]} m for both")


def _around_sprocket(run: _Run, radius: float) -> None:
    """Shoes from below the sprocket to its top: all that are not yet level there."""
    half = math.asin(0.5 * run.pitch / radius)
    angle = half
    while angle < math.pi:
        run.add(angle)
        angle += 2.0 * half


def _close(run: _Run, start: tuple[float, float], shoes: int) -> None:
    """The last shoes, in two straight runs that make an isosceles triangle with the way back to the start."""
    left = shoes - run.count
    across, up = start[0] - run.x, start[1] - run.z
    way = math.hypot(across, up)
    if left <= 0 or left * run.pitch < way:
        missing = way - left * run.pitch
        needed = run.count + 2 * math.ceil(0.5 * way / run.pitch)
        raise SpecError(
            f"track: a chain of {shoes} shoes of {run.pitch:g} m does not close, {missing:.4g} m are missing; "
            f"use {needed} shoes, or move idler or sprocket"
        )
    fold = math.acos(min(1.0, way / (left * run.pitch)))
    if math.pi - 2.0 * fold < SHARPEST_FOLD:
        most = run.count + 2 * math.floor(0.5 * way / run.pitch / math.sin(0.5 * SHARPEST_FOLD))
        raise SpecError(
            f"track: {shoes} shoes of {run.pitch:g} m are {left * run.pitch - way:.4g} m more than the way around, and "
            f"lie in each other; use {most} shoes or fewer, or move idler or sprocket"
        )
    way_angle = math.atan2(up, across)
    for k in range(left):
        run.add(way_angle - fold if k < left // 2 else way_angle + fold)
