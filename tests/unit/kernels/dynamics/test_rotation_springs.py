"""Springs, tables and drives on rotations: ball joints in the tree and in loops, bushings, floating bodies.

A passive spring on a rotation is the gradient of a potential, which `measure_energy` has: the torque is its derivative,
no motion gains energy from it, it comes to rest at its rest, and swings about it as mass and stiffness say.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.core.types import WORLD, Dof, JointType, PositionDrive, PrescribedPosition, pose
from simwarp.model.builder import ModelBuilder
from tests.reference.step_laws import relative_rotation
from tests.unit.kernels.dynamics.side_by_side import Controls, assert_same_steps

PLACES = ("ball", "loop", "bushing", "floating")
INERTIA = (0.05, 0.06, 0.08)
CENTRE = (0.1, 0.05, -0.3)
EVEN = (2.0, 2.0, 2.0)
UNEVEN = (2.0, 20.0, 0.5)
BENT = ((-1.0, 0.2, 3.0), (-2.0, 0.5, 7.0))


def sprung(place: str, dofs: list[Dof], gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> ModelBuilder:
    """A body with laws about the world's axes; its coordinates of rotation are the last three of joint "spring"."""
    builder = ModelBuilder(gravity=gravity)
    body = builder.add_body("body", mass=1.0, inertia=INERTIA, pose=pose(CENTRE, (0.1, 0.2, -0.3, 0.9)))
    if place == "ball":
        builder.add_joint_spherical("spring", WORLD, body, anchor=(0, 0, 0), dofs=dofs)
    elif place == "loop":  # three efforts on either: the first one is part of the tree
        builder.add_joint_spherical("tree", WORLD, body, anchor=(0, 0, 0), dofs=[Dof(armature=1e-9)] * 3)
        builder.add_joint_spherical("spring", WORLD, body, anchor=(0, 0, 0), dofs=dofs)
    elif place == "bushing":
        index = builder.add_bushing("spring", WORLD, body, anchor=(0, 0, 0), stiffness=(500.0,) * 3 + (1.0,) * 3)
        along = builder.joints[index].dofs[:3]
        builder.joints[index] = dataclasses.replace(builder.joints[index], dofs=(*along, *dofs))
    else:
        along = (Dof(stiffness=500.0),) * 3
        builder.add_joint_free("spring", body, anchor=(0, 0, 0), dofs=[*along, *dofs])
    return builder


def rotation_columns(model: sw.Model) -> np.ndarray:
    """Columns of the rotation vector of joint "spring"."""
    joint = model.joint_names.index("spring")
    return model.joint_dof_start[joint] + len(model.builder.joints[joint].dofs) - 3 + np.arange(3)


def place_body(sim: sw.Simulation, turns: Rotation, omega: np.ndarray | None = None) -> None:
    """World w: the body turned by `turns[w]` about the anchor, from its pose as built."""
    spec = sim.model.builder.bodies[0].pose
    start = Rotation.from_quat(spec.rotation)
    sim.state.body_rot.assign((turns * start).as_quat()[:, None])
    arms = turns.apply(spec.position)
    sim.state.body_x.assign(arms[:, None])
    if omega is not None:
        sim.state.body_omega.assign(omega[:, None].astype(np.float32))
        sim.state.body_v.assign(np.cross(omega, arms)[:, None].astype(np.float32))
    sim.measure()


def energies(sim: sw.Simulation) -> np.ndarray:
    sim.measure_energy()
    return sim.diagnostics.energy.numpy()


def free_dofs(stiffness: tuple[float, ...], rest: tuple[float, ...] = (0.6, -0.5, 0.4), **more: Any) -> list[Dof]:
    return [Dof(stiffness=k, rest=r, **more) for k, r in zip(stiffness, rest, strict=True)]


