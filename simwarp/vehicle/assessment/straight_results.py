"""Results of braking, acceleration, hill starts and bumps."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.assessment.verdict import Verdict, at_least, at_most
from simwarp.vehicle.driving.braking_maneuvers import HOLD
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.channels import WHEELS, Run
from simwarp.vehicle.results.run_result import (
    STANDSTILL,
    Result,
    crossing,
    lateral_acceleration,
    smoothed,
    until,
)

Array = npt.NDArray[np.float64]

SPEED_MARKS: Final = (30.0, 60.0, 80.0, 100.0, 120.0)
"""[km/h]."""
QUARTER_MILE: Final = 402.336
"""[m]."""


def acceleration_times(run: Run, maneuver: Maneuver) -> list[Result]:
    """Times from rest to speeds in km/h that were reached, to the quarter mile and with what speed, and to 95 % of the
    highest speed.
    """
    t, speed = run["t_s"], run["speed_mps"]
    times = [(mark, crossing(t, speed, mark / 3.6)) for mark in SPEED_MARKS]
    found = [
        Result(f"time_to_{mark:g}_kmh", f"time to {mark:g} km/h", time, "s")
        for mark, time in times
        if math.isfinite(time) or mark == 100.0
    ]
    top = float(speed.max())
    way = travelled(run)
    there = crossing(t, way, QUARTER_MILE)
    with_speed = math.nan if math.isnan(there) else float(np.interp(there, t, speed))
    return [
        *found,
        Result("quarter_mile", "quarter mile", there, "s"),
        Result("quarter_mile_speed", "speed at the quarter mile", with_speed, "m/s"),
        Result("time_to_95_percent", "time to 95 % of the top speed of this run", crossing(t, speed, 0.95 * top), "s"),
        Result("greatest_acceleration", "greatest acceleration over half a second",
               float(smoothed(np.gradient(speed, t), 51).max()), "m/s²"),
    ]  # fmt: skip


def travelled(run: Run) -> Array:
    """(n,) way of the frame of reference since the first row, wherever the vehicle points [m]."""
    steps = np.stack([np.diff(run[name]) for name in ("x_m", "y_m", "z_m")])
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=0))])


def ground_speed(run: Run) -> Array:
    """(n,) size of the frame's horizontal velocity, wherever the vehicle points [m/s].

    Differences of second order also at the ends: those of first order are half a row late, by which a stop of 8 m/s²
    would begin 4 cm/s too slow.
    """
    if len(run["t_s"]) < 3:
        return np.abs(run["speed_mps"])
    t = run["t_s"]
    return np.hypot(np.gradient(run["x_m"], t, edge_order=2), np.gradient(run["y_m"], t, edge_order=2))


def braking_results(run: Run, maneuver: Maneuver) -> list[Result]:
    """From the first row with brakes: distance, time, mean deceleration over the distance, yaw and deviation.

    The mean deceleration is v² / (2 s); the mean fully developed one is that between 80 and 10 % of the speed, over
    the way between.
    """
    stopped = stopping_row(run)
    until_stop = run if stopped is None else until(run, float(run["t_s"][stopped]))
    t, speed, way = until_stop["t_s"], ground_speed(until_stop), travelled(until_stop)
    begin = float(speed[0])
    missing = "still moving at the end"
    distance = math.nan if stopped is None else float(way[-1])
    mean = begin**2 / (2.0 * distance) if distance > 0.0 else math.nan
    off, yaw = course_deviation(until_stop)
    return [
        Result("braking_from", "braking from", begin, "m/s"),
        Result("stopping_distance", "stopping distance", distance, "m", missing),
        Result("stopping_time", "stopping time", math.nan if stopped is None else float(t[-1]), "s", missing),
        Result("mean_deceleration", "mean deceleration over the distance", mean, "m/s²", missing),
        Result("developed_deceleration", "mean fully developed deceleration", developed(speed, way), "m/s²", missing),
        Result("yaw_deviation", "greatest change of the heading", math.degrees(float(np.abs(yaw).max())), "deg"),
        Result("yaw_after_1_s", "change of the heading after 1 s", math.degrees(float(np.interp(1.0, t, yaw))), "deg"),
        Result("course_deviation", "greatest distance from the line", float(np.abs(off).max()), "m"),
        Result("peak_yaw_rate", "peak yaw rate", float(np.abs(until_stop["yawrate_radps"]).max()), "rad/s"),
    ]  # fmt: skip


def stopping_row(run: Run) -> int | None:
    """First row at standstill."""
    still = np.flatnonzero(ground_speed(run) < STANDSTILL)
    return int(still[0]) if still.size else None


def developed(speed: Array, way: Array) -> float:
    """Mean fully developed deceleration of a stop [m/s²]: (v1² - v2²) / (2 s) from 80 to 10 % of the speed."""
    first, last = (np.flatnonzero(speed <= share * speed[0]) for share in (0.8, 0.1))
    if first.size == 0 or last.size == 0:
        return math.nan
    a, b = int(first[0]), int(last[0])
    return float((speed[a] ** 2 - speed[b] ** 2) / (2.0 * max(way[b] - way[a], 1e-9)))


def course_deviation(run: Run) -> tuple[Array, Array]:
    """(n,) distance to the left of the line along the first heading [m], and change of the heading [rad]."""
    yaw = np.unwrap(run["yaw_rad"])
    x, y = run["x_m"] - run["x_m"][0], run["y_m"] - run["y_m"][0]
    return y * math.cos(yaw[0]) - x * math.sin(yaw[0]), yaw - yaw[0]


MOST_YAW: Final = 15.0
"""UN R13-H: change of the heading in a stop [deg]."""
ROAD_WIDTH: Final = 3.5
"""UN R13-H: of the lane that the vehicle does not leave [m]."""


def braking_verdicts(run: Run, maneuver: Maneuver) -> list[Verdict]:
    """UN R13-H: the vehicle stops, turns by 15° at most, and its frame stays within half a lane of 3.5 m."""
    stopped = stopping_row(run)
    until_stop = run if stopped is None else until(run, float(run["t_s"][stopped]))
    off, yaw = course_deviation(until_stop)
    return [
        at_most("speed at the end", float(ground_speed(run)[-1 if stopped is None else stopped]), STANDSTILL, "m/s"),
        at_most("UN R13-H: change of the heading", math.degrees(float(np.abs(yaw).max())), MOST_YAW, "deg"),
        at_most("UN R13-H: distance from the line", float(np.abs(off).max()), 0.5 * ROAD_WIDTH, "m"),
    ]


def turn_braking_results(run: Run, maneuver: Maneuver) -> list[Result]:
    """ISO 7975: steady values before the brakes, yaw rate a second after over that of a vehicle that keeps its circle,
    mean deceleration in that second, greatest yaw rate and sideslip, and the deviation from the circle.
    """
    t, speed, yaw_rate = run["t_s"], run["speed_mps"], run["yawrate_radps"]
    lateral = lateral_acceleration(run)
    begin = float(speed[0])
    radius = begin / yaw_rate[0] if abs(yaw_rate[0]) > 1e-3 else math.nan
    at_one = {name: float(np.interp(1.0, t, values)) for name, values in (("v", speed), ("r", yaw_rate))}
    stands = at_one["v"] < 0.1 * begin
    ratio = math.nan if stands else at_one["r"] / (at_one["v"] / radius)
    # a vehicle that hardly moves has no direction
    slip = np.degrees(np.where(speed > 0.2 * begin, sideslip(run), sideslip(run)[0]))
    return [
        Result("braking_from", "braking from", begin, "m/s"),
        Result("steady_lateral", "lateral acceleration before", float(lateral[0]), "m/s²"),
        Result("steady_radius", "radius before", radius, "m", "it goes straight on"),
        Result("yaw_rate_ratio", "yaw rate after 1 s over that on the circle", ratio, "", "it stands by then"),
        Result("mean_deceleration", "mean deceleration in that second", begin - at_one["v"], "m/s²"),
        Result("peak_yaw_rate", "peak yaw rate", float(np.abs(yaw_rate).max()), "rad/s"),
        Result("peak_sideslip", "greatest change of the sideslip angle", float(np.abs(slip - slip[0]).max()), "deg"),
        *_circle_deviation(run, radius, t <= 1.0 + 1e-9),
    ]


def sideslip(run: Run) -> Array:
    """(n,) angle of the frame's velocity from its heading, positive to the left [rad]; 0 at standstill."""
    t = run["t_s"]
    vx, vy = np.gradient(run["x_m"], t), np.gradient(run["y_m"], t)
    angle = np.arctan2(vy, vx) - run["yaw_rad"]
    return np.where(np.hypot(vx, vy) > 0.1, np.arctan2(np.sin(angle), np.cos(angle)), 0.0)


