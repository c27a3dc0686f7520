"""Every field of SolverOptions has a domain, checked when it is written; any `dense_rows` works with any solver."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.simulation.solver_options import SOLVERS
from simwarp.simulation.step_sizes import step_sizes

NAN, INF = float("nan"), float("inf")
NO_NUMBERS: list[Any] = ["", "1", "abc", b"1", [], [1.0], {}, object(), 1j, NAN, INF, -INF, 1e39, 10**400, -1.0, -1e-30]
NO_COUNTS: list[Any] = ["", "1", [], [1], 1.5, 1.0, NAN, INF, True, False, -1, 2**33, 10**400, 1j, object()]
NO_FLAGS: list[Any] = ["", "yes", 0, 1, 2, 1.0, NAN, [], [True], object()]
NO_NAMES: list[Any] = [None, "", "newton", "APGD", 0, 1.0, True, [], ["apgd"], b"apgd", object(), NAN, "a" * 10_000]
WRONG: dict[str, list[Any]] = {
    "max_depenetration_velocity": [*NO_NUMBERS, None, True],
    "max_depenetration_rate": [*NO_NUMBERS, None, True],
    "position_projection": [*NO_COUNTS, 1001],
    "numerical_damping": [*NO_NUMBERS, None, True, 1.001, 2.0],
    "refinement": [*NO_COUNTS, 1001],
    "pivot_tolerance": [*NO_NUMBERS, None, True, 1.0, 2.0],
    "max_iterations": [*NO_COUNTS, None, 0, 2**31],
    "tolerance": [*NO_NUMBERS, None, True],
    "row_tolerance": [*NO_NUMBERS, None, True],
    "gyroscopic": [*NO_FLAGS, None],
    "solver": NO_NAMES,
    "fallback": NO_FLAGS,
    "friction_law": NO_NAMES,
    "contact_model": NO_NAMES,
    "restitution_threshold": [*NO_NUMBERS, None, True],
    "contact_margin": [*NO_NUMBERS, None, True],
    "dense_rows": [*NO_COUNTS, None, 32_769],
}
RIGHT: dict[str, list[Any]] = {
    "max_depenetration_velocity": [0, 0.0, 1.0, np.float32(0.5), 1e30],
    "max_depenetration_rate": [0, 1],
    "position_projection": [None, 0, 3, np.int64(2)],
    "numerical_damping": [0, 0.0, 0.1, np.float32(0.5), 1],
    "refinement": [None, 0, 2],
    "pivot_tolerance": [0.0, 0.5],
    "max_iterations": [1, 10_000_000, np.int32(7)],
    "tolerance": [0.0, 1e-9],
    "row_tolerance": [0.0, 1e-3],
    "gyroscopic": [True, False, np.bool_(True)],
    "solver": [*SOLVERS],
    "fallback": [None, True, False],
    "friction_law": ["exact", "convex"],
    "contact_model": ["rigid", "smooth", "smooth_hooke"],
    "restitution_threshold": [0.0, 100.0],
    "contact_margin": [0.0, 1.0],
    "dense_rows": [0, 1, 128, 32_768],
}


def test_every_field_is_in_the_tables():
    fields = [field.name for field in dataclasses.fields(sw.SolverOptions)]
    assert [*WRONG] == fields
    assert [*RIGHT] == fields


@pytest.mark.parametrize("field", WRONG)
def test_values_outside_the_domain_are_refused(field):
    for value in WRONG[field]:
        with pytest.raises(sw.ModelError) as caught:
            sw.SolverOptions(**{field: value})
        message = str(caught.value)
        assert message.startswith(f"SolverOptions: {field} must be ")
        assert ", got " in message
        assert "; " in message
        assert message.isprintable()
        assert len(message) < 300


@pytest.mark.parametrize("field", RIGHT)
def test_values_inside_are_kept_as_plain_numbers(field):
    for value in RIGHT[field]:
        kept = getattr(sw.SolverOptions(**{field: value}), field)
        assert kept == value
        assert type(kept) in (int, float, bool, str, type(None))


def test_options_must_be_options():
    model = scenes.stack(count=1).finalize(1, "cpu")
    strange: list[Any] = [{}, "apgd", sw.SolverOptions]
    for wrong in strange:
        with pytest.raises(sw.ModelError, match="solver must be a SolverOptions, got"):
            sw.Simulation(model, 1e-3, solver=wrong)


# ---- dense rows ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("fallback", [None, True, False])
def test_the_scratch_has_room_for_all_rows_whatever_is_dense(solver, fallback):
    """Where another solver may follow the first, its impulses are kept for comparison: all rows of them."""
    model = scenes.heavy_on_light().finalize(1, "cpu")
    for dense_rows in (0, 1, 2, 5, 128):
        sim = sw.Simulation(
            model, 5e-3, solver=sw.SolverOptions(solver=solver, fallback=fallback, dense_rows=dense_rows)
        )
        rows = 3 * model.contact_capacity
        scratch: Any = sim._scratch
        dense = min(rows, dense_rows)
        assert scratch.cone_s.shape[1] >= dense
        assert scratch.cone_vectors.shape[2] >= rows
        if solver != "apgd" or fallback is not False:  # in this model masses differ by more than 100
            assert scratch.kept.shape[1] >= rows
            assert scratch.cone_factor.shape[1] >= dense
            assert scratch.cone_wide.shape[2] >= dense
        assert step_sizes(model, dense_rows, True).kept_rows == rows


STEPS = """
import hashlib, json, sys
import warp as wp
wp.config.log_level = wp.LOG_WARNING
import simwarp as sw
from simwarp import scenes
models = {name: getattr(scenes, name)().finalize(2, "cpu") for name in ("stack", "heavy_on_light")}
found = {}
for solver in json.loads(sys.argv[1]):
    for fallback in (False, True):
        for dense_rows in (0, 1, 2, 5, 128):
            options = sw.SolverOptions(solver=solver, fallback=fallback, dense_rows=dense_rows, max_iterations=30)
            for name, model in models.items():
                sim = sw.Simulation(model, 5e-3, solver=options)
                for _ in range(6):
                    sim.step()
                state = b"".join(getattr(sim.state, part).numpy().tobytes() for part in ("body_x", "body_v"))
                rows = 3 * int(sim.contacts.contact_count.numpy().max())
                digest = hashlib.sha256(state).hexdigest()
                frozen = bool(sim.state.world_status.numpy().any())
                found[f"{name} {solver} {fallback} {dense_rows}"] = [digest, rows, frozen]
print(json.dumps(found))
"""


def test_every_solver_steps_with_any_number_of_dense_rows():
    """In a process of its own, which writing beyond an array would end (it did: SIGABRT)."""
    done = subprocess.run(
        [sys.executable, "-c", STEPS, json.dumps(SOLVERS)], capture_output=True, text=True, timeout=300,
        cwd=Path(__file__).resolve().parents[3],
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    assert len(found) == len(SOLVERS) * 2 * 5 * 2
    for case, (digest, rows, frozen) in found.items():
        name, solver, fallback, dense_rows = case.split()
        assert not frozen, case
        assert rows > 5, case
        if int(dense_rows) < rows:  # then none of these worlds is dense
            assert digest == found[f"{name} {solver} {fallback} 0"][0], case
