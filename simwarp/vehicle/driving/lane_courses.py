"""Courses of lanes between cones: those of ISO 3888-1 and ISO 3888-2, and a line to drive through them."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.driving.paths import Path
from simwarp.vehicle.driving.vehicle_outline import Outline
from simwarp.vehicle.spec.vehicle_spec import SpecError

Array = npt.NDArray[np.float64]

LANE_OFFSET: Final = 3.5
"""ISO 3888-1: right edge of the second lane from the right edge of the first one, to the left [m]."""
OBSTACLE_OFFSET: Final = 1.0
"""ISO 3888-2: right edge of the second lane from the left edge of the first one, to the left [m]."""
NARROWEST_EXIT: Final = 3.0
"""ISO 3888-2: least width of the last lane [m]."""
CONE_SPACING: Final = 7.5
"""Between cones along a lane, at most [m]: ends and middle of a lane of 15 m."""
STATION: Final = 0.5
"""Between the points of a driven line [m]."""
SMOOTHING_LENGTH: Final = 3.0
"""A line's change of curvature over this length counts as much as its curvature [m]."""
MEAN_WEIGHT: Final = 0.3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lane:
    """A straight lane along the world's x axis.

    Attributes:
        start, end: along x [m].
        right, left: y of its edges [m], which touch the cones' bases.
    """

    start: float
    end: float
    right: float
    left: float

    @property
    def width(self) -> float:
        """Between its edges [m]."""
        return self.left - self.right

    @property
    def middle(self) -> float:
        """Y of its middle [m]."""
        return 0.5 * (self.left + self.right)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cone:
    """A cone at a lane's edge.

    Attributes:
        name: number of the lane from 1, side (L or R), and number along the lane from 1: "2R3".
        x, y: where its base touches the lane [m].
        outward: to which side of that point it stands, along y: 1 to the left, -1 to the right.
    """

    name: str
    x: float
    y: float
    outward: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class LaneCourse:
    """Lanes that a vehicle must not leave; between them it is free.

    Attributes:
        standard: where its dimensions are from.
        lanes: in the order in which they are driven.
        outline: of the vehicle that has to stay between the cones.
    """

    standard: str
    lanes: tuple[Lane, ...]
    outline: Outline

    @property
    def start(self) -> float:
        """X of the entry [m]."""
        return self.lanes[0].start

    @property
    def end(self) -> float:
        """X of the exit [m]."""
        return self.lanes[-1].end

    def cones(self, spacing: float = CONE_SPACING) -> tuple[Cone, ...]:
        """At both ends of each lane and evenly between, on both sides.

        Args:
            spacing: between cones of a side, at most [m].
        """
        found = []
        for number, lane in enumerate(self.lanes, 1):
            count = math.ceil((lane.end - lane.start) / spacing - 1e-9) + 1
            for side, y, outward in (("L", lane.left, 1.0), ("R", lane.right, -1.0)):
                places = np.linspace(lane.start, lane.end, count).tolist()
                found += [Cone(name=f"{number}{side}{k}", x=x, y=y, outward=outward) for k, x in enumerate(places, 1)]
        return tuple(found)


def double_lane_change_course(outline: Outline, start: float) -> LaneCourse:
    """ISO 3888-1, to the left: 15 m, 30 m free, 25 m, 25 m free, 30 m; widths 1.1 w, 1.2 w and 1.3 w, each + 0.25 m.

    The first lane lies about y = 0; the last one has the same right edge.

    Args:
        outline: of the vehicle, w is its width.
        start: x of the entry [m].
    """
    w = outline.width
    first, second, third = 1.1 * w + 0.25, 1.2 * w + 0.25, 1.3 * w + 0.25
    right = -0.5 * first
    lanes = (
        Lane(start=start, end=start + 15.0, right=right, left=right + first),
        Lane(start=start + 45.0, end=start + 70.0, right=right + LANE_OFFSET, left=right + LANE_OFFSET + second),
        Lane(start=start + 95.0, end=start + 125.0, right=right, left=right + third),
    )
    return LaneCourse(standard="ISO 3888-1", lanes=lanes, outline=outline)