def _circle_deviation(run: Run, radius: float, rows: npt.NDArray[np.bool_]) -> list[Result]:
    """Distance outwards from the circle on which the vehicle began."""
    slip = float(sideslip(run)[0])
    course = float(run["yaw_rad"][0]) + slip
    center = np.array([run["x_m"][0] - radius * math.sin(course), run["y_m"][0] + radius * math.cos(course)])
    out = np.hypot(run["x_m"] - center[0], run["y_m"] - center[1]) - abs(radius)
    return [Result("path_deviation", "outwards from the circle after 1 s", float(out[rows][-1]), "m")]


def hill_results(run: Run, maneuver: Maneuver) -> list[Result]:
    """Creep on the brakes, way rolled back after they opened, and what was climbed."""
    way = climbed(run, maneuver)
    t = run["t_s"]
    on_brakes = (t >= min(HILL_CALM, t[-1])) & (t <= HOLD)
    creep = float(np.ptp(way[on_brakes])) if on_brakes.any() else math.nan
    return [
        Result("creep", "moved on the brakes", 1e3 * creep, "mm"),
        Result("rollback", "rolled back", 1e3 * rollback(run, maneuver), "mm"),
        Result("climbed", "climbed", float(way[-1] - way[0]), "m"),
        Result("time_to_2_m", "2 m climbed after", crossing(t, way - way[0], CLIMBED) - HOLD, "s"),
    ]


