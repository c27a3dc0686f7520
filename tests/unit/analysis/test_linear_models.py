"""Linear models and modes against closed forms, finite differences of other kinds, and themselves."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp import scenes
from simwarp.analysis import linearise, modes, solve_static
from simwarp.verify import analysis_checks as checks

CHECKS = [checks.pendulum, checks.masses, checks.hanging_chain, checks.half_car_modes]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_closed_forms(check: Any) -> None:
    for row in check():
        assert row.passed, row


def double_pendulum_matrix(q1: float, q2: float) -> np.ndarray:
    """d(accelerations)/d(angles) of two uniform rods of 1 m and 1 kg, angles from +X downwards, by their equations."""

    def accelerations(a: np.ndarray) -> np.ndarray:
        angle = np.cumsum(a)  # of each rod in the world
        m = np.array(
            [[4.0 / 3.0, 0.5 * math.cos(angle[1] - angle[0])], [0.5 * math.cos(angle[1] - angle[0]), 1.0 / 3.0]]
        )
        f = 9.81 * np.array([1.5 * math.cos(angle[0]), 0.5 * math.cos(angle[1])])
        first, second = np.linalg.solve(m, f)
        return np.array([first, second - first])

    steps = 1e-6 * np.eye(2)
    base = np.array([q1, q2])
    return np.stack([(accelerations(base + s) - accelerations(base - s)) / 2e-6 for s in steps], axis=1)


@pytest.mark.parametrize("q", [(math.pi / 2, 0.0), (0.4, 0.9), (-1.0, 0.3)])
def test_a_double_pendulum_anywhere(q: tuple[float, float]) -> None:
    """Also where it accelerates: the model is about the state, not about an equilibrium."""
    sim = sw.Simulation(scenes.double_pendulum().finalize(8, "cpu"), 1e-3)
    sim.set_joint_state(None, np.array(q), None)
    expected = double_pendulum_matrix(*q)
    found = linearise(sim)
    # float32 leaves 6e-8 of g in an acceleration, over 2e-3 rad: 3e-4
    np.testing.assert_allclose(found.a[2:, :2], expected, atol=2e-3 + 2e-4 * np.abs(expected).max())
    np.testing.assert_allclose(found.a[:2], np.eye(4)[2:], atol=1e-6)
    mass = np.array(
        [[4 / 3 + 1 / 3 + math.cos(q[1]), 1 / 3 + 0.5 * math.cos(q[1])], [1 / 3 + 0.5 * math.cos(q[1]), 1 / 3]]
    )
    np.testing.assert_allclose(found.b[2:], np.linalg.inv(mass), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("worlds", [1, 3, 64])
def test_the_number_of_worlds_does_not_matter(worlds: int) -> None:
    """Lanes are a matter of speed: each change has a world of its own or waits for one."""
    sim = sw.Simulation(scenes.double_pendulum().finalize(worlds, "cpu"), 1e-3)
    found, one = linearise(sim), linearise(sw.Simulation(scenes.double_pendulum().finalize(1, "cpu"), 1e-3))
    np.testing.assert_array_equal(found.a, one.a)
    np.testing.assert_array_equal(found.b, one.b)


def test_the_state_comes_back_bit_by_bit() -> None:
    sim = sw.Simulation(scenes.ant(ground=False).finalize(4, "cpu"), 5e-3)
    sim.control.joint_force.assign(
        np.random.default_rng(1).uniform(-1, 1, sim.control.joint_force.shape).astype(np.float32)
    )
    sim.step(20)
    before = {name: array.numpy().copy() for name, array in sim.snapshot().arrays().items()}
    linearise(sim, world=2)
    for name, array in sim.snapshot().arrays().items():
        np.testing.assert_array_equal(array.numpy(), before[name], err_msg=name)


def test_only_worlds_with_the_same_parameters_are_lanes() -> None:
    """World 1 weighs twice as much: its springs give another frequency, whichever world is asked for."""
    builder = checks.two_masses(damping=0.0)
    model = builder.finalize(6, "cpu", per_world=("body_mass",))
    mass = model.body_mass.numpy()
    mass[1] *= 2.0
    model.body_mass.assign(mass)
    sim = sw.Simulation(model, 1e-3)
    light, heavy = modes(sim, world=0), modes(sim, world=1)
    np.testing.assert_allclose(heavy.frequency, light.frequency / math.sqrt(2.0), rtol=2e-4)


def test_a_closed_loop_has_one_coordinate() -> None:
    """A four-bar at rest, by the energy of its one motion: 1/2 m(q) qd² + V(q) from assembled positions alone."""
    sim = sw.Simulation(scenes.four_bar().finalize(8, "cpu"), 1e-3)
    solve_static(sim)
    found = linearise(sim, inputs=())
    assert len(found.coordinates) == 1
    model = sim.model
    masses, inertias = model.body_mass.numpy()[0].astype(float), model.body_inertia_b.numpy()[0].astype(float)
    motion = found.bodies[:, :, 0]
    moved = (masses[:, None] * motion[:, :3] ** 2).sum() + sum(
        w[1] ** 2 * i[1, 1] for w, i in zip(motion[:, 3:], inertias, strict=True)
    )

    def potential(change: float) -> float:
        q = sim.state.joint_q.numpy()[0] + change * found.basis[:, 0]
        start = sim.snapshot()
        sim.set_joint_state(None, q.astype(np.float32), None)
        height = float((9.81 * masses * sim.state.body_x.numpy()[0, :, 2]).sum())
        sim.restore(start)
        return height

    bend = (potential(0.05) - 2.0 * potential(0.0) + potential(-0.05)) / 0.05**2
    # the curvature of the potential over 0.05 rad is off by its fourth derivative, some 1e-3
    assert found.stiffness[0, 0] == pytest.approx(bend / moved, rel=5e-3)


def test_stiffness_times_mass_is_symmetric() -> None:
    """Springs and weights have a potential: M (M⁻¹K) is symmetric, with M from the bodies' motions."""
    sim = sw.Simulation(checks.half_car().finalize(16, "cpu"), 1e-3)
    found = linearise(sim, inputs=())
    model = sim.model
    masses, inertias = model.body_mass.numpy()[0].astype(float), model.body_inertia_b.numpy()[0].astype(float)
    motion = found.bodies
    mass = np.einsum("b,bik,bil->kl", masses, motion[:, :3], motion[:, :3])
    mass += np.einsum("bij,bik,bjl->kl", inertias, motion[:, 3:], motion[:, 3:])
    stiffness = mass @ found.stiffness
    assert np.abs(stiffness - stiffness.T).max() < 1e-3 * np.abs(stiffness).max()