LAWS = {
    "even": free_dofs(EVEN),
    "uneven": free_dofs(UNEVEN),
    "tables": free_dofs((0.0, 0.0, 0.0), spring_table=BENT),
    "preload": free_dofs(UNEVEN, preload=0.7),
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("place", PLACES)
def test_the_torque_is_the_gradient_of_the_measured_energy(place, law):
    """Central differences over 1e-4 rad in float64: their error is 1e-8 of the third derivative of the potential, some
    100 N·m here, and rounding of the energy 1e-15 / 1e-4; the torque is float32, of a step in which nothing turns.
    """
    rng = np.random.default_rng(4)
    turns = Rotation.from_rotvec(np.repeat(rng.normal(size=(4, 3)), 7, axis=0))
    delta = 1e-4
    shifts = np.tile(np.vstack([np.zeros(3), delta * np.eye(3), -delta * np.eye(3)]), (4, 1))
    model = sprung(place, LAWS[law]).finalize(28, "cpu")
    sim = sw.Simulation(model, 1e-6, joint_reactions=True)
    place_body(sim, Rotation.from_rotvec(shifts) * turns)
    values = energies(sim).reshape(4, 7)
    gradient = (values[:, 1:4] - values[:, 4:7]) / (2.0 * delta)
    sim.step()
    joint = model.joint_names.index("spring")
    torque = sim.diagnostics.joint_reaction_torque.numpy()[::7, joint]
    np.testing.assert_allclose(torque, -gradient, rtol=1e-5, atol=2e-5)


def passive_motion(place: str, even: bool, dt: float, *, worlds: int, seconds: float) -> None:
    """Worlds with springs, rests and motions of their own, from soft ones to h²k/I of 100: none ever has more energy
    than at first. The implicit step loses energy; float32 may give back some 1e-6 of it.
    """
    rng = np.random.default_rng(7)
    model = sprung(place, free_dofs(EVEN if even else UNEVEN), (0.0, 0.0, -9.81)).finalize(
        worlds, "cpu", per_world=["joint_stiffness", "joint_rest"]
    )
    columns = rotation_columns(model)
    stiffness, rest = model.joint_stiffness.numpy(), model.joint_rest.numpy()
    share = np.ones((worlds, 3)) if even else 10.0 ** rng.uniform(-3.0, 0.0, (worlds, 3))
    stiffness[:, columns] = share * 10.0 ** rng.uniform(-1.0, np.log10(10.0 / dt**2), (worlds, 1))
    rest[:, columns] = rng.normal(size=(worlds, 3))
    model.joint_stiffness.assign(stiffness)
    model.joint_rest.assign(rest)
    sim = sw.Simulation(model, dt)
    place_body(sim, Rotation.from_rotvec(rng.normal(size=(worlds, 3))), rng.normal(size=(worlds, 3)))
    first = energies(sim)
    scale = np.abs(first) + 3.0  # m g l is 3 J
    for _ in range(10):
        sim.step(round(0.1 * seconds / dt))
        assert (energies(sim) <= first + 1e-5 * scale).all(), (energies(sim) - first).max()
    assert not sim.state.world_status.numpy().any()


@pytest.mark.parametrize("even", [True, False], ids=["even", "uneven"])
@pytest.mark.parametrize("place", PLACES)
def test_a_passive_spring_never_gains_energy(place, even):
    passive_motion(place, even, 4e-3, worlds=12, seconds=2.0)


@pytest.mark.slow
@pytest.mark.parametrize("dt", [5e-4, 1e-3, 4e-3])
@pytest.mark.parametrize("even", [True, False], ids=["even", "uneven"])
@pytest.mark.parametrize("place", PLACES)
def test_many_passive_springs_never_gain_energy(place, even, dt):
    passive_motion(place, even, dt, worlds=60, seconds=10.0)


def test_the_example_of_a_ball_with_a_rest_keeps_its_energy():
    """It was gained without bound, 2300 J after 10 s."""
    model = sprung("ball", free_dofs(EVEN)).finalize(1, "cpu")
    sim = sw.Simulation(model, 1e-3)
    first = energies(sim)
    assert first == pytest.approx(0.77)  # 2 / 2 of |rest|²
    for _ in range(10):
        sim.step(1000)
        assert energies(sim) <= first * (1.0 + 1e-5)


@pytest.mark.parametrize("stiffness", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("place", PLACES)
def test_a_damped_spring_comes_to_rest_at_its_rest(place, stiffness):
    """The slowest mode, 0.5 N·m/rad against 0.3 N·m·s/rad, has e^-33 left after 20 s; then float32."""
    rest = (0.6, -0.5, 0.4)
    dofs = free_dofs(stiffness, rest, damping=0.3)
    model = sprung(place, dofs).finalize(1, "cpu")
    sim = sw.Simulation(model, 4e-3)
    place_body(sim, Rotation.from_rotvec([[-1.0, 0.8, 0.5]]))
    sim.step(5000)
    turn = sim.state.joint_x.numpy()[0, rotation_columns(model)]
    np.testing.assert_allclose(relative_rotation(turn, np.array(rest)), 0.0, atol=1e-4)


@pytest.mark.parametrize("stiffness", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_small_oscillations_about_the_rest(stiffness):
    """A ball at the centre of mass: I x'' = -K x in the axes of frame 0, with I turned to the rest."""
    rest = np.array([0.625, -0.5, 0.375])  # float32 has these
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("body", mass=1.0, inertia=INERTIA)
    builder.add_joint_spherical("spring", WORLD, body, anchor=(0, 0, 0), dofs=free_dofs(stiffness, tuple(rest)))
    turned = Rotation.from_rotvec(rest).as_matrix()
    inertia = turned @ np.diag(INERTIA) @ turned.T
    root = np.linalg.inv(np.linalg.cholesky(inertia))
    squares, modes = np.linalg.eigh(root @ np.diag(stiffness) @ root.T)
    dt = 4e-4
    sim = sw.Simulation(builder.finalize(3, "cpu"), dt)
    shapes = (root.T @ modes).T
    shapes *= 1e-5 / np.linalg.norm(shapes, axis=1, keepdims=True)
    place_body(sim, Rotation.from_rotvec(shapes) * Rotation.from_rotvec(np.tile(rest, (3, 1))))
    for mode, square in enumerate(squares):
        period = 2.0 * np.pi / np.sqrt(square)
        steps = round(period / dt)
        fresh = sw.Simulation(sim.model, dt)
        fresh.state.body_rot.assign(sim.state.body_rot.numpy())
        fresh.measure()
        fresh.step(steps)
        after = relative_rotation(fresh.state.joint_x.numpy()[mode], rest)
        # damped by backward Euler; the springs' quadratic terms are (k_i - k_j) / k of the amplitude, less than 1e-3
        expected = shapes[mode] * np.exp(-0.5 * square * dt * period)
        np.testing.assert_allclose(after, expected, atol=2e-3 * float(np.linalg.norm(shapes[mode])))


def test_unequal_stiffness_of_worlds_of_an_even_ball_stays_passive():
    """Built alike about all axes, the ball has no rows: worlds that differ take the largest stiffness implicitly."""
    rng = np.random.default_rng(9)
    model = sprung("ball", free_dofs(EVEN)).finalize(30, "cpu", per_world=["joint_stiffness"])
    model.joint_stiffness.assign(10.0 ** rng.uniform(-1.0, 5.0, (30, 3)))
    sim = sw.Simulation(model, 1e-3)
    place_body(sim, Rotation.from_rotvec(rng.normal(size=(30, 3))))
    first = energies(sim)
    for _ in range(20):
        sim.step(100)
        assert (energies(sim) <= first * (1.0 + 1e-5)).all()


@pytest.mark.parametrize("gains", [(30.0, 30.0, 30.0), (30.0, 5.0, 80.0)], ids=["even", "uneven"])
@pytest.mark.parametrize("limit", [float("inf"), 3.0])
@pytest.mark.parametrize("place", ["ball", "loop"])
def test_drives_hold_a_target_rotation(place, limit, gains):
    """exp(target), from any start: drives with damping lose energy, of which only the target has the least."""
    drives = [Dof(drive=PositionDrive(stiffness=k, damping=2.0, effort_limit=limit)) for k in gains]
    model = sprung(place, drives).finalize(4, "cpu")
    sim = sw.Simulation(model, 4e-3)
    rng = np.random.default_rng(2)
    place_body(sim, Rotation.from_rotvec(rng.normal(size=(4, 3))))
    columns = rotation_columns(model)
    targets = rng.normal(size=(4, 3))
    wanted = np.zeros((4, model.dof_count))
    wanted[:, columns] = targets
    sim.control.joint_target_q.assign(wanted.astype(np.float32))
    sim.step(1500)
    for turn, target in zip(sim.state.joint_x.numpy()[:, columns], targets, strict=True):
        np.testing.assert_allclose(relative_rotation(turn, target), 0.0, atol=1e-4)


def test_beyond_half_a_turn_the_spring_pulls_the_other_way():
    """The potential of the rotation is that of the smaller angle: it has a ridge at half a turn, which a body with more
    energy passes. Nothing is gained there.
    """
    model = sprung("ball", free_dofs(EVEN, (0.0, 0.0, 0.0))).finalize(1, "cpu")
    sim = sw.Simulation(model, 1e-3)
    ridge = 0.5 * EVEN[0] * np.pi**2
    inertia = INERTIA[0] + 0.1  # about the anchor, m l² included: its largest is below this
    place_body(sim, Rotation.from_rotvec([[0.0, 0.0, 0.0]]), np.array([[0.0, 0.0, np.sqrt(6.0 * ridge / inertia)]]))
    first = energies(sim)
    turns = []
    for _ in range(400):
        sim.step(5)
        turns.append(np.linalg.norm(sim.state.joint_q.numpy()[0]))
        assert energies(sim) <= first * (1.0 + 1e-5)
    assert max(turns) > 3.0  # it did pass
    assert max(turns) <= np.pi + 1e-6


def test_springs_beside_a_prescribed_axis():
    """One axis is held: about the two others the body swings, and gains nothing."""
    dofs = free_dofs(UNEVEN, (0.3, -0.2, 0.4))
    dofs[1] = Dof(drive=PrescribedPosition())
    for place in ("ball", "loop"):
        model = sprung(place, dofs).finalize(1, "cpu")
        sim = sw.Simulation(model, 1e-3)
        sim.step(3000)
        rate = sim.state.joint_qd.numpy()[0, rotation_columns(model)]
        # a rotation vector of which one component stays at zero still needs a rate about that axis, of second order
        assert np.isfinite(rate).all()
        assert abs(sim.state.joint_q.numpy()[0, rotation_columns(model)][1]) < 5e-3


def test_a_ball_of_the_tree_has_rows_only_where_its_springs_differ():
    for dofs, rows in ((LAWS["even"], 0), (LAWS["uneven"], 3), (LAWS["tables"], 3), ([Dof(damping=1.0)] * 3, 0)):
        tables = sprung("ball", dofs).finalize(1, "cpu").tables
        assert tables.row_count == rows
        assert [link.type for link in tables.links] == [JointType.SPHERICAL]


SIDE_BY_SIDE = {
    **LAWS,
    "drives": [Dof(stiffness=2.0, rest=0.4, drive=PositionDrive(stiffness=k, damping=0.3)) for k in UNEVEN],
    "bounded drives": [
        Dof(stiffness=k, damping=0.1, drive=PositionDrive(stiffness=30.0, damping=0.3, effort_limit=2.0)) for k in EVEN
    ],
}


@pytest.mark.parametrize("law", SIDE_BY_SIDE)
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.sweep
def test_steps_are_those_of_the_reference(place, law):
    if place == "floating" and law == "bounded drives":
        pytest.skip("a floating body has none")
    builder = sprung(place, SIDE_BY_SIDE[law], (1.0, 2.0, -9.81))
    spec = builder.bodies[0]
    omega = np.array([0.7, -1.1, 0.4])
    builder.bodies[0] = dataclasses.replace(spec, omega=omega, velocity=np.cross(omega, spec.pose.position))

    def controls(rng: np.random.Generator, step: int) -> Controls:
        count = builder.dof_count
        return {"joint_force": rng.normal(size=count), "joint_target_q": rng.normal(size=count),
                "joint_target_qd": rng.normal(size=count)}  # fmt: skip

    assert_same_steps(builder, controls=controls, steps=6)
