"""Physics against known answers: the checks behind ``simwarp verify`` and tests/physics.

A check is a function that steps the engine and returns rows of expected, got and tolerance; why a tolerance is what it
is stands in its docstring. Measures are taken from the published state in float64, never from the solver.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from simwarp.verify import chain_problem, laws
from simwarp.verify import contact_answers as contact
from simwarp.verify import mechanism_answers as mechanisms
from simwarp.verify import vehicle_runs as vehicles
from simwarp.verify.report import Row

SCENES: Final[dict[str, Callable[..., list[Row]]]] = {
    "pendulum": mechanisms.pendulum,
    "dzhanibekov": mechanisms.dzhanibekov,
    "free-spin": mechanisms.free_spin,
    "andrews": mechanisms.andrews,
    "double-pendulum": mechanisms.double_pendulum,
    "slider-crank": mechanisms.slider_crank,
    "chain": mechanisms.chain,
    "four-bar": mechanisms.four_bar,
    "bricard": mechanisms.bricard,
    "far-away": mechanisms.far_away,
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
    "incline": contact.incline,
    "rolling-ball": contact.rolling_ball,
    "rolling-box": contact.rolling_box,
    "stopping": contact.stopping,
    "heavy-on-light": contact.heavy_on_light,
    "three-balls": contact.three_balls,
    "bouncing": contact.bouncing,
    "convex-law": contact.convex_law,
    "smooth": contact.smooth,
    "card-house": contact.card_house,
    "arch": contact.arch,
    "stack": contact.stack,
    "cube-stack": contact.cube_stack,
    "wall": contact.wall,
    "pile": contact.pile,
    "vehicles": vehicles.vehicles,
}
"""Name -> check, in the order in which they run. The first argument is the device."""
