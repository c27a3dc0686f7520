"""Tasks of commanded velocities: what is observed, paid and counted, commands, falls, pushes, resets, and resuming."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.core.interop import to_torch
from simwarp.tasks import InputError, check_step, make, replace_fields
from simwarp.tasks.framework.registry import config_to_train_in
from simwarp.tasks.locomotion.velocity import quadruped
from simwarp.tasks.locomotion.velocity.config import VelocityConfig, VelocityObs
from simwarp.tasks.locomotion.velocity.ground import Ground
from simwarp.tasks.locomotion.velocity.quadruped import QuadrupedVelocity
from simwarp.train.config import default_config, task_config_from_plain
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import SHIPPED, find_policy, network_policy, zero_policy
from simwarp.train.runs.training import train

GO2 = Path(__file__).parents[4] / "../shared/reference/robots/mjcf/go2/go2.xml"
JOINTS = {"quadruped-velocity": 12, "hexapod-velocity": 18}
both = pytest.mark.parametrize("name", list(JOINTS))
grounds = pytest.mark.parametrize("ground", list(Ground))


def made(name: str, worlds: int, **options: Any) -> Any:
    """A task, with the attributes that its own class has."""
    return make(name, worlds, **options)


def random_actions(task, steps, seed=0, size=0.6):
    """(steps, W, A) within some share of the range."""
    generator = torch.Generator().manual_seed(seed)
    return size * (2.0 * torch.rand(steps, task.num_worlds, task.action_size, generator=generator) - 1.0)


def idle(task):
    return torch.zeros(task.num_worlds, task.action_size)


def rolled(task, actions):
    """All observations and rewards of some steps."""
    results = (task.step(action) for action in actions)  # a captured step hands out the same tensors again
    return [torch.cat([each.observations["policy"], each.rewards[:, None]], dim=1).clone() for each in results]


# ---- observations ---------------------------------------------------------------------------------------------------


@both
def test_observations_are_what_their_names_say(name):
    task = made(name, 3, seed=4)
    for action in random_actions(task, 12):
        seen = task.step(action).observations["policy"].numpy()
    names = task.observation_names["policy"]
    assert seen.shape == (3, len(names)) == (3, 12 + 3 * JOINTS[name])
    column = {each: index for index, each in enumerate(names)}
    views, body = task.views, task.body
    turn = Rotation.from_quat(views.body_q[:, body, 3:].double().numpy()).inv()
    for part, vector in (
        ("velocity", views.body_v[:, body]), ("turning", views.body_omega[:, body]),
        ("down", torch.tensor([[0.0, 0.0, -1.0]] * 3)),
    ):  # fmt: skip
        first = column[f"{part} x"]
        np.testing.assert_allclose(seen[:, first : first + 3], turn.apply(vector.numpy()), atol=1e-5)
    for joint, angle in task.stance.items():
        dof = task.simulation.model.dof(joint)
        np.testing.assert_allclose(seen[:, column[f"angle {joint}"]], views.joint_q[:, dof] - angle, atol=1e-6)
        np.testing.assert_allclose(seen[:, column[f"rate {joint}"]], views.joint_qd[:, dof], atol=1e-6)
    np.testing.assert_array_equal(seen[:, column["command ahead"]], task.command[:, 0])
    first = column[f"action {task.action_joints[0]}"]
    np.testing.assert_array_equal(seen[:, first:], task.action)


def test_actions_are_targets_around_the_stance():
    task = made("quadruped-velocity", 1)
    action = torch.linspace(-1.0, 1.0, 12).view(1, 12)
    task.step(action)
    targets = task.simulation.control.joint_target_q.numpy()[0]
    for column, (joint, angle) in enumerate(task.stance.items()):
        aim = angle + task.action_scale[column] * float(action[0, column])
        assert targets[task.simulation.model.dof(joint)] == pytest.approx(aim, abs=1e-6)


def test_a_history_is_what_was_felt_before():
    task = made("quadruped-velocity", 2, seed=1, obs=VelocityObs.HISTORY, history=4, max_episode_steps=9)
    size = 9 + 3 * 12
    assert task.observation_shapes == {"policy": (4 * size,)}
    felt = [task.restart(seed=1)["policy"].view(2, 4, size).clone()]
    assert torch.equal(felt[0], felt[0][:, :1].expand(-1, 4, -1))  # as if it had stood there before
    for step, action in enumerate(random_actions(task, 9), 1):
        felt.append(task.step(action).observations["policy"].view(2, 4, size).clone())
        if step < 9:
            for age in range(4):
                assert torch.equal(felt[step][:, age], felt[max(0, step - age)][:, 0])
    assert torch.equal(felt[9], felt[9][:, :1].expand(-1, 4, -1))  # a new episode
    assert not torch.equal(felt[9][:, 0], felt[8][:, 0])


@grounds
def test_teachers_see_more_of_the_same_worlds(ground):
    task = made("quadruped-velocity", 3, seed=2, obs=VelocityObs.HISTORY, ground=ground)
    exact = made("quadruped-velocity", 3, seed=2, obs=VelocityObs.SCAN, ground=ground)
    for action in random_actions(task, 5):
        task.step(action)
        seen = exact.step(action).observations["policy"]
    assert torch.equal(task.observe_as("scan")["policy"], seen)
    assert torch.equal(task.observe_as("state")["policy"], seen[:, : 12 + 36])
    heights = seen[:, 48:]
    assert heights.shape == (3, 77)
    # In the middle all ground is level
    sunk = (task.height - task.views.body_q[:, task.body, 2:3]).expand(-1, 77)
    np.testing.assert_allclose(heights, sunk, atol=1e-5)


def test_a_critic_may_see_the_ground_and_the_feet():
    task = made("quadruped-velocity", 2, obs=VelocityObs.HISTORY, push_speed=0.0)
    for _ in range(50):
        task.step(idle(task))
    seen = task.observe_privileged()
    assert torch.equal(seen[:, :125], task.observe_as("scan")["policy"])
    upwards = seen[:, 125:].view(2, 4, 3)[:, :, 2]
    assert upwards.sum(dim=1).tolist() == pytest.approx([1.0, 1.0], abs=0.05)  # it still sways a little


# ---- rewards and metrics --------------------------------------------------------------------------------------------


def test_errors_are_means_over_the_episode():
    task = made("quadruped-velocity", 2, seed=3, max_episode_steps=30, command_time=0.2)
    sums, commands = np.zeros((2, 2)), set()
    for step, action in enumerate(random_actions(task, 30, size=0.3), 1):
        command = task.command.double().numpy().copy()
        commands.add(float(command[0, 0]))
        result = task.step(action)
        seen = result.final_observations["policy"].double().numpy()
        sums[:, 0] += np.hypot(seen[:, 0] - command[:, 0], seen[:, 1] - command[:, 1])
        sums[:, 1] += np.abs(seen[:, 5] - command[:, 2])
        got = torch.stack([result.metrics["speed_error"], result.metrics["turn_error"]], dim=1)
        np.testing.assert_allclose(got, sums / step, rtol=1e-4)
    assert len(commands) == 3  # one every ten steps
    assert result.truncated.all()
    assert result.success.all()
    task.step(idle(task))
    assert float(task.error_sums.abs().max()) == 0.0


def test_who_follows_is_paid_more_than_who_stands():
    task = made("quadruped-velocity", 2, seed=1)
    task.command[:] = torch.tensor([0.0, 0.0, 0.0])
    standing = task.rewards()["speed"].clone()
    assert standing.tolist() == pytest.approx([2.0 * 0.02] * 2, rel=1e-3)
    task.command[:] = torch.tensor([0.5, 0.0, 0.0])
    assert task.rewards()["speed"].tolist() == pytest.approx([2.0 * 0.02 * math.exp(-1.0)] * 2, rel=1e-3)


def test_the_reward_is_that_of_the_mirror_image():
    """Left for right: actions change legs, hips and the commands to the side and turn their sign."""
    one, other = (made("quadruped-velocity", 1, seed=1, start_angle=0.0, push_speed=0.0) for _ in range(2))
    sign, swap = torch.tensor([-1.0, 1.0, 1.0]), [1, 0, 3, 2]
    start = torch.zeros(1, 18)
    start[:, 2], start[:, 6:] = 0.35, torch.tensor(list(one.stance.values()))
    command = torch.tensor([[0.1, 0.1, -0.1]])
    for task, mirror in ((one, torch.ones(3)), (other, torch.tensor([1.0, -1.0, -1.0]))):
        task.simulation.set_joint_state(None, start, torch.zeros(1, 18))
        task.command.copy_(command * mirror)
    for action in random_actions(one, 20, size=0.4):
        mirrored = (action.view(4, 3)[swap] * sign).view(1, 12)
        terms, others = one.step(action).reward_terms, other.step(mirrored).reward_terms
        # The solve goes to 1e-3 m/s in another order of the legs; over 20 steps of feet that slip and land that
        # grows to 1 cm/s, a few per cent of the largest terms, which are 0.04
        np.testing.assert_allclose(terms, others, atol=1e-3)
    assert float(terms[0, one.reward_terms.index("speed")]) > 0.01


# ---- what happens ---------------------------------------------------------------------------------------------------


@both
def test_it_stands_on_its_feet_and_they_carry_its_weight(name):
    task = made(name, 2, seed=1, start_angle=0.0, push_speed=0.0)
    for _ in range(300):
        result = task.step(idle(task))
    assert not result.terminated.any()
    assert task.on_feet.touching.all()
    assert not task.on_trunk.touching.any()
    weight = 9.81 * float(task.simulation.model.body_mass.numpy()[0].sum())
    # Contacts to 1e-3 m/s: of the whole mass in 5 ms that is 2 % of the weight
    assert task.on_feet.force[:, :, 2].sum(dim=1).tolist() == pytest.approx([weight] * 2, rel=0.02)
    assert task.on_feet.time_in_contact.min() > 4.0


@both
def test_a_robot_on_its_back_fell(name):
    task = made(name, 2)
    start = task._start.clone()
    start[1, task._place + 3 : task._place + 6] = torch.tensor([math.pi, 0.0, 0.0])
    task.simulation.set_joint_state(None, start, torch.zeros_like(start))
    result = task.step(idle(task))
    assert result.terminated.tolist() == [False, True]
    assert task.end_reasons[result.end_reason[1]] == "fell"
    assert result.success.tolist() == [False, False]
    assert float(result.reward_terms[1, task.reward_terms.index("fall")]) < -1.0


def test_the_trunk_must_not_touch_the_ground():
    task = made("quadruped-velocity", 1)
    start = task._start.clone()
    start[:, 2] = 0.056  # half of the trunk's height is 0.057 m; legs point up
    start[:, 6:] = torch.tensor([0.0, 3.0, -0.9] * 4)
    task.simulation.set_joint_state(None, start, torch.zeros_like(start))
    assert task.step(idle(task)).terminated.all()


def test_commands_have_their_bounds_and_their_time():
    task = made("quadruped-velocity", 300, seed=2, command_time=0.1, max_speed=0.9, max_sideways=0.2, max_turn=0.4)
    before, most = task.command.clone(), torch.tensor([0.9, 0.2, 0.4])
    assert (before.abs() <= most).all()
    assert (before.abs().amax(dim=0) > 0.95 * most).all()
    for step in range(1, 11):
        task.step(idle(task))
        assert torch.equal(task.command, before) == (step % 5 != 0)
        before = task.command.clone()


def test_headings_lead_the_turn():
    task = made("quadruped-velocity", 50, seed=2, heading=True)
    task.step(idle(task))
    ahead = Rotation.from_quat(task.views.body_q[:, task.body, 3:].double().numpy()).apply([1.0, 0.0, 0.0])
    away = task.heading.numpy() - np.arctan2(ahead[:, 1], ahead[:, 0])
    away = (away + np.pi) % (2.0 * np.pi) - np.pi
    np.testing.assert_allclose(task.command[:, 2], np.clip(away, -1.0, 1.0), atol=1e-4)


def test_pushes_change_the_momentum():
    pushed = made("quadruped-velocity", 4, seed=1, push_speed=1.0, push_time=0.1)
    calm = made("quadruped-velocity", 4, seed=1, push_speed=0.0)
    masses = to_torch(calm.simulation.model.body_mass)[0].unsqueeze(1)

    def momentum(task):
        return (task.views.body_v * masses).sum(dim=1)[:, :2] / masses.sum()

    for task in (pushed, calm):  # in the air, where nothing else acts along x and y
        start = task._start.clone()
        start[:, 2] = 3.0
        task.simulation.set_joint_state(None, start, torch.zeros_like(start))
    total = torch.zeros(4, 2)
    for _ in range(8):
        pushed.step(idle(pushed))
        calm.step(idle(calm))
        total += 0.02 * pushed.views.body_force[:, pushed.body, :2] / masses.sum()
    assert (total.norm(dim=1) > 0.05).all()
    # float32 of speeds up to 1 m/s and forces up to 760 N, over 32 physics steps
    np.testing.assert_allclose(momentum(pushed) - momentum(calm), total, atol=1e-4)


def test_rough_ground_ends_at_its_edge_and_tells_its_level():
    task = made("quadruped-velocity", 2, ground=Ground.ROUGH)
    start = task._start.clone()
    start[1, 0], start[:, 2] = 3.9, 0.5
    task.simulation.set_joint_state(None, start, torch.zeros_like(start))
    result = task.step(idle(task))
    assert result.truncated.tolist() == [False, True]
    assert task.end_reasons[result.end_reason[1]] == "edge"
    assert (result.metrics["level"] >= 0.0).all()


@pytest.mark.skipif(not GO2.exists(), reason="no reference robots here")
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_an_imported_robot_is_another_subclass():
    class Imported(QuadrupedVelocity):
        trunk, base, height = "base_link", "joint0", 0.29
        feet = ("FL", "FR", "RL", "RR")

        def robot(self):
            robot = sw.importers.load_mjcf(GO2)
            for joint in self.stance:
                robot.set_drive(joint, sw.PositionDrive(stiffness=40.0, damping=1.0, effort_limit=23.7))
            return robot.builder

        def visuals(self, visuals):
            """As in the file."""

    task = Imported(VelocityConfig(start_angle=0.0, push_speed=0.0), 2)
    own = made("quadruped-velocity", 2)
    assert task.observation_names == own.observation_names
    for _ in range(150):
        result = task.step(idle(task))
    assert not result.terminated.any()
    weight = 9.81 * float(task.simulation.model.body_mass.numpy()[0].sum())
    # It still sways: at 0.3 m/s2 some 3 % of the weight are inertia
    assert task.on_feet.force[:, :, 2].sum(dim=1).tolist() == pytest.approx([weight] * 2, rel=0.05)


# ---- laws of every task ---------------------------------------------------------------------------------------------


@both
@grounds
def test_worlds_do_not_depend_on_how_many_there_are_nor_on_each_other(name, ground):
    options = {"seed": 1, "max_episode_steps": 12, "ground": ground, "push_speed": 0.5, "push_time": 0.1}
    many, few = made(name, 5, **options), made(name, 2, **options)
    actions = random_actions(many, 20)
    actions[:, 4] = 1.0
    alone = rolled(few, actions[:, :2])
    for together, apart in zip(rolled(many, actions), alone, strict=True):
        assert torch.equal(together[:2], apart)


@both
@grounds
def test_a_resumed_run_repeats_bit_by_bit(name, ground):
    options = {
        "max_episode_steps": 20,
        "ground": ground,
        "command_time": 0.12,
        "heading": True,
        "obs": VelocityObs.HISTORY,
    }
    task, other = made(name, 3, seed=2, **options), made(name, 3, seed=9, **options)
    actions = random_actions(task, 40)
    rolled(task, actions[:17])
    state = task.state_dict()
    expected, metrics = rolled(task, actions[17:]), task.metrics()
    other.load_state_dict(state)
    for mine, theirs in zip(expected, rolled(other, actions[17:]), strict=True):
        assert torch.equal(mine, theirs)
    for name_, values in other.metrics().items():
        assert torch.equal(values, metrics[name_])


def test_a_masked_reset_changes_nothing_in_other_worlds():
    task = made("quadruped-velocity", 3, seed=1)
    rolled(task, random_actions(task, 10))
    before = task.observe()["policy"].clone()
    task.begin_episodes(torch.tensor([False, True, False]))
    after = task.observe()["policy"]
    assert torch.equal(after[[0, 2]], before[[0, 2]])
    assert not torch.equal(after[1], before[1])


@both
def test_a_step_reads_nothing_on_the_host(name):
    assert check_step(made(name, 4)).problems() == []


def test_the_clock_of_a_gait_is_observed_and_rewarded():
    task = made("quadruped-velocity", 3, seed=1, **{"gait.rate": 2.5}, push_speed=0.0)
    plain = made("quadruped-velocity", 3, seed=1, push_speed=0.0)
    names = task.observation_names["policy"]
    assert names[-2:] == ["clock sine", "clock cosine"]
    assert len(names) == len(plain.observation_names["policy"]) + 2
    assert "gait_contacts" in task.reward_terms
    assert "gait_contacts" not in plain.reward_terms
    for step in range(1, 25):
        task.step(idle(task))
        result = plain.step(idle(plain))
        # 2.5 cycles of 1 / 2.5 s, in steps of 0.02 s
        angle = 2.0 * math.pi * 2.5 * 0.02 * step
        seen = task.observe()["policy"]
        np.testing.assert_allclose(seen[:, -2:], [[math.sin(angle), math.cos(angle)]] * 3, atol=1e-5)
        torch.testing.assert_close(seen[:, :-2], result.observations["policy"])  # the clock moves nothing
    kept = task.gait_terms(torch.ones(3))["gait_contacts"]
    assert torch.equal(kept, torch.zeros(3))  # it stands on four feet, two of which should be up


def test_a_robot_without_a_gait_has_no_clock(monkeypatch):
    monkeypatch.setattr(QuadrupedVelocity, "gait", ())
    with pytest.raises(
        InputError, match=r"--task.gait.rate must be 0 for task 'quadruped-velocity', got 2.5: the class"
    ):
        made("quadruped-velocity", 1, **{"gait.rate": 2.5})


def test_the_task_file_is_short():
    assert len(Path(quadruped.__file__).read_text(encoding="utf-8").splitlines()) <= 150


@pytest.mark.parametrize("obs", ["state", "scan"])
def test_shipped_policies_follow_commands(obs):
    """On a plane by what is felt, on rough ground of level 3 with a scan; bounds are those of the training below."""
    source = find_policy("quadruped-velocity", SHIPPED / f"quadruped-velocity.{obs}.pt")
    config = task_config_from_plain(QuadrupedVelocity, source.content["task_config"])
    changes = {"max_episode_steps": 250, "rough.level": 3}
    task = make("quadruped-velocity", 16, seed=21, config=replace_fields(config, changes))
    result = evaluate(task, network_policy(source.content, task), 16, seed=21)
    assert result.success_rate >= 0.9
    assert result.metrics["speed_error"] <= 0.25
    assert result.metrics["turn_error"] <= 0.2


@pytest.mark.slow
def test_it_learns_to_follow_commands_in_minutes(tmp_path):
    config = replace_fields(default_config(QuadrupedVelocity), {"device": "cpu"})
    trained_in = config_to_train_in(QuadrupedVelocity)
    run = train("quadruped-velocity", config, trained_in, root=tmp_path)
    task = make("quadruped-velocity", 256, seed=11, config=trained_in)
    source = find_policy("quadruped-velocity", Path(run.checkpoint))
    result = evaluate(task, network_policy(source.content, task), 256, seed=11)
    still = evaluate(task, zero_policy(task), 256, seed=11)
    assert result.success_rate >= 0.95
    assert result.metrics["speed_error"] <= min(0.25, still.metrics["speed_error"] / 3.0)
    assert result.metrics["turn_error"] <= min(0.2, still.metrics["turn_error"] / 3.0)
