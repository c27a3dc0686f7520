"""Pieces of velocity tasks against slow NumPy that is written from their equations, and their symmetries."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from simwarp.tasks import make
from simwarp.tasks.framework.rotations import heading_of, in_body_axes, in_world_axes
from simwarp.tasks.locomotion.velocity import mdp
from simwarp.tasks.randomisation.randomisation_config import Mode
from simwarp.tasks.randomisation.randomness import WorldRandom

WORLDS = 7


def drawn(*shape, seed=0):
    """Normal numbers, float32 as tasks have them."""
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def some_views(seed=0):
    """A state of three bodies in some worlds, as `task.views`."""
    rotation = drawn(WORLDS, 3, 4, seed=seed)
    rotation /= rotation.norm(dim=2, keepdim=True)
    place = torch.cat([drawn(WORLDS, 3, 3, seed=seed + 1), rotation], dim=2)
    return SimpleNamespace(
        body_q=place, body_v=drawn(WORLDS, 3, 3, seed=seed + 2), body_omega=drawn(WORLDS, 3, 3, seed=seed + 3)
    )


def near(got, expected):
    """Equal but for the rounding of float32 over a few operations."""
    np.testing.assert_allclose(got.numpy(), expected, rtol=2e-5, atol=2e-6)


# ---- axes and observations ------------------------------------------------------------------------------------------


def test_axes_of_world_and_body_are_those_of_the_rotation():
    views = some_views()
    rotation, vector = views.body_q[:, 1, 3:], drawn(WORLDS, 3, seed=9)
    turn = Rotation.from_quat(rotation.double().numpy())
    near(in_world_axes(rotation, vector), turn.apply(vector.numpy()))
    near(in_body_axes(rotation, vector), turn.inv().apply(vector.numpy()))
    ahead = turn.apply([1.0, 0.0, 0.0])
    near(heading_of(rotation), np.arctan2(ahead[:, 1], ahead[:, 0]))


def test_observations_of_a_body_are_in_its_axes():
    views = some_views()
    turn = Rotation.from_quat(views.body_q[:, 2, 3:].double().numpy())
    near(mdp.base_lin_vel(views, 2), turn.inv().apply(views.body_v[:, 2].numpy()))
    near(mdp.base_ang_vel(views, 2), turn.inv().apply(views.body_omega[:, 2].numpy()))
    near(mdp.projected_gravity(views, 2), turn.inv().apply(np.tile([0.0, 0.0, -1.0], (WORLDS, 1))))


def test_names_of_a_row():
    assert mdp.component_names(speed=3, flag=2, joint=["hip", "knee"]) == [
        "speed x", "speed y", "speed z", "flag 0", "flag 1", "joint hip", "joint knee",
    ]  # fmt: skip


# ---- rewards --------------------------------------------------------------------------------------------------------


def test_rewards_of_tracking():
    velocity, turning, command = drawn(WORLDS, 3), drawn(WORLDS, 3, seed=1), drawn(WORLDS, 3, seed=2)
    v, w, c = (each.double().numpy() for each in (velocity, turning, command))
    error = np.sqrt((v[:, 0] - c[:, 0]) ** 2 + (v[:, 1] - c[:, 1]) ** 2)
    near(mdp.lin_vel_xy_error(velocity, command), error)
    near(mdp.ang_vel_z_error(turning, command), np.abs(w[:, 2] - c[:, 2]))
    near(mdp.track_exp(mdp.lin_vel_xy_error(velocity, command), 0.5), np.exp(-(error**2) / 0.25))
    assert mdp.track_exp(torch.zeros(1), 0.3).item() == 1.0


def test_rewards_of_the_body():
    velocity, turning, gravity = drawn(WORLDS, 3), drawn(WORLDS, 3, seed=1), drawn(WORLDS, 3, seed=2)
    near(mdp.lin_vel_z_l2(velocity), velocity.numpy()[:, 2] ** 2)
    near(mdp.ang_vel_xy_l2(turning), (turning.numpy()[:, :2] ** 2).sum(axis=1))
    near(mdp.flat_orientation_l2(gravity), (gravity.numpy()[:, :2] ** 2).sum(axis=1))
    near(mdp.base_height_l2(velocity[:, 0], 0.3), (velocity.numpy()[:, 0] - 0.3) ** 2)
    tilted = torch.tensor([[math.sin(0.3), 0.0, -math.cos(0.3)]])
    assert mdp.flat_orientation_l2(tilted).item() == pytest.approx(math.sin(0.3) ** 2, rel=1e-6)


def test_rewards_of_joints():
    q, qd, target = drawn(WORLDS, 5), drawn(WORLDS, 5, seed=1), drawn(WORLDS, 5, seed=2)
    stiffness, damping, limit = torch.linspace(10.0, 50.0, 5), torch.linspace(0.5, 1.5, 5), torch.full((5,), 20.0)
    expected = np.zeros((WORLDS, 5))
    for world in range(WORLDS):
        for joint in range(5):
            effort = float(stiffness[joint]) * float(target[world, joint] - q[world, joint])
            effort -= float(damping[joint]) * float(qd[world, joint])
            expected[world, joint] = max(-20.0, min(20.0, effort))
    torque = mdp.drive_torque(q, qd, target, stiffness, damping, limit)
    near(torque, expected)
    assert (np.abs(expected) == 20.0).any()
    near(mdp.joint_l2(q), (q.numpy() ** 2).sum(axis=1))
    near(mdp.joint_power(torque, qd), np.abs(expected * qd.numpy()).sum(axis=1))
    low, high = torch.full((5,), -0.5), torch.full((5,), 0.8)
    outside = [sum(max(0.0, -0.5 - x) + max(0.0, x - 0.8) for x in row) for row in q.tolist()]
    near(mdp.joint_pos_limits(q, low, high), outside)
    moving = torch.tensor([1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0])
    near(mdp.stand_still(q, moving), np.abs(q.numpy()).sum(axis=1) * (1.0 - moving.numpy()))


def test_rewards_of_feet():
    velocity, force = drawn(WORLDS, 4, 3), 50.0 * drawn(WORLDS, 4, 3, seed=1)
    touching = drawn(WORLDS, 4, seed=2) > 0.0
    height = drawn(WORLDS, 4, seed=3).abs()
    v, f = velocity.double().numpy(), force.double().numpy()
    slid, raised, hit = np.zeros(WORLDS), np.zeros(WORLDS), np.zeros(WORLDS)
    for world in range(WORLDS):
        for foot in range(4):
            fast = math.hypot(v[world, foot, 0], v[world, foot, 1])
            slid[world] += fast**2 if touching[world, foot] else 0.0
            raised[world] += abs(float(height[world, foot]) - 0.08) * fast
            hit[world] += math.hypot(*f[world, foot, :2]) > 4.0 * abs(f[world, foot, 2])
    near(mdp.feet_slide(velocity, touching), slid)
    near(mdp.feet_clearance(height, velocity, 0.08), raised)
    near(mdp.feet_stumble(force), hit)
    assert 0 < hit.sum() < 4 * WORLDS
    near(mdp.undesired_contacts(touching), touching.numpy().sum(axis=1))
    assert mdp.feet_stumble(torch.zeros(1, 4, 3)).item() == 0.0


def test_feet_are_paid_for_swings_and_stances_of_the_right_length():
    in_air = torch.tensor([[0.0, 0.05, 0.2, 0.9], [0.3, 0.3, 0.0, 0.0]])
    standing = torch.tensor([[0.15, 0.0, 0.0, 0.0], [0.0, 0.0, 0.2, 0.2]])
    moving = torch.tensor([1.0, 0.0])
    assert mdp.feet_air_time(in_air, standing, moving, least=0.1, longest=0.4).tolist() == [2.0, 0.0]
    for swing in (0.06, 0.24, 0.5):
        times = torch.arange(0.0, swing, 1e-4).view(-1, 1)
        paid = 1e-4 * mdp.feet_air_time(times, 0.0 * times, torch.ones(len(times)), least=0.1, longest=0.4).sum()
        assert float(paid) == pytest.approx(min(max(swing, 0.1), 0.4) - 0.1, abs=2e-4)  # two steps of the sum


def test_feet_keep_to_the_clock_of_a_gait():
    phase, offsets = torch.tensor([0.1, 0.6, 12.3, 0.1]), torch.tensor([0.0, 0.5, 0.5, 0.0])
    moving = torch.tensor([1.0, 1.0, 1.0, 0.0])
    trot = torch.tensor([[True, False, False, True]])
    touching = torch.cat([trot, trot, trot, trot])
    # half a cycle later the other pair stands; whole cycles change nothing; who is to stand has all feet down
    found = mdp.gait_contacts(touching, phase, offsets, moving, stance=0.5)
    assert found.tolist() == [1.0, -1.0, 1.0, 0.0]
    down, late = torch.ones(2, 4, dtype=torch.bool), torch.tensor([0.1, 0.9])
    longer = mdp.gait_contacts(down, late, offsets, moving[:2], stance=0.75)
    assert longer.tolist() == [1.0, 0.0]  # at 0.1 and at 0.6 all feet stand; at 0.9 two are up
    clock = mdp.gait_clock(phase)
    near(clock[:, 0], np.sin(2.0 * np.pi * phase.double().numpy()))
    near(clock[:, 1], np.cos(2.0 * np.pi * phase.double().numpy()))


def test_rewards_are_those_of_the_mirror_image():
    """Left for right: y changes its sign, and rotations about x and z do."""
    flip, turn = torch.tensor([1.0, -1.0, 1.0]), torch.tensor([-1.0, 1.0, -1.0])
    velocity, turning, gravity = drawn(WORLDS, 3), drawn(WORLDS, 3, seed=1), drawn(WORLDS, 3, seed=2)
    command, mirror = drawn(WORLDS, 3, seed=3), torch.tensor([1.0, -1.0, -1.0])
    feet, force, swap = drawn(WORLDS, 4, 3, seed=4), drawn(WORLDS, 4, 3, seed=5), [1, 0, 3, 2]
    touching = drawn(WORLDS, 4, seed=6) > 0.0
    for one, other in (
        (mdp.lin_vel_xy_error(velocity, command), mdp.lin_vel_xy_error(velocity * flip, command * mirror)),
        (mdp.ang_vel_z_error(turning, command), mdp.ang_vel_z_error(turning * turn, command * mirror)),
        (mdp.lin_vel_z_l2(velocity), mdp.lin_vel_z_l2(velocity * flip)),
        (mdp.ang_vel_xy_l2(turning), mdp.ang_vel_xy_l2(turning * turn)),
        (mdp.flat_orientation_l2(gravity), mdp.flat_orientation_l2(gravity * flip)),
        (mdp.is_moving(command), mdp.is_moving(command * mirror)),
        (mdp.feet_slide(feet, touching), mdp.feet_slide((feet * flip)[:, swap], touching[:, swap])),
        (mdp.feet_stumble(force), mdp.feet_stumble((force * flip)[:, swap])),
    ):
        near(one, other.numpy())


# ---- commands and events --------------------------------------------------------------------------------------------


def random_of(worlds, *, seed=3):
    """Random numbers of some worlds, with their clocks."""
    episode, step = torch.zeros(worlds, dtype=torch.int64), torch.zeros(worlds, dtype=torch.int64)
    return WorldRandom(seed, episode, step), step


def test_commands_are_uniform_and_change_when_their_time_has_come():
    random, steps = random_of(4000)
    command, most = torch.zeros(4000, 3), torch.tensor([1.0, 0.5, 0.8])
    seen = []
    for step in range(21):
        steps.fill_(step)
        due = mdp.resample_command(command, random, steps, every=10, most=most)
        assert bool(due.all()) == bool(due.any()) == (step % 10 == 0)
        seen.append(command.clone())
        mdp.resample_command(command, random, steps, every=10, most=most)
        assert torch.equal(command, seen[-1])
    for step in range(1, 21):
        assert torch.equal(seen[step], seen[step - 1]) == (step % 10 != 0)
    for draws in (seen[0], seen[10]):
        assert (draws.abs() <= most).all()
        # Of 4000 draws of U(-1, 1) the mean deviates by 0.577 / 63, the square by 0.298 / 63: four times that
        np.testing.assert_allclose((draws / most).mean(dim=0), 0.0, atol=0.037)
        np.testing.assert_allclose((draws / most).square().mean(dim=0), 1 / 3, atol=0.019)
    # The same for two episodes' worth of independence, and for two components
    assert abs(float((seen[0] * seen[10] / most.square()).mean())) < 0.02
    assert abs(float((seen[0][:, 0] * seen[0][:, 1]).mean())) < 0.02


def test_worlds_begin_with_a_new_command_and_others_keep_theirs():
    random, steps = random_of(6)
    command, most = torch.zeros(6, 3), torch.ones(3)
    mdp.resample_command(command, random, steps, every=10, most=most)
    before = command.clone()
    steps.copy_(torch.tensor([3, 3, 0, 10, 3, 3]))
    assert (
        mdp.resample_command(command, random, steps, every=10, most=most).tolist()
        == [False] * 2 + [True] * 2 + [False] * 2
    )
    # World 2 is at the same step of the same episode: the same draw
    assert torch.equal(command[[0, 1, 2, 4, 5]], before[[0, 1, 2, 4, 5]])
    assert not torch.equal(command[3], before[3])


def test_a_share_of_commands_is_to_stand():
    random, steps = random_of(4000)
    command = torch.ones(4000, 3)
    mdp.resample_command(command, random, steps, every=10, most=torch.ones(3), standing=0.25)
    still = 1.0 - mdp.is_moving(command, 1e-6)
    assert float(still.mean()) == pytest.approx(0.25, abs=0.03)  # four deviations of 0.0068
    assert (command[still > 0.0] == 0.0).all()


def test_a_heading_is_reached_by_the_shorter_way():
    quarter = torch.tensor([[0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)]]).repeat(4, 1)
    wanted = torch.tensor([0.0, math.pi / 2 + 0.2, math.pi / 2 - 0.2, -math.pi / 2 - 0.1])
    turn = mdp.heading_to_ang_vel(quarter, wanted, gain=1.0, most=1.0)
    near(turn, [-1.0, 0.2, -0.2, 1.0])
    random, _ = random_of(2000)
    heading, due = torch.full((2000,), 9.0), torch.arange(2000) % 2 == 0
    mdp.resample_heading(heading, random, due)
    assert (heading[~due] == 9.0).all()
    assert 3.1 < heading[due].abs().max() <= math.pi


def test_pushes_change_the_momentum_at_one_step_of_many():
    random, steps = random_of(500)
    kicked = torch.zeros(500, 3)
    pushes = torch.zeros(500)
    for step in range(41):
        steps.fill_(step)
        force = mdp.push_by_force(random, steps, every=20, speed=0.8, mass=12.0, period=0.02)
        kicked += force * 0.02 / 12.0
        pushes += force.norm(dim=1) > 0.0
        largest = force.norm(dim=1).max() * 0.02 / 12.0
        assert largest <= 0.8 + 1e-6
    assert (kicked[:, 2] == 0.0).all()
    assert ((pushes >= 1) & (pushes <= 3)).all()  # two in 40 steps; one more, or less, at the ends
    assert float(pushes.mean()) == pytest.approx(2.0, abs=0.1)


def test_ranges_of_a_robot_are_those_of_randomise():
    ranges = mdp.robot_ranges("trunk", ["a", "b"], friction=(0.4, 0.9), payload=2.0, gains=0.2)
    assert ranges["shape_friction"].only == ("a", "b")
    assert ranges["shape_friction"].mode is Mode.SET
    assert (ranges["body_mass"].low, ranges["body_mass"].high) == (-2.0, 2.0)
    assert ranges["drive_damping"].high == pytest.approx(1.2)
    assert {name for name in ranges if name.startswith("body_com")} == {"body_com_x", "body_com_y", "body_com_z"}
    assert (ranges["body_com_y"].low, ranges["body_com_y"].high) == (-0.02, 0.02)
    make("quadruped-velocity", 2, randomise=mdp.robot_ranges("trunk", ["FL_foot", "FR_foot"]))
