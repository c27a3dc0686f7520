"""The hexapod: its model against the tables, what it observes and is paid for, where episodes end, that it walks."""

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.core.interop import to_torch
from simwarp.core.rotation import matrix_of
from simwarp.scenes import hexapod, phantomx
from simwarp.tasks import InputError, make
from simwarp.tasks.locomotion.hexapod import HexapodConfig, HexapodReward, HexapodTask
from simwarp.tasks.locomotion.walking import Orientation
from simwarp.train.config import default_config
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import SHIPPED, find_policy, network_policy
from simwarp.train.runs.training import train

WEIGHT = 1.4778 * 9.81
# Left for right: legs 1 to 3 are right, 4 to 6 left; hips turn the other way, femurs and tibias the same
SWAPPED = [3, 4, 5, 0, 1, 2]


def place(task, *, x=0.0, y=0.0, height=0.5, rotation=(0.0, 0.0, 0.0, 1.0), q=None, qd=None, velocity=(0.0, 0.0, 0.0)):
    """Put every hexapod somewhere, its joints as built unless ``q`` says otherwise."""
    state, every = task.simulation.state, torch.ones(task.num_worlds, dtype=torch.bool)
    to_torch(state.body_x)[:, 0] = torch.tensor([x, y, height], dtype=torch.float64)
    to_torch(state.body_rot)[:, 0] = torch.tensor(rotation, dtype=torch.float64)
    to_torch(state.body_v)[:, 0] = torch.tensor(velocity)
    to_torch(state.body_omega)[:, 0] = 0.0
    zero = torch.zeros(task.num_worlds, 18)
    task.simulation.set_joint_state(every, zero if q is None else q, zero if qd is None else qd)
    task.simulation.measure(every)


def still(worlds=1, **options):
    return make("hexapod", worlds, start_angle=0.0, start_rate=0.0, **options)


def idle(task):
    return torch.zeros(task.num_worlds, 18)


# ---- the model -------------------------------------------------------------------------------------------------


def test_bodies_and_hinges_are_in_the_order_of_the_source():
    builder = hexapod()
    assert sum(body.mass for body in builder.bodies) == pytest.approx(1.4778, abs=5e-5)
    model = builder.finalize(world_count=1, device="cpu")
    assert (model.body_count, model.joint_count, model.dof_count) == (19, 18, 18)
    assert model.body_names[0] == "base"
    for index, joint in enumerate(builder.joints):
        assert (joint.parent, joint.child) == (0 if index < 6 else index - 5, index + 1)
    np.testing.assert_allclose(model.parameters.joint_limit_upper.numpy(), 0.5 * math.pi, rtol=1e-6)
    np.testing.assert_allclose(model.parameters.joint_limit_lower.numpy(), -0.5 * math.pi, rtol=1e-6)


def source_matrix(quaternion):
    """Rotation matrix of a scalar-first quaternion."""
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


OURS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""The source's axes in ours: forward z to X, left x to Y, up y to Z."""


def source_body(position, quaternion, centre, moments, products):
    """Centre of mass and inertia of an exported body in our world axes."""
    turn = source_matrix(quaternion)
    xx, yy, zz = moments
    xy, xz, yz = products
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return OURS @ (np.array(position) + turn @ np.array(centre)) + [0.0, 0.0, 0.1325], OURS @ inertia @ OURS.T


def test_a_foot_is_merged_into_its_tibia():
    # Tibia-4 and Foot-6 of the tables
    tibia_at, tibia_inertia = source_body(
        (0.15185, -0.0013265, 0.21265), (0.33379, -0.45184, 0.80585, -0.18716), (0.015962, -0.020308, 0.00024097),
        (9.7502e-05, 5.7287e-05, 8.9002e-05), (2.3933e-05, -1.4798e-05, 3.1565e-05),
    )  # fmt: skip
    foot_at, foot_inertia = source_body(
        (0.17493, -0.0013265, 0.23579), (0.80585, 0.18716, -0.33379, -0.45184), (0.084604, -0.070877, -1.7255e-05),
        (1.4426e-06, 1.846e-06, 1.3687e-06), (-4.1287e-07, 3.0411e-07, -2.0753e-07),
    )  # fmt: skip
    masses = np.array([0.074983, 0.0093282])
    centre = (masses[0] * tibia_at + masses[1] * foot_at) / masses.sum()
    # Two points and two inertias: by the reduced mass, not by two parallel-axis shifts
    apart = foot_at - tibia_at
    reduced = masses.prod() / masses.sum()
    expected = tibia_inertia + foot_inertia + reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    body = next(body for body in hexapod().bodies if body.name == "tibia_4")
    assert body.mass == pytest.approx(masses.sum())
    np.testing.assert_allclose(body.pose.position, centre, atol=1e-9)
    turn = matrix_of(np.asarray(body.pose.rotation))
    np.testing.assert_allclose(turn @ body.inertia @ turn.T, expected, atol=1e-12)


