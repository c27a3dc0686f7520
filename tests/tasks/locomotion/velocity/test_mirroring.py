"""The mirror image of the quadruped: mirrored worlds stay mirrored under mirrored actions, whatever is observed."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from simwarp.tasks import InputError, make
from simwarp.tasks.framework.mirror import check_mirror
from simwarp.tasks.locomotion.velocity.mirroring import mirror_of
from simwarp.train.algorithm.symmetry import MirrorImages

POLAR, AXIAL = torch.tensor([1.0, -1.0, 1.0]), torch.tensor([-1.0, 1.0, -1.0])
"""What a mirror makes of positions and velocities, and of rotations."""


def mirrored_rows(task, images, rows):
    """Coordinates or rates (W, 18) in a mirror: position, rotation, joints."""
    columns = task._columns
    found = rows.clone()
    found[:, :3], found[:, 3:6] = rows[:, :3] * POLAR, rows[:, 3:6] * AXIAL
    found[:, columns] = images.actions(rows[:, columns] - task._stance) + task._stance
    return found


@pytest.mark.parametrize("obs", ["state", "scan", "history", "clock"])
def test_mirrored_worlds_stay_mirrored(obs):
    """With a clock the image is half a cycle later, which is 10 control steps of 0.02 s at 2.5 Hz."""
    clock = obs == "clock"
    options: dict[str, Any] = {"gait.rate": 2.5} if clock else {"obs": obs}
    task: Any = make("quadruped-velocity", 4, seed=3, history=3, push_speed=0.0, **options)
    mirror = check_mirror(task, task.observation_shapes, "test")
    images = MirrorImages(mirror, "cpu")
    generator = torch.Generator().manual_seed(1)
    task.restart(seed=3)
    q, qd = task.views.joint_q.clone(), task.views.joint_qd.clone()
    qd += 0.3 * torch.randn(qd.shape, generator=generator)
    q[2:], qd[2:] = mirrored_rows(task, images, q[:2]), mirrored_rows(task, images, qd[:2])
    qd[2:, task._columns] = images.actions(qd[:2, task._columns])
    task.simulation.set_joint_state(None, q, qd)
    task.episode_steps[2:] += 10 if clock else 0
    task.command[2:] = task.command[:2] * torch.tensor([1.0, -1.0, -1.0])
    task.past.copy_(task.proprioception().unsqueeze(1).expand_as(task.past))
    for _ in range(6):
        half = (0.4 * torch.randn(2, 12, generator=generator)).to(task.device)
        result = task.step(torch.cat([half, images.actions(half)]))
        seen = result.observations["policy"]
        # contacts are solved to 1 mm/s, and their order is another one in the mirror; rates are up to 20 rad/s
        torch.testing.assert_close(seen[2:], images.group("policy", seen[:2]), rtol=2e-3, atol=2e-2)
        torch.testing.assert_close(result.rewards[2:], result.rewards[:2], rtol=2e-3, atol=2e-3)
    assert float((seen[2:] - seen[:2]).abs().max()) > 0.5


def test_sides_that_no_joint_is_named_by_are_told():
    names = {"policy": ["angle left_hip", "angle right_hip"]}
    with pytest.raises(InputError, match="no joint has 'FL' or 'FR' in its name, such as 'left_hip'"):
        mirror_of(names, ["left_hip", "right_hip"], sides=[("FL", "FR")], turned=[])
