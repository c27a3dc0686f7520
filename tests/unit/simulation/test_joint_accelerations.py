"""`Diagnostics.joint_qdd` against closed forms, MuJoCo's forward dynamics, and the rates that a step publishes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.bench.contact_peers import ANT_FILE
from simwarp.core.rotation import matrix_of
from simwarp.core.types import WORLD, PrescribedPosition
from simwarp.simulation.state import State
from tests.reference.mechanisms import random_mechanism

G = 9.81


def qdd(sim: sw.Simulation) -> np.ndarray:
    return sim.diagnostics.joint_qdd.numpy().astype(float)


def pendulum() -> sw.ModelBuilder:
    """A bar that hangs level, 0.5 m from its hinge to its centre."""
    builder = sw.ModelBuilder()
    bar = builder.add_body("bar", mass=2.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.5, 0.0, 0.0)))
    builder.add_joint_revolute("hinge", WORLD, bar, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0))
    return builder


def test_a_pendulum_in_closed_form() -> None:
    """m g l cos q / (I + m l²), whatever the rate is: sums with the rate itself are left out. What bends the path,
    ω² l = 1250 m/s² across the motion, leaves a rounding in float32.
    """
    angle = np.linspace(-1.5, 1.5, 7)
    sim = sw.Simulation(pendulum().finalize(7, "cpu"), 1e-5, joint_accelerations=True)
    sim.set_joint_state(None, angle[:, None], np.full((7, 1), 50.0))
    expected = 2.0 * G * 0.5 * np.cos(sim.state.joint_q.numpy()[:, 0]) / (0.1 + 2.0 * 0.25)
    sim.step()
    # a rate of 50 rad/s has an ulp of 4e-6: the difference of two published ones would be off by 0.4 rad/s²
    rounding = float(np.finfo(np.float32).eps) * 50.0**2 * 0.5
    np.testing.assert_allclose(qdd(sim)[:, 0], expected, atol=rounding)


def test_of_the_last_substep_and_divided_by_its_time() -> None:
    whole, parts = (
        sw.Simulation(pendulum().finalize(1, "cpu"), dt, substeps=substeps, joint_accelerations=True)
        for dt, substeps in ((1e-3, 1), (4e-3, 4))
    )
    whole.advance(4)
    parts.step()
    assert qdd(parts).tobytes() == qdd(whole).tobytes()


def test_a_free_body_at_its_anchor() -> None:
    """The anchor of a spinning body falls, and turns about the centre: a + α × r + ω × (ω × r)."""
    builder = sw.ModelBuilder()
    inertia, omega, arm = np.array([0.1, 0.2, 0.25]), np.array([0.3, -0.2, 0.5]), np.array([0.2, 0.1, -0.3])
    body = builder.add_body("body", mass=3.0, inertia=inertia, velocity=(1.0, 0.0, 0.0), omega=omega)
    builder.add_joint_free("root", body, anchor=arm)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-5, joint_accelerations=True)
    force, torque = np.array([1.0, 2.0, 3.0]), np.array([0.5, -0.3, 0.2])
    sim.control.body_force[0, 0] = force
    sim.control.body_torque[0, 0] = torque
    sim.step()
    alpha = (torque - np.cross(omega, inertia * omega)) / inertia
    linear = force / 3.0 + (0.0, 0.0, -G) + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    # the gyroscopic torque is that of the middle of the step
    np.testing.assert_allclose(qdd(sim)[0], [*linear, *alpha], atol=1e-4)


def test_a_prescribed_motion_has_its_own_acceleration() -> None:
    times = np.linspace(0.0, 1.0, 101)
    builder = sw.ModelBuilder()
    for name in ("a", "b"):
        builder.add_body(name, mass=1.0, inertia=(0.1, 0.1, 0.1))
    table = (tuple(times), tuple(0.5 * 3.0 * times**2))
    builder.add_joint_revolute("driven", WORLD, 0, axis=(0.0, 0.0, 1.0), drive=PrescribedPosition(table=table))
    builder.add_joint_revolute("carried", 0, 1, axis=(0.0, 0.0, 1.0))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 0.01, joint_accelerations=True)
    sim.advance(20)
    # the second difference of the table, over rates of 0.6 rad/s in float32 (6e-8 / 0.01 s); nothing turns the other
    np.testing.assert_allclose(qdd(sim)[0], [3.0, -3.0], atol=5e-5)


@pytest.mark.parametrize("name", ["four_bar", "busy", "linkage"])
def test_it_is_the_change_of_the_published_rates(name: str) -> None:
    """In the tree and out of it, with loops, couplings and positions that are projected."""
    made = {"busy": lambda: random_mechanism(0, bounds=True, couplings=True)}.get(name) or getattr(scenes, name)
    builder = made()
    builder.add_shaft("spun", inertia=0.1, speed=2.0)
    dt = 1e-3
    sim = sw.Simulation(builder.finalize(2, "cpu"), dt, joint_accelerations=True)
    force = np.random.default_rng(1).normal(size=(2, sim.model.dof_count))
    sim.control.joint_force.assign(force.astype(np.float32))
    free = [
        dof for joint, kind in enumerate(sim.model.joint_types) if kind is sw.JointType.FREE
        for dof in range(*sim.model.joint_dof_start[joint : joint + 2])
    ]  # fmt: skip
    for _ in range(5):
        before = sim.state.joint_qd.numpy().astype(float)
        sim.step()
        after = sim.state.joint_qd.numpy().astype(float)
        # two roundings of the rate to float32
        rounding = 2.0 * np.finfo(np.float32).eps * np.maximum(np.abs(after), np.abs(before)).max() / dt
        wrong = np.abs(qdd(sim) - (after - before) / dt)
        wrong[:, free] = 0.0  # whose anchors' published rates are those of the frames of a step before
        assert wrong.max() <= rounding + 1e-6 * np.abs(after - before).max() / dt
    assert np.abs(qdd(sim)).max() > 0.1


BY_LEG = np.array([0, 4, 1, 5, 2, 6, 3, 7])
"""Coordinates of simwarp's ant in the order of MuJoCo's."""


def mujoco_qdd(sim: sw.Simulation, torque: np.ndarray) -> np.ndarray:
    """`mj_forward` of the ants' states, without constraints, as rates of simwarp."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(ANT_FILE))
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= int(off.mjDSBL_CONSTRAINT) | int(off.mjDSBL_ACTUATION)
    data = mujoco.MjData(model)
    fields = (sim.state.body_x, sim.state.body_rot, sim.state.body_v, sim.state.body_omega)
    x, rot, v, omega = (array.numpy()[:, 0].astype(float) for array in fields)
    q, qd = sim.state.joint_x.numpy(), sim.state.joint_qd.numpy().astype(float)
    found = np.zeros_like(q)
    for world in range(len(q)):
        axes = matrix_of(rot[world])
        data.qpos[:] = [*x[world], rot[world, 3], *rot[world, :3], *q[world, BY_LEG]]
        data.qvel[:] = [*v[world], *(omega[world] @ axes), *qd[world, BY_LEG]]
        data.qfrc_applied[6:] = torque[world, BY_LEG]
        mujoco.mj_forward(model, data)
        found[world, BY_LEG] = data.qacc[6:]
        found[world, 8:] = [*data.qacc[:3], *(axes @ data.qacc[3:6])]
    return found


