"""What does not fit is refused before anything is allocated: worlds, contact slots, scratch, snapshots."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.core import memory
from simwarp.kernels.core.layouts import run_layouts, snapshot_layouts
from simwarp.simulation.step_sizes import step_layouts, step_sizes

CPU = wp.get_device("cpu")


def message(call) -> str:
    with pytest.raises(sw.ModelError) as caught:
        call()
    text = str(caught.value)
    assert text.isprintable()
    assert len(text) < 400
    return text


@pytest.mark.quick("per_world0-1000000000", "per_world1-100000000", "per_world2-2147483647")
@pytest.mark.parametrize("worlds", [10**8, 10**9, 2**31 - 1])
@pytest.mark.parametrize("per_world", [(), ("body_mass",), ("shape_x", "body_inertia_b")])
def test_worlds_that_do_not_fit(worlds, per_world):
    text = message(lambda: scenes.stack().finalize(worlds, "cpu", per_world=per_world))
    assert text.startswith(f"finalize: {worlds} worlds need ")
    assert "device cpu has " in text
    assert " are free; take fewer worlds" in text


@pytest.mark.parametrize("worlds", [2**31, 10**12, 10**400, 0, -1, 1.0, True, "1", None, float("nan")])
def test_world_counts_that_no_array_has(worlds):
    text = message(lambda: scenes.stack().finalize(worlds, "cpu"))
    assert text.startswith("finalize: world_count must be an integer")


@pytest.mark.parametrize("capacity", [2**31, 10**400, 0, -1, 1.0, True, "1", float("nan")])
def test_capacities_that_no_array_has(capacity):
    text = message(lambda: scenes.stack().finalize(1, "cpu", contact_capacity=capacity))
    assert text.startswith("finalize: contact_capacity must be an integer")


@pytest.mark.parametrize("capacity", [2**28, 2**31 - 1])
def test_rows_beyond_32_bits(capacity):
    """Kernels find an element by the bytes before it in its row: 12 of them for each slot of a vector."""
    text = message(lambda: scenes.stack().finalize(1, "cpu", contact_capacity=capacity))
    assert "beyond 32 bits" in text or "are free" in text


def test_pairs_of_shapes_that_do_not_fit(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda device: 1000)
    text = message(lambda: scenes.stack(count=10).finalize(1, "cpu"))
    assert text.startswith("finalize: the 55 pairs of 11 shapes need ")


def test_scratch_beyond_32_bits(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda device: 2**50)
    model = scenes.stack().finalize(1, "cpu", contact_capacity=2**25)
    text = message(lambda: sw.Simulation(model, 1e-3))
    assert text.startswith("Simulation: 1 worlds need an array 'scratch.")
    assert "beyond 32 bits" in text


def test_what_is_computed_is_what_is_allocated():
    """One layout makes the arrays and counts their bytes."""
    model = scenes.stack(count=3).finalize(5, "cpu", contact_capacity=40)
    solver = sw.SolverOptions(solver="padmm")
    sim = sw.Simulation(model, 1e-3, joint_reactions=True, joint_accelerations=True, solver=solver)
    scratch: list[Any] = [sim._scratch, sim._collision_scratch, sim._contact_lists, sim._progress]
    groups: list[Any] = [
        *((part, part.NAMES) for part in (sim.state, sim._initial, sim.control, sim.contacts)),
        (sim.diagnostics, (*sim.diagnostics.NAMES, "energy")),
        *((part, part._cls.vars) for part in scratch),
    ]  # fmt: skip
    taken = sum(getattr(part, name).capacity for part, names in groups for name in names)
    layouts = run_layouts(model.sizes(reactions=True, accelerations=True)) | step_layouts(
        model, step_sizes(model, 128, True), len(sim.shares.ranges)
    )
    assert taken == memory.layout_bytes(layouts.values())
    kept = sum(array.capacity for array in sim.snapshot().arrays().values())
    assert kept == memory.layout_bytes(snapshot_layouts(model.sizes()).values())


def test_nothing_is_made_where_it_does_not_fit(monkeypatch):
    model = scenes.stack(count=2).finalize(4, "cpu")
    sim = sw.Simulation(model, 1e-3)
    monkeypatch.setattr(memory, "free_memory", lambda device: 1000)
    monkeypatch.setattr(wp, "zeros", None)  # nothing may be allocated
    assert message(lambda: sw.Simulation(model, 1e-3)).startswith("Simulation: 4 worlds need ")
    assert message(sim.snapshot).startswith("snapshot: its arrays need ")
    assert message(lambda: sw.solve_cone_problems(np.eye(3), np.ones(3), [0.5], device="cpu")).startswith(
        "solve_cone_problems: its arrays need "
    )


# ---- what is free ----------------------------------------------------------------------------------------------------


def test_free_memory_is_at_most_what_there_is():
    assert 0 < memory.free_memory(CPU) <= memory.device_memory(CPU)


@pytest.mark.parametrize("version", [1, 2])
def test_limits_of_control_groups_count(tmp_path, monkeypatch, version):
    """Of a group and of those around it; caches that can be dropped count as free."""
    outer = tmp_path / ("memory/outer" if version == 1 else "outer")
    inner = outer / "inner"
    inner.mkdir(parents=True)
    limit, usage, cache = (
        ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file") if version == 1
        else ("memory.max", "memory.current", "inactive_file")
    )  # fmt: skip
    for folder, most, used in ((outer, 5000, 4500), (inner, 9000, 100)):
        (folder / limit).write_text(f"{most}\n")
        (folder / usage).write_text(f"{used}\n")
        (folder / "memory.stat").write_text(f"anon 1\n{cache} 300\n")
    groups = tmp_path / "groups"
    groups.write_text("7:cpu:/x\n4:memory:/outer/inner\n" if version == 1 else "0::/outer/inner\n")
    monkeypatch.setattr(memory, "CGROUPS", tmp_path)
    monkeypatch.setattr(memory, "OWN_GROUPS", groups)
    assert sorted(memory._control_groups()) == [800, 9200]
    assert memory.free_memory(CPU) == 800
    (outer / limit).write_text("max\n" if version == 2 else "9223372036854771712\n")
    assert memory._control_groups() == [9200]


def test_systems_without_these_files(monkeypatch, tmp_path):
    monkeypatch.setattr(memory, "OWN_GROUPS", tmp_path / "none")
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "none")
    monkeypatch.setitem(sys.modules, "psutil", None)
    assert memory._control_groups() == memory._meminfo() == []
    assert memory.free_memory(CPU) > 0
