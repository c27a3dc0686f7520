"""Results of handling tests: ISO 7401, the sine with dwell and the fishhook."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.assessment.verdict import Verdict, at_least, at_most
from simwarp.vehicle.driving.handling_maneuvers import DWELL_FREQUENCY, SINE_END, USUAL_FACTOR
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.channels import WHEELS, Run
from simwarp.vehicle.results.run_result import Result, crossing, lateral_acceleration

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


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