@pytest.mark.parametrize(("steps", "passes"), [(0, 0), (1, 0), (5, 0), (5, 1)])
def test_an_ant_in_the_air_against_mujoco(steps: int, passes: int) -> None:
    """Also in the first step after a state was set, when positions and velocities do not tell velocity products; and
    where projected positions tell them otherwise.
    """
    worlds, rng = 16, np.random.default_rng(0)
    builder = scenes.ant(height=5.0, ground=False)
    builder.add_joint_free("root", 0)
    solver = sw.SolverOptions(position_projection=passes)
    sim = sw.Simulation(builder.finalize(worlds, "cpu"), 1e-5, solver=solver, joint_accelerations=True)
    q = rng.uniform(-0.4, 0.4, (worlds, 14))
    q[:, 8:] = rng.normal(size=(worlds, 6))
    torque = rng.uniform(-5.0, 5.0, (worlds, 8))
    sim.set_joint_state(None, q, rng.uniform(-2.0, 2.0, (worlds, 14)))
    sim.control.joint_force[:, :8] = torque.astype(np.float32)
    sim.advance(steps)
    expected = mujoco_qdd(sim, torque.astype(np.float32))
    sim.step()
    # float32 answers of ten links to 3e-6; a step takes its forces up to 1e-5 s from its start
    assert np.abs(qdd(sim) - expected).max() <= 1e-5 * np.abs(expected).max()


