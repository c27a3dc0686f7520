"""Results of a recorded manoeuvre: a few numbers, such as times to a speed or the distance to a stop."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.assessment.entry_speed import entry_results, shortfall
from simwarp.vehicle.assessment.handling_results import (
    dwell_results,
    fishhook_results,
    step_input_response,
)
from simwarp.vehicle.assessment.lane_verdicts import lane_results
from simwarp.vehicle.assessment.straight_results import (
    acceleration_times,
    braking_results,
    bump_results,
    hill_results,
    turn_braking_results,
)
from simwarp.vehicle.assessment.understeer import steady_state
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.paths import Path
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.run_result import (
    STANDSTILL,
    STEADY,
    Result,
    crossing,
    last_mean,
    lateral_acceleration,
    since_zero,
)

Array = npt.NDArray[np.float64]

MARKS: Final = (5.0, 10.0, 15.0, 20.0, 25.0)
TRACK_MARKS: Final = (1.0, 2.0, 3.0, 4.0, 5.0, *MARKS[1:])
"""Speeds whose times are reported, of vehicles on wheels and on tracks [m/s]."""
CLIMBED: Final = 0.5
"""Way up a slope from which on a vehicle has climbed it [m]."""
PAIRS: Final = 2**14
"""Of a place and a chord of a path whose distances are found at once, in the processor's cache."""
NEARLY: Final = 1.0 + 1.0e-6
"""Share of a chord beside which a place is, for rounding."""
ON_TRACKS: Final = "track_speed_L_mps"
"""A column that only runs on tracks have."""


def results(run: Run, maneuver: Maneuver) -> list[Result]:
    """The numbers that fit a manoeuvre, then those of every run."""
    moving = since_zero(run)
    if len(moving["t_s"]) < 2:
        return []
    special = _SPECIAL.get(maneuver.name)
    found = [] if special is None else special(moving, maneuver)
    if maneuver.course is not None:
        found = [*lane_results(run, maneuver.course), *found]
    found = [*entry_results(moving, maneuver), *found]
    told = [*shortfall(found, maneuver), *_missed_speed(moving, maneuver)]
    return [*found, *told, *_common(moving), *_energy(moving)]


def _missed_speed(run: Run, maneuver: Maneuver) -> list[Result]:
    """A result that reports a driver who never reached the speed to hold; otherwise none."""
    follow = maneuver.follow
    wanted = max(speed for _, speed in maneuver.script.speed) if follow is None else follow.speed
    top = float(run["speed_mps"].max())
    if wanted <= 0.0 or top > 0.95 * wanted:
        return []
    return [Result("speed_to_hold", f"speed to hold ({wanted:g} m/s)", math.nan, "m/s", "not reached")]


def _common(run: Run) -> list[Result]:
    t, speed = run["t_s"], run["speed_mps"]
    return [
        Result("top_speed", "top speed", float(speed.max()), "m/s"),
        Result("final_speed", "final speed", float(speed[-1]), "m/s"),
        Result("distance", "distance", float(np.trapezoid(np.abs(speed), t)), "m"),
        Result("gear_changes", "gear changes", float(np.count_nonzero(np.diff(run["gear"])))),
    ]


def acceleration(run: Run, maneuver: Maneuver) -> list[Result]:
    """Times to speeds."""
    marks = TRACK_MARKS if ON_TRACKS in run.columns else MARKS
    times = [(mark, crossing(run["t_s"], run["speed_mps"], mark)) for mark in marks]
    reached = [(mark, time) for mark, time in times if math.isfinite(time)]
    return [Result(f"time_to_{mark:g}", f"time to {mark:g} m/s", time, "s") for mark, time in reached]


