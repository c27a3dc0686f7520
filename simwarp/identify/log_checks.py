"""What readings of one log tell about each other: a speed in km/h shows beside a path in metres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from simwarp.core.wording import shortened
from simwarp.identify.fit_error import FitError
from simwarp.identify.logs import RunLog, Signal

GUESSES: Final = (
    (3.6, "km/h"), (1.0 / 0.44704, "mph"), (3600.0 / 1852.0, "kn"),
)  # fmt: skip
"""How many times a speed is too large, and the unit that it probably has."""
NEAR: Final = 0.05
"""Relative difference of a factor from a guess."""
LEAST_WAY: Final = 1.0
"""From which a path tells a speed [m]."""
LEAST_TURN: Final = 0.2
"""Mean square of a lateral acceleration, from which it tells a speed [m/s²]."""


def check_speed(run: RunLog) -> None:
    """Refuse a speed that other readings contradict by the factor of a usual unit.

    Raises:
        FitError: it names the unit that the column probably has.
    """
    speed = run.readings.get("speed_mps")
    if speed is None:
        return
    for factor, beside in _factors(run, speed):
        for wanted, unit in GUESSES:
            if abs(factor / wanted - 1.0) < NEAR:
                raise FitError(
                    f"{shortened(run.config.file[0])}: readings.speed_mps: must be in m/s, got {factor:.3g} times what "
                    f'{beside} tells: it looks like {unit}; give unit = "{unit}"'
                )


def _factors(run: RunLog, speed: Signal) -> Iterator[tuple[float, str]]:
    """Measured speeds over those that other readings tell."""
    times = speed.time[(speed.time >= run.begin) & (speed.time <= run.end)]
    if len(times) < 2:
        return
    way = float(np.trapezoid(np.abs(speed.at(times)), times))
    x, y = run.readings.get("x_m"), run.readings.get("y_m")
    if x is not None and y is not None:
        # a coarse grid: noise of positions makes a path longer
        coarse = np.linspace(times[0], times[-1], max(2, round((times[-1] - times[0]) / 0.5)))
        path = float(np.hypot(np.diff(x.at(coarse)), np.diff(y.at(coarse))).sum())
        if path > LEAST_WAY:
            yield way / path, "the path of x_m and y_m"
    yaw, across = run.readings.get("yawrate_radps"), run.readings.get("latacc_com_mps2")
    if yaw is not None and across is not None:
        product, measured = yaw.at(times) * speed.at(times), across.at(times)
        if float(np.sqrt(np.mean(measured**2))) > LEAST_TURN:
            yield float(product @ measured / (measured @ measured)), "latacc_com_mps2 over yawrate_radps"
