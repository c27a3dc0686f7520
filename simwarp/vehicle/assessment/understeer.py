"""Understeer of a steady turn (ISO 4138): two angles beyond Ackermann's over the lateral acceleration, their slopes.

That of the road wheels holds what tires and rear axle do. That of the steering wheel over the overall steering ratio,
by which ISO 8855 defines the gradient, holds the roll steer and the compliance of the front axle and its steering, too.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.run_result import Result, lateral_acceleration, smoothed
from simwarp.vehicle.suspensions.steerings import HANDWHEEL

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

GRAVITY: Final = 9.81
LINEAR: Final = (1.0, 4.0)
"""Lateral accelerations between which gradients are taken [m/s²]; of vehicles that do not reach the second one, from a
quarter of what they reach on."""
BANDS: Final = ((1.0, 2.0), (2.0, 4.0), (4.0, math.inf))
"""Lateral accelerations between which gradients of a bent curve are told [m/s²]."""
USED_SHARE: Final = 0.9
"""Of the greatest lateral acceleration: above it a vehicle slides, and its curve is that of the slide."""
COVERED: Final = 0.25
"""Least width that a run covers of a band [m/s²]."""
FEWEST_ROWS: Final = 30
"""In a band."""
FIT_WINDOW: Final = 101
"""Rows of the means from which gradients are fitted: a second."""
LEAST_STRAIGHTNESS: Final = 0.5
"""Of the line of a gradient: below it, what is beside the line is larger than the line, and its sign is not sure."""
NO_LINE: Final = "no line: see the bands"
NOT_STEERED: Final = "its wheels do not steer"
UNIT_RANGE: Final = (0.1 * GRAVITY, 0.375 * GRAVITY)
UNIT_LATERAL: Final = 0.3 * GRAVITY
"""FMVSS 126: range of the fit, and lateral acceleration at which the steering is the unit of amplitudes [m/s²]."""


@dataclasses.dataclass(frozen=True)
class UndersteerCurve:
    """Means over a second of a run in a turn, n rows; positive towards the inside of the turn.

    Attributes:
        lateral: (n,) lateral acceleration [m/s²].
        road_wheels: (n,) mean angle of the front wheels less Ackermann's, wheelbase times curvature [rad].
        steering_wheel: (n,) angle of the steering wheel over the overall steering ratio less Ackermann's [rad]; NaN
            where nothing is steered.
        steer: (n,) steering input, -1 to 1.
        roll: (n,) [rad].
        steered: whether the front wheels turn.
    """

    lateral: Array
    road_wheels: Array
    steering_wheel: Array
    steer: Array
    roll: Array
    steered: bool

    @property
    def rising(self) -> Flags:
        """(n,) rows up to the greatest acceleration: what comes behind is a slide, a spin or a roll-over."""
        return np.arange(len(self.lateral)) <= int(np.argmax(self.lateral))

    def rows(self, low: float, high: float) -> Flags:
        """(n,) rows between two lateral accelerations [m/s²], before the second one is reached."""
        used = (self.lateral > low) & (self.lateral < high)
        reached = np.flatnonzero(self.lateral >= high)
        if reached.size:
            used[reached[0] :] = False
        return used & self.rising

    @property
    def linear_range(self) -> tuple[float, float]:
        """Lateral accelerations between which gradients are taken [m/s²]."""
        high = min(LINEAR[1], USED_SHARE * float(self.lateral.max()))
        return min(LINEAR[0], 0.25 * high), high

    def bands(self) -> list[tuple[float, float]]:
        """Those of `BANDS` that the run covers, ended by what it reaches [m/s²]."""
        top = USED_SHARE * float(self.lateral.max())
        ended = [(low, min(high, top)) for low, high in BANDS]
        return [
            (low, high)
            for low, high in ended
            if high - low > COVERED and self.rows(low, high).sum() >= FEWEST_ROWS
        ]  # fmt: skip


def understeer_curve(run: Run, maneuver: Maneuver) -> UndersteerCurve:
    """Of a run from its zero on.

    Args:
        run: recorded.
        maneuver: with wheelbase and steering angle of the vehicle.
    """
    names = ("speed_mps", "yawrate_radps", "steerangle_FL_rad", "steerangle_FR_rad", "steer", "roll_rad")
    lateral = smoothed(lateral_acceleration(run), FIT_WINDOW)
    sign = 1.0 if lateral.sum() >= 0.0 else -1.0
    speed, *turned = (smoothed(run[name], FIT_WINDOW) for name in names)
    yaw_rate, left, right, steer, roll = (sign * each for each in turned)
    ackermann = maneuver.wheelbase * yaw_rate / np.maximum(speed, 1e-3)
    angle = 0.5 * (left + right)
    return UndersteerCurve(
        sign * lateral, angle - ackermann, maneuver.steering_angle * steer - ackermann, steer, roll,
        bool(np.abs(angle).max() >= 1e-3),
    )  # fmt: skip


def steady_state(run: Run, maneuver: Maneuver) -> list[Result]:
    """ISO 4138: understeer gradients, characteristic or critical speed, roll gradient, steering per acceleration."""
    curve = understeer_curve(run, maneuver)
    used = curve.rows(*curve.linear_range)
    found = [Result("peak_lateral", "greatest lateral acceleration", float(curve.lateral.max()), "m/s²")]
    if used.sum() < FIT_WINDOW:
        missing = "too little lateral acceleration"
        return [*found, Result("understeer_gradient", "understeer gradient", math.nan, "rad/(m/s²)", missing)]
    lateral, ratio = curve.lateral[used], math.radians(HANDWHEEL) / maneuver.steering_angle
    per_g = math.degrees(GRAVITY)
    return [
        *found,
        *_gradients(curve, used),
        *_bands(curve),
        *_characteristic(curve, used, maneuver.wheelbase),
        Result("steering_ratio", f"steering ratio, {HANDWHEEL:g}° at full steering", ratio, "", NOT_STEERED),
        Result("steering_gradient", "steering input per lateral acceleration", slope(lateral, curve.steer[used]),
               "1/(m/s²)"),
        Result("steering_at_0.3_g", "steering input at 0.3 g", _steering_unit(curve), "", "0.3 g not reached"),
        Result("roll_gradient", "roll gradient", per_g * slope(lateral, curve.roll[used]), "deg/g"),
    ]  # fmt: skip


ROAD: Final = "understeer, road wheels"
WHEEL: Final = "understeer, steering wheel (ISO 8855)"


def _angles(curve: UndersteerCurve) -> list[tuple[str, str, Array]]:
    """Prefix of the keys, label and values of both definitions."""
    return [("understeer", ROAD, curve.road_wheels), ("understeer_handwheel", WHEEL, curve.steering_wheel)]


def _gradients(curve: UndersteerCurve, used: Flags) -> list[Result]:
    """Of both definitions in deg/g, then in SI units, then how straight their curves are."""
    degrees, plain, straight = [], [], []
    for prefix, label, values in _angles(curve):
        line = line_of(curve, values, used)
        missing = NO_LINE if curve.steered else NOT_STEERED
        degrees.append(
            Result(f"{prefix}_gradient_deg_g", label, math.degrees(line.gradient) * GRAVITY, "deg/g", missing)
        )
        plain.append(Result(f"{prefix}_gradient", f"{label}, SI", line.gradient, "rad/(m/s²)", missing))
        straight.append(Result(f"{prefix}_straightness", f"{label}: R²", line.straightness, "", NOT_STEERED))
    return [*degrees, *plain, *straight]


@dataclasses.dataclass(frozen=True)
class Line:
    """Slope of an angle over the lateral acceleration [rad/(m/s²)], NaN where it is no line, and the share of the
    variance that it explains.
    """

    gradient: float
    straightness: float


def line_of(curve: UndersteerCurve, values: Array, used: Flags) -> Line:
    """Of some rows of a curve."""
    if not curve.steered or np.isnan(values).any():
        return Line(math.nan, math.nan)
    straight = straightness(curve.lateral[used], values[used])
    return Line(slope(curve.lateral[used], values[used]) if straight >= LEAST_STRAIGHTNESS else math.nan, straight)


def _bands(curve: UndersteerCurve) -> list[Result]:
    """Gradients of both definitions in the bands."""
    if not curve.steered:
        return []
    found = []
    for prefix, label, values in _angles(curve):
        if np.isnan(values).any():
            continue
        for low, end in curve.bands():
            used = curve.rows(low, end)
            gradient = math.degrees(slope(curve.lateral[used], values[used])) * GRAVITY
            found.append(Result(f"{prefix}_{low:g}_deg_g", f"{label}, {low:g} to {end:.2g} m/s²", gradient, "deg/g"))
    return found


def slope(x: Array, y: Array) -> float:
    """Of the line of least squares."""
    return float(np.polyfit(x, y, 1)[0])


def straightness(x: Array, y: Array) -> float:
    """Share of the variance of y that the line of least squares explains, 0 to 1; NaN of a constant."""
    spread = float(np.var(y))
    return float(np.corrcoef(x, y)[0, 1]) ** 2 if spread > 0.0 else math.nan


def _characteristic(curve: UndersteerCurve, used: Flags, wheelbase: float) -> list[Result]:
    """The speed at which the yaw gain is greatest, or beyond which the vehicle is unstable with its steering wheel
    held; NaN without a line.
    """
    line = line_of(curve, curve.steering_wheel, used)
    if not curve.steered or math.isnan(line.straightness):
        return []
    if math.isnan(line.gradient):
        return [Result("characteristic_speed", "characteristic or critical speed", math.nan, "m/s", NO_LINE)]
    speed = math.sqrt(wheelbase / abs(line.gradient)) if line.gradient else math.inf
    if line.gradient >= 0.0:
        return [Result("characteristic_speed", "characteristic speed", speed, "m/s")]
    return [Result("critical_speed", "critical speed", speed, "m/s")]


def _steering_unit(curve: UndersteerCurve) -> float:
    """Steering at 0.3 g on the line of FMVSS 126; NaN if it was not reached."""
    first = np.flatnonzero(curve.lateral >= UNIT_RANGE[1])
    end = int(first[0]) if first.size else 0
    used = np.flatnonzero(curve.lateral[:end] >= UNIT_RANGE[0])
    if used.size < 10:
        return math.nan
    line = np.polyfit(curve.lateral[used], curve.steer[used], 1)
    return float(np.polyval(line, UNIT_LATERAL))
