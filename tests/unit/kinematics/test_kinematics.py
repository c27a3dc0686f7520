"""Points on bodies: Jacobians beside finite differences, and coordinates that bring a point to its target."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.kinematics import InverseKinematics, PointJacobian
from simwarp.scenes import IRB120, RACER3, Arm, four_bar, robot_arm
from tests.reference import kinematics as reference

WORLDS = 64
ARMS = {"racer3": RACER3, "irb120": IRB120}


def mixed_tree() -> sw.ModelBuilder:
    """A chain with every kind of joint that the search moves, and a branch beside it."""
    rng = np.random.default_rng(3)
    builder = sw.ModelBuilder()
    bodies = [sw.WORLD]

    def add(name: str, parent: int) -> int:
        turn = rng.normal(size=4)
        at = sw.pose(0.3 * rng.normal(size=3), turn / np.linalg.norm(turn))
        return builder.add_body(name, mass=1.0, inertia=(0.1, 0.1, 0.1), pose=at)

    def draw() -> np.ndarray:
        return rng.normal(size=3)

    for index in range(6):
        bodies.append(add(f"link_{index}", bodies[-1]))
    first, second = draw(), draw()
    second -= (second @ first) / (first @ first) * first
    builder.add_joint_revolute("turn", sw.WORLD, bodies[1], axis=draw(), anchor=draw())
    # named from its far end: the tree runs against the joint
    builder.add_joint_prismatic("slide", bodies[2], bodies[1], axis=draw(), anchor=draw())
    builder.add_joint_universal("cross", bodies[2], bodies[3], anchor=draw(), axis0=first, axis1=second)
    builder.add_joint_fixed("weld", bodies[3], bodies[4])
    builder.add_joint_cylindrical("screw", bodies[4], bodies[5], axis=draw(), anchor=draw())
    builder.add_joint_planar("plane", bodies[5], bodies[6], normal=draw(), anchor=draw())
    side = add("side", bodies[2])
    builder.add_joint_revolute("aside", bodies[2], side, axis=draw(), anchor=draw())
    return builder


def placed(builder: sw.ModelBuilder, q: np.ndarray) -> sw.Simulation:
    """A simulation with these coordinates, (W, dofs)."""
    simulation = sw.Simulation(builder.finalize(world_count=len(q), device="cpu"), dt=1e-3)
    simulation.set_joint_state(None, q.astype(np.float32), None)
    return simulation


def limits(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.array([joint.limit for joint in arm.joints]).T
    return low, high


def poses_within(arm: Arm, count: int, seed: int) -> np.ndarray:
    low, high = limits(arm)
    return np.random.default_rng(seed).uniform(low, high, (count, len(low))).astype(np.float32)


def grip_of(arm: Arm) -> np.ndarray:
    return np.asarray(arm.grip) - np.asarray(arm.links[-1].centre)


def searching(arm: Arm, start: np.ndarray, **options: Any) -> InverseKinematics:
    hand = arm.links[-1].name
    return InverseKinematics(placed(robot_arm(arm), start), hand, grip_of(arm), **options)


def grips(arm: Arm, q: np.ndarray) -> np.ndarray:
    builder = robot_arm(arm)
    hand = len(builder.bodies) - 1
    return np.array([reference.point_position(builder, hand, grip_of(arm), row) for row in q.astype(np.float64)])


def solve(ik: InverseKinematics, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    ik.target.assign(np.broadcast_to(target, (len(ik.q), 3)))
    ik.solve()
    return ik.q.numpy(), ik.error.numpy()


# ---- Jacobian --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_columns_are_the_differences_of_forward_kinematics(seed):
    builder = mixed_tree()
    q = np.random.default_rng(seed).uniform(-0.8, 0.8, (4, 10)).astype(np.float32)
    simulation = placed(builder, q)
    measured = PointJacobian(simulation, "link_5", (0.2, -0.1, 0.3))
    measured.update()
    jacobian = measured.jacobian.numpy().copy()
    assert jacobian.shape == (4, 6, 10)
    assert not jacobian[:, :, simulation.model.dof("aside")].any()
    # differences of the engine's own poses, float64: steps of 1e-3 leave 1e-6 of curvature beside float32 columns
    for dof in range(10):
        ends = []
        for sign in (1.0, -1.0):
            there = q.copy()
            there[:, dof] += sign * 1e-3
            simulation.set_joint_state(None, there, None)
            measured.update()
            ends.append((measured.position.numpy().copy(), there[:, dof].astype(np.float64)))
        difference = (ends[0][0] - ends[1][0]) / (ends[0][1] - ends[1][1])[:, None]
        np.testing.assert_allclose(jacobian[:, :3, dof], difference, atol=5e-6)


@pytest.mark.parametrize("name", ARMS)
def test_an_arms_jacobian_is_that_of_the_float64_reference(name):
    arm = ARMS[name]
    builder = robot_arm(arm)
    q = poses_within(arm, 5, 1)
    simulation = placed(builder, q)
    measured = PointJacobian(simulation, arm.links[-1].name, grip_of(arm))
    measured.update()
    hand = len(builder.bodies) - 1
    for world, row in enumerate(q.astype(np.float64)):
        expected = reference.point_jacobian(builder, hand, grip_of(arm), row)
        # float32 columns of up to 1 m
        np.testing.assert_allclose(measured.jacobian.numpy()[world], expected, atol=1e-6)
        place = reference.point_position(builder, hand, grip_of(arm), row)
        np.testing.assert_allclose(measured.position.numpy()[world], place, atol=1e-7)


def test_rates_move_the_point_and_turn_the_body_as_the_jacobian_says():
    builder = mixed_tree()
    rng = np.random.default_rng(5)
    simulation = placed(builder, rng.uniform(-0.5, 0.5, (8, 10)))
    q, qd = simulation.state.joint_q.numpy(), rng.normal(size=(8, 10)).astype(np.float32)
    simulation.set_joint_state(None, q, qd)
    for name in ("link_5", "side", "link_3"):
        measured = PointJacobian(simulation, name)
        measured.update()
        rates = np.einsum("wrd,wd->wr", measured.jacobian.numpy().astype(np.float64), qd)
        body = simulation.model.body(name)
        # float32 sums of nine terms of some units
        np.testing.assert_allclose(rates[:, :3], simulation.state.body_v.numpy()[:, body], atol=1e-5)
        np.testing.assert_allclose(rates[:, 3:], simulation.state.body_omega.numpy()[:, body], atol=1e-5)


def test_a_floating_root_has_columns_of_its_own():
    builder = sw.ModelBuilder()
    root = builder.add_body("root", mass=1.0, inertia=(0.1, 0.2, 0.3), pose=sw.pose((0.1, 0.2, 0.3)))
    tip = builder.add_body("tip", mass=1.0, inertia=(0.1, 0.2, 0.3), pose=sw.pose((0.5, 0.2, 0.3)))
    builder.add_joint_free("float", root, anchor=(0.0, 0.0, 0.1))
    builder.add_joint_revolute("bend", root, tip, axis=(0, 1, 0), anchor=(0.3, 0.2, 0.3))
    rng = np.random.default_rng(2)
    q, qd = rng.uniform(-1.0, 1.0, (4, 7)), rng.normal(size=(4, 7))
    simulation = placed(builder, q)
    simulation.set_joint_state(None, q.astype(np.float32), qd.astype(np.float32))
    measured = PointJacobian(simulation, tip)
    measured.update()
    rates = np.einsum("wrd,wd->wr", measured.jacobian.numpy().astype(np.float64), qd)
    np.testing.assert_allclose(rates[:, :3], simulation.state.body_v.numpy()[:, tip], atol=5e-6)
    np.testing.assert_allclose(rates[:, 3:], simulation.state.body_omega.numpy()[:, tip], atol=5e-6)


# ---- inverse kinematics ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ARMS)
def test_targets_within_reach_are_reached(name):
    arm = ARMS[name]
    rng = np.random.default_rng(7)
    there = poses_within(arm, WORLDS, 2)
    low, high = limits(arm)
    start = np.clip(there + rng.uniform(-0.7, 0.7, there.shape), low, high)
    ik = searching(arm, start)
    target = grips(arm, there)
    q, error = solve(ik, target)
    assert error.max() < 1e-5
    # where they are is told by the reference: its float64 kinematics of the float32 coordinates, 1e-7 of some rad
    np.testing.assert_allclose(grips(arm, q), target, atol=1e-5)
    assert (q >= low.astype(np.float32)).all()
    assert (q <= high.astype(np.float32)).all()
    assert ik.iterations.numpy().max() < 100


def test_the_search_takes_the_steps_of_the_reference():
    there = poses_within(RACER3, 3, 11)
    start = np.zeros_like(there)
    low, high = limits(RACER3)
    start[2, 1] = low[1]  # at its stop, and drawn further: the others do without it
    ik = searching(RACER3, start, iterations=4, damping=0.05, longest_step=0.25)
    target = grips(RACER3, there)
    target[2] = -0.9, 0.3, -1.0
    q, error = solve(ik, target)
    builder = robot_arm(RACER3)
    for world in range(len(there)):
        expected, left = reference.search(
            builder, len(builder.bodies) - 1, grip_of(RACER3), start[world].astype(np.float64), target[world],
            low=low, high=high, damping=0.05, longest=0.25, iterations=4, tolerance=1e-6,
        )  # fmt: skip
        # four steps of float32 columns: 1e-7 each, divided by singular values of some 0.1 m
        np.testing.assert_allclose(q[world], expected, atol=1e-5)
        assert error[world] == pytest.approx(left, abs=1e-5)


def test_stops_hold_and_the_rest_goes_on():
    # The target belongs to a pose with joint 2 at its lower stop, and the way there leads along the stop
    low, high = limits(RACER3)
    there, start = np.zeros((1, 6)), np.zeros((1, 6))
    there[0, 1:3] = low[1], -0.4
    start[0, 1:3] = low[1] + 1e-3, 0.6
    q, error = solve(searching(RACER3, start), grips(RACER3, there))
    assert (q[0] >= low.astype(np.float32)).all()
    assert (q[0] <= high.astype(np.float32)).all()
    assert error[0] < 1e-5
    free = searching(RACER3, start, longest_step=3.0, iterations=1)
    once, _ = solve(free, np.array([-0.9, 0.0, -1.0]))
    assert once[0, 1] == np.float32(low[1])  # a step that would pass the stop ends there


def test_beyond_the_reach_the_arm_stretches_and_stays_bounded():
    direction = np.array([-0.6, 0.3, 0.2])
    direction /= np.linalg.norm(direction)
    # Racer3's shoulder, from which the grip reaches 0.81 m
    target = np.array([0.0, 0.0, 0.365]) + 3.0 * direction
    ik = searching(RACER3, np.full((4, 6), 0.2) * np.arange(1, 5)[:, None], iterations=400)
    q, error = solve(ik, target)
    assert np.isfinite(q).all()
    low, high = limits(RACER3)
    assert (q >= low.astype(np.float32)).all()
    assert (q <= high.astype(np.float32)).all()
    # the best that anybody does: all starts end at the same distance, which no other pose undercuts
    assert np.ptp(error) < 1e-3
    elsewhere = PointJacobian(placed(robot_arm(RACER3), poses_within(RACER3, 2000, 3)), "hand", grip_of(RACER3))
    elsewhere.update()
    others = np.linalg.norm(elsewhere.position.numpy() - target, axis=1)
    assert error.max() < others.min() + 1e-3


def test_a_singular_pose_is_left_by_bounded_steps():
    # stretched upwards: no joint moves the grip along the arm
    start = np.zeros((1, 6))
    start[0, 2] = math.radians(90.0)
    ik = searching(RACER3, start, iterations=1, longest_step=0.3)
    below = grips(RACER3, start)[0] - np.array([0.0, 0.0, 0.05])
    q, _ = solve(ik, below)
    assert np.isfinite(q).all()
    assert np.abs(q - start).max() <= 0.3 + 1e-6
    longer = searching(RACER3, start)
    _, error = solve(longer, below)
    assert error[0] < 1e-5


def test_only_named_joints_move_and_the_state_stays():
    simulation = placed(robot_arm(IRB120), poses_within(IRB120, 3, 4))
    start, before = simulation.state.joint_q.numpy().copy(), simulation.state.body_x.numpy().copy()
    ik = InverseKinematics(simulation, "hand", grip_of(IRB120), joints=["joint_1", "joint_2", "joint_3"])
    q, error = solve(ik, np.array([0.4, 0.1, 0.3]))
    np.testing.assert_array_equal(q[:, 3:], start[:, 3:])
    assert np.abs(q[:, :3] - start[:, :3]).max() > 0.1
    assert error.max() < 0.2
    np.testing.assert_array_equal(simulation.state.body_x.numpy(), before)


def test_worlds_do_not_depend_on_each_other_or_on_threads():
    there = poses_within(RACER3, 7, 5)
    target = grips(RACER3, there)
    together, _ = solve(searching(RACER3, np.zeros((7, 6))), target)
    alone, _ = solve(searching(RACER3, np.zeros((2, 6))), target[:2])
    np.testing.assert_array_equal(together[:2], alone)
    shared = sw.Simulation(robot_arm(RACER3).finalize(world_count=7, device="cpu"), dt=1e-3, threads=3)
    divided, _ = solve(InverseKinematics(shared, "hand", grip_of(RACER3)), target)
    np.testing.assert_array_equal(together, divided)


def test_a_search_begins_where_it_is_told():
    there = poses_within(RACER3, 3, 6)
    ik = searching(RACER3, np.zeros((3, 6)))
    ik.target.assign(grips(RACER3, there))
    ik.solve(wp.array(there, dtype=wp.float32, device="cpu"))
    assert ik.iterations.numpy().tolist() == [0, 0, 0]
    np.testing.assert_array_equal(ik.q.numpy(), there)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"body": "elbow"}, "model has no body 'elbow'"),
        ({"body": 9}, r"InverseKinematics: body must be a name or in 0\.\.6, got 9; pass what add_body returned"),
        ({"tolerance": 0.0}, r"InverseKinematics: tolerance must be positive, got 0\.0"),
        ({"damping": -1.0}, r"damping must be positive, got -1\.0"),
        ({"iterations": 0}, "iterations must be from 1 to 10000, got 0"),
        ({"point": (0.0, math.nan, 0.0)}, "point must be"),
        ({"joints": ["joint_7"]}, "model has no joint 'joint_7'"),
        ({"body": "link_2", "joints": ["joint_4"]}, "joints must carry body 'link_2', got 'joint_4'; leave it out"),
        ({"body": "base"}, "a joint must carry body 'base', got none that moves"),
    ],
)  # fmt: skip
def test_wrong_searches_are_refused(options, message):
    simulation = placed(robot_arm(RACER3), np.zeros((1, 6)))
    with pytest.raises(sw.ModelError, match=message):
        InverseKinematics(simulation, **{"body": "hand", **options})


def test_models_that_have_no_tree_are_refused():
    loop = sw.Simulation(four_bar().finalize(world_count=1, device="cpu"), dt=1e-3)
    with pytest.raises(sw.ModelError, match="PointJacobian: the model must be a tree without loops and couplings, got"):
        PointJacobian(loop, 0)
    builder = sw.ModelBuilder()
    ball = builder.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((1, 0, 0)))
    builder.add_joint_spherical("socket", sw.WORLD, ball, anchor=(0, 0, 0))
    hanging = sw.Simulation(builder.finalize(world_count=1, device="cpu"), dt=1e-3)
    with pytest.raises(sw.ModelError, match=r"integrals of their rates, got 'socket' \(SPHERICAL\)"):
        InverseKinematics(hanging, "ball")
    arm = searching(RACER3, np.zeros((1, 6)))
    with pytest.raises(sw.ModelError, match=r"start must be a Warp array of float32 of shape \(1, 6\)"):
        arm.solve(np.zeros((1, 6)))  # type: ignore[arg-type]
