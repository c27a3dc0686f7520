"""What an adapter has handed out never changes: observations of every group, rewards, dones, infos, final observations.

Physics steps as recorded launches, which write to the same addresses every time; a graph captured from a step does too.
"""

import numpy as np
import pytest
import torch
import warp as wp
from tensordict import TensorDictBase

from simwarp.tasks import Sensing, TaskVectorEnv, make
from simwarp.train.algorithm.vec_env import TaskVecEnv
from tests.tasks.framework.samples import counter

STEPS = 9
WORLDS = 3


def as_they_are(task):
    """The task's own buffers: what an adapter must not hand out."""

    def act():
        result = task.step(torch.rand(WORLDS, task.action_size) * 2.0 - 1.0)
        return result.observations, result.rewards, result.final_observations

    return task.restart(), act


def over_rsl_rl(task):
    env = TaskVecEnv(task)
    return env.get_observations(), lambda: env.step(torch.rand(WORLDS, task.action_size) * 2.0 - 1.0)


def over_gymnasium(task):
    env = TaskVectorEnv(task)
    env.action_space.seed(0)
    return env.reset(seed=0), lambda: env.step(env.action_space.sample())


def over_sb3(task):
    pytest.importorskip("stable_baselines3", reason="the extra sb3 is not installed")
    from simwarp.tasks.adapters.sb3_adapter import SB3VecEnv

    env = SB3VecEnv(task)
    generator = np.random.default_rng(0)
    shape = (WORLDS, task.action_size)
    return env.reset(), lambda: env.step(generator.uniform(-1.0, 1.0, shape).astype(np.float32))


def over_skrl(task):
    pytest.importorskip("skrl", reason="the extra skrl is not installed")
    from skrl.envs.wrappers.torch import wrap_env

    from simwarp.tasks.adapters.skrl_adapter import true_next

    env = wrap_env(TaskVectorEnv(task), verbose=False)

    def act():
        step = env.step(torch.rand(WORLDS, task.action_size) * 2.0 - 1.0)
        return step, true_next(env.observation_space, step[0], step[4])

    return env.reset(), act


ADAPTERS = {"rsl-rl": over_rsl_rl, "gymnasium": over_gymnasium, "sb3": over_sb3, "skrl": over_skrl}
TASKS = {
    "groups": lambda: counter(WORLDS, max_episode_steps=4),
    "fast": lambda: make("fast", WORLDS, max_episode_steps=4),
    "late": lambda: make("fast", WORLDS, max_episode_steps=4, sensing={"policy": Sensing(delay=(0, 2))}),
    "pendulum": lambda: make("pendulum", WORLDS, max_episode_steps=4),
    "ant": lambda: make("ant", WORLDS, max_episode_steps=4),
}


def leaves(thing):
    """Every array, tensor and number inside of what a step returned."""
    if isinstance(thing, TensorDictBase):
        return leaves(dict(thing.items()))
    if isinstance(thing, dict):
        return [leaf for name in sorted(thing) for leaf in leaves(thing[name])]
    if isinstance(thing, list | tuple) or (isinstance(thing, np.ndarray) and thing.dtype == object):
        return [leaf for item in thing for leaf in leaves(item)]
    return [thing]


def frozen(leaf):
    if isinstance(leaf, torch.Tensor):
        return leaf.clone()
    return leaf.copy() if isinstance(leaf, np.ndarray) else leaf


def changed(task, adapter):
    """How many of the things handed out were different after all steps; and how many there were."""
    torch.manual_seed(0)
    first, act = adapter(task)
    kept = leaves(first)
    copies = [frozen(leaf) for leaf in kept]
    for _ in range(STEPS):
        new = leaves(act())
        kept += new
        copies += [frozen(leaf) for leaf in new]
    different = 0
    for leaf, copy in zip(kept, copies, strict=True):
        same = torch.equal(leaf, copy) if isinstance(leaf, torch.Tensor) else np.array_equal(leaf, copy)
        different += not same
    return different, len(kept)


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("adapter", ADAPTERS)
def test_nothing_handed_out_changes(adapter, name):
    task = TASKS[name]()
    if task.simulation is not None:
        assert task.simulation.physics_commands  # recorded launches: the addresses are fixed
    different, count = changed(task, ADAPTERS[adapter])
    assert different == 0
    assert count > 3 * STEPS
    assert int(task.episode_index.min()) >= 2  # resets happened on the way


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("adapter", ADAPTERS)
@pytest.mark.parametrize("name", ["pendulum", "ant"])
def test_nothing_changes_under_a_captured_graph(name, adapter, device, monkeypatch):
    task = make(name, WORLDS, max_episode_steps=4, device=device, capture=False)  # its own graph would call no program
    simulation = task.simulation
    program = task._physics or simulation._program
    with task._acting():
        program.run(1)  # loads kernels
    with wp.ScopedCapture(
        device=simulation.model.device
    ) as capture:  # not on torch's stream, which CUDA cannot capture
        program.run(1)
    launches = []

    def replay(times):
        for _ in range(times):
            launches.append(1)
            wp.capture_launch(capture.graph)

    monkeypatch.setattr(program, "run", replay)
    before = task.views.joint_q.clone()
    different, _ = changed(task, ADAPTERS[adapter])
    assert different == 0
    assert len(launches) == STEPS * task.config.decimation
    assert not torch.equal(task.views.joint_q, before)


@pytest.mark.parametrize("name", ["groups", "fast"])
def test_the_check_sees_a_task_that_hands_out_its_buffers(name):
    different, _ = changed(TASKS[name](), as_they_are)
    assert different > 0