def test_the_base_looks_along_x_and_the_tables_are_turned():
    base, *_ = hexapod().bodies
    np.testing.assert_allclose(base.pose.position, [-0.0016328, -0.00035713, 0.1325 + 0.019258], atol=1e-9)
    np.testing.assert_allclose(base.pose.rotation, [0.0, 0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(np.diag(base.inertia), [0.0016536, 0.003434, 0.0048807], rtol=1e-6)
    model = hexapod().finalize(world_count=1, device="cpu")
    # Concentric4, body-hip 4: (0.06091, 0.0364, 0.12191) with Y up is ahead on the left
    anchor = np.asarray(base.pose.position) + model.parameters.joint_anchor0.numpy()[0, model.joint("hip_4")]
    np.testing.assert_allclose(anchor, [0.12191, 0.06091, 0.1325 + 0.0364], atol=1e-9)


def test_legs_repeat_after_half_a_turn_and_nearly_in_the_mirror():
    at = {body.name: np.asarray(body.pose.position) for body in hexapod().bodies}
    for kind in ("hip", "femur", "tibia"):
        for leg, opposite, mirrored in ((1, 6, 4), (2, 5, 5), (3, 4, 6)):
            here, half_turn = at[f"{kind}_{leg}"], at[f"{kind}_{opposite}"]
            np.testing.assert_allclose(here * [-1.0, -1.0, 1.0], half_turn, atol=2e-5)
            np.testing.assert_allclose(here * [1.0, -1.0, 1.0], at[f"{kind}_{mirrored}"], atol=2.5e-3)


def test_as_built_the_feet_are_just_above_the_floor():
    model = hexapod().finalize(world_count=1, device="cpu")
    sim = sw.Simulation(model, dt=0.005)
    pose = to_torch(sim.state.body_q)[0]
    for leg in range(1, 7):
        tibia = pose[model.body(f"tibia_{leg}")]
        ball = torch.tensor(model.shape_x.numpy()[0, model.shape_names.index(f"foot_{leg}")], dtype=torch.float32)
        height = float(tibia[2]) + Rotation.from_quat(tibia[3:]).apply(ball)[2] - phantomx.HEXAPOD_FOOT_RADIUS
        assert 0.0 < height < 1e-3


def test_it_stands_on_six_feet_when_its_joints_are_held():
    drive = sw.PositionDrive(stiffness=20.0, damping=0.2)
    sim = sw.Simulation(hexapod(drive=drive).finalize(world_count=1, device="cpu"), dt=0.005)
    for _ in range(400):
        sim.step()
    names = sim.model.shape_names
    force = sim.contacts.shape_contact_force.numpy()[0, :, 2]
    feet = np.array([force[names.index(f"foot_{leg}")] for leg in range(1, 7)])
    assert feet.sum() == pytest.approx(WEIGHT, rel=0.01)
    assert feet.min() > 0.5
    touching = {name for name, value in zip(names, force, strict=True) if value != 0.0}
    assert touching == {"floor"} | {f"foot_{leg}" for leg in range(1, 7)}
    base = sim.state.body_q.numpy()[0, 0]
    assert base[2] == pytest.approx(0.1518, abs=4e-3)
    assert abs(base[:2]).max() < 0.01


# ---- observations ----------------------------------------------------------------------------------------------


def quaternion_of(angles):
    """xyzw of the rotation about x, then the new y, then the new z, from its matrix."""
    a, b, c = angles
    x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    m = x @ y @ z
    w = 0.5 * math.sqrt(1.0 + np.trace(m))
    vector = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]) / (4.0 * w)
    return (*vector.tolist(), w), m


