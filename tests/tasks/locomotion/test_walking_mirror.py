"""Mirror images of what walks and of the pendulum: mirrored worlds stay mirrored under mirrored actions."""

from __future__ import annotations

from typing import Any

import pytest
import torch

import simwarp as sw
from simwarp.tasks import make
from simwarp.tasks.framework.mirror import check_mirror
from simwarp.train.algorithm.symmetry import MirrorImages


def images_of(task):
    return MirrorImages(check_mirror(task, task.observation_shapes, "test"), "cpu")


def mirror_states(task, images):
    """Make worlds 2 and 3 the images of 0 and 1, with rates drawn for all."""
    sim, generator = task.simulation, torch.Generator().manual_seed(1)
    q, qd = task.views.joint_q.clone(), task.views.joint_qd.clone()
    qd[:2] += 0.3 * torch.randn((2, qd.shape[1]), generator=generator)
    q[2:], qd[2:] = images.actions(q[:2]), images.actions(qd[:2])
    # the base floats without a joint: its pose and its rates are those of the body
    position, rotation = sw.to_torch(sim.state.body_x), sw.to_torch(sim.state.body_rot)
    position[2:, 0] = position[:2, 0] * torch.tensor([1.0, -1.0, 1.0], dtype=position.dtype)
    rotation[2:, 0] = rotation[:2, 0] * torch.tensor([-1.0, 1.0, -1.0, 1.0], dtype=rotation.dtype)
    sim.set_joint_state(None, q, qd)


@pytest.mark.parametrize("options", [{}, {"orientation": "quaternion"}, {"lateral": True}])
def test_mirrored_ants_stay_mirrored(options):
    task: Any = make("ant", 4, seed=3, tolerance=1e-6, **options)
    images = images_of(task)
    task.restart(seed=3)
    mirror_states(task, images)
    generator = torch.Generator().manual_seed(2)
    for _ in range(8):  # then the first torso touches the ground, and another start is drawn
        half = 0.4 * torch.randn((2, 8), generator=generator)
        result = task.step(torch.cat([half, images.actions(half)]))
        seen = result.observations["policy"]
        assert not result.terminated.any()
        # contacts are solved to 1e-6 m/s, in another order in the mirror; rates of up to 20 rad/s in float32
        torch.testing.assert_close(seen[2:], images.group("policy", seen[:2]), rtol=1e-3, atol=2e-3)
        torch.testing.assert_close(result.rewards[2:], result.rewards[:2], rtol=1e-3, atol=1e-3)
    assert float((seen[2:] - seen[:2]).abs().max()) > 0.5


def test_the_mirrored_pendulum_stays_mirrored():
    task: Any = make("pendulum", 4, seed=3)
    images = images_of(task)
    task.restart(seed=3)
    q, qd = task.views.joint_q.clone(), task.views.joint_qd.clone()
    q[2:], qd[2:] = -q[:2], -qd[:2]
    task.simulation.set_joint_state(None, q, qd)
    push = torch.tensor([[0.5], [-0.3]])
    for _ in range(20):
        result = task.step(torch.cat([push, images.actions(push)]))
    seen = result.observations["policy"]
    # sums of 20 steps in float32
    torch.testing.assert_close(seen[2:], images.group("policy", seen[:2]), rtol=1e-5, atol=1e-6)
    assert float((seen[2:] - seen[:2]).abs().max()) > 0.05


def test_unsigned_observations_have_no_mirror():
    assert make("pendulum", 1, legacy_compat=True).mirror() is None


def test_the_hexapod_is_nearly_its_own_image():
    """The original's parts are up to 2 mm from the image of their partners: a learnt symmetry is as good as they."""
    task: Any = make("hexapod", 1)
    images = images_of(task)
    task.simulation.reset()  # as it is built
    names = list(task.simulation.model.body_names)
    places = task.simulation.state.body_x.numpy()[0]
    number = dict(zip(names, places, strict=True))
    for name, place in number.items():
        kind, _, leg = name.partition("_")
        partner = f"{kind}_{(int(leg) + 2) % 6 + 1}" if leg else name
        assert number[partner] == pytest.approx(place * [1.0, -1.0, 1.0], abs=2.5e-3), name
    joints = torch.arange(18.0).view(1, 18)
    hips = images.actions(joints)[0, :6]
    assert hips.tolist() == [-3.0, -4.0, -5.0, -0.0, -1.0, -2.0]
    assert images.actions(images.actions(joints)).equal(joints)