def obstacle_avoidance_course(outline: Outline, start: float) -> LaneCourse:
    """ISO 3888-2, to the left: 12 m, 13.5 m free, 11 m, 12.5 m free, 12 m; widths 1.1 w + 0.25 m, w + 1 m, and
    1.3 w + 0.25 m but 3 m at least.

    The first lane lies about y = 0; the second one begins 1 m to the left of it, the last one has its right edge.

    Args:
        outline: of the vehicle, w is its width.
        start: x of the entry [m].
    """
    w = outline.width
    first, second, third = 1.1 * w + 0.25, w + 1.0, max(1.3 * w + 0.25, NARROWEST_EXIT)
    right = -0.5 * first
    across = right + first + OBSTACLE_OFFSET
    lanes = (
        Lane(start=start, end=start + 12.0, right=right, left=right + first),
        Lane(start=start + 25.5, end=start + 36.5, right=across, left=across + second),
        Lane(start=start + 49.0, end=start + 61.0, right=right, left=right + third),
    )
    return LaneCourse(standard="ISO 3888-2", lanes=lanes, outline=outline)


@functools.lru_cache(maxsize=64)
def driven_line(course: LaneCourse, begin: float, end: float, *, share: float = 0.5) -> Path:
    """The line of least curvature on which the outline, seen along the line, stays between the cones.

    A linear program over the line's offsets: least greatest curvature, with changes of curvature counted over
    `SMOOTHING_LENGTH`, and with a weight of `MEAN_WEIGHT` the mean curvature, so that it is straight where nothing asks
    for a curve. It begins at y = 0 and ends in the middle of the last lane, straight along x both times, and is
    for the vehicle's frame of reference.

    Args:
        course: lanes along x.
        begin: x of the first point [m], before the entry.
        end: x of the last point [m], behind the exit.
        share: of the room beside the outline that the line keeps free, 0 to 1: 1 leads along the lanes' middles.

    Raises:
        SpecError: the course has no room for such a line, or `begin` and `end` do not lie around it.
    """
    from scipy.optimize import linprog  # takes a while to import

    if not begin < course.start < course.end < end:
        raise SpecError(f"path: must begin before x = {course.start:g} m and end behind {course.end:g} m")
    x = np.arange(begin, end + 0.5 * STATION, STATION)
    n = len(x)
    lanes, limits = _inside(course, x, share)
    second = np.diff(np.eye(n), 2, axis=0) / STATION**2
    third = np.diff(np.eye(n), 3, axis=0) / STATION**3
    m = len(second)
    # unknowns: n offsets, m sizes of the curvature, the greatest curvature, the greatest change of it
    each, greatest, jump = np.eye(m), np.ones((m, 1)), np.ones((len(third), 1))
    curved = [np.hstack([sign * second, -each, np.zeros((m, 2))]) for sign in (1.0, -1.0)]
    bounded = np.hstack([np.zeros((m, n)), each, -greatest, np.zeros((m, 1))])
    changing = [np.hstack([sign * third, np.zeros((len(third), m + 1)), -jump]) for sign in (1.0, -1.0)]
    inside = np.hstack([lanes, np.zeros((len(lanes), m + 2))])
    above = np.vstack([*curved, bounded, *changing, inside])
    goal = course.lanes[-1].middle
    solution = linprog(
        np.concatenate([np.zeros(n), np.full(m, MEAN_WEIGHT / m), [1.0, SMOOTHING_LENGTH]]),
        A_ub=above, b_ub=np.concatenate([np.zeros(len(above) - len(limits)), limits]),
        A_eq=np.eye(n + m + 2)[[0, 1, n - 2, n - 1]], b_eq=[0.0, 0.0, goal, goal], bounds=(None, None), method="highs",
    )  # fmt: skip
    if not solution.success:
        raise SpecError(f"path: {course.standard}: no line leads through; the vehicle is too long for its lanes")
    return Path(np.stack([x, solution.x[:n]], axis=1))


def _inside(course: LaneCourse, x: Array, share: float) -> tuple[Array, Array]:
    """Rows and limits: edges of the outline, whose heading is the line's slope, stay in the lanes that they are in."""
    rows, limits = [], []
    for lane in course.lanes:
        room = 0.5 * (1.0 - share) * (lane.width - course.outline.width)
        for edge in (course.outline.front, course.outline.rear, 0.0):
            over = np.flatnonzero((x + edge >= lane.start - STATION) & (x + edge <= lane.end + STATION))
            for k in over[(over > 0) & (over < len(x) - 1)]:
                row = np.zeros(len(x))
                row[k] = 1.0
                row[[k - 1, k + 1]] += np.array([-0.5, 0.5]) * edge / STATION  # the slope's share at that lever
                rows += [row, -row]
                limits += [lane.middle + room, room - lane.middle]
    return np.array(rows), np.array(limits)