def test_observation_has_its_53_entries_in_order():
    task = still(2)
    rotation, m = quaternion_of((0.2, -0.1, 0.5))
    q = torch.linspace(-0.4, 0.3, 18).repeat(2, 1)
    qd = torch.linspace(1.0, -1.0, 18).repeat(2, 1)
    place(task, y=0.3, height=0.8, rotation=rotation, q=q, qd=qd, velocity=(1.0, 2.0, 0.5))
    to_torch(task.simulation.state.body_omega)[:, 0] = torch.tensor([0.1, -0.2, 0.3])
    seen = task.observations()["policy"][0]
    assert seen.shape == (53,)
    assert seen[0] == pytest.approx(0.8)
    assert seen[1:5].tolist() == pytest.approx(rotation, abs=1e-6)
    velocity = to_torch(task.simulation.state.body_v)[0, 0].numpy()
    assert seen[5:8].tolist() == pytest.approx((m.T @ velocity).tolist(), abs=1e-5)
    assert seen[8:11].tolist() == pytest.approx((m.T @ [0.1, -0.2, 0.3]).tolist(), abs=1e-5)
    assert seen[11:29].tolist() == pytest.approx(q[0].tolist(), abs=1e-4)
    assert seen[29:47].tolist() == pytest.approx(qd[0].tolist(), abs=1e-3)
    assert seen[47:53].tolist() == [0.0] * 6


def test_observation_options():
    turned = still(orientation=Orientation.EULER)
    assert turned.observation_shapes == {"policy": (52,)}
    rotation, _ = quaternion_of((0.2, -0.1, 0.5))
    place(turned, rotation=rotation)
    assert turned.observations()["policy"][0, 1:4].tolist() == pytest.approx([0.2, -0.1, 0.5], abs=1e-5)
    plain, scaled = still(), still(scaled=True)
    assert plain.observation_shapes == scaled.observation_shapes == {"policy": (53,)}
    assert plain.action_size == 18
    sizes = plain.observations()["policy"][0, 0] / scaled.observations()["policy"][0, 0]
    assert sizes == pytest.approx(0.15)


def test_feet_feel_the_ground_up_to_the_clip():
    task = still()
    felt = torch.stack([task.step(idle(task)).observations["policy"][0, 47:53].clone() for _ in range(5)])
    assert felt.min() >= 0.0
    assert 0.0 < felt.max() <= 5.0
    place(task, height=0.1, velocity=(0.0, 0.0, -3.0))
    task.simulation.step()
    assert task.observations()["policy"][0, 47:53].max() == 5.0


# ---- actions ---------------------------------------------------------------------------------------------------


def test_torque_is_cut_beyond_the_speed_limit():
    task = still(3)
    limit = math.radians(354.0)
    assert task.config.speed_limit == pytest.approx(limit)
    qd = torch.zeros(3, 18)
    qd[:, 2] = torch.tensor([0.99 * limit, 1.01 * limit, -1.01 * limit])
    place(task, qd=qd)
    action = torch.zeros(3, 18, device=task.device)
    action[:, 2], action[:, 7] = 0.5, -1.0
    task.apply(action)
    force = task.views.joint_force
    assert force[:, 2].tolist() == pytest.approx([0.75, 0.0, 0.75])  # it may still brake
    assert force[:, 7].tolist() == pytest.approx([-1.5] * 3)
    assert force.abs().sum() == pytest.approx(6.0)


def test_torque_is_cut_anew_after_every_physics_step():
    task = still()
    place(task, height=5.0)
    task.action[:] = 0.0
    task.action[:, 3] = 1.0
    task.apply(task.action)
    forces, speeds = [], []
    for _ in range(4):
        task.simulation.step()
        task.after_physics()
        forces.append(float(task.views.joint_force[0, 3]))
        speeds.append(float(task.views.joint_qd[0, 3]))
    for force, speed in zip(forces, speeds, strict=True):
        assert force == pytest.approx(0.0 if speed > task.config.speed_limit else 1.5)
    assert 0.0 in forces


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_joints_stop_at_a_right_angle(sign):
    task = still()
    place(task, height=30.0)
    for _ in range(100):
        task.step(torch.full((1, 18), 0.2 * sign))
    assert task.views.joint_q.abs().max() < 0.5 * math.pi + 0.1
    assert (task.views.joint_q * sign > 1.5).sum() >= 12


