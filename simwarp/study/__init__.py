"""Studies of vehicles: a manoeuvre in many worlds that differ by chance, and a search for the best design.

The page docs/study.md has both from a file to a result; `simwarp drive --vary` and `--search` are the commands.
"""

from __future__ import annotations

from simwarp.study.design_goal import Bound, Goal
from simwarp.study.design_search import Design, DesignSearch, SearchPlan
from simwarp.study.monte_carlo import MonteCarlo, StudyResult, StudyRow, Worst
from simwarp.study.study_error import StudyError
from simwarp.study.study_summary import FigureSummary
from simwarp.study.varied_vehicle import VariedVehicle, varied_vehicle
from simwarp.study.world_runs import WorldRuns

__all__ = [
    "Bound", "Design", "DesignSearch", "FigureSummary", "Goal", "MonteCarlo", "SearchPlan", "StudyError", "StudyResult",
    "StudyRow", "VariedVehicle", "WorldRuns", "Worst", "varied_vehicle",
]  # fmt: skip
