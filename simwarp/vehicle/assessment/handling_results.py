"""Results of handling tests: ISO 4138, ISO 7401, the sine with dwell and the fishhook."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.assessment.verdict import Verdict, at_least, at_most
from simwarp.vehicle.driving.handling_maneuvers import DWELL_FREQUENCY, SINE_END, USUAL_FACTOR
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.channels import WHEELS, Run
from simwarp.vehicle.results.run_result import Result, crossing, lateral_acceleration, smoothed

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

GRAVITY: Final = 9.81
LINEAR: Final = (1.0, 4.0)
"""Lateral accelerations between which gradients are taken [m/s²]; of vehicles that do not reach the second one, from a
quarter of what they reach on."""
FIT_WINDOW: Final = 101
"""Rows of the means from which gradients are fitted: a second."""
LEAST_STRAIGHTNESS: Final = 0.5
"""Of the line of a gradient: below it, what is beside the line is larger than the line, and its sign is not sure."""
NO_LINE: Final = "not a line: see the plot"
UNIT_RANGE: Final = (0.1 * GRAVITY, 0.375 * GRAVITY)
UNIT_LATERAL: Final = 0.3 * GRAVITY
"""FMVSS 126: range of the fit, and lateral acceleration at which the steering is the unit of amplitudes [m/s²]."""


def steady_state(run: Run, maneuver: Maneuver) -> list[Result]:
    """ISO 4138: understeer gradient, characteristic or critical speed, roll gradient, steering per acceleration.

    The gradient is the slope, over the lateral acceleration, of the mean angle of the front wheels less wheelbase times
    curvature: of what a vehicle needs beyond its geometry. It holds on a circle and at constant speed alike.
    """
    lateral, yaw_rate = (smoothed(values, FIT_WINDOW) for values in (lateral_acceleration(run), run["yawrate_radps"]))
    names = ("speed_mps", "steerangle_FL_rad", "steerangle_FR_rad", "steer", "roll_rad")
    speed, left, right, steer, roll = (smoothed(run[name], FIT_WINDOW) for name in names)
    sign = 1.0 if lateral.sum() >= 0.0 else -1.0
    lateral = sign * lateral
    used = linear_range(lateral)
    found = [Result("peak_lateral", "greatest lateral acceleration", float(lateral.max()), "m/s²")]
    if used.sum() < FIT_WINDOW:
        missing = "too little lateral acceleration"
        return [*found, Result("understeer_gradient", "understeer gradient", math.nan, "rad/(m/s²)", missing)]
    lateral_used, angle = lateral[used], 0.5 * sign * (left + right)[used]
    curvature = sign * yaw_rate[used] / np.maximum(speed[used], 1e-3)
    beyond = angle - maneuver.wheelbase * curvature
    gradient, straight = slope(lateral_used, beyond), straightness(lateral_used, beyond)
    missing = "its wheels do not steer"
    if np.abs(angle).max() < 1e-3:
        gradient = math.nan
    return [
        *found,
        Result("understeer_gradient", "understeer gradient", gradient, "rad/(m/s²)", missing),
        Result("understeer_gradient_deg_g", "understeer gradient", math.degrees(gradient) * GRAVITY, "deg/g", missing),
        Result("understeer_straightness", "variance that its line explains, 0 to 1", straight),
        *_characteristic(gradient, straight, maneuver.wheelbase),
        Result("steering_gradient", "steering input per lateral acceleration",
               slope(lateral_used, sign * steer[used]), "1/(m/s²)"),
        Result("steering_at_0.3_g", "steering input at 0.3 g", _steering_unit(lateral, sign * steer), "",
               "0.3 g not reached"),
        Result("roll_gradient", "roll gradient", math.degrees(slope(lateral_used, sign * roll[used])) * GRAVITY,
               "deg/g"),
    ]  # fmt: skip


def linear_range(lateral: Array) -> Flags:
    """Rows between the bounds of `LINEAR`, before the greatest acceleration is reached."""
    top = float(lateral.max())
    high = min(LINEAR[1], 0.9 * top)
    low = min(LINEAR[0], 0.25 * high)
    used = (lateral > low) & (lateral < high)
    first = int(np.argmax(lateral >= high))
    used[first:] = False
    return used


def slope(x: Array, y: Array) -> float:
    """Of the line of least squares."""
    return float(np.polyfit(x, y, 1)[0])


def straightness(x: Array, y: Array) -> float:
    """Share of the variance of y that the line of least squares explains, 0 to 1; NaN of a constant."""
    spread = float(np.var(y))
    return float(np.corrcoef(x, y)[0, 1]) ** 2 if spread > 0.0 else math.nan


def _characteristic(gradient: float, straight: float, wheelbase: float) -> list[Result]:
    """The speed at which the yaw gain is greatest, or beyond which the vehicle is unstable; NaN without a line."""
    if math.isnan(gradient) or gradient == 0.0:
        return []
    speed = math.sqrt(wheelbase / abs(gradient)) if straight >= LEAST_STRAIGHTNESS else math.nan
    if gradient > 0.0:
        return [Result("characteristic_speed", "characteristic speed", speed, "m/s", NO_LINE)]
    return [Result("critical_speed", "critical speed", speed, "m/s", NO_LINE)]


def _steering_unit(lateral: Array, steer: Array) -> float:
    """Steering at 0.3 g on the line of FMVSS 126; NaN if it was not reached."""
    first = np.flatnonzero(lateral >= UNIT_RANGE[1])
    end = int(first[0]) if first.size else 0
    used = np.flatnonzero(lateral[:end] >= UNIT_RANGE[0])
    if used.size < 10:
        return math.nan
    line = np.polyfit(lateral[used], steer[used], 1)
    return float(np.polyval(line, UNIT_LATERAL))


def step_input_response(run: Run, maneuver: Maneuver) -> list[Result]:
    """ISO 7401: gains at the end, response times from half the steering on, peaks and overshoots.

    Yaw rate and lateral acceleration: response time until 90 % of the steady value, peak response time.
    """
    t, steer = run["t_s"], run["steer"] - run["steer"][0]
    if t[-1] < STEP_STEADY or not np.abs(steer).max() > 0.0:
        return [Result("yaw_gain", "steady yaw rate per steering input", math.nan, "rad/s")]
    amount = float(steer[-1])
    half = crossing(t, steer / amount, 0.5)
    late = t > t[-1] - STEP_STEADY
    angle = 0.5 * (run["steerangle_FL_rad"] + run["steerangle_FR_rad"])
    turned = float(angle[late].mean() - angle[0])
    columns = {"yaw": ("yaw rate", run["yawrate_radps"], "rad/s"), "lateral": (
        "lateral acceleration", lateral_acceleration(run), "m/s²")}  # fmt: skip
    found = []
    for key, (name, signal, unit) in columns.items():
        moved = signal - signal[0]
        steady = float(moved[late].mean())
        if not abs(steady) > 1e-3:
            continue
        share = moved / steady
        peak = int(np.argmax(share))
        found += [
            Result(f"{key}_steady", f"steady {name}", steady, unit),
            Result(f"{key}_gain", f"steady {name} per steering input", steady / amount, unit),
            Result(f"{key}_response_time", f"90 % of the {name} after", crossing(t, share, 0.9) - half, "s"),
            Result(f"{key}_peak_time", f"peak {name} after", float(t[peak]) - half, "s"),
            Result(f"{key}_overshoot", f"overshoot of the {name}", 100.0 * (float(share[peak]) - 1.0), "%"),
        ]
        if key == "yaw" and abs(turned) > 1e-3:
            found.append(Result("yaw_gain_wheels", "steady yaw rate per angle of the front wheels", steady / turned,
                                "1/s"))  # fmt: skip
    roll = np.degrees(np.abs(run["roll_rad"] - run["roll_rad"][0]))
    return [*found, Result("peak_roll", "peak roll", float(roll.max()), "deg")]


STEP_STEADY: Final = 1.0
"""At the end of a step input, over which steady values are means [s]."""


def dwell_results(run: Run, maneuver: Maneuver) -> list[Result]:
    """FMVSS 126: yaw rates after the steering's end over the peak, lateral displacement, and the amplitude's factor."""
    factor = _dwell_factor(run, maneuver)
    return [
        Result("amplitude_factor", "amplitude over the steering at 0.3 g", factor, "", "not known"),
        Result("yaw_peak", "peak yaw rate after the reversal", dwell_peak(run), "rad/s"),
        Result("yaw_ratio_1", f"yaw rate {RATIO_TIMES[0]:g} s after the end over it", 100.0 * dwell_ratio(run, 0), "%"),
        Result("yaw_ratio_2", f"yaw rate {RATIO_TIMES[1]:g} s after the end over it", 100.0 * dwell_ratio(run, 1), "%"),
        Result("displacement", f"lateral displacement {DISPLACED_AFTER:g} s after the start", displacement(run), "m"),
    ]


def dwell_verdicts(run: Run, maneuver: Maneuver) -> list[Verdict]:
    """FMVSS 126: yaw rate 1 s and 1.75 s after the end of the steering, and lateral displacement from 5 A on."""
    found = [
        at_most(f"FMVSS 126: yaw rate {time:g} s after end over the peak", 100.0 * abs(dwell_ratio(run, k)), limit, "%")
        for k, (time, limit) in enumerate(zip(RATIO_TIMES, RATIO_LIMITS, strict=True))
    ]
    if _dwell_factor(run, maneuver) >= USUAL_FACTOR - 1e-6:
        rule = f"FMVSS 126: lateral displacement {DISPLACED_AFTER:g} s after the start"
        found.append(at_least(rule, displacement(run), LEAST_DISPLACEMENT, "m"))
    return [*found, _roll_verdict(run)]


def _roll_verdict(run: Run) -> Verdict:
    return at_most("no roll-over: greatest roll", math.degrees(float(np.abs(run["roll_rad"]).max())), MOST_ROLL, "deg")


RATIO_TIMES: Final = (1.0, 1.75)
RATIO_LIMITS: Final = (35.0, 20.0)
"""Times after the end of the steering [s], and the most of the yaw rate's peak that is left then [%]."""
DISPLACED_AFTER: Final = 1.07
"""Time since the steering began at which the displacement counts [s]."""
MOST_ROLL: Final = 45.0
"""Beyond which a vehicle counts as rolled over [deg]."""
LEAST_DISPLACEMENT: Final = 1.83
"""Of vehicles of up to 3500 kg [m]."""


