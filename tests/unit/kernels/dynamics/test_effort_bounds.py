"""Drives whose effort has a limit of its own on either side, in closed form on a slide."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import PositionDrive, VelocityMotor

INF = float("inf")
MASS, DT = 2.0, 1e-3


def slide(drive: Any, worlds: int = 1, **options: Any) -> sw.Simulation:
    """A mass on a slide across gravity."""
    builder = sw.ModelBuilder()
    body = builder.add_body("mass", mass=MASS, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(1.0, 0.0, 0.0), drive=drive)
    return sw.Simulation(builder.finalize(worlds, "cpu", **options), DT)


def speeds(sim: sw.Simulation, target: float, steps: int = 100) -> np.ndarray:
    """Rates after some steps towards a far target."""
    sim.reset()
    sim.control.joint_target_q[:] = target
    sim.control.joint_target_qd[:] = target
    sim.advance(steps)
    return sim.state.joint_qd.numpy()[:, 0].astype(float)


@pytest.mark.parametrize(
    ("limit", "least", "most"), [((-2.0, 5.0), -2.0, 5.0), ((0.0, 3.0), 0.0, 3.0), ((-4.0, 0.0), -4.0, 0.0)]
)
@pytest.mark.parametrize("kind", ["motor", "drive"])
def test_the_effort_is_the_one_of_its_side(kind: str, limit: tuple[float, float], least: float, most: float) -> None:
    drive = VelocityMotor(effort_limit=limit) if kind == "motor" else PositionDrive(stiffness=1e4, effort_limit=limit)
    sim = slide(drive)
    # 100 sums of float32, and the solver's 1e-5 m/s
    assert speeds(sim, 100.0)[0] == pytest.approx(most * 0.1 / MASS, abs=2e-5)
    assert speeds(sim, -100.0)[0] == pytest.approx(least * 0.1 / MASS, abs=2e-5)


@pytest.mark.parametrize("kind", ["motor", "drive"])
def test_a_side_without_a_limit_takes_what_it_needs(kind: str) -> None:
    limit = (-INF, 5.0)
    drive = VelocityMotor(effort_limit=limit) if kind == "motor" else PositionDrive(stiffness=1e4, effort_limit=limit)
    sim = slide(drive)
    assert speeds(sim, 100.0)[0] == pytest.approx(0.25, abs=2e-5)
    if kind == "motor":
        assert speeds(sim, -100.0, steps=1)[0] == pytest.approx(-100.0, rel=1e-6)
    else:  # the implicit spring of a drive without a limit, on its way there
        free = slide(PositionDrive(stiffness=1e4))
        assert speeds(sim, -100.0, steps=5)[0] == pytest.approx(speeds(free, -100.0, steps=5)[0], rel=1e-6)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (VelocityMotor(effort_limit=2.0), VelocityMotor(effort_limit=(-2.0, 2.0))),
        (PositionDrive(stiffness=90.0, damping=1.0, effort_limit=2.0),
         PositionDrive(stiffness=90.0, damping=1.0, effort_limit=(-2.0, 2.0))),
        (PositionDrive(stiffness=90.0, damping=1.0),
         PositionDrive(stiffness=90.0, damping=1.0, effort_limit=(-INF, INF))),
    ],
)  # fmt: skip
def test_a_number_is_a_pair_of_equal_sides(one: Any, other: Any) -> None:
    pair = [slide(drive) for drive in (one, other)]
    assert pair[0].identity.digest == pair[1].identity.digest
    assert pair[0].model.box_count == pair[1].model.box_count
    for target in (0.3, -0.3):
        assert speeds(pair[0], target).tobytes() == speeds(pair[1], target).tobytes()


def test_worlds_have_limits_of_their_own() -> None:
    drive = VelocityMotor(effort_limit=(-2.0, 5.0))
    sim = slide(drive, 3, per_world=["drive_effort_limit", "drive_effort_lower"])
    sim.model.drive_effort_lower[:, 0] = [-2.0, -1.0, -1e30]
    sim.model.drive_effort_limit[:, 0] = [5.0, 6.0, 7.0]
    assert speeds(sim, 100.0) == pytest.approx(np.array([5.0, 6.0, 7.0]) * 0.1 / MASS, abs=2e-5)
    assert speeds(sim, -100.0) == pytest.approx([-0.1, -0.05, -100.0], rel=1e-6, abs=2e-5)


def test_a_drive_built_with_one_number_keeps_one() -> None:
    """Whoever changes `drive_effort_limit` of such a drive means both sides."""
    sim = slide(VelocityMotor(effort_limit=2.0), 2, per_world=["drive_effort_limit"])
    sim.model.drive_effort_limit[:, 0] = [2.0, 3.0]
    assert speeds(sim, 100.0) == pytest.approx([0.1, 0.15], abs=2e-5)
    assert speeds(sim, -100.0) == pytest.approx([-0.1, -0.15], abs=2e-5)


def test_a_drive_without_gains_has_no_effort() -> None:
    """Not even that of a weak damper: against the smallest bodies and steps it would be felt."""
    drive = PositionDrive(stiffness=1.0, effort_limit=5.0)
    builder = sw.ModelBuilder()
    body = builder.add_body("mass", mass=MASS, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(1.0, 0.0, 0.0), drive=drive)
    model = builder.finalize(1, "cpu")
    model.drive_stiffness.zero_()
    sim = sw.Simulation(model, 1e-5, joint_accelerations=True)
    sim.set_joint_state(None, [[0.0]], [[2.0]])
    sim.step()
    assert sim.diagnostics.joint_qdd.numpy()[0, 0] == 0.0