def test_mirrored_torques_make_a_mirrored_motion():
    task = still(2)
    action = torch.rand(1, 18, generator=torch.Generator().manual_seed(3)).mul(0.2).sub(0.1)
    by_kind = action.view(3, 6)
    mirrored = by_kind[:, SWAPPED] * torch.tensor([[-1.0], [1.0], [1.0]])
    for _ in range(3):
        task.step(torch.cat([action, mirrored.reshape(1, 18)]))
    here, there = task.views.joint_q.view(2, 3, 6)
    swapped = there[:, SWAPPED] * torch.tensor([[-1.0], [1.0], [1.0]])
    assert here.abs().max() > 0.1
    assert (here - swapped).abs().max() < 0.2 * here.abs().max()
    pose = task.views.body_q[:, 0]
    roll, pitch, yaw = Rotation.from_quat(pose[:, 3:]).as_euler("XYZ").T
    assert abs(float(pose[0, 2] - pose[1, 2])) < 2e-3
    for angle, sign in ((roll, 1.0), (pitch, -1.0), (yaw, 1.0)):
        assert abs(float(angle[0] + sign * angle[1])) < 0.02


# ---- rewards and the end of an episode -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["walk", "code"])
def test_rewards_are_those_of_the_option(name):
    task = still(reward=HexapodReward(name))
    place(task, height=0.8, velocity=(0.3, 0.1, 0.0))
    to_torch(task.simulation.state.body_v)[:] = torch.tensor([0.3, 0.1, 0.0])
    task.simulation.measure()
    start = float(task.views.body_q[0, 0, 0])
    action = torch.full((1, 18), 0.01)
    result = task.step(action)
    terms = dict(zip(task.reward_terms, result.reward_terms[0].tolist(), strict=True))
    after = result.final_observations["policy"][0]
    power = float((action[0] * after[29:47]).abs().mean())
    moved = float(task.views.body_q[0, 0, 0]) - start
    assert moved == pytest.approx(0.3 * 0.02, rel=0.1)
    assert terms["progress"] == pytest.approx(5.0 * moved / 0.02, rel=2e-3)
    if name == "code":
        assert set(terms) == {"progress", "alive", "energy", "joint_pos_limits", "height"}
        assert terms["alive"] == 1.0
        assert terms["energy"] == pytest.approx(-0.1 * power, rel=1e-4)
        assert terms["height"] == pytest.approx(2.0 * (float(after[0]) - 0.1325 - 0.019258), rel=1e-4)
        return
    assert terms["alive"] == 0.5
    assert terms["lin_vel_y_l1"] == pytest.approx(-0.1, rel=0.3)


def test_joints_at_their_limits_cost():
    task = still(reward=HexapodReward.CODE)
    q = torch.zeros(1, 18)
    q[0, 0], q[0, 9], q[0, 12] = 0.5 * math.pi, -0.5 * math.pi, 1.5
    place(task, height=0.8, q=q)
    assert task.rewards()["joint_pos_limits"].tolist() == pytest.approx([-1.6])


@pytest.mark.parametrize("part", ["base", "tibia"])
def test_anything_but_a_foot_on_the_ground_is_a_failure(part):
    task = still(2)
    legs = torch.zeros(2, 18)
    if part == "base":
        legs[:, 6:] = -1.2  # legs up: it lies on its belly
        place(task, height=0.02, q=legs)
    else:
        legs[:, 6:12] = 1.5  # femurs straight down, feet inwards and up: it kneels
        legs[:, 12:] = 0.6
        place(task, height=0.09, q=legs)
    task.simulation.step()
    names = task.simulation.model.shape_names
    force = task.simulation.contacts.shape_contact_force.numpy()[0]
    touching = {names[index].split("_")[0] for index in np.flatnonzero(np.abs(force).sum(axis=1))}
    assert touching == {"floor", part}
    result = task.step(idle(task))
    assert result.terminated.all()
    assert not result.success.any()
    assert {task.end_reasons[index] for index in result.end_reason} == {"contact"}
    terms = dict(zip(task.reward_terms, result.reward_terms[0].tolist(), strict=True))
    assert terms["alive"] < 0.0