def _dwell_factor(run: Run, maneuver: Maneuver) -> float:
    amplitude = 0.0 if maneuver.intervention is None else abs(maneuver.intervention.amplitude)
    return amplitude / maneuver.steering_unit


def dwell_peak(run: Run) -> float:
    """Yaw rate of the peak that the second half of the sine makes, with its sign [rad/s]; NaN without any."""
    t, yaw_rate = run["t_s"], run["yawrate_radps"]
    second = (t > 0.5 / DWELL_FREQUENCY) & (t < SINE_END + RATIO_TIMES[0])
    if not second.any():
        return math.nan
    steered = float(run["steer"][second & (t < SINE_END)].sum()) if (second & (t < SINE_END)).any() else 0.0
    sign = -1.0 if steered < 0.0 else 1.0
    return sign * float((sign * yaw_rate[second]).max())


def dwell_ratio(run: Run, which: int) -> float:
    """Yaw rate after the end of the steering over its peak, positive to the same side; NaN if the run ends before."""
    t, time = run["t_s"], SINE_END + RATIO_TIMES[which]
    if t[-1] < time - 1e-9:
        return math.nan
    return float(np.interp(time, t, run["yawrate_radps"])) / dwell_peak(run)


def displacement(run: Run) -> float:
    """Of the centre of the vehicle's frame across its heading at the start, towards the first steering [m]."""
    t = run["t_s"]
    if t[-1] < DISPLACED_AFTER:
        return math.nan
    begin = int(np.argmin(np.abs(t)))
    x, y = (float(np.interp(DISPLACED_AFTER, t, run[name])) - float(run[name][begin]) for name in ("x_m", "y_m"))
    yaw = float(run["yaw_rad"][begin])
    first = float(run["steer"][(t > 0.0) & (t < 0.5 / DWELL_FREQUENCY)].sum())
    return math.copysign(1.0, first) * (y * math.cos(yaw) - x * math.sin(yaw))


