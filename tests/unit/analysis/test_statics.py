"""Equilibria that are found, what is said of them, and where there are none; mechanisms that are assembled."""

from __future__ import annotations

import math

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.analysis import assemble, solve_static
from simwarp.verify import analysis_checks as checks


def test_a_chain_hangs_as_it_must() -> None:
    for row in checks.catenary():
        assert row.passed, row


def test_every_world_finds_its_own_equilibrium() -> None:
    """Springs of other rates: z = -m g/k in each world; the clock stays, and nothing moves afterwards."""
    builder = sw.ModelBuilder()
    body = builder.add_body("mass", mass=2.0, inertia=(0.1, 0.1, 0.1))
    builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(0.0, 0.0, 1.0), anchor=(0.0, 0.0, 0.0), stiffness=100.0)
    model = builder.finalize(3, "cpu", per_world=("joint_stiffness",))
    rates = np.array([[50.0], [100.0], [400.0]], np.float32)
    model.joint_stiffness.assign(rates)
    sim = sw.Simulation(model, 1e-3)
    found = solve_static(sim)
    assert found.stable.all()
    assert not found.by_contacts
    np.testing.assert_allclose(sim.state.joint_q.numpy(), -2.0 * 9.81 / rates, rtol=1e-5)
    np.testing.assert_array_equal(sim.time.numpy(), 0.0)
    before = sim.state.joint_q.numpy().copy()
    sim.step(1000)
    np.testing.assert_allclose(sim.state.joint_q.numpy(), before, atol=2e-5)


def test_worlds_with_loops_start_at_states_of_their_own() -> None:
    """A four-bar from many positions of its crank: each ends in a valley as if it were alone."""
    alone = sw.Simulation(scenes.four_bar().finalize(1, "cpu"), 1e-3)
    sim = sw.Simulation(scenes.four_bar().finalize(4, "cpu"), 1e-3)
    q = np.tile(sim.state.joint_q.numpy()[:1], (4, 1))
    q[:, 0] += (0.0, 0.5, 1.0, -0.7)
    sim.set_joint_state(None, q, None)
    starts = sim.state.joint_q.numpy().copy()
    assert solve_static(sim).stable.all()
    found = sim.state.joint_q.numpy().copy()
    for world in range(4):
        alone.set_joint_state(None, starts[world], None)
        solve_static(alone)
        assert np.abs(np.sin(0.5 * (alone.state.joint_q.numpy()[0] - found[world]))).max() < 1e-4
    sim.step(100)
    np.testing.assert_allclose(sim.state.joint_q.numpy(), found, atol=1e-4)


def test_a_pendulum_on_its_head_is_an_equilibrium_but_no_stable_one() -> None:
    sim = sw.Simulation(scenes.pendulum().finalize(1, "cpu"), 1e-3)
    sim.set_joint_state(None, [-math.pi / 2.0], None)
    found = solve_static(sim)
    assert not found.stable[0]
    sim.set_joint_state(None, [-math.pi / 2.0 + 0.3], None)
    assert solve_static(sim).stable[0]
    assert math.sin(float(sim.state.joint_q.numpy()[0, 0])) == pytest.approx(1.0, abs=1e-6)


def test_contacts_come_to_rest() -> None:
    """A box that falls on the ground; a slope with friction above its angle holds another where it lands."""
    builder = sw.ModelBuilder(gravity=(9.81 * math.sin(0.2), 0.0, -9.81 * math.cos(0.2)))
    box = builder.add_body("box", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.0, 0.0, 0.102)))
    builder.add_shape_box(box, half=(0.1, 0.1, 0.1), material=sw.Material(friction=0.6))
    builder.add_shape_plane(material=sw.Material(friction=0.6))
    sim = sw.Simulation(builder.finalize(2, "cpu"), 1e-3)
    found = solve_static(sim)
    assert found.by_contacts
    x = sim.state.body_x.numpy()[:, 0]
    np.testing.assert_allclose(x[:, 2], 0.1, atol=1e-4)
    assert (np.abs(x[:, 0]) < 5e-3).all()


