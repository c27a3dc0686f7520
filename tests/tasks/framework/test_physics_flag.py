"""A class says whether kernels or methods step its physics; where that does not fit what it writes, it is refused."""

import pytest
import torch

from simwarp.tasks import TaskError
from simwarp.tasks.locomotion.ant import AntConfig, AntTask
from simwarp.tasks.pendulum import PendulumTask


def roll(kind):
    """Rewards of some steps, and the task."""
    task = kind(AntConfig(), 2)
    generator = torch.Generator().manual_seed(0)
    return torch.stack([task.step(2.0 * torch.rand(2, 8, generator=generator) - 1.0).rewards for _ in range(4)]), task


class ByMethods(AntTask):
    fused_physics = False
    calls = 0

    def apply(self, action):
        ByMethods.calls += 1
        super().apply(action)


def test_methods_and_kernels_step_alike():
    (fused, task), (stepped, other) = roll(AntTask), roll(ByMethods)
    assert task._physics is not None
    assert other._physics is None
    assert ByMethods.calls == 5  # once to check it, and once a step
    assert torch.equal(fused, stepped)


@pytest.mark.parametrize("method", ["apply", "after_physics"])
def test_a_method_that_is_never_called_is_refused(method):
    with pytest.raises(TaskError, match=rf"task class Own: {method} is not called .* AntTask; set fused_physics = Fal"):
        type("Own", (AntTask,), {method: lambda self, *action: None})
    mixin = type("Mixin", (), {method: lambda self, *action: None})
    with pytest.raises(TaskError, match=f"{method} is not called"):
        type("Own", (mixin, AntTask), {})
    type("Own", (AntTask,), {method: lambda self, *action: None, "fused_physics": False})
    type("Own", (AntTask,), {method: lambda self, *action: None, "physics_launches": lambda self: []})


def test_launches_that_never_run_or_lack_are_refused():
    with pytest.raises(TaskError, match=r"task class Own: physics_launches\(\) is not called .* set it to True"):
        type("Own", (PendulumTask,), {"physics_launches": lambda self: []})
    with pytest.raises(TaskError, match=r"fused_physics is True without physics_launches\(\); write it, or set False"):
        type("Own", (PendulumTask,), {"fused_physics": True})


def test_who_watches_physics_is_called_after_each_step():
    assert not PendulumTask.watches_physics
    mixin = type("Mixin", (), {"after_physics": lambda self: None})
    assert vars(type("Own", (mixin, PendulumTask), {}))["watches_physics"]
    assert AntTask.watches_physics
