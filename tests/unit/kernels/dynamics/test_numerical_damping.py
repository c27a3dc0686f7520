"""Springs, dampers and drives at other values of `numerical_damping`: each step against the float64 reference."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import Dof, JointType, PositionDrive
from simwarp.model.builder import ModelBuilder
from tests.reference.mechanisms import _set_consistent_velocities as set_consistent_velocities, random_mechanism
from tests.unit.kernels.dynamics.side_by_side import EPS, assert_same_steps
from tests.unit.kernels.dynamics.test_step_against_reference import (
    LAWS,
    add_joint,
    law_controls,
    ring,
)

DAMPING = (0.0, 0.1, 0.7)
"""Two of the range with an average of positions, one of that without."""
COMPLIANT = ("spring", "stiff spring", "spring table", "damper table", "drive over a spring", "speed table",
             "bounded drive", "bounded drive and all")  # fmt: skip


def options(damping: float) -> sw.SolverOptions:
    return sw.SolverOptions(position_projection=0, numerical_damping=damping)


def chain(kind: JointType, dof: Dof) -> ModelBuilder:
    """Three bodies in a row, with the law at the first and the last joint."""
    rng = np.random.default_rng(3)
    builder = ModelBuilder()
    for k in range(3):
        builder.add_body(f"b{k}", mass=1.0 + k, inertia=(0.02, 0.03, 0.04), pose=sw.pose((0.4 * k, 0.1, 0.0)))
        add_joint(builder, kind, f"j{k}", k - 1, k, rng, dof if k != 1 else Dof())
    set_consistent_velocities(builder, rng, 1.0)
    return builder


@pytest.mark.parametrize("damping", DAMPING)
@pytest.mark.parametrize("law", COMPLIANT)
def test_law_in_the_tree(law, damping):
    builder = chain(JointType.REVOLUTE, LAWS[law])
    assert_same_steps(builder, controls=law_controls(builder), steps=6, solver=options(damping))


@pytest.mark.parametrize("damping", DAMPING)
@pytest.mark.parametrize("law", ["spring", "drive over a spring", "bounded drive"])
@pytest.mark.parametrize("kind", [JointType.REVOLUTE, JointType.DISTANCE], ids=lambda kind: kind.name)
def test_law_on_a_loop_joint(kind, law, damping):
    dof = LAWS[law]
    if kind == JointType.DISTANCE:  # its coordinate starts at 0.4 m
        dof = dataclasses.replace(dof, rest=dof.rest + 0.4)
    builder = ring(kind, dof)
    assert_same_steps(builder, controls=law_controls(builder), steps=6, solver=options(damping))


@pytest.mark.parametrize("damping", DAMPING)
@pytest.mark.parametrize("stiffness", [(8.0, 8.0, 8.0), (8.0, 3.0, 20.0)], ids=["even", "uneven"])
@pytest.mark.parametrize("drive", [None, PositionDrive(stiffness=5.0, damping=0.2),
                                   PositionDrive(stiffness=5.0, damping=0.2, effort_limit=0.5)],
                         ids=["springs", "drives", "bounded drives"])  # fmt: skip
def test_ball_joint(drive, stiffness, damping):
    rng = np.random.default_rng(4)
    builder = ModelBuilder()
    body = builder.add_body("ball", mass=1.0, inertia=(0.02, 0.03, 0.04))
    dofs = [Dof(stiffness=k, damping=0.3, rest=0.1 * i, armature=0.01, drive=drive) for i, k in enumerate(stiffness)]
    builder.add_joint_spherical("joint", sw.WORLD, body, anchor=(0.1, 0.0, 0.2), dofs=dofs)
    set_consistent_velocities(builder, rng, 1.0)
    assert_same_steps(builder, controls=law_controls(builder), steps=6, solver=options(damping))


@pytest.mark.parametrize("damping", DAMPING)
@pytest.mark.parametrize("seed", range(4))
def test_everything_at_once(seed, damping):
    """Bushings, loops, bounds and couplings among others."""
    builder = random_mechanism(seed, bounds=True, couplings=True, floating=False)
    assert_same_steps(builder, solver=options(damping))


@pytest.mark.parametrize("damping", [0.0, 0.1, 1.0])
def test_a_viscous_coupling(damping):
    """Relative speed s of two shafts: I/2 ds/dt = -c s, whose step is the rule's with u0 = s."""
    inertia, c, h, steps = 0.1, 20.0, 1e-3, 5
    builder = ModelBuilder()
    shafts = [builder.add_shaft(f"s{k}", inertia=inertia, speed=(3.0, -1.0)[k]) for k in range(2)]
    builder.add_coupling("clutch", [(shafts[0], 1.0), (shafts[1], -1.0)], damping=c)
    sim = sw.Simulation(builder.finalize(1, "cpu"), h, solver=options(damping))
    sim.step(steps)
    share = 2.0 * c * h / inertia
    factor = (1.0 - 0.5 * (1.0 - damping) * share) / (1.0 + 0.5 * (1.0 + damping) * share)
    rates = sim.state.joint_qd.numpy()[0].astype(float)
    assert rates[0] - rates[1] == pytest.approx(4.0 * factor**steps, abs=steps * 3.0 * EPS)  # a rounding in each step
    assert rates.sum() == pytest.approx(2.0, rel=1e-6)