HILL_CALM: Final = 1.0
"""From which on creep on the brakes is measured [s]: springs swing out before."""
CLIMBED: Final = 2.0
"""Way up of a hill start that has worked [m]."""
MOST_ROLLBACK: Final = 0.3
MOST_CREEP: Final = 5.0
"""Way back [m] and on the brakes [mm] of a hill start that has worked."""


def climbed(run: Run, maneuver: Maneuver) -> Array:
    """(n,) place along the slope [m]."""
    lean = math.atan(maneuver.slope)
    return np.asarray(math.cos(lean) * run["x_m"] + math.sin(lean) * run["z_m"])


def rollback(run: Run, maneuver: Maneuver) -> float:
    """Farthest place below that when the brakes began to open [m]."""
    way, after = climbed(run, maneuver), run["t_s"] >= HOLD - 1e-9
    if not after.any():
        return math.nan
    return float(max(0.0, way[after][0] - way[after].min()))


def hill_verdicts(run: Run, maneuver: Maneuver) -> list[Verdict]:
    """The brakes hold, the vehicle does not roll back by more than 0.3 m, and climbs 2 m."""
    values = {item.key: item.value for item in hill_results(run, maneuver)}
    return [
        at_most("hold: moved on the brakes", values["creep"], MOST_CREEP, "mm"),
        at_most("start: rolled back", 1e-3 * values["rollback"], MOST_ROLLBACK, "m"),
        at_least("start: climbed", values["climbed"], CLIMBED, "m"),
    ]


def bump_results(run: Run, maneuver: Maneuver) -> list[Result]:
    """Peaks of the vertical acceleration and the pitch of the frame, and of the wheel loads over those at the start."""
    t = run["t_s"]
    rise = np.gradient(run["z_m"], t)
    vertical = np.gradient(rise, t)
    loads = {wheel: run[f"Fz_{wheel}_N"] / max(float(run[f"Fz_{wheel}_N"][0]), 1e-6) for wheel in WHEELS}
    front, rear = (max(float(loads[wheel].max()) for wheel in WHEELS if wheel[0] == end) for end in "FR")
    pitch = np.degrees(run["pitch_rad"])
    air = min(float(load.min()) for load in loads.values())
    return [
        Result("peak_up", "greatest vertical acceleration, upwards", float(vertical.max()), "m/s²"),
        Result("peak_down", "greatest vertical acceleration, downwards", -float(vertical.min()), "m/s²"),
        Result("pitch_range", "range of the pitch", float(np.ptp(pitch)), "deg"),
        Result("front_load", "greatest load of a front wheel over that before", front, ""),
        Result("rear_load", "greatest load of a rear wheel over that before", rear, ""),
        Result("least_load", "least load of a wheel over that before", max(air, 0.0), ""),
    ]
