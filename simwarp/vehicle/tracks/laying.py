"""How a chain is laid around sprocket, idler and road wheels: pins in the plane of the track.

A link reaches from a pin to the next one: a shoe, or, of shoes with two pins, a shoe or a connector in turn.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.spec.parts import SpecError

Array = npt.NDArray[np.float64]

SHARPEST_FOLD: Final = math.radians(60.0)
"""Least angle between the two last straight runs: shoes of a sharper one lie in each other."""
MOST_LINKS: Final = 4000
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
    """A closed chain of N links. Link k reaches from pin k to pin k + 1, the last one to pin 0."""

    pins: Array
    """(N, 2) x, z of the pins, in the frame of the course [m]; straight below the sprocket's axis is pin 0, or the
    middle of link 0."""
    angles: Array
    """(N,) direction from a link's first pin to its second, from +x towards +z [rad]."""

    @property
    def centres(self) -> Array:
        """(N, 2) middle between the two pins of each link [m]."""
        middle: Array = 0.5 * (self.pins + np.roll(self.pins, -1, axis=0))
        return middle


def lay_chain(course: TrackCourse, *, lengths: Sequence[float], shoes: int) -> LaidChain:
    """Lays a closed chain: from below the sprocket around its far side, straight to the idler, around it, down to the
    nearest road wheel, level below the wheels, and in two straight runs of equally many links back to the start.

    A sprocket in front and one behind are mirror images; links are numbered from the sprocket's lowest point.

    Args:
        course: what it runs around.
        lengths: distances of the two pins of the links of a shoe, in their order [m]: one, or shoe and connector.
            With one pin, a shoe begins straight below the sprocket; with two, the first one lies level there, in a gap.
        shoes: how many there are.

    Raises:
        SpecError: the chain does not close, or a link is longer than a wheel is wide.
    """
    _check(course, lengths, shoes)
    forward = 1.0 if course.sprocket[0] > course.idler[0] else -1.0
    radius = course.sprocket_radius
    half = 0.5 * lengths[0] if len(lengths) > 1 else 0.0
    start = (-half, course.sprocket[1] - math.sqrt(radius**2 - half**2))
    run = _Run(*start, lengths=tuple(lengths))

    def ahead(point: tuple[float, float]) -> tuple[float, float]:
        """From the sprocket, with the idler on the side of negative x."""
        return forward * (point[0] - course.sprocket[0]), point[1]

    idler, near, far = ahead(course.idler), ahead(course.wheel_front), ahead(course.wheel_rear)
    run.around(radius, -math.asin(half / radius), math.pi)
    top = (course.sprocket[1] + radius) - (idler[1] + course.idler_radius)
    slope = math.pi + math.atan2(top, -idler[0])
    while run.x > idler[0]:
        run.add(slope)
    before = slope + math.asin(0.5 * run.length(run.count - 1) / course.idler_radius)
    run.around(course.idler_radius, before, 2.0 * math.pi)
    bottom = (idler[1] - course.idler_radius) - (far[1] - course.wheel_radius)
    down = -math.atan2(bottom, far[0] - idler[0])
    while run.x < far[0]:
        run.add(down)
    while run.x < near[0]:
        run.add(0.0)
    count = shoes * len(lengths)
    if (count - run.count) % 2 == 1:
        run.add(0.0)
    _close(run, start, count)
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
    lengths: tuple[float, ...]
    pins: list[tuple[float, float]] = dataclasses.field(default_factory=list)
    angles: list[float] = dataclasses.field(default_factory=list)

    def __post_init__(self) -> None:
        self.pins.append((self.x, self.z))

    @property
    def count(self) -> int:
        """Links laid so far."""
        return len(self.angles)

    def length(self, link: int) -> float:
        """Of a link [m]."""
        return self.lengths[link % len(self.lengths)]

    def reach(self, first: int, count: int) -> float:
        """Of some links in line [m]."""
        return math.fsum(self.length(first + k) for k in range(count))

    def around(self, radius: float, before: float, end: float) -> None:
        """Links whose pins lie on a circle, from the pin at which its tangent has the direction `before`, until the
        next link's direction would pass the `end`.
        """
        while True:
            half = math.asin(0.5 * self.length(self.count) / radius)
            if before + half >= end:
                return
            self.add(before + half)
            before += 2.0 * half

    def add(self, angle: float) -> None:
        """One more link."""
        if self.count == MOST_LINKS:
            raise SpecError(
                f"track: the way around takes more than {MOST_LINKS} links of {self.length(0):g} m; give metres"
            )
        length = self.length(self.count)
        self.x += length * math.cos(angle)
        self.z += length * math.sin(angle)
        self.angles.append(angle)
        self.pins.append((self.x, self.z))


