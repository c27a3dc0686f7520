"""Tasks whose physics are MuJoCo's: states go over and come back, pushes and resets too, and parameters are its own."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from simwarp.tasks import InputError, Range, make
from simwarp.tasks.adapters.in_mujoco import put_in_mujoco
from tests.tasks.actuation.hinge_task import hinges
from tests.tasks.actuation.test_actuator_network import saved


def stepped(task, steps, action=0.0):
    actions = torch.full((task.num_worlds, task.action_size), action)
    for _ in range(steps):
        result = task.step(actions)
    return result


@pytest.fixture
def hexapod():
    task = make("hexapod", 3, seed=2)
    inside = put_in_mujoco(task)
    task.restart(seed=5)
    return task, inside


def test_what_the_task_sees_is_the_state_of_mujoco(hexapod):
    task, inside = hexapod
    stepped(task, 3, 0.3)
    for index, world in enumerate(inside.worlds):
        names = task.simulation.model.body_names
        for body, name in enumerate(names):
            seen, theirs = task.views.body_q[index, body].numpy(), world.data.body(name)
            np.testing.assert_allclose(seen[:3], theirs.xipos, atol=1e-6)
            assert abs(float(seen[3:] @ np.roll(theirs.xquat, -1))) == pytest.approx(1.0, abs=1e-6)
        angles = [world.data.joint(name).qpos[0] for name in task.simulation.model.joint_names]
        np.testing.assert_allclose(task.views.joint_q[index].numpy(), angles, atol=2e-6)
        rates = [world.data.joint(name).qvel[0] for name in task.simulation.model.joint_names]
        np.testing.assert_allclose(task.views.joint_qd[index].numpy(), rates, rtol=1e-4, atol=1e-4)
    assert float(task.simulation.time.numpy()[0]) == pytest.approx(3 * task.config.control_dt)


def test_a_reset_begins_where_the_task_says(hexapod):
    task, inside = hexapod
    stepped(task, 5, 0.5)
    mask = torch.tensor([False, True, False])
    others = [inside.worlds[index].data.qpos.copy() for index in (0, 2)]
    task.begin_episodes(mask)
    start = task.views.body_q[1, 0, :3].clone()
    inside.step()
    moved = np.abs(inside.worlds[1].data.xipos[1] - start.numpy()).max()
    assert moved < 0.01  # a step of a few milliseconds from there
    for before, index in zip(others, (0, 2), strict=True):
        assert np.abs(inside.worlds[index].data.qpos - before).max() < 0.2
        assert inside.worlds[index].data.time > inside.worlds[1].data.time


def test_a_push_is_taken_over(hexapod):
    task, inside = hexapod
    stepped(task, 2)
    task.views.body_v[1, :, 1] += 1.0
    inside.step()
    speeds = [float(world.data.body("base").cvel[4]) for world in inside.worlds]
    assert speeds[1] - max(speeds[0], speeds[2]) > 0.3


def test_contact_forces_carry_the_robot(hexapod):
    task, _ = hexapod
    stepped(task, 40)
    weight = float(task.simulation.model.body_mass.numpy().sum()) * 9.81
    forces = task.simulation.contacts.body_contact_force.numpy()[:, :, 2].sum(axis=1)
    assert np.all(forces > 0.3 * weight)
    assert np.all(forces < 3.0 * weight)


def test_two_runs_are_equal_bit_by_bit_and_worlds_do_not_meet():
    found = []
    for pushed in (False, False, True):
        task = make("hexapod", 3, seed=2)
        inside = put_in_mujoco(task)
        task.restart(seed=5)
        stepped(task, 2, 0.2)
        if pushed:
            task.views.body_v[2] += 0.5
        result = stepped(task, 4, 0.2)
        found.append((result.observations["policy"].clone(), [world.data.qpos.copy() for world in inside.worlds]))
    (first, _), (second, _), (third, _) = found
    assert torch.equal(first, second)
    assert torch.equal(first[:2], third[:2])
    assert not torch.equal(first[2], third[2])


def test_drawn_parameters_are_those_of_mujoco():
    task = make("ant", 3, seed=1, randomise={"body_mass": Range(0.5, 2.0)})
    inside = put_in_mujoco(task)
    for seed in (3, 4):
        task.restart(seed=seed)
        stepped(task, 1)
        masses = task.simulation.model.body_mass.numpy()
        for world, row in zip(inside.worlds, masses, strict=True):
            found = [world.model.body(name).mass[0] for name in task.simulation.model.body_names]
            np.testing.assert_allclose(found, row, rtol=1e-6)
    assert len({float(row[0]) for row in masses}) == 3


def test_what_mujoco_cannot_hold_is_refused():
    with pytest.raises(InputError, match="has no physics"):
        put_in_mujoco(make("fast", 2))
    with pytest.raises(InputError, match="force elements must be Actuators"):
        put_in_mujoco(make("hallway", 1, obs="state"))


@pytest.mark.parametrize("learned", [False, True])
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # TorchScript is old, and what such files are
def test_motors_act_there_as_here(tmp_path, learned):
    """Two hinges without weight and contacts: both simulators have the same equations."""
    options = {"network": saved(tmp_path / "law.pt", (7.0, 2.0, -0.3, -0.1))} if learned else {}
    found = []
    for there in (False, True):
        task = hinges(3, seed=2, **options)
        if there:
            put_in_mujoco(task, steps=1)
        task.restart(seed=2)
        actions = torch.rand(12, 3, 2, generator=torch.Generator().manual_seed(1)) * 2 - 1
        found.append(torch.stack([task.step(action).observations["policy"].clone() for action in actions]))
    # the same steps of an explicit law, in float32 and in float64
    torch.testing.assert_close(found[0], found[1], rtol=1e-3, atol=1e-3)
    assert float((found[0][-1] - found[0][0]).abs().max()) > 0.2


def test_forces_in_axes_of_the_bodies_turn_with_them():
    moved = []
    for field in ("body_force", "body_force_b"):
        task = make("ant", 1, seed=2)
        inside = put_in_mujoco(task)
        task.restart(seed=2)
        getattr(task.simulation.control, field)[0, 0] = (0.0, 0.0, 60.0)
        stepped(task, 5)
        moved.append(inside.worlds[0].data.body("torso").xipos.copy())
        world_up = task.views.body_q[0, 0, 3:]
    assert abs(float(world_up[2])) > 0.001, "the torso is turned about more than the vertical"
    assert 1e-6 < np.abs(moved[0] - moved[1]).max() < 0.1