@pytest.mark.parametrize("start", [-0.3, 0.1, 0.4])
def test_dry_friction_holds_where_a_spring_is_weaker(start: float) -> None:
    """A slide on a spring of 100 N/m with 5 N of dry friction stops within 0.05 m of where the spring is at ease, and
    stays there; a static solver that knew derivatives alone found no end.
    """
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("block", mass=2.0, inertia=(0.1, 0.1, 0.1))
    builder.add_joint_prismatic(
        "slide", sw.WORLD, body, axis=(1.0, 0.0, 0.0), anchor=(0.0, 0.0, 0.0), stiffness=100.0, friction=5.0
    )
    sim = sw.Simulation(builder.finalize(2, "cpu"), 1e-3)
    sim.set_joint_state(None, [start], None)
    found = solve_static(sim)
    assert found.by_contacts
    place = sim.state.joint_q.numpy()[:, 0].copy()
    # beyond the band by the resolution of float32 in rates, a micrometre
    assert (np.abs(place) <= 0.05 + 1e-5).all()
    sim.step(200)
    np.testing.assert_allclose(sim.state.joint_q.numpy()[:, 0], place, atol=1e-6)


@pytest.mark.parametrize("pinned", [False, True])
def test_what_falls_has_no_equilibrium_and_stays_where_it_was(pinned: bool) -> None:
    builder = sw.ModelBuilder()
    body = builder.add_body("stone", mass=1.0, inertia=(1.0, 1.0, 1.0))
    if pinned:
        builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(0.0, 0.0, 1.0), anchor=(0.0, 0.0, 0.0))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    what = "joint 'slide'" if pinned else r"body 'stone' \(z\)"
    with pytest.raises(
        sw.ModelError, match=f"no equilibrium was found near the given state: {what} of world 0 still acc"
    ):
        solve_static(sim, max_steps=200)
    np.testing.assert_array_equal(sim.state.body_x.numpy(), 0.0)
    np.testing.assert_array_equal(sim.state.body_v.numpy(), 0.0)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, math.nan, math.inf])
def test_tolerances_that_are_none_are_refused(tolerance: float) -> None:
    sim = sw.Simulation(scenes.pendulum().finalize(1, "cpu"), 1e-3)
    with pytest.raises(sw.ModelError, match="solve_static: tolerance must be > 0 m/s²"):
        solve_static(sim, tolerance=tolerance)


def test_a_rough_start_is_assembled() -> None:
    sim = sw.Simulation(scenes.four_bar().finalize(5, "cpu"), 1e-3)
    rough = sim.state.joint_q.numpy()[0] + np.array([0.4, -0.3, 0.2, 0.5])
    found = assemble(sim, rough)
    assert (sim.state.world_status.numpy() == 0).all()
    assert found.q.shape == (5, 4)
    sim.step(10)
    assert float(sim.diagnostics.position_error.numpy().max()) < 1e-4


def test_what_cannot_be_closed_is_listed() -> None:
    """A rod that is half a metre too short; the other pins fit."""
    sim = sw.Simulation(scenes.four_bar().finalize(2, "cpu"), 1e-3)
    before = sim.state.joint_q.numpy().copy()
    anchor = sim.model.joint_anchor0
    values = anchor.numpy()
    values[:, sim.model.joint_names.index("rocker_pivot")] += (5.0, 0.0, 0.0)
    anchor.assign(values)
    with pytest.raises(sw.ModelError) as caught:
        assemble(sim, starts=4)
    message = str(caught.value)
    assert "loops of world 0 do not close from 4 starts: joint '" in message
    assert " mm apart" in message
    assert "\n" not in message
    np.testing.assert_array_equal(sim.state.joint_q.numpy(), before)
