"""Kernels that are recorded together are loaded together, once, and each launch is recorded once."""

from __future__ import annotations

import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.simulation.world_launches import WorldShares


def recorded_kernels(monkeypatch) -> tuple[list[str], list[list[str]]]:
    """Lists that grow: names of kernels that are recorded, and of modules that are loaded together."""
    launches: list[str] = []
    loads: list[list[str]] = []
    launch, load = wp.launch, wp.force_load

    def noted_launch(kernel, *args, **kwargs):
        if kwargs.get("record_cmd"):
            launches.append(kernel.key)
        return launch(kernel, *args, **kwargs)

    def noted_load(device, modules, **kwargs):
        loads.append([module.name for module in modules])
        return load(device, modules, **kwargs)

    monkeypatch.setattr(wp, "launch", noted_launch)
    monkeypatch.setattr(wp, "force_load", noted_load)
    return launches, loads


def test_a_simulation_loads_its_modules_together_and_records_each_launch_once(monkeypatch):
    launches, loads = recorded_kernels(monkeypatch)
    sim = sw.Simulation(scenes.ant().finalize(3, "cpu"), 2e-3, threads=1)
    assert len(loads[0]) >= 5, "the step, collision, setting, measuring and energy"
    assert all(len(set(modules)) == len(modules) for modules in loads)
    for name in ("step_worlds", "collide_worlds", "assemble_trees", "measure_worlds", "measure_energy"):
        assert sum(key.endswith(name) for key in launches) == 1, name
    sim.step(3)
    assert sim.state.world_time.numpy() == pytest.approx([6e-3] * 3)


def test_what_is_recorded_later_is_there_at_once(monkeypatch):
    sim = sw.Simulation(scenes.pendulum().finalize(2, "cpu"), 2e-3, threads=1)
    launches, loads = recorded_kernels(monkeypatch)
    before = len(launches)
    sim._record_setting()
    assert len(launches) > before
    assert loads == []


def test_an_error_inside_leaves_nothing_waiting():
    model = scenes.pendulum().finalize(2, "cpu")
    sim = sw.Simulation(model, 2e-3, threads=1)
    shares = WorldShares(2, 1, model.device)
    kept = []

    def record_and_fail() -> None:
        with shares.recording_together():
            inputs = [sim._all_worlds, model.topology, model.parameters, sim._scratch]
            outputs = [sim.state.arrays, sim.contacts.arrays]
            kept.append(shares.record(sim._measuring.kernel, inputs=inputs, outputs=outputs))
            raise RuntimeError("a bug")

    with pytest.raises(RuntimeError, match="a bug"):
        record_and_fail()
    assert len(kept[0].parts) == 1, "a launch that somebody kept can still be used"