def _check(course: TrackCourse, lengths: Sequence[float], shoes: int) -> None:
    for length in lengths:
        if not (math.isfinite(length) and length > 0.0):
            raise SpecError(f"track: pitch must be > 0 m, got {length}; give the distance of a link's two pins")
    if isinstance(shoes, bool) or not isinstance(shoes, int) or shoes < 3:
        raise SpecError(f"track: shoes must be a whole number >= 3, got {shoes!r}; fewer do not make a loop")
    for name in ("sprocket_radius", "idler_radius", "wheel_radius"):
        radius = getattr(course, name)
        if not (math.isfinite(radius) and radius > 0.0):
            raise SpecError(f"track: {name} must be > 0 m, got {radius}; give the distance of the pins from the axis")
    for name in ("sprocket_radius", "idler_radius"):
        if max(lengths) >= 2.0 * getattr(course, name):
            raise SpecError(
                f"track: {name} must be more than half the pitch of {max(lengths)} m, got {getattr(course, name)} m; "
                "a shoe does not fit around it"
            )
    for name in ("sprocket", "idler", "wheel_front", "wheel_rear"):
        point = getattr(course, name)
        if not all(map(math.isfinite, point)):
            raise SpecError(f"track: {name} must be two finite numbers [m], got {point}")
    if course.sprocket[0] == course.idler[0]:
        raise SpecError(f"track: sprocket and idler must not have the same x, got {course.idler[0]} m for both")


def _close(run: _Run, start: tuple[float, float], count: int) -> None:
    """The last links, in two straight runs that make a triangle with the way back to the start."""
    left = count - run.count
    across, up = start[0] - run.x, start[1] - run.z
    way, pair = math.hypot(across, up), len(run.lengths)
    reach = run.reach(run.count, max(left, 0))
    shoes, pitch = count // pair, math.fsum(run.lengths)
    if left <= 0 or reach < way:
        needed = math.ceil((run.count + 2 * math.ceil(0.5 * way * pair / pitch)) / pair)
        raise SpecError(
            f"track: a chain of {shoes} shoes of {pitch:g} m does not close, {way - reach:.4g} m are missing; "
            f"use {needed} shoes, or move idler or sprocket"
        )
    first = run.reach(run.count, left // 2)
    second = reach - first
    away = _angle(first, way, second)
    between = _angle(first, second, way)
    if between < SHARPEST_FOLD:
        most = (run.count + 2 * math.floor(0.5 * way * pair / pitch / math.sin(0.5 * SHARPEST_FOLD))) // pair
        raise SpecError(
            f"track: {shoes} shoes of {pitch:g} m are {reach - way:.4g} m more than the way around, and "
            f"lie in each other; use {most} shoes or fewer, or move idler or sprocket"
        )
    way_angle = math.atan2(up, across)
    back = way_angle - away + math.pi - between
    for k in range(left):
        run.add(way_angle - away if k < left // 2 else back)


def _angle(a: float, b: float, opposite: float) -> float:
    """Between two sides of a triangle, by the law of cosines [rad]."""
    return math.acos(max(-1.0, min(1.0, (a * a + b * b - opposite * opposite) / (2.0 * a * b))))
