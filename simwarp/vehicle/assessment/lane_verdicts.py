"""Whether the outline of a vehicle stayed between the cones of a course, and which cone it came closest to or hit."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.assessment.verdict import Verdict, at_least, at_most
from simwarp.vehicle.driving.lane_courses import Cone, Lane, LaneCourse
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.run_result import Result, crossing, lateral_acceleration

Array = npt.NDArray[np.float64]

STRIDE: Final = 0.05
"""Between the places at which the outline is looked at, at most [m]."""


def lane_verdicts(run: Run, course: LaneCourse) -> list[Verdict]:
    """One verdict per lane on how far the outline is beyond its edges, and one on the exit being reached.

    The value of a lane is the greatest distance of a point of the outline within the lane's length beyond an edge,
    negative if the outline stayed inside by so much. `where` names the nearest cone of that edge.

    Args:
        run: recorded.
        course: lanes and outline.
    """
    corners = outline_corners(run, course)
    cones = course.cones()
    found = [_lane_verdict(number, lane, corners, cones) for number, lane in enumerate(course.lanes, 1)]
    furthest = float(corners[:, :, 0].min(axis=1).max()) if len(corners) else math.nan
    rule = f"{course.standard}: rear of the vehicle behind the exit"
    return [*found, at_least(rule, furthest - course.start, course.end - course.start, "m")]


def outline_corners(run: Run, course: LaneCourse) -> Array:
    """(n, 4, 2) corners of the outline at and between the rows of a run, up to the first that is not finite [m]."""
    x, y, yaw = run["x_m"], run["y_m"], np.unwrap(run["yaw_rad"])
    bad = np.flatnonzero(~np.isfinite(x + y + yaw))
    count = int(bad[0]) if bad.size else len(x)
    if count == 0:
        return np.zeros((0, 4, 2))
    x, y, yaw = x[:count], y[:count], yaw[:count]
    # a corner moves by what the frame moves and turns
    reach = math.hypot(max(abs(course.outline.front), abs(course.outline.rear)), 0.5 * course.outline.width)
    way = np.hypot(np.diff(x), np.diff(y)) + reach * np.abs(np.diff(yaw))
    parts = np.maximum(1, np.ceil(way / STRIDE).astype(int))
    rows = np.concatenate([[0.0], np.cumsum(parts)])
    fine = np.interp(np.arange(rows[-1] + 1), rows, np.arange(count))
    places = (np.interp(fine, np.arange(count), values) for values in (x, y, yaw))
    return course.outline.corners(*places)


def _lane_verdict(number: int, lane: Lane, corners: Array, cones: tuple[Cone, ...]) -> Verdict:
    rule = f"lane {number}, {lane.width:.2f} m wide: outline beyond its cones"
    over, place, side = _overstep(lane, corners)
    if side == "":
        return at_most(rule, math.nan, 0.0, "m", "not reached")
    name = f"{number}{side}"
    nearest = min((cone for cone in cones if cone.name.startswith(name)), key=lambda cone: abs(cone.x - place))
    return at_most(rule, over, 0.0, "m", f"cone {nearest.name}")


def _overstep(lane: Lane, corners: Array) -> tuple[float, float, str]:
    """Greatest distance beyond an edge [m], its x [m] and the edge's side; no side if the lane was never reached."""
    worst = (-math.inf, math.nan, "")
    for x, y in _points_within(lane, corners):
        if len(x) == 0:
            continue
        for side, over in (("L", y - lane.left), ("R", lane.right - y)):
            k = int(np.argmax(over))
            if over[k] > worst[0]:
                worst = (float(over[k]), float(x[k]), side)
    return worst


def _points_within(lane: Lane, corners: Array) -> list[tuple[Array, Array]]:
    """X and y of corners within a lane's length, and of the points where edges of the outline pass its ends."""
    found = []
    for k in range(4):
        a, b = corners[:, k], corners[:, (k + 1) % 4]
        inside = (a[:, 0] >= lane.start) & (a[:, 0] <= lane.end)
        found.append((a[inside, 0], a[inside, 1]))
        for end in (lane.start, lane.end):
            across = (a[:, 0] - end) * (b[:, 0] - end) < 0.0
            p, q = a[across], b[across]
            part = (end - p[:, 0]) / (q[:, 0] - p[:, 0])
            found.append((np.full(len(p), end), p[:, 1] + part * (q[:, 1] - p[:, 1])))
    return found


def lane_results(run: Run, course: LaneCourse) -> list[Result]:
    """Speeds at the entry and at the exit, and peaks of lateral acceleration, yaw rate and roll between."""
    front = run["x_m"] + course.outline.front
    inside = (front >= course.start) & (run["x_m"] + course.outline.rear <= course.end)
    if not inside.any():
        return [Result("entry_speed", "speed at the entry", math.nan, "m/s")]
    t, speed = run["t_s"], run["speed_mps"]
    entered = crossing(t, front, course.start)
    left = crossing(t, run["x_m"] + course.outline.rear, course.end)
    exit_speed = math.nan if math.isnan(left) else float(np.interp(left, t, speed))
    return [
        Result("entry_speed", "speed at the entry", float(np.interp(entered, t, speed)), "m/s"),
        Result("exit_speed", "speed at the exit", exit_speed, "m/s"),
        Result("peak_lateral", "peak lateral acceleration between the cones",
               float(np.abs(lateral_acceleration(run)[inside]).max()), "m/s²"),
        Result("peak_yaw_rate", "peak yaw rate", float(np.abs(run["yawrate_radps"][inside]).max()), "rad/s"),
        Result("peak_roll", "peak roll", math.degrees(float(np.abs(run["roll_rad"][inside]).max())), "deg"),
    ]  # fmt: skip