def test_the_arena_ends_an_episode_without_failure():
    task = still()
    place(task, x=49.01, height=1.0)
    result = task.step(idle(task))
    assert result.truncated.all()
    assert not result.terminated.any()


def test_success_needs_distance_time_and_line():
    task = still(3, max_episode_steps=5)
    place(task, height=3.0)
    shift = torch.tensor([[2.1, 0.0], [1.8, 0.0], [2.1, 0.7]], dtype=torch.float64)
    to_torch(task.simulation.state.body_x)[:, :, :2] += shift.unsqueeze(1)
    task.simulation.measure()
    for _ in range(5):
        result = task.step(idle(task))
    assert result.truncated.all()
    assert result.success.tolist() == [True, False, False]
    assert result.metrics["distance"].tolist() == pytest.approx([2.1, 1.8, 2.1], abs=0.02)
    assert result.metrics["lateral_error"][2] == pytest.approx(0.7, abs=0.02)
    late = still(max_episode_steps=5, goal_time=0.02)
    for _ in range(4):
        late.step(idle(late))
    place(late, x=3.0, height=3.0)
    assert not late.step(idle(late)).success.any()


# ---- worlds ----------------------------------------------------------------------------------------------------


def test_start_is_random_within_its_range_and_above_the_ground():
    task = make("hexapod", 300, seed=1)
    seen = task.restart(seed=1)["policy"].clone()
    assert 0.045 < seen[:, 11:17].abs().max() <= 0.05 + 1e-5
    assert seen[:, 17:29].min() >= -0.05 - 1e-5
    assert seen[:, 17:29].max() <= 1e-5
    assert 0.045 < np.abs(Rotation.from_quat(seen[:, 1:5]).as_euler("XYZ")[:, 2]).max() <= 0.05 + 1e-5
    task.simulation.step()
    assert to_torch(task.simulation.contacts.penetration).max() < 1e-3
    assert torch.equal(task.restart(seed=1)["policy"], seen)
    assert torch.equal(make("hexapod", 3, seed=1).restart(seed=1)["policy"], seen[:3])


def test_worlds_do_not_depend_on_how_many_there_are():
    def roll(worlds):
        task = make("hexapod", worlds, seed=1, max_episode_steps=15)
        generator = torch.Generator().manual_seed(0)
        actions = torch.rand(25, 5, 18, generator=generator) * 2 - 1
        return torch.stack([task.step(a[:worlds]).observations["policy"].clone() for a in actions])

    assert torch.equal(roll(5)[:, :2], roll(2))


def test_state_dict_continues_exactly():
    task = make("hexapod", 3, seed=2, max_episode_steps=20)
    actions = torch.rand(40, 3, 18, generator=torch.Generator().manual_seed(0)) * 0.4 - 0.2
    for action in actions[:17]:
        task.step(action)
    state = task.state_dict()
    expected = [task.step(action) for action in actions[17:]]
    other = make("hexapod", 3, seed=9, max_episode_steps=20)
    other.load_state_dict(state)
    for action, before in zip(actions[17:], expected, strict=True):
        assert torch.equal(other.step(action).rewards, before.rewards)


def test_wrong_settings_are_named():
    with pytest.raises(InputError, match="speed-limit must be positive"):
        make("hexapod", speed_limit=0.0)
    with pytest.raises(InputError, match=r"start-angle must be in \[0, 0.5\]"):
        make("hexapod", start_angle=1.0)


# ---- walking ---------------------------------------------------------------------------------------------------


def test_the_shipped_policy_walks_two_metres():
    task = make("hexapod", 8, seed=21)
    source = find_policy("hexapod", SHIPPED / "hexapod.pt")
    result = evaluate(task, network_policy(source.content, task), 8, seed=21)
    assert result.success_rate == 1.0
    assert result.metrics["distance"] >= 2.0


@pytest.mark.slow
def test_forty_iterations_turn_losses_into_gains(tmp_path):
    config = dataclasses.replace(default_config(HexapodTask), iterations=40, num_envs=256)
    run = train("hexapod", config, HexapodConfig(), root=tmp_path)
    with (Path(run.checkpoint).parents[1] / "progress.csv").open(encoding="utf-8") as file:
        rewards = [float(row["mean_reward"]) for row in csv.DictReader(file)]
    assert np.mean(rewards[:3]) < 0.0
    assert np.mean(rewards[-3:]) > 2.0
