"""`Simulation.problems()`: every diagnostic has a threshold, and what is sound has no line."""

from __future__ import annotations

import numpy as np
import pytest

import simwarp as sw
from simwarp import scenes
from simwarp.core.types import JointType
from simwarp.model.joint_types import ELEMENTS
from simwarp.simulation.joint_errors import joint_errors, sound_travels
from tests.reference.mechanisms import random_mechanism


def hanging_weight(links: int, light: float, heavy: float, length: float = 0.2) -> sw.ModelBuilder:
    """A chain of light links, held at an angle, with a weight at its end."""
    builder = sw.ModelBuilder()
    parent, along = sw.WORLD, np.array([np.sin(1.0), 0.0, -np.cos(1.0)])
    for link in range(links + 1):
        mass, name = (light, f"link{link}") if link < links else (heavy, "weight")
        body = builder.add_body(
            name, mass=mass, inertia=(mass * length**2 / 12.0,) * 3, pose=sw.pose(along * length * (link + 0.5))
        )
        builder.add_joint_revolute(f"j{link}", parent, body, axis=(0, 1, 0), anchor=along * length * link)
        parent = body
    return builder


@pytest.mark.parametrize(("links", "light", "heavy"), [(10, 0.01, 10.0), (3, 0.005, 20.0)])
def test_a_chain_that_falls_apart_is_named(links, light, heavy):
    """Light links under tension vibrate with 2 sqrt(T / (m l)), which times the step is beyond 2."""
    builder = hanging_weight(links, light, heavy)
    assert 2.0 * np.sqrt(heavy * 9.81 / (light * 0.2)) * 5e-3 > 2.0
    sim = sw.Simulation(builder.finalize(2, "cpu"), 5e-3)
    sim.step(400)
    reach = (links + 1) * 0.2
    assert np.linalg.norm(sim.body_position("weight")) > 1.5 * reach
    found = sim.problems()
    assert [line.split(":")[0] for line in found] == ["world 0", "world 1"]
    for part in (
        "joint 'j",
        " m apart, a sound step leaves less than 0.005 m; take more substeps",
        f"{heavy / light:.2g} times",
    ):
        assert part in found[0]


def test_the_remedy_of_that_line_helps():
    sim = sw.Simulation(hanging_weight(10, 0.01, 10.0).finalize(1, "cpu"), 5e-3, substeps=5)
    for _ in range(20):
        sim.step(20)
        assert sim.problems() == []
    assert float(sim.diagnostics.position_error.numpy()[0]) < 1e-4


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_errors_of_joints_are_those_that_were_made(seed):
    """A body moved by hand is apart from its neighbours by as much, in the directions that each joint holds."""
    builder = random_mechanism(seed, bounds=True, couplings=True)
    model = builder.finalize(2, "cpu")
    sim = sw.Simulation(model, 1e-3)
    worlds = np.arange(2)
    assert max(errors.max(initial=0.0) for errors in joint_errors(model, sim.state, worlds)) < 1e-6
    moved = model.body_count - 1
    shift = np.array([0.03, -0.05, 0.07])
    x = sim.state.body_x.numpy().copy()
    x[1, moved] += shift
    sim.state.body_x.assign(x)
    errors = joint_errors(model, sim.state, worlds)
    assert errors.travel[0].max(initial=0.0) < 1e-6
    assert errors.angle.max(initial=0.0) < 1e-6
    for joint, spec in enumerate(builder.joints):
        touched = moved in (spec.parent, spec.child) and bool(ELEMENTS[spec.type].rows)
        if touched and spec.type in (JointType.FIXED, JointType.REVOLUTE, JointType.SPHERICAL, JointType.UNIVERSAL):
            assert errors.travel[1, joint] == pytest.approx(np.linalg.norm(shift), rel=1e-6)
        elif not touched:
            assert errors.travel[1, joint] < 1e-6


def test_a_turned_body_is_named_by_its_angle():
    builder = sw.ModelBuilder(gravity=(0, 0, 0))
    body = builder.add_body("door", mass=1.0, inertia=(0.1,) * 3)
    builder.add_joint_revolute("hinge", sw.WORLD, body, axis=(0, 0, 1), anchor=(0, 0, 0))
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    angle = 0.4
    sim.state.body_rot.assign([[[np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)]]])
    sim.step()
    (line,) = sim.problems()
    # one step takes max_depenetration_rate of it away, 3 rad/s in 1 ms; the row is the sine
    assert f"joint 'hinge' is {np.sin(angle - 3e-3):.2g} rad apart, a sound step leaves less than 0.05 rad" in line
    sim.step(200)
    assert sim.problems() == []


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("row_residual", 0.5, "loops and couplings are not kept: rows are off by 0.5 m/s or rad/s"),
        ("row_residual", float("nan"), "loops and couplings are not kept"),
        ("cone_residual", 0.1, "not converged: residual 0.1 m/s"),
        ("cone_residual", float("nan"), "not converged"),
        ("joint_reaction_force", float("inf"), "joint_reaction_force must be finite, got inf"),
        ("joint_reaction_torque", float("nan"), "joint_reaction_torque must be finite, got nan"),
        ("joint_qdd", float("inf"), "joint_qdd must be finite, got inf"),
        ("energy", float("nan"), "energy must be finite, got nan"),
    ],
)
def test_every_diagnostic_is_read(name, value, words):
    sim = sw.Simulation(
        scenes.four_bar().finalize(3, "cpu"), 1e-3, joint_reactions=True, joint_accelerations=True
    )  # fmt: skip
    sim.step(5)
    sim.measure_energy()
    assert sim.problems() == []
    array = getattr(sim.diagnostics, name)
    values = array.numpy().copy()
    values[1, ...] = value
    array.assign(values)
    (line,) = sim.problems()
    assert line.startswith(f"world 1: {words}")
    assert "\n" not in line


def test_no_diagnostic_is_forgotten():
    """Each has a check, or is a count that says nothing by itself."""
    read = {
        "row_residual", "cone_residual", "position_error", "joint_reaction_force", "joint_reaction_torque", "joint_qdd",
        "energy",
    }  # fmt: skip
    model = scenes.four_bar().finalize(1, "cpu")
    names = set(sw.Simulation(model, 1e-3).diagnostics.FIELDS)
    assert names == read | {"constraint_count", "iterations"}


def test_rows_are_judged_by_the_speed_of_their_world():
    """An error of 0.5 m/s is much at some m/s, and nothing at 100 m/s."""
    sim = sw.Simulation(scenes.four_bar().finalize(2, "cpu"), 1e-3)
    sim.diagnostics.row_residual.assign([0.5, 0.5])
    velocity = sim.state.body_v.numpy().copy()
    velocity[1, 0] = (100.0, 0.0, 0.0)
    sim.state.body_v.assign(velocity)
    assert [line.split(":")[0] for line in sim.problems()] == ["world 0"]


def test_sound_travels_follow_the_levers():
    builder = hanging_weight(2, 0.1, 1.0, length=0.3)
    wheel = builder.add_body("wheel", mass=1.0, inertia=(0.1,) * 3, pose=sw.pose((0, 1, 0)))
    builder.add_joint_revolute("axle", sw.WORLD, wheel, axis=(0, 1, 0), anchor=(0, 1, 0))
    travels = sound_travels(builder.finalize(1, "cpu"))
    assert travels == pytest.approx([0.05 * 0.15] * 3 + [1e-3])