def steady_turn(run: Run, maneuver: Maneuver) -> list[Result]:
    """Steady values: means of the last three seconds."""
    speed, yaw_rate = last_mean(run, "speed_mps"), last_mean(run, "yawrate_radps")
    radius = speed / yaw_rate if abs(yaw_rate) > 1e-3 else math.nan
    return [
        Result("steady_speed", "steady speed", speed, "m/s"),
        Result("steady_yaw_rate", "steady yaw rate", yaw_rate, "rad/s"),
        Result("steady_radius", "steady radius", radius, "m", "it goes straight on"),
        _steady_lateral(run),
    ]


def _steady_lateral(run: Run) -> Result:
    """Of the centre of mass; runs on tracks have speed times yaw rate, which is the same in a steady turn."""
    if "latacc_com_mps2" in run.columns:
        return Result("steady_lateral", "steady lateral acceleration", last_mean(run, "latacc_com_mps2"), "m/s²")
    product = last_mean(run, "speed_mps") * last_mean(run, "yawrate_radps")
    return Result("steady_lateral", "steady speed x yaw rate", product, "m/s²")


def step_response(run: Run, maneuver: Maneuver) -> list[Result]:
    """Steady values, and how the yaw rate gets there from where the steering first moves."""
    steady = steady_turn(run, maneuver)
    t, yaw_rate = run["t_s"], run["yawrate_radps"]
    moved = np.flatnonzero(run["steer"] != 0.0)
    goal = steady[1].value
    if moved.size == 0 or not abs(goal) > 1e-3:
        return steady
    begin = max(int(moved[0]) - 1, 0)
    share = yaw_rate[begin:] / goal
    rise = crossing(t[begin:], share, 0.9) - t[begin]
    return [
        *steady,
        Result("yaw_rise_time", "90 % of the yaw rate after", rise, "s"),
        Result("yaw_rate_peak", "peak yaw rate", float(share.max() * goal), "rad/s"),
    ]


def stop(run: Run, maneuver: Maneuver) -> list[Result]:
    """From full brakes to standstill."""
    t, speed = run["t_s"], run["speed_mps"]
    braked = np.flatnonzero((run["brake"] >= 1.0) & (t > 1.0))
    if braked.size == 0:
        return []
    begin = int(braked[0])
    still = np.flatnonzero(speed[begin:] < STANDSTILL)
    end = begin + int(still[0]) if still.size else None
    distance = time = deceleration = math.nan
    missing = "still moving at the end"
    if speed[begin] < STANDSTILL:
        missing = "it does not drive"
    elif end is not None:
        distance = float(np.trapezoid(speed[begin : end + 1], t[begin : end + 1]))
        time = float(t[end] - t[begin])
        deceleration = float((speed[begin] - speed[end]) / time)
    return [
        Result("braking_from", "braking from", float(speed[begin]), "m/s"),
        Result("stopping_distance", "stopping distance", distance, "m", missing),
        Result("stopping_time", "stopping time", time, "s", missing),
        Result("mean_deceleration", "mean deceleration", deceleration, "m/s²", missing),
    ]