def test_coupled_hinges_share_their_velocity_products() -> None:
    """An arm of two bars whose hinges turn alike, in closed form, right after its state was set."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    mass, length, inertia = (2.0, 1.5), 0.8, (0.1, 0.2)
    for k in range(2):
        at = sw.pose(((k + 0.5) * length, 0.0, 0.0))
        builder.add_body(f"bar{k}", mass=mass[k], inertia=(1.0, 1.0, inertia[k]), pose=at)
        builder.add_joint_revolute(f"hinge{k}", k - 1, k, axis=(0.0, 0.0, 1.0), anchor=(k * length, 0.0, 0.0))
    builder.add_coupling("alike", [(0, 1.0), (1, -1.0)], offset=0.0)
    sim = sw.Simulation(builder.finalize(4, "cpu"), 1e-5, joint_accelerations=True)
    angle, rate = np.array([0.3, 0.8, -1.2, 2.0]), np.array([2.0, -1.5, 1.0, 2.0])
    sim.set_joint_state(None, np.stack([angle, angle], 1), np.stack([rate, rate], 1))
    sim.step()
    # L = ½ M(q) q̇² of the one coordinate: M q̈ = -½ M' q̇²
    arm = 0.5 * length
    m = inertia[0] + mass[0] * arm**2 + 4.0 * inertia[1]
    m = m + mass[1] * (length**2 + 4.0 * arm**2 + 4.0 * length * arm * np.cos(angle))
    slope = -4.0 * mass[1] * length * arm * np.sin(angle)
    expected = -0.5 * slope * rate**2 / m
    np.testing.assert_allclose(qdd(sim), np.stack([expected, expected], 1), atol=2e-5 * np.abs(expected).max())


TREE_KINDS = ("revolute", "prismatic", "spherical", "cylindrical", "universal", "planar")


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("kind", TREE_KINDS)
def test_the_first_step_knows_the_velocity_products_of_every_joint(kind: str, flipped: bool) -> None:
    """They are those of the motion that follows, whose steps get them from positions and velocities."""
    rng = np.random.default_rng(3)
    builder = sw.ModelBuilder(gravity=(1.0, -2.0, 3.0))
    for k in range(4):
        builder.add_body(f"b{k}", mass=1.0 + k, inertia=(0.2, 0.3, 0.4), pose=sw.pose((0.6 * k, 0.1, 0.2 * k)))
    for k, each in enumerate((kind, "revolute", kind)):
        axis = rng.normal(size=3)
        across = np.cross(axis, rng.normal(size=3))
        options: dict[str, Any] = {
            "spherical": {}, "planar": {"normal": axis}, "universal": {"axis0": axis, "axis1": across},
        }.get(each, {"axis": axis})  # fmt: skip
        anchor = 0.1 * rng.normal(size=3) + (0.6 * k + 0.3, 0.1, 0.2 * k)
        ends = (k + 1, k) if flipped else (k, k + 1)
        getattr(builder, f"add_joint_{each}")(f"j{k}", *ends, anchor=anchor, **options)
    builder.add_joint_free("root", 0, anchor=(0.2, 0.3, 0.1))
    dt, steps = 1e-4, 40
    sim = sw.Simulation(builder.finalize(1, "cpu"), dt, joint_accelerations=True)
    count = sim.model.dof_count
    sim.set_joint_state(None, 0.3 * rng.normal(size=(1, count)), 2.0 * rng.normal(size=(1, count)))
    sim.step()
    first = qdd(sim)[0]
    sim.advance(4)
    start = sim.state.joint_qd.numpy()[0].astype(float)
    sim.advance(steps)
    change = (sim.state.joint_qd.numpy()[0].astype(float) - start) / (steps * dt)
    # it changes by some percent over the 4 ms; each velocity product that is left out is more than that
    assert np.abs(first - change).max() <= 0.05 * np.abs(change).max()


@pytest.mark.parametrize("name", ["four_bar", "ant"])
def test_asking_changes_nothing(name: str) -> None:
    silent, asked = (
        sw.Simulation(getattr(scenes, name)().finalize(2, "cpu"), 2e-3, joint_accelerations=asked)
        for asked in (False, True)
    )
    assert silent.diagnostics.joint_qdd.shape == (0, silent.model.dof_count)
    assert asked.diagnostics.joint_qdd.shape == (2, asked.model.dof_count)
    for sim in (silent, asked):
        sim.advance(20)
    for field in State.NAMES:
        assert getattr(silent.state, field).numpy().tobytes() == getattr(asked.state, field).numpy().tobytes(), field
