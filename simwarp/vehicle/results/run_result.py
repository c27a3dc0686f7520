"""One number of a recorded run, and how numbers are read off its columns."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.results.channels import Run

Array = npt.NDArray[np.float64]

STANDSTILL: Final = 0.05
"""[m/s]."""
STEADY: Final = 3.0
"""At the end of a run, over which steady values are means [s]."""
LATERAL_WINDOW: Final = 5
"""Rows over which the lateral acceleration, a difference from row to row, is a mean."""


@dataclasses.dataclass(frozen=True)
class Result:
    """One number of a run; NaN where the run did not come to it."""

    key: str
    label: str
    value: float
    unit: str = ""
    missing: str = "not reached"
    """Text in place of NaN."""

    @property
    def unit_text(self) -> str:
        """The unit of a number, nothing where there is none."""
        return "" if math.isnan(self.value) else self.unit

    @property
    def value_text(self) -> str:
        """The value for people; what is below any meaning is 0."""
        if math.isnan(self.value):
            return self.missing
        return "0" if abs(self.value) < 5e-5 else f"{self.value:.4g}"


def crossing(t: Array, values: Array, mark: float) -> float:
    """First time at which the values reach a mark from below, between samples; NaN if never."""
    above = np.flatnonzero(values >= mark)
    if above.size == 0:
        return math.nan
    index = int(above[0])
    if index == 0:
        return float(t[0])
    part = (mark - values[index - 1]) / (values[index] - values[index - 1])
    return float(t[index - 1] + part * (t[index] - t[index - 1]))


def last_mean(run: Run, name: str, last: float = STEADY) -> float:
    """Mean of a column over the last seconds of a run."""
    return float(run[name][run["t_s"] > run["t_s"][-1] - last].mean())


def lateral_acceleration(run: Run) -> Array:
    """Of the chassis' centre of mass, to the left, a mean over `LATERAL_WINDOW` rows [m/s²]."""
    return smoothed(run["latacc_com_mps2"], LATERAL_WINDOW)


def smoothed(values: Array, rows: int) -> Array:
    """Means over an odd number of rows; at the ends over those that there are."""
    window = np.ones(min(rows, len(values)))
    return np.asarray(np.convolve(values, window, "same") / np.convolve(np.ones(len(values)), window, "same"))


def since_zero(run: Run) -> Run:
    """The run from the manoeuvre's zero on."""
    later = run["t_s"] >= -1e-9
    return Run({name: values[later] for name, values in run.columns.items()})


def until(run: Run, end: float) -> Run:
    """The run up to a time [s]."""
    earlier = run["t_s"] <= end + 1e-9
    return Run({name: values[earlier] for name, values in run.columns.items()})
