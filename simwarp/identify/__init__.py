"""Parameters of vehicles, robots and models from recorded runs (docs/identify.md).

config = sw.identify.read_fit("fit.toml")
result = sw.identify.Fit(config).run()
"""

from __future__ import annotations

from simwarp.identify.fit import Fit, FitResult, FittedReading, Progress, list_parameters, load_target
from simwarp.identify.fit_config import (
    Column,
    FitConfig,
    LoggedRun,
    Meant,
    Method,
    Search,
    Wanted,
    fit_config,
    read_fit,
)
from simwarp.identify.fit_error import FitError
from simwarp.identify.identifiability import Uncertainty
from simwarp.identify.levenberg_marquardt import LevenbergMarquardt, SearchSpace
from simwarp.identify.log_units import UNITS

__all__ = [
    "UNITS", "Column", "Fit", "FitConfig", "FitError", "FitResult", "FittedReading", "LevenbergMarquardt", "LoggedRun",
    "Meant", "Method", "Progress", "Search", "SearchSpace", "Uncertainty", "Wanted", "fit_config", "list_parameters",
    "load_target", "read_fit",
]  # fmt: skip
