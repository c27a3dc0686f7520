"""The step stage by stage, as a GPU runs it, against the step in one kernel: the same functions, the same motion."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.simulation import world_launches
from tests.reference.mechanisms import random_mechanism
from tests.reference.yards import PARTS, content, yard

pytestmark = pytest.mark.slow  # the parts compile for half a minute


def held() -> sw.ModelBuilder:
    """A box that cannot move touches the ground before a ball with rolling friction and a box do."""
    builder = sw.ModelBuilder()
    rough = sw.Material(friction=0.6, rolling_friction=0.01, spinning_friction=0.01)
    builder.add_shape_plane(material=rough)
    for index, x in enumerate((0.0, 1.0, 2.0)):
        body = builder.add_body(
            f"b{index}", mass=1.0, inertia=(0.01, 0.01, 0.01), pose=sw.pose((x, 0.0, 0.199)), velocity=(0.1, 0.2, 0.0)
        )
        if index == 1:
            builder.add_shape_sphere(body, radius=0.2, material=rough)
        else:
            builder.add_shape_box(body, half=(0.2, 0.2, 0.2))
        if index == 0:
            builder.add_joint_fixed("hold", parent=sw.WORLD, child=body, anchor=(x, 0.0, 0.199))
    return builder


def tendons() -> sw.ModelBuilder:
    """A chain with sums of its angles: with a law, with bounds alone, and with neither."""
    builder = sw.ModelBuilder()
    for k in range(4):
        body = builder.add_body(f"b{k}", mass=1.0, inertia=(0.1, 0.1, 0.05), pose=sw.pose((0.4 * k, 0.0, 0.1)))
        builder.add_joint_revolute(f"j{k}", body - 1, body, axis=(0.0, 1.0, 0.2 * k), anchor=(0.4 * k - 0.2, 0.0, 0.1))
    builder.add_combination("spring", [(0, 1.0), (1, -0.5), (3, 2.0)], stiffness=30.0, damping=0.4, friction=0.2)
    builder.add_combination("stop", [(1, 1.0), (2, 1.0)], limit=(-0.01, 0.005))
    builder.add_combination("force", [(2, -1.0), (3, 0.7)])
    return builder


def balls() -> sw.ModelBuilder:
    """A chain on balls whose springs differ from axis to axis, with a bounded drive, and a bushing that closes it."""
    builder = sw.ModelBuilder()
    drive = sw.PositionDrive(stiffness=5.0, damping=0.2, effort_limit=0.3)
    for k in range(3):
        body = builder.add_body(f"b{k}", mass=1.0, inertia=(0.1, 0.1, 0.05), pose=sw.pose((0.4 * k, 0.0, 0.1)))
        dofs = [sw.Dof(stiffness=3.0 * (1 + axis * k), rest=0.3 - 0.2 * axis, damping=0.1) for axis in range(3)]
        if k == 1:
            dofs = [dataclasses.replace(dof, drive=drive) for dof in dofs]
        builder.add_joint_spherical(f"j{k}", body - 1, body, anchor=(0.4 * k - 0.2, 0.0, 0.1), dofs=dofs)
    builder.add_bushing("bush", sw.WORLD, 2, anchor=(1.0, 0.0, 0.1), stiffness=(50.0, 50.0, 50.0, 1.0, 9.0, 0.2))
    return builder


MODELS: dict[str, Any] = {
    "pendulum": scenes.pendulum, "four_bar": scenes.four_bar, "ant": scenes.ant, "stack": lambda: scenes.stack(count=3),
    "everything": lambda: random_mechanism(0, bounds=True, couplings=True), "held": held,
    "tendons": tendons, "balls": balls, "yard": lambda: yard(PARTS),
}  # fmt: skip
TOLERANCE = 2e-5
"""Compilers fuse multiplications and additions of one kernel differently from those of ten: after 20 steps rounding
(1e-7) has grown by what a mechanism amplifies and by solves to 1e-6 m/s."""


def moved(name: str, threads: int, reactions: bool) -> tuple[sw.Simulation, dict[str, np.ndarray]]:
    model = MODELS[name]().finalize(5, "cpu")
    solver = sw.SolverOptions(tolerance=1e-6, position_projection=1)
    sim = sw.Simulation(
        model, 2e-3, solver=solver, joint_reactions=reactions, joint_accelerations=reactions, threads=threads
    )
    rng = np.random.default_rng(3)
    sim.control.joint_force.assign(rng.uniform(-0.2, 0.2, (5, model.dof_count)).astype(np.float32))
    sim.advance(20)
    names = ("body_x", "body_v", "body_omega", "joint_q", "joint_qd", "world_time")
    return sim, {name: getattr(sim.state, name).numpy().astype(float) for name in names}


@pytest.mark.parametrize("reactions", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_the_same_motion(name, reactions, monkeypatch):
    whole, expected = moved(name, 1, reactions)
    monkeypatch.setattr(world_launches, "has_own_slots", lambda device: True)
    parts, found = moved(name, 1, reactions)
    assert len(parts.physics_commands) > len(whole.physics_commands)
    for key, values in expected.items():
        np.testing.assert_allclose(
            found[key], values, rtol=0.0, atol=TOLERANCE * max(1.0, np.abs(values).max(initial=0.0))
        )
    for key in ("constraint_count", "position_error"):
        report = getattr(parts.diagnostics, key).numpy()
        np.testing.assert_allclose(report, getattr(whole.diagnostics, key).numpy(), atol=1e-6)
    if reactions:
        force = whole.diagnostics.joint_reaction_force.numpy()
        np.testing.assert_allclose(
            parts.diagnostics.joint_reaction_force.numpy(), force, atol=2e-3 * max(1.0, np.abs(force).max(initial=0.0))
        )
        qdd = whole.diagnostics.joint_qdd.numpy()
        np.testing.assert_allclose(
            parts.diagnostics.joint_qdd.numpy(), qdd, atol=2e-3 * max(1.0, np.abs(qdd).max(initial=0.0))
        )


SOLVERS = ("apgd", "psor", "spg", "padmm", "interior_point")


@pytest.mark.parametrize("dense_rows", [128, 0])
@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_finds_the_same(solver, dense_rows, monkeypatch):
    def stepped() -> sw.Simulation:
        model = scenes.stack(count=3).finalize(3, "cpu")
        options = sw.SolverOptions(
            solver=solver, fallback=True, tolerance=1e-6, max_iterations=40, dense_rows=dense_rows
        )
        sim = sw.Simulation(model, 2e-3, solver=options, threads=1)
        sim.advance(5)
        return sim

    whole = stepped()
    monkeypatch.setattr(world_launches, "has_own_slots", lambda device: True)
    parts = stepped()
    names = [command.kernel.key.rpartition("__")[2] for command in parts.physics_commands]
    newton = {"start_newton_of_islands", "follow_newton_of_islands"} & set(names)
    assert len(newton) == (2 if solver == "interior_point" else 1)
    solves = {name for name in names if name.startswith(("solve_by_", "descend_for_"))}
    assert len(solves) == (2 if solver == "padmm" else 1)
    np.testing.assert_allclose(parts.state.body_v.numpy(), whole.state.body_v.numpy(), atol=TOLERANCE)
    counted = parts.diagnostics.iterations.numpy()
    np.testing.assert_allclose(counted, whole.diagnostics.iterations.numpy(), atol=30)  # rounding may cost some


@pytest.mark.parametrize("dense_rows", [128, 0])
@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_takes_the_islands_in_turn(solver, dense_rows, monkeypatch):
    """Each as if it were alone, bit by bit, though room is shared and kernels follow each other."""
    monkeypatch.setattr(world_launches, "has_own_slots", lambda device: True)
    options = sw.SolverOptions(
        solver=solver, fallback=True, refinement=0, position_projection=1, tolerance=1e-6, dense_rows=dense_rows,
        max_iterations=4 if solver == "interior_point" else 45,
    )  # fmt: skip

    def stepped(*parts: str) -> sw.Simulation:
        sim = sw.Simulation(yard(parts).finalize(2, "cpu"), 2e-3, solver=options, joint_reactions=True)
        sim.advance(30)
        return sim

    together = stepped(*PARTS)
    assert "build_islands" in [command.kernel.key.rpartition("__")[2] for command in together.physics_commands]
    most, worst = 0, 0.0
    for part in PARTS:
        alone = stepped(part)
        among = content(part, together)
        for name, values in content(part, alone).items():
            assert values.tobytes() == among[name].tobytes(), (part, name)
        most = max(most, alone.diagnostics.iterations.numpy()[0])
        worst = max(worst, alone.diagnostics.cone_residual.numpy()[0])
    assert together.diagnostics.iterations.numpy()[0] == most
    assert together.diagnostics.cone_residual.numpy()[0] == worst


def test_the_same_bits_for_any_number_of_threads(monkeypatch):
    monkeypatch.setattr(world_launches, "has_own_slots", lambda device: True)
    _, alone = moved("ant", 1, False)
    for threads in (2, 3):
        _, shared = moved("ant", threads, False)
        assert all(np.array_equal(shared[key], values) for key, values in alone.items())


def test_only_the_parts_that_a_model_needs(monkeypatch):
    monkeypatch.setattr(world_launches, "has_own_slots", lambda device: True)

    def kernels(name: str, **options: Any) -> list[str]:
        sim = sw.Simulation(MODELS[name]().finalize(2, "cpu"), 1e-3, **options)
        return [command.kernel.key.rpartition("__")[2] for command in sim.physics_commands]

    start, end = ["load_state", "move_freely"], ["publish_bodies", "publish_joints"]
    loops = ["form_rows", "bias_rows", "factor_constraints", "solve_bilateral"]
    contacts = ["collect_bounds", "collect_contacts", "respond_to_contacts", "reduce_contacts"]
    assert kernels("pendulum") == [*start, *end]
    assert kernels("four_bar") == [*start, *loops, *end]
    collision = ["place_shapes", "collide_simple_pairs", "keep_contacts"]
    solves = ["solve_by_apgd", "step_newton", "descend_on"]
    assert kernels("ant") == [*collision, *start, *contacts, *solves, "apply_impulses", *end]
    several = kernels("stack")
    of_islands = [f"{name}_of_islands" for name in solves]
    steps = [*start, *contacts, "build_islands", *of_islands, "apply_impulses", *end]
    assert several[several.index("load_state") :] == steps
    assert kernels("pendulum", joint_reactions=True) == [*start, "compute_reactions", *end]
    accelerations = ["keep_rate_changes", "compute_accelerations"]
    assert kernels("pendulum", joint_accelerations=True) == [*start, *accelerations, *end]
    projecting = kernels("four_bar", solver=sw.SolverOptions(position_projection=1))
    assert projecting == [*start, *loops, "project_onto_joints", *end]
