"""Combinations, coordinates that are sums of others: against the float64 reference, one step at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import WORLD, Dof, JointType, pose
from simwarp.model.builder import ModelBuilder
from tests.reference.mechanisms import _set_consistent_velocities as set_consistent_velocities
from tests.unit.kernels.dynamics.side_by_side import assert_same_steps
from tests.unit.kernels.dynamics.test_step_against_reference import LAWS, law_controls, ring


def branched(*, floating: bool = False) -> tuple[ModelBuilder, list[tuple[int, float] | tuple[int, int, float]]]:
    """A tree with two branches and a shaft; terms on joints of both, of all kinds that can be named."""
    rng = np.random.default_rng(4)
    builder = ModelBuilder(gravity=(1.0, -2.0, -5.0))
    for k in range(6):
        builder.add_body(
            f"b{k}", mass=1.0 + 0.3 * k, inertia=(0.02, 0.03, 0.04),
            pose=pose((0.4 * k, 0.1 * k * k, 0.1), rng.normal(size=4)),
        )  # fmt: skip
    axes = rng.normal(size=(6, 3))
    if floating:
        builder.add_joint_free("root", 0)
    else:
        builder.add_joint_spherical("root", WORLD, 0, anchor=(-0.2, 0.1, 0.0))
    hinge = builder.add_joint_revolute("hinge", 0, 1, axis=axes[1], anchor=(0.2, 0.0, 0.1), damping=0.2)
    slide = builder.add_joint_prismatic("slide", 1, 2, axis=axes[2])
    screw = builder.add_joint_cylindrical("screw", 0, 3, axis=axes[3], anchor=(0.7, 0.4, 0.0))
    cross = np.cross(axes[4], axes[5])
    cardan = builder.add_joint_universal("cardan", 3, 4, anchor=(1.3, 1.2, 0.0), axis0=axes[4], axis1=cross)
    flat = builder.add_joint_planar("flat", 4, 5, normal=axes[5], anchor=(1.8, 2.0, 0.0))
    shaft = builder.add_shaft("shaft", inertia=0.05, position=0.2, speed=1.5)
    terms: list[Any] = [
        (hinge, 0.7), (slide, -2.0), (screw, 1, 1.3), (cardan, 0, -0.4), (cardan, 1, 0.6), (flat, 0, 0.8),
        (flat, 2, -0.5), (shaft, 0.3),
    ]  # fmt: skip
    return builder, terms


def near_start(dof: Dof) -> dict[str, Any]:
    """The fields of a law, with its stops about the place where the combination starts."""
    fields = dict(vars(dof))
    at = 0.3 * 0.2  # of the shaft
    if dof.limit is not None:
        fields["limit"] = (dof.limit[0] + at, dof.limit[1] + at)
    return fields


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.sweep
def test_law_on_a_combination(law: str) -> None:
    builder, terms = branched()
    builder.add_combination("sum", terms, **near_start(LAWS[law]))
    set_consistent_velocities(builder, np.random.default_rng(1), 1.0)
    assert_same_steps(builder, controls=law_controls(builder), steps=6)


@pytest.mark.parametrize("law", ["spring", "friction", "limit near", "bounded drive and all"])
def test_combinations_that_share_terms_beside_couplings(law: str) -> None:
    builder, terms = branched(floating=True)
    builder.add_coupling("gear", [terms[0], terms[-1]])
    first = builder.add_combination("first", terms[:4], **vars(LAWS[law]))  # without the shaft: it starts at 0
    builder.add_combination("second", terms[2:], **near_start(LAWS["limit near"]))
    builder.add_combination("of sums", [(first, 2.0), terms[5]], friction=0.5, stiffness=3.0)
    builder.add_combination("silent", terms[1:3])
    set_consistent_velocities(builder, np.random.default_rng(1), 1.0)
    assert_same_steps(builder, controls=law_controls(builder), steps=6)


@pytest.mark.parametrize("law", ["spring", "target speed", "friction", "limit near", "motor", "bounded drive"])
def test_law_on_a_combination_over_a_closed_loop(law: str) -> None:
    builder = ring(JointType.POINT_ON_LINE, Dof())
    builder.add_combination("sum", [(1, 0.8), (3, -1.2), (6, 0.5)], **vars(LAWS[law]))
    assert_same_steps(builder, controls=law_controls(builder), steps=6)


@pytest.mark.parametrize("law", ["spring", "friction", "limit near", "bounded drive and all"])
def test_a_combination_of_one_coordinate_is_that_coordinate(law: str) -> None:
    """The same law on the joint itself, and on a sum of which it is the only term: the same motion."""
    ends = []
    for combined in (False, True):
        builder = ModelBuilder()
        body = builder.add_body("b", mass=2.0, inertia=(0.1, 0.1, 0.1), pose=pose((0.3, 0.0, 0.0)))
        options = vars(LAWS[law])
        hinge = builder.add_joint_revolute(
            "hinge", WORLD, body, axis=(0, 1, 0), anchor=(0, 0, 0), **({} if combined else options)
        )
        if combined:
            builder.add_combination("sum", [(hinge, 1.0)], **options)
        sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3, threads=1)
        column = int(combined)
        sim.control.joint_target_q[:, column] = 0.01
        sim.control.joint_force[:, column] = 0.4
        for _ in range(100):
            sim.step()
        assert sim.state.joint_q.numpy()[0, column] == sim.state.joint_q.numpy()[0, 0]
        ends.append((sim.state.joint_x.numpy()[0, 0], sim.state.joint_qd.numpy()[0, 0]))
    # a row beside the tree, or a part of it: 100 roundings of float32, and bounds to the solver's tolerance
    assert ends[0] == pytest.approx(ends[1], rel=2e-5, abs=1e-5)
