"""Physics against known answers: the checks behind ``simwarp verify`` and tests/physics.

A check is a function that steps the engine and returns rows of expected, got and tolerance; why a tolerance is what it
is stands in its docstring. Measures are taken from the published state in float64, never from the solver.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from simwarp.verify import (
    analysis_checks,
    chain_problem,
    contact_checks,
    flexible_checks,
    laws,
    mechanism_checks,
    soil_checks,
    tracked_runs,
    vehicle_runs,
)
from simwarp.verify.check_result import CheckResult

SCENES: Final[dict[str, Callable[..., list[CheckResult]]]] = {
    "pendulum": mechanism_checks.pendulum,
    "dzhanibekov": mechanism_checks.dzhanibekov,
    "free-spin": mechanism_checks.free_spin,
    "andrews": mechanism_checks.andrews,
    "double-pendulum": mechanism_checks.double_pendulum,
    "slider-crank": mechanism_checks.slider_crank,
    "chain": mechanism_checks.chain,
    "four-bar": mechanism_checks.four_bar,
    "bricard": mechanism_checks.bricard,
    "far-away": mechanism_checks.far_away,
    "chain-problem": chain_problem.chain_problem,
    "momentum": laws.momentum,
    "energy": laws.energy,
    "reactions": laws.reactions,
    "springs": laws.springs,
    "limits": laws.limits,
    "friction": laws.friction,
    "motors": laws.motors,
    "drives": laws.drives,
    "prescribed": laws.prescribed,
    "couplings": laws.couplings,
    "incline": contact_checks.incline,
    "rolling-ball": contact_checks.rolling_ball,
    "rolling-box": contact_checks.rolling_box,
    "stopping": contact_checks.stopping,
    "heavy-on-light": contact_checks.heavy_on_light,
    "three-balls": contact_checks.three_balls,
    "bouncing": contact_checks.bouncing,
    "convex-law": contact_checks.convex_law,
    "smooth": contact_checks.smooth,
    "card-house": contact_checks.card_house,
    "arch": contact_checks.arch,
    "stack": contact_checks.stack,
    "cube-stack": contact_checks.cube_stack,
    "wall": contact_checks.wall,
    "pile": contact_checks.pile,
    "soil": soil_checks.soil,
    "analysis": analysis_checks.analysis,
    "flexible": flexible_checks.flexible,
    "vehicles": vehicle_runs.vehicles,
    "tracks": tracked_runs.tracks,
}
"""Name -> check, in the order in which they run. The first argument is the device."""
