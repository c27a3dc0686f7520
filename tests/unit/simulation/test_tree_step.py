"""The step of trees alone: the motion of the step that all models share, and which models have it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.kernels.dynamics import step_stages

DT = 2e-3
STEPS = 150


def arm() -> sw.ModelBuilder:
    """Three links with a limit that is reached, a spring, friction and a bounded drive."""
    builder = sw.ModelBuilder()
    options: list[dict[str, Any]] = [
        {"limit": (-0.2, 0.3)}, {"stiffness": 3.0, "damping": 0.1, "friction": 0.05},
        {"drive": sw.PositionDrive(stiffness=5.0, damping=0.2, effort_limit=0.3)},
    ]  # fmt: skip
    for k, each in enumerate(options):
        body = builder.add_body(f"b{k}", mass=1.0, inertia=(0.1, 0.1, 0.05), pose=sw.pose((0.4 * k, 0.0, 0.1)))
        axis, anchor = (0.0, 1.0, 0.2 * k), (0.4 * k - 0.2, 0.0, 0.1)
        builder.add_joint_revolute(f"j{k}", body - 1, body, axis=axis, anchor=anchor, **each)
    return builder


def motion(builder: sw.ModelBuilder, **options: Any) -> list[Any]:
    sim = sw.Simulation(builder.finalize(3, device="cpu"), DT, **options)
    sim.step(STEPS)
    return [sim.state.body_q.numpy().copy(), sim.state.body_v.numpy().copy(), sim.state.joint_q.numpy().copy()]


def used(builder: sw.ModelBuilder, monkeypatch: pytest.MonkeyPatch, **options: Any) -> str:
    """Which of the two kernels a model asks for, without compiling it."""
    asked = []

    def kernel(name: str) -> Any:
        def make(*parts: bool) -> Any:
            asked.append(name)
            raise InterruptedError

        return make

    monkeypatch.setattr(step_stages, "fused_tree_step", kernel("trees"))
    monkeypatch.setattr(step_stages, "fused_step", kernel("all"))
    with pytest.raises(InterruptedError):
        sw.Simulation(builder.finalize(1, device="cpu"), DT, **options)
    return asked.pop()


def test_the_motion_is_that_of_the_step_that_all_share(monkeypatch):
    """Compilers join products and sums in other places, so that each step may differ by some rounding of float32;
    the arm is not chaotic, and 150 steps keep errors below a hundred of those."""
    found = motion(arm())
    monkeypatch.setattr(step_stages, "fused_tree_step", lambda: step_stages.fused_step(False, False, False, False))
    for one, other in zip(found, motion(arm()), strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=100 * 1.2e-7)
    assert np.abs(found[2]).max() > 0.1


def test_reports_leave_the_motion_alone():
    plain = motion(arm())
    for one, other in zip(plain, motion(arm(), joint_accelerations=True, joint_reactions=True), strict=True):
        np.testing.assert_array_equal(one, other)


def test_whatever_needs_more_has_the_step_of_all(monkeypatch):
    loop, pair, apart = arm(), arm(), arm()
    loop.add_joint_distance("rod", sw.WORLD, 2, anchor0=(0.8, 0.0, 1.0), anchor1=(0.8, 0.0, 0.1))
    pair.add_shape_plane()
    pair.add_shape_sphere(2, radius=0.1)
    other = apart.add_body("other", mass=1.0, inertia=(0.1, 0.1, 0.1))
    apart.add_joint_revolute("own", sw.WORLD, other, axis=(1.0, 0.0, 0.0), anchor=(0.0, 1.0, 0.0), limit=(-1.0, 1.0))
    assert used(arm(), monkeypatch) == "trees"
    assert used(arm(), monkeypatch, joint_reactions=True) == "trees"
    assert [used(each, monkeypatch) for each in (loop, pair, apart)] == ["all"] * 3
    psor = sw.SolverOptions(solver="psor")
    assert used(arm(), monkeypatch, solver=psor) == "all"
