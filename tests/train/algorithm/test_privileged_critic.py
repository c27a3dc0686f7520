"""A critic that sees exact state: it alone does, it trains, and a run with it goes on exactly."""

from pathlib import Path

import pytest
import torch
from rich.console import Console

from simwarp.tasks import InputError, make, replace_fields
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.algorithm.vec_env import TaskVecEnv
from simwarp.train.config import CriticSees, NetworkKind, TrainConfig, default_config
from simwarp.train.networks.networks import ImageModel, Perceptron
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.training import train
from tests.tasks.driving.driving_checks import NAMES, driving
from tests.tasks.framework.camera_task import CameraTask, camera_task

__all__ = ["camera_task"]


@pytest.fixture
def knowing(camera_task, monkeypatch):
    """The task with a camera, whose exact state is where the point is."""
    monkeypatch.setattr(CameraTask, "privileged", lambda task: task.x.unsqueeze(1))
    return camera_task


def settings(**changes):
    small = {
        "num_envs": 8, "iterations": 2, "steps_per_iteration": 8, "device": "cpu", "save_interval": 1,
        "network.kind": NetworkKind.EARLY_FUSION, "network.critic": CriticSees.PRIVILEGED, "network.hidden": (16, 8),
        "ppo.epochs": 1, "ppo.mini_batches": 2,
    }  # fmt: skip
    return replace_fields(TrainConfig(), small | changes)


@pytest.mark.parametrize("objective", ["clip", "kl-penalty"])
def test_only_the_critic_sees_the_exact_state_and_it_alone_learns_from_it(knowing, objective):
    from simwarp.train.config import Objective

    trainer = Trainer(make(knowing, 8), settings(**{"ppo.objective": Objective(objective)}))
    actor, critic = trainer.algorithm.actor, trainer.algorithm.critic
    assert isinstance(actor, ImageModel)
    assert isinstance(critic, Perceptron)
    assert [layer.in_features for layer in critic.mlp if isinstance(layer, torch.nn.Linear)] == [1, 16, 8]
    before = [parameter.detach().clone() for parameter in critic.parameters()]
    trainer.iterate()
    assert all(not torch.equal(old, new) for old, new in zip(before, critic.parameters(), strict=True))
    # What is stored beside each image is where the point was then: the bright column says so too
    stored = trainer.storage.observations
    column = (stored["camera"][..., 0, :, 0] > 0).float()
    middle = (column * torch.arange(column.shape[-1])).sum(-1) / column.sum(-1)
    inside = stored["critic"][..., 0].abs() < 0.8  # nearer to the edge a part of the column is cut off
    assert int(inside.sum()) > 10
    shown = 2.0 * middle / (column.shape[-1] - 1) - 1.0
    assert (shown - stored["critic"][..., 0])[inside].abs().max() < 1.0 / (column.shape[-1] - 1) + 1e-6  # half a column
    seen = trainer.env.get_observations()
    exact = seen.clone()
    exact["critic"] += 1.0
    assert torch.equal(actor(seen), actor(exact))
    assert not torch.equal(critic(seen), critic(exact))


def test_what_is_handed_out_is_a_copy(knowing):
    env = TaskVecEnv(make(knowing, 3), privileged=True)
    handed = env.get_observations()["critic"]
    before = handed.clone()
    env.step(torch.ones(3, 2))
    assert torch.equal(handed, before)


def test_a_run_goes_on_exactly_and_its_policy_needs_no_exact_state(knowing, tmp_path, monkeypatch):
    config = CameraTask.config_type()

    def run(root, iterations, resume=None):
        return train(
            knowing, settings(iterations=iterations), config, root=root, resume=resume, console=Console(quiet=True)
        )

    whole = run(tmp_path / "whole", 3)
    part = run(tmp_path / "part", 2)
    resumed = run(tmp_path / "part", 3, resume=Path(part.run))
    left, right = (load_checkpoint(Path(result.checkpoint)) for result in (whole, resumed))
    for key in ("actor_state_dict", "critic_state_dict"):
        assert all(torch.equal(left[key][name], right[key][name]) for name in left[key])
    monkeypatch.setattr(CameraTask, "privileged", lambda task: None)
    task = make(knowing, 2)
    actions = network_policy(left, task)(task.restart())
    assert actions.shape == (2, 2)


def test_a_task_without_exact_state_and_a_network_with_memory_are_refused(camera_task):
    with pytest.raises(InputError, match=r"--network.critic privileged: task 'camera-test' keeps nothing.*same"):
        Trainer(make(camera_task, 8), settings())
    with pytest.raises(InputError, match="critic"):
        settings(**{"network.kind": NetworkKind.RECURRENT})


@pytest.mark.quick("obstacle-avoidance", "hallway")
@pytest.mark.parametrize("name", NAMES)
def test_beside_a_camera_the_critic_sees_what_a_policy_by_state_does(name):
    tracks = {"tracks": 2} if name == "barrier-track" else {}
    by_camera, by_state = (driving(name, 3, seed=1, obs=obs, **tracks) for obs in ("camera", "state"))
    handed = TaskVecEnv(by_camera, privileged=True).get_observations()
    assert torch.equal(handed["critic"], by_state.restart()["policy"])
    assert by_state.observe_privileged() is None
    assert default_config(type(by_camera), by_camera.config).network.critic is CriticSees.PRIVILEGED