def deviation(run: Run, path: Path) -> Array:
    """Distance of the vehicle's frame from a path, sample by sample [m]."""
    place = np.stack([run["x_m"], run["y_m"]], axis=1)
    start, chord = path.points[:-1], np.diff(path.points, axis=0)
    at_once = max(1, PAIRS // len(chord))
    found = [
        _distances(place[first : first + at_once], start, chord, closed=path.closed)
        for first in range(0, len(place), at_once)
    ]
    return np.concatenate([*found, np.empty(0)])


def _distances(place: Array, start: Array, chord: Array, *, closed: bool) -> Array:
    """(n,) distances of places (n, 2) from chords (k, 2) that begin at `start` (k, 2) [m]."""
    squared = (chord * chord).sum(axis=1)
    x, y = place[:, :1] - start[:, 0], place[:, 1:] - start[:, 1]
    along = (x * chord[:, 0] + y * chord[:, 1]) / squared
    part = np.clip(along, 0.0, 1.0)
    if not closed:
        # beyond its ends the path goes straight on
        for row in np.flatnonzero(along[:, 0] < NEARLY):
            part[row, 0] = min(part[row, 0], ((place[row] - start[0]) @ chord[0]) / squared[0])
        for row in np.flatnonzero(along[:, -1] > 1.0 - NEARLY):
            part[row, -1] = max(part[row, -1], ((place[row] - start[-1]) @ chord[-1]) / squared[-1])
    x -= part * chord[:, 0]
    y -= part * chord[:, 1]
    return np.asarray(np.sqrt((x * x + y * y).min(axis=1)))


def path_deviation(run: Run, maneuver: Maneuver) -> list[Result]:
    """Deviation of a path tracker from its path, and the peaks of its yaw rate and lateral acceleration.

    On a course between cones the peaks are those there (`lane_results`).
    """
    if maneuver.follow is None:
        return []
    off = deviation(run, maneuver.follow.paths[0])
    found = [Result("largest_deviation", "largest distance from the path", float(off.max()), "m")]
    if maneuver.course is not None:
        return found
    lateral = np.abs(lateral_acceleration(run))
    return [
        *found,
        Result("peak_yaw_rate", "peak yaw rate", float(np.abs(run["yawrate_radps"]).max()), "rad/s"),
        Result("peak_lateral", "peak lateral acceleration", float(lateral.max()), "m/s²"),
    ]


def steady_circle(run: Run, maneuver: Maneuver) -> list[Result]:
    """Steady values on a circle, with the steering they take."""
    found = steady_turn(run, maneuver)
    found.append(Result("steady_steering", "steady steering input", last_mean(run, "steer")))
    if maneuver.follow is not None:
        off = deviation(run, maneuver.follow.paths[0])
        late = off[run["t_s"] > run["t_s"][-1] - STEADY]
        found.append(Result("steady_deviation", "steady distance from the circle", float(late.mean()), "m"))
        found.append(Result("largest_deviation", "largest distance from the circle", float(off.max()), "m"))
    return found


def frequency_response(run: Run, maneuver: Maneuver) -> list[Result]:
    """Yaw rate per steering input at some frequencies of the sweep, and how far it lags."""
    t, steer = run["t_s"], run["steer"]
    crossings = np.flatnonzero((steer[:-1] <= 0.0) & (steer[1:] > 0.0))
    found = []
    for frequency in (0.3, 0.5, 1.0, 2.0):
        # the three periods whose mean length is nearest
        spans = [(t[b] - t[a], a, b) for a, b in zip(crossings[:-3], crossings[3:], strict=True)]
        if not spans:
            break
        length, a, b = min(spans, key=lambda span: abs(math.log(span[0] * frequency / 3.0)))
        if abs(length * frequency / 3.0 - 1.0) > 0.2:
            continue
        wave = np.exp(-2j * math.pi * (3.0 / length) * t[a:b]) * np.hanning(b - a)
        gain = np.sum(wave * run["yawrate_radps"][a:b]) / np.sum(wave * steer[a:b])
        label = f"yaw rate per steering at {frequency:g} Hz"
        found.append(Result(f"yaw_gain_{frequency:g}_hz", label, float(abs(gain)), "rad/s"))
        lag = -math.degrees(float(np.angle(gain)))
        found.append(Result(f"yaw_lag_{frequency:g}_hz", f"its lag at {frequency:g} Hz", lag, "deg"))
    return found


def standstill_drift(run: Run, maneuver: Maneuver) -> list[Result]:
    """Displacement of a standing vehicle, from the beginning and after five seconds, when the springs are calm."""
    t = run["t_s"]
    place = np.stack([run["x_m"], run["y_m"], run["z_m"]], axis=1)
    found = [Result("moved", "moved since t = 0", 1e3 * float(np.linalg.norm(place[-1] - place[0])), "mm")]
    if t[-1] > 5.0:
        calm = place[np.searchsorted(t, 5.0 - 1e-9)]
        moved = 1e3 * float(np.linalg.norm(place[-1] - calm))
        found.append(Result("creep", "creep since t = 5 s", moved, "mm"))
        found.append(Result("creep_rate", "creep per minute", 60.0 * moved / float(t[-1] - 5.0), "mm"))
    return found


PULL_SLIPS: Final = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Slips at which a drawbar test tells the pull."""


def pull_at(run: Run, slip: float, width: float = 0.015) -> float:
    """Mean pull over weight of the rows within `width` of a slip, after the carriage has its speed; NaN without any."""
    near = (np.abs(run["slip"] - slip) < width) & (run["t_s"] > 0.0)
    return float(run["pull_per_weight"][near].mean()) if near.any() else math.nan


def drawbar_pull(run: Run, maneuver: Maneuver) -> list[Result]:
    """Pull over weight at slips, the greatest, and the torque that it takes."""
    if maneuver.drawbar is None or "slip" not in run.columns:
        return []
    steady = Run({name: values[run["t_s"] > maneuver.drawbar.ramp] for name, values in run.columns.items()})
    found = [
        Result(f"pull_at_slip_{slip:g}", f"pull / weight at slip {slip:g}", pull_at(steady, slip))
        for slip in PULL_SLIPS
    ]  # fmt: skip
    if len(steady["t_s"]) > 0:
        # over a second: a wheel rides up and down on the nodes of its soil
        window = min(100, len(steady["t_s"]))
        smooth = np.convolve(steady["pull_N"], np.full(window, 1.0 / window), "valid")
        found.append(Result("greatest_pull", "greatest pull over a second", float(smooth.max()), "N"))
        found.append(Result("carriage_speed", "speed of the carriage", float(steady["speed_mps"].mean()), "m/s"))
    return found


def _energy(run: Run) -> list[Result]:
    """Of a run on tracks: work of the engine and into the driveline, and what is neither in motion nor in height."""
    if ON_TRACKS not in run.columns:
        return []
    t = run["t_s"]
    engine = 1e-3 * float(np.trapezoid(run["engine_Nm"] * run["engine_radps"], t))
    drive = 1e-3 * float(np.trapezoid(run["drive_W"], t))
    gain = 1e-3 * float(run["energy_J"][-1] - run["energy_J"][0])
    return [
        Result("engine_work", "work of the engine", engine, "kJ"),
        Result("drive_work", "work into the driveline", drive, "kJ"),
        Result("energy_gain", "gain of energy", gain, "kJ"),
        Result("losses", "losses: converter, brakes, contacts", engine - gain, "kJ"),
    ]


def track_turn(run: Run, maneuver: Maneuver) -> list[Result]:
    """Steady values of a turn on tracks, with the speeds of both."""
    tracks = [
        Result(f"steady_track_speed_{side}", f"steady speed of the {name} track",
               last_mean(run, f"track_speed_{side}_mps"), "m/s")
        for side, name in (("L", "left"), ("R", "right"))
    ]  # fmt: skip
    return [*step_response(run, maneuver), *tracks]


def turn_on_the_spot(run: Run, maneuver: Maneuver) -> list[Result]:
    """How far and how fast a vehicle turns about itself, and how far it moves meanwhile."""
    yaw, rate = np.unwrap(run["yaw_rad"]), run["yawrate_radps"]
    turned = np.degrees(yaw - yaw[0])
    moved = float(np.hypot(run["x_m"] - run["x_m"][0], run["y_m"] - run["y_m"][0]).max())
    quarter = crossing(run["t_s"], np.abs(turned), 90.0)
    return [
        Result("turned", "turned", float(turned[-1]), "deg"),
        Result("quarter_turn", "a quarter turn after", quarter, "s", "not reached"),
        Result("peak_yaw_rate", "peak yaw rate", float(np.abs(rate).max()), "rad/s"),
        Result("steady_yaw_rate", "steady yaw rate", last_mean(run, "yawrate_radps", 1.0), "rad/s"),
        Result("moved", "moved meanwhile", moved, "m"),
    ]


def over_a_crossing(run: Run, maneuver: Maneuver) -> list[Result]:
    """Whether a vehicle came over what lies across its way, and how far it pitched there."""
    crossed = maneuver.crossing
    if crossed is None:
        return []
    t, x, pitch, height = run["t_s"], run["x_m"], np.degrees(run["pitch_rad"]), run["z_m"]
    near = x >= crossed.ahead - 2.0 * crossed.size
    if not near.any():
        return [Result("crossed_after", "crossed after", math.nan, "s", "it did not come there")]
    after = crossing(t, x, crossed.beyond + crossed.length)
    return [
        Result("crossed_after", "crossed after", after, "s", "stuck"),
        Result("nose_up", "most nose up", -float(pitch[near].min()), "deg"),
        Result("nose_down", "most nose down", float(pitch[near].max()), "deg"),
        Result("lowest", "frame of reference, lowest", float(height[near].min()), "m"),
        Result("highest", "frame of reference, highest", float(height[near].max()), "m"),
        Result("least_speed", "least speed there", float(run["speed_mps"][near].min()), "m/s"),
        Result("greatest_pin", "greatest force of a pin", 1e-3 * _greatest_pin(run), "kN", "not recorded"),
    ]


def _greatest_pin(run: Run) -> float:
    """Of all pins and times [N]; NaN without a record of them."""
    return max((float(run[name].max()) for name in ("pin_max_L_N", "pin_max_R_N") if name in run.columns),
               default=math.nan)  # fmt: skip


def climb(run: Run, maneuver: Maneuver) -> list[Result]:
    """Way up a slope at full throttle, and what the brakes hold then."""
    t, lean = run["t_s"], math.atan(maneuver.slope)
    way = math.cos(lean) * (run["x_m"] - run["x_m"][0]) + math.sin(lean) * (run["z_m"] - run["z_m"][0])
    braked = np.flatnonzero((run["brake"] >= 1.0) & (t > 1.0))
    top = int(braked[0]) if braked.size else len(t) - 1
    risen = float(way[top])
    found = [
        Result("climbed", "climbed", risen if risen > CLIMBED else math.nan, "m", "not climbed"),
        Result("climbing_speed", "speed at the end of the climb", float(run["speed_mps"][top]), "m/s"),
    ]
    stood = np.flatnonzero((t > t[top] + 1.0) & (np.abs(run["speed_mps"]) < STANDSTILL))
    if braked.size:
        held = float(way[-1] - way[stood[0]]) if stood.size else math.nan
        found.append(Result("held", "moved since it stood on the brakes", 1e3 * held, "mm", "it slides"))
    return found


_SPECIAL: Final[dict[str, Callable[[Run, Maneuver], list[Result]]]] = {
    "reference-accel": acceleration,
    "reference-steer": step_response,
    "reference-brake": stop,
    "step-steer": step_response,
    "double-lane-change": path_deviation,
    "sine-sweep": frequency_response,
    "constant-radius": steady_circle,
    "slope-hold": standstill_drift,
    "drawbar": drawbar_pull,
    "iso-3888-1": path_deviation,
    "iso-3888-2": path_deviation,
    "steady-state-circle": steady_state,
    "slow-steer": steady_state,
    "step-input": step_input_response,
    "sine-with-dwell": dwell_results,
    "fishhook": fishhook_results,
    "braking": braking_results,
    "split-braking": braking_results,
    "brake-in-turn": turn_braking_results,
    "acceleration": acceleration_times,
    "hill-start": hill_results,
    "bump": bump_results,
    "accelerate": acceleration,
    "brake": stop,
    "steady-turn": track_turn,
    "pivot": turn_on_the_spot,
    "obstacle": over_a_crossing,
    "trench": over_a_crossing,
    "slope": climb,
}