def test_outputs_of_ones_own() -> None:
    """The height of a pendulum's bob: dy/dq = -L sin of the angle from the horizontal, that is its x."""
    sim = sw.Simulation(scenes.pendulum().finalize(4, "cpu"), 1e-3)
    sim.set_joint_state(None, [0.5], None)
    found = linearise(sim, outputs=lambda each: each.state.body_x.numpy()[:, 0, 2])
    np.testing.assert_allclose(found.c, [[-math.cos(0.5), 0.0]], atol=1e-5)
    assert found.d.shape == (1, 1)


def test_drives_are_inputs() -> None:
    """A drive's target acts by its stiffness over the inertia."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("arm", mass=2.0, inertia=(0.1, 0.1, 0.1))
    builder.add_joint_prismatic(
        "slide",
        sw.WORLD,
        body,
        axis=(1.0, 0.0, 0.0),
        anchor=(0.0, 0.0, 0.0),
        drive=sw.PositionDrive(stiffness=50.0, damping=3.0),
    )
    found = linearise(sw.Simulation(builder.finalize(2, "cpu"), 1e-3), of="joint_target_q")
    np.testing.assert_allclose(found.b, [[0.0], [25.0]], rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(found.damping, [[1.5]], rtol=2e-3)


def test_a_mode_is_shown_world_by_world() -> None:
    sim = sw.Simulation(checks.chain_of_points(links=3).finalize(3, "cpu"), 1e-3)
    found = modes(sim, damped=False)
    found.place(sim, 0.0, amplitude=1e-3)
    q = sim.state.joint_q.numpy()
    for world in range(3):
        np.testing.assert_allclose(q[world], 1e-3 * found.coordinates(world).real, atol=2e-6)  # (1e-3 rad)² is left out
    found.place(sim, math.pi / 2.0, amplitude=1e-3)
    np.testing.assert_allclose(sim.state.joint_q.numpy(), 0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda sim: linearise(sim, world=9), "world must be an integer >= 0 and <= 1, got 9; count from 0"),
        (lambda sim: linearise(sim, inputs=["knee"]), "must be names of joints, got 'knee'; see model.joint_names"),
        (lambda sim: linearise(sim, of="force"), "must be one of joint_force, joint_target_q, joint_target_qd, got"),
        (lambda sim: linearise(cast(Any, "sim")), "simulation must be a Simulation, got 'sim'; pass Simulation(...)"),
        (lambda sim: linearise(sim, time_step=0.0), "time_step must be > 0 s, got 0"),
        (lambda sim: modes(sim), "got 9.81 m/s² or rad/s² of joint 'pivot'; call analysis.solve_static"),
    ],
)  # fmt: skip
def test_errors_are_one_line(call: Any, says: str) -> None:
    sim = sw.Simulation(scenes.pendulum().finalize(2, "cpu"), 1e-3)
    with pytest.raises(sw.ModelError) as caught:
        call(sim)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_contacts_have_no_derivative() -> None:
    builder = sw.ModelBuilder()
    box = builder.add_body("box", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.0, 0.0, 0.1)))
    builder.add_shape_box(box, half=(0.1, 0.1, 0.1))
    builder.add_shape_plane()
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.step(20)
    with pytest.raises(sw.ModelError, match=r"contacts must not push, got [1-9] that do in world 0"):
        linearise(sim)


def test_a_mechanism_that_locks_is_singular() -> None:
    """Two rods in a line between two pins: rates may bend them, positions may not."""
    builder = sw.ModelBuilder()
    rods = [
        builder.add_body(f"rod{k}", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.1 + 0.2 * k, 0.0, 0.0)))
        for k in (0, 1)
    ]
    for k, (parent, child) in enumerate(((sw.WORLD, rods[0]), (rods[0], rods[1]), (rods[1], sw.WORLD))):
        builder.add_joint_revolute(f"pin{k}", parent, child, axis=(0.0, 1.0, 0.0), anchor=(0.2 * k, 0.0, 0.0))
    with pytest.raises(sw.ModelError, match="singular position: joint 'pin1' cannot move as its rate says"):
        linearise(sw.Simulation(builder.finalize(1, "cpu"), 1e-3))


@pytest.mark.cuda
def test_a_gpu_gives_the_same_model() -> None:
    on = [linearise(sw.Simulation(scenes.double_pendulum().finalize(4, device), 1e-3)) for device in ("cpu", "cuda:0")]
    np.testing.assert_allclose(on[1].a, on[0].a, atol=5e-3)
    wp.synchronize()
