"""Machines side by side in one world: each like the float64 reference, and, out of touch, like itself alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import ConeSolver
from simwarp.simulation.step_sizes import step_sizes
from tests.reference.contact_step import ContactReference
from tests.reference.machines import JOINTS, PARTS, machines, of_machine
from tests.unit.kernels.dynamics.side_by_side import EPS, assert_same_steps

APART = [(0.0, 5.0 * index, 0.0) for index in range(3)]
NEAR = [(0.0, 0.0, 0.0), (0.05, 0.599, 0.02)]
DT = 1e-3


@pytest.mark.parametrize("count", [1, 3])
def test_machines_apart_against_the_reference(count: int) -> None:
    assert_same_steps(machines(APART[:count]), steps=6)


def test_machines_tied_to_each_other_against_the_reference() -> None:
    builder = machines(APART)
    builder.add_joint_distance("rod", 0, 2, anchor0=(0.0, 0.0, 0.1), anchor1=(0.0, 10.0, 0.1))
    assert_same_steps(builder, steps=6)


def test_a_bounded_row_between_two_groups_against_the_reference() -> None:
    builder = machines(APART[:2], approach=1.0)
    shortest = 5.0 - 2.0**-11  # as float32, which coordinates are compared in: one step alone starts where it is exact
    builder.add_joint_distance("strut", 0, 1, anchor0=(0.0, 0.0, 0.1), anchor1=(0.0, 5.0, 0.1), limit=(shortest, 6.0))
    options = sw.SolverOptions(position_projection=0, tolerance=1e-7, max_iterations=2000)
    pair = assert_same_steps(builder, steps=1, size=0.1, solver=options)
    assert np.abs(pair.reference.box_impulse).max() > 0.1
    assert pair.sim.model.share_width == 14


@pytest.mark.parametrize("dense_rows", [128, 0])
def test_machines_that_touch_against_the_reference(dense_rows: int) -> None:
    """A ball of each on the other's, in a contact that both loops answer."""
    builder = machines(NEAR, approach=1.5, shapes=True)
    options = sw.SolverOptions(
        tolerance=1e-7, max_iterations=2000, position_projection=0, contact_margin=0.1, dense_rows=dense_rows
    )
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, solver=options)
    reference = ContactReference(builder, DT, envelope=0.1)
    pushed = 0.0
    for _ in range(5):
        sim.step()
        reference.step()
        assert reference.solve_residual < 2e-7
        pushed += DT * float(np.abs(sim.contacts.body_contact_force.numpy()[0]).max())
    assert pushed > 1.0
    # as for heaps (test_contact_step.py): gaps are formed in float32 and corrected within a step
    allowed = 3.0 * (0.5 * 0.6 * EPS / DT + 1e-5)
    assert np.abs(sim.state.body_v.numpy()[0] - reference.v).max() < allowed
    assert np.abs(sim.state.body_omega.numpy()[0] - reference.omega).max() < allowed / 0.05


def run(builder: sw.ModelBuilder, steps: int, first: int = 0, worlds: int = 2, **options: Any) -> sw.Simulation:
    """Steps machines on which efforts of their own act, those of the machine `first` and the next ones."""
    solver = sw.SolverOptions(position_projection=1, **options)
    sim = sw.Simulation(builder.finalize(worlds, "cpu"), 2e-3, solver=solver, joint_reactions=True)
    force = sim.control.joint_force.numpy()
    places = force.shape[1] // JOINTS
    for index in range(places):
        force[:, of_machine(index, places, JOINTS)] = 0.3 * (first + index + 1)
    sim.control.joint_force.assign(force)
    sim.advance(steps)
    return sim


@pytest.mark.parametrize("solver", [each.name.lower() for each in ConeSolver])
def test_every_solver_sees_both_groups_of_a_contact(solver: str) -> None:
    found = {}
    for dense_rows in (128, 0):
        sim = run(
            machines(NEAR, approach=1.5, shapes=True), 10, solver=solver, dense_rows=dense_rows, tolerance=1e-7,
            max_iterations=3000,
        )  # fmt: skip
        found[dense_rows] = sim.state.body_v.numpy().astype(float)
    assert np.abs(found[128] - found[0]).max() < 2e-5
    reference = run(machines(NEAR, approach=1.5, shapes=True), 10, tolerance=1e-7, max_iterations=3000)
    assert np.abs(found[128] - reference.state.body_v.numpy()).max() < 5e-5


def content(sim: sw.Simulation, index: int, count: int) -> dict[str, np.ndarray]:
    """All that there is of one machine."""
    bodies, joints = of_machine(index, count, PARTS), of_machine(index, count, JOINTS)
    state, reports = sim.state, sim.diagnostics
    found = {
        name: getattr(state, name).numpy()[:, bodies]
        for name in ("body_x", "body_rot", "body_v", "body_omega", "body_v_low", "body_omega_low")
    }
    found |= {name: getattr(state, name).numpy()[:, joints] for name in ("joint_x", "joint_q", "joint_qd")}
    for name in ("joint_reaction_force", "joint_reaction_torque"):
        found[name] = getattr(reports, name).numpy()[:, joints]
    return found


@pytest.mark.parametrize("shapes", [False, True])
def test_a_machine_among_others_equals_itself_alone(shapes: bool) -> None:
    """Bit by bit, out of touch: each goes by the residual of its own rows."""
    speeds = (3.0, 0.0, 1.8)
    together = run(machines(APART, speeds=speeds, shapes=shapes), 200)
    assert together.diagnostics.constraint_count.numpy().tolist() == [3, 3]
    for index, place in enumerate(APART):
        alone = run(machines([place], speeds=speeds[index : index + 1], shapes=shapes), 200, first=index)
        mine = content(together, index, len(APART))
        for name, values in content(alone, 0, 1).items():
            assert values.tobytes() == mine[name].tobytes(), (index, name)


@pytest.mark.parametrize("places", [APART, NEAR])
def test_the_number_of_worlds_changes_nothing(places: list[tuple[float, float, float]]) -> None:
    few, many = (
        run(machines(places, approach=1.0, shapes=True), 60, worlds=worlds).state.body_x.numpy() for worlds in (1, 17)
    )
    assert all(world.tobytes() == few[0].tobytes() for world in many)


def test_scratch_grows_by_the_number_of_machines() -> None:
    def room(count: int, shapes: bool) -> int:
        builder = machines([(0.0, 5.0 * index, 0.0) for index in range(count)], shapes=shapes)
        sizes = step_sizes(builder.finalize(1, "cpu"), 0, False)
        return (
            sizes.responses * sizes.columns + sizes.response_room + sizes.factor_room
            + sizes.padded_rows + sizes.rows
        )  # fmt: skip

    for count in (2, 5, 16):
        assert room(count, False) <= count * room(1, False)
        assert room(count, True) == room(count, False)
