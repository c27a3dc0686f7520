"""Physics against known answers: the checks behind ``simwarp verify`` and tests/physics.

A check is a function that steps the engine and returns rows of expected, got and tolerance; why a tolerance is what it
is stands in its docstring. Measures are taken from the published state in float64, never from the solver.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from simwarp.verify import chain_problem, contact_answers, laws, mechanism_answers, vehicle_runs
from simwarp.verify.report import Row

SCENES: Final[dict[str, Callable[..., list[Row]]]] = {
    "pendulum": mechanism_answers.pendulum,
    "dzhanibekov": mechanism_answers.dzhanibekov,
    "free-spin": mechanism_answers.free_spin,
    "andrews": mechanism_answers.andrews,
    "double-pendulum": mechanism_answers.double_pendulum,
    "slider-crank": mechanism_answers.slider_crank,
    "chain": mechanism_answers.chain,
    "four-bar": mechanism_answers.four_bar,
    "bricard": mechanism_answers.bricard,
    "far-away": mechanism_answers.far_away,
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
    "incline": contact_answers.incline,
    "rolling-ball": contact_answers.rolling_ball,
    "rolling-box": contact_answers.rolling_box,
    "stopping": contact_answers.stopping,
    "heavy-on-light": contact_answers.heavy_on_light,
    "three-balls": contact_answers.three_balls,
    "bouncing": contact_answers.bouncing,
    "convex-law": contact_answers.convex_law,
    "smooth": contact_answers.smooth,
    "card-house": contact_answers.card_house,
    "arch": contact_answers.arch,
    "stack": contact_answers.stack,
    "cube-stack": contact_answers.cube_stack,
    "wall": contact_answers.wall,
    "pile": contact_answers.pile,
    "vehicles": vehicle_runs.vehicles,
}
"""Name -> check, in the order in which they run. The first argument is the device."""