LIFT_SHARE: Final = 0.01
"""Of a wheel's load at the start, below which it counts as lifted."""
LIFT_ROWS: Final = 3
"""For so many rows both wheels of a side are lifted at least."""


def lifted_sides(run: Run) -> Flags:
    """(n, 2) bool: both wheels of the left and of the right side bear nothing."""
    lifted = {wheel: run[f"Fz_{wheel}_N"] < LIFT_SHARE * max(run[f"Fz_{wheel}_N"][0], 1e-6) for wheel in WHEELS}
    return np.stack([lifted["FL"] & lifted["RL"], lifted["FR"] & lifted["RR"]], axis=1)


def fishhook_results(run: Run, maneuver: Maneuver) -> list[Result]:
    """Peaks of roll, lateral acceleration and yaw rate, and the smallest load of a side over that at rest."""
    sides = [run[f"Fz_F{side}_N"] + run[f"Fz_R{side}_N"] for side in "LR"]
    least = min(float(side.min() / max(side[0], 1e-6)) for side in sides)
    wheels = [wheel for wheel in WHEELS if run[f"Fz_{wheel}_N"].min() < LIFT_SHARE * max(run[f"Fz_{wheel}_N"][0], 1e-6)]
    return [
        Result("peak_roll", "peak roll", math.degrees(float(np.abs(run["roll_rad"]).max())), "deg"),
        Result("peak_lateral", "peak lateral acceleration", float(np.abs(lateral_acceleration(run)).max()), "m/s²"),
        Result("peak_yaw_rate", "peak yaw rate", float(np.abs(run["yawrate_radps"]).max()), "rad/s"),
        Result("least_side_load", "least load of a side over that at the start", 100.0 * least, "%"),
        Result("lifted_wheels", "wheels that lift", float(len(wheels))),
    ]


def lift_verdicts(run: Run, maneuver: Maneuver) -> list[Verdict]:
    """Fishhook: both wheels of a side do not bear nothing together for longer than two rows."""
    rows = max(_longest(column) for column in lifted_sides(run).T)
    step = float(np.median(np.diff(run["t_s"])))
    lifted = at_most("fishhook: both wheels of a side lifted for", rows * step, (LIFT_ROWS - 0.5) * step, "s")
    return [lifted, _roll_verdict(run)]


def _longest(flags: Flags) -> int:
    """Length of the longest run of True."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return int((ends[1::2] - ends[::2]).max()) if ends.size else 0
