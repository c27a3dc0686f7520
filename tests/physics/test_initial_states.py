"""States that no motion leads to: named where a simulation is built, and recovered from without speed."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import rotate
from simwarp.core.types import RowKind
from simwarp.importers.imported import Imported
from simwarp.importers.report import ImportedWarning
from tests.reference.wrong_robots import ROBOTS, Part, cube_stl, urdf, wrong_robots

DT = 1e-3
GRAVITY = 9.81
FASTEST = 0.6
"""Default of `max_depenetration_velocity` [m/s]."""
RATE = 3.0
"""Default of `max_depenetration_rate` [rad/s]."""
EDGE = 0.03
"""Speed that joints may add [m/s]: a recovery moves bodies on straight lines, which opens a chain of seven joints by up
to (7 RATE DT)² / 2 of its 0.1 m; the next step takes that back."""


def loaded(folder: Path, parts: list[Part], base: Any, **options: Any) -> Imported:
    """The robot of these parts."""
    (folder / "cube.stl").write_text(cube_stl())
    (folder / "robot.urdf").write_text(urdf(parts))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ImportedWarning)
        return sw.importers.load_urdf(folder / "robot.urdf", base=base, allow=["massless link"], **options)


def simulation_of(builder: sw.ModelBuilder, dt: float = DT) -> tuple[sw.Simulation, list[str]]:
    """With what its construction warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sim = sw.Simulation(builder.finalize(1, "cpu"), dt, threads=1)
    return sim, [str(each.message) for each in caught if each.category is sw.InitialStateWarning]


def mean_speed(sim: sw.Simulation) -> float:
    """Root of twice the kinetic energy over the mass [m/s]."""
    state, builder = sim.state, sim.model.builder
    v, omega, turn = (array.numpy()[0].astype(float) for array in (state.body_v, state.body_omega, state.body_rot))
    twice, mass = 0.0, 0.0
    for index, body in enumerate(builder.bodies):
        local = rotate(turn[index] * (-1.0, -1.0, -1.0, 1.0), omega[index])
        twice += body.mass * v[index] @ v[index] + local @ np.asarray(body.inertia) @ local
        mass += body.mass
    return float(np.sqrt(twice / mass))


def assert_no_faster_than_free_fall(sim: sw.Simulation, steps: int) -> None:
    """Without springs and drives the power of gravity is at most M g V, with the kinetic energy M V² / 2: V grows by g
    at most, whatever joints, stops and contacts do, and the recovery adds nothing to it. Coordinates move beside their
    rates by the recovery alone.
    """
    kinds = sim.model.topology.dof_kind.numpy()
    fastest = np.where(kinds == int(RowKind.POINT_AXIS0), FASTEST, RATE)
    hinges = np.array([joint.type != sw.JointType.FREE for joint in sim.model.builder.joints for _ in joint.dofs], bool)
    for step in range(1, steps + 1):
        before = sim.state.joint_x.numpy()[0].copy()
        sim.step()
        assert sim.state.world_status.numpy()[0] == 0
        # 1e-3: float32, and what the solver leaves (1e-5 m/s per step)
        assert mean_speed(sim) <= 1.001 * GRAVITY * step * DT + EDGE
        beside = np.abs(sim.state.joint_x.numpy()[0] - before - DT * sim.state.joint_qd.numpy()[0]) / DT
        # rates are those in the frames of the step's start: a chain that turns moves them by some per cent
        assert np.all((beside <= 1.1 * fastest + 0.05 * np.abs(sim.state.joint_qd.numpy()[0]))[hinges])


def test_there_are_twenty_robots() -> None:
    assert len(ROBOTS) >= 20


@pytest.mark.quick("links thicker than long", "between shifted walls", "limits without zero", "a lever of a millimetre")
@pytest.mark.parametrize("name", ROBOTS)
def test_a_wrong_robot_is_named_and_moves_no_faster_than_free_fall(name: str, tmp_path: Path) -> None:
    parts, base = ROBOTS[name]
    robot = loaded(tmp_path, parts, base)
    sim, told = simulation_of(robot.builder)
    faults = sim.check_state()
    assert faults
    assert len(told) == 1
    assert str(faults) in sim.problems()[0]
    for overlap in faults.overlaps[:4]:
        assert str(overlap) in told[0]
        assert set(overlap.names) <= set(sim.model.shape_names)
        assert overlap.depth > 0.0
    for limit in faults.limits[:4]:
        assert f"'{limit.joint}'" in told[0]
        assert not limit.limit[0] <= limit.value <= limit.limit[1]
    assert_no_faster_than_free_fall(sim, 300)


@pytest.mark.slow
@hypothesis.given(robot=wrong_robots())
@hypothesis.settings(max_examples=60, deadline=None, database=None)
def test_no_wrong_robot_moves_faster_than_free_fall(
    robot: tuple[list[Part], str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    _check_drawn(robot, tmp_path_factory.mktemp("robot"), 150)


@hypothesis.given(robot=wrong_robots())
@hypothesis.settings(max_examples=6, deadline=None, database=None, derandomize=True)
def test_some_wrong_robots(robot: tuple[list[Part], str], tmp_path_factory: pytest.TempPathFactory) -> None:
    _check_drawn(robot, tmp_path_factory.mktemp("robot"), 50)


def _check_drawn(robot: tuple[list[Part], str], folder: Path, steps: int) -> None:
    """Loads, is named, and obeys the law."""
    parts, base = robot
    builder = loaded(folder, parts, base).builder
    if not builder.bodies:
        return
    sim, told = simulation_of(builder)
    faults = sim.check_state()
    assert any(str(faults) in line for line in sim.problems()) == bool(faults)
    assert len(told) == int(bool(faults))  # all that a URDF has is one mechanism
    assert_no_faster_than_free_fall(sim, steps)


# ---- how it recovers -------------------------------------------------------------------------------------------------


def sunk(depth: float, height: float = 0.0) -> sw.ModelBuilder:
    """A ball in the ground, under gravity."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane(name="ground")
    builder.add_solid("ball", "sphere", 0.25, mass=2.0, pose=sw.pose((0.0, 0.0, 0.25 - depth + height)))
    return builder


@pytest.mark.parametrize("depth", [2e-4, 5e-3, 0.05])
def test_an_overlap_is_taken_away_at_the_depenetration_velocity_and_leaves_no_speed(depth: float) -> None:
    sim, told = simulation_of(sunk(depth))
    assert told == []  # the ground is no part of a mechanism
    assert sim.check_state().overlaps[0].names[0] == "ground"
    assert sim.check_state().overlaps[0].depth == pytest.approx(depth, abs=1e-6)
    sim.step()
    risen = float(sim.state.body_x.numpy()[0, 0, 2]) - (0.25 - depth)
    assert risen == pytest.approx(min(FASTEST * DT, depth), rel=1e-3)  # of float32
    assert abs(sim.state.body_v.numpy()[0, 0, 2]) < 1e-5  # the solver's tolerance
    sim.step(round(depth / FASTEST / DT * 1.02) + 20)
    assert float(sim.state.body_x.numpy()[0, 0, 2]) == pytest.approx(0.25, abs=2e-5)
    assert np.abs(sim.state.body_v.numpy()).max() < 0.02  # of what asks for less than a fiftieth, the rows take care
    assert sim.problems() == []


@pytest.mark.parametrize("far", [1.0, 1e29, 1e30])
def test_a_coordinate_without_limits_passes_none_however_far_it_is(far: float) -> None:
    """No limit is 1e30 in float32; the length of this spring is sqrt(3) times `far`, beyond it."""
    builder = sw.ModelBuilder()
    builder.add_body("ball", mass=1.0, inertia=(0.1, 0.1, 0.1))
    builder.add_spring("spring", sw.WORLD, 0, anchor0=(far, far, far), anchor1=(0.0, 0.0, 0.0), stiffness=1.0)
    assert simulation_of(builder)[1] == []


def test_a_limit_recovers_at_the_depenetration_rate_and_leaves_no_speed() -> None:
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    arm = builder.add_body("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.5, 0.0, 0.0)))
    builder.add_joint_revolute("hinge", sw.WORLD, arm, axis=(0.0, 0.0, 1.0), limit=(0.6, 1.0))
    sim, told = simulation_of(builder)
    assert len(told) == 1
    assert "joint 'hinge' is at 0 rad, outside 0.6 to 1" in told[0]
    sim.step(100)
    assert sim.joint_position("hinge") == pytest.approx(0.1 * RATE, rel=1e-3)  # of float32
    assert np.abs(sim.state.joint_qd.numpy()).max() < 1e-5
    sim.step(150)
    assert sim.joint_position("hinge") == pytest.approx(0.6, abs=1e-4)
    assert np.abs(sim.state.joint_qd.numpy()).max() < 0.02 * RATE + 1e-5
    assert sim.problems() == []


def test_contradicting_stops_hold_still() -> None:
    """Two stops ask for opposite motions of coupled coordinates: no motion can satisfy both."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    carts = []
    for index, limit in enumerate([(0.1, 0.3), (-0.3, -0.1)]):
        cart = builder.add_body(f"cart{index}", mass=1.0, inertia=(1, 1, 1), pose=sw.pose((0.0, float(index), 0.0)))
        carts.append(builder.add_joint_prismatic(f"rail{index}", sw.WORLD, cart, axis=(1.0, 0.0, 0.0), limit=limit))
    builder.add_coupling("same", [(carts[0], 1.0), (carts[1], -1.0)])
    sim, _ = simulation_of(builder)
    sim.step(500)
    assert np.abs(sim.state.joint_q.numpy()).max() < 1e-3
    assert np.abs(sim.state.joint_qd.numpy()).max() < 1e-3
    assert "rail0" in sim.problems()[0]


def test_a_body_that_touches_as_it_should_is_not_told_and_steps_as_before() -> None:
    """A ball that falls on the ground, and lies there: no fault."""
    sim, told = simulation_of(sunk(0.0, 0.01))
    assert told == sim.problems() == []
    for _ in range(300):
        sim.step()
        assert sim.problems() == []


def test_checking_changes_nothing() -> None:
    sim, other = (simulation_of(sunk(0.01))[0] for _ in range(2))
    for _ in range(5):
        sim.step()
        other.step()
        sim.check_state()
        sim.problems()
    for one, same in zip(sim.snapshot().arrays().values(), other.snapshot().arrays().values(), strict=True):
        np.testing.assert_array_equal(one.numpy(), same.numpy())


def test_a_snapshot_in_a_recovery_goes_on_bit_by_bit() -> None:
    sim, _ = simulation_of(sunk(0.02))
    sim.step(5)
    kept = sim.snapshot()
    sim.step(20)
    first = sim.state.body_x.numpy().copy()
    sim.restore(kept)
    sim.step(20)
    np.testing.assert_array_equal(first, sim.state.body_x.numpy())


def test_a_world_does_not_exist() -> None:
    sim, _ = simulation_of(sunk(0.0))
    with pytest.raises(sw.ModelError, match="check_state: world"):
        sim.check_state(1)
