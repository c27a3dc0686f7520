"""Every network trains, keeps images as bytes, and goes on from a checkpoint exactly."""

from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from simwarp.tasks import InputError, make, replace_fields, task_class
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import NetworkKind, TrainConfig, default_config
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.encoders import NatureEncoder, nature_size
from simwarp.train.networks.networks import thesis_sizes
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.training import train
from tests.tasks.framework.camera_task import CameraConfig, camera_task

__all__ = ["camera_task"]
QUIET = Console(quiet=True)
IMAGES = [NetworkKind.NATURE_CNN, NetworkKind.EARLY_FUSION, NetworkKind.LATE_FUSION]


def small(kind, **changes):
    settings = {
        "num_envs": 8, "iterations": 2, "steps_per_iteration": 8, "device": "cpu", "save_interval": 1,
        "network.kind": kind, "ppo.epochs": 1, "ppo.mini_batches": 2, "network.memory": 16,
    }  # fmt: skip
    return replace_fields(TrainConfig(), settings | changes)


def camera_config(kind):
    return CameraConfig(vectors=kind is not NetworkKind.NATURE_CNN)


def linear_sizes(model):
    return [(m.in_features, m.out_features) for m in model.modules() if isinstance(m, torch.nn.Linear)]


def test_the_sizing_rule_gives_the_numbers_of_the_thesis():
    assert thesis_sizes(30, 8) == [300, 154, 80]
    assert thesis_sizes(30, 1) == [300, 54, 10]
    assert thesis_sizes(4, 1) == [40, 20, 10]


@pytest.mark.parametrize(("height", "width", "size"), [(45, 80, 768), (90, 160, 7168), (160, 210, 22528)])
def test_the_convolutions_leave_what_the_thesis_counts(height, width, size):
    assert nature_size(height, width) == size
    with torch.no_grad():
        assert NatureEncoder((height, width, 3))(torch.zeros(1, height, width, 3, dtype=torch.uint8)).shape == (1, size)


def test_pixels_are_shifted_and_scaled_and_channels_come_last():
    encoder = NatureEncoder((36, 40, 3))
    encoder.layers = torch.nn.Sequential()
    image = torch.randint(0, 256, (2, 36, 40, 3), dtype=torch.uint8)
    expected = ((image.float() - 127) / 255).permute(0, 3, 1, 2).flatten(1)
    assert torch.equal(encoder(image), expected)


def test_layers_of_the_fusion_networks(camera_task):
    actor, critic = {}, {}
    for kind in (NetworkKind.EARLY_FUSION, NetworkKind.LATE_FUSION):
        algorithm = Trainer(make(camera_task, 8), small(kind, **{"network.normalise": False})).algorithm
        actor[kind], critic[kind] = linear_sizes(algorithm.actor), linear_sizes(algorithm.critic)
    features = nature_size(36, 40)
    head = [(20, 40), (40, 20), (20, 10)]
    early, late = NetworkKind.EARLY_FUSION, NetworkKind.LATE_FUSION
    assert sorted(actor[early]) == sorted([(features, 10), (3, 10), *head, (10, 2)])
    assert sorted(critic[early]) == sorted([(features, 10), (3, 10), *head, (10, 1)])
    assert sorted(actor[late]) == sorted([(features, 2), (3, 15), (15, 25), (25, 10), (10, 2), (4, 2)])
    assert sorted(critic[late]) == sorted([(features, 1), (3, 15), (15, 15), (15, 5), (5, 1), (2, 1)])


def test_the_thesis_mlp_has_its_layers_and_the_tanh_bounds_the_mean():
    trainer = Trainer(make("fast", 8), small(NetworkKind.THESIS_MLP, **{"network.tanh_output": True}))
    assert linear_sizes(trainer.algorithm.actor) == [(2, 20), (20, 20), (20, 20), (20, 2)]
    assert linear_sizes(trainer.algorithm.critic) == [(2, 20), (20, 14), (14, 10), (10, 1)]
    far = trainer.env.get_observations().apply(lambda group: 1e6 * torch.ones_like(group))
    assert float(trainer.algorithm.actor(far).detach().abs().max()) <= 1.0
    assert not any(isinstance(layer, torch.nn.Tanh) for layer in trainer.algorithm.critic.modules())


@pytest.mark.parametrize("kind", list(NetworkKind), ids=[kind.value for kind in NetworkKind])
@pytest.mark.parametrize(("tanh", "mean"), [(False, (0.1, -0.6)), (True, (0.1, -0.6)), (False, (0.3,))])
def test_a_mean_action_at_the_start_is_that_of_any_seed_and_observation(camera_task, kind, tanh, mean):
    config = camera_config(kind) if kind in IMAGES else None
    name = camera_task if kind in IMAGES else "fast"
    for seed in (0, 1):
        changes = {"network.init_mean": mean, "network.tanh_output": tanh, "seed": seed}
        trainer = Trainer(make(name, 8, config=config), small(kind, **changes))
        observations = trainer.env.get_observations()
        with torch.no_grad():
            found = trainer.algorithm.actor(observations).numpy()
            values = trainer.algorithm.critic(observations)
        # A hundredth of the weights: of 10 to 64 numbers near 1 with weights up to 0.3, and of images of 0 or 255
        assert found == pytest.approx(np.broadcast_to(mean, (8, 2)), abs=0.03)
        assert values.abs().max() > 1e-3  # the critic's own layers are as they were drawn
    trainer.iterate()
    with torch.no_grad():
        assert not np.array_equal(trainer.algorithm.actor(observations).numpy(), found)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"network.init_mean": (0.1, 0.2, 0.3)},
            r"--network.init-mean must be one number or 2, one for each action, got 3: 0\.1 0\.2 0\.3; give one",
        ),
        (
            {"network.init_mean": (0.0, -1.0), "network.tanh_output": True},
            r"--network.init-mean must be between -1 and 1 with --network.tanh-output, got 0\.0 -1\.0; take numbers",
        ),
    ],
)
def test_a_mean_action_that_does_not_fit_is_one_clear_error(changes, message):
    with pytest.raises(InputError, match=message):
        Trainer(make("fast", 8), small(NetworkKind.MLP, **changes))


@pytest.mark.parametrize("kind", IMAGES, ids=[kind.value for kind in IMAGES])
def test_networks_over_images_train_and_bytes_stay_bytes(camera_task, kind):
    trainer = Trainer(make(camera_task, 8, config=camera_config(kind)), small(kind))
    assert trainer.storage.observations["camera"].dtype == torch.uint8
    before = [parameter.detach().clone() for parameter in trainer.algorithm.actor.parameters()]
    trainer.iterate()
    after = list(trainer.algorithm.actor.parameters())
    # Convolutions learn too
    assert sum(not torch.equal(old, new) for old, new in zip(before, after, strict=True)) > len(before) // 2
    stored = trainer.storage.observations["camera"]
    assert set(stored.unique().tolist()) == {0, 255}


@pytest.mark.quick("kl-penalty-lstm")
@pytest.mark.parametrize("cell", ["gru", "lstm"])
@pytest.mark.parametrize("objective", ["clip", "kl-penalty"])
def test_a_recurrent_run_goes_on_exactly(tmp_path, cell, objective):
    from simwarp.train.config import Cell, Objective

    changes = {"network.cell": Cell(cell), "ppo.objective": Objective(objective)}
    task_config = task_class("fast").config_type(max_episode_steps=12)

    def run(root, iterations, resume=None):
        config = small(NetworkKind.RECURRENT, iterations=iterations, **changes)
        return train("fast", config, task_config, root=root, resume=resume, console=QUIET)

    whole = run(tmp_path / "whole", 3)
    part = run(tmp_path / "part", 2)
    resumed = run(tmp_path / "part", 3, resume=Path(part.run))
    left, right = (load_checkpoint(Path(result.checkpoint)) for result in (whole, resumed))
    assert all(torch.equal(left["actor_state_dict"][k], right["actor_state_dict"][k]) for k in left["actor_state_dict"])
    assert all(torch.equal(*pair) for cells in zip(left["memories"], right["memories"], strict=True)
               for pair in zip(*cells, strict=True))  # fmt: skip


def test_the_memory_of_a_policy_is_cleared_where_episodes_end(tmp_path):
    trainer = Trainer(make("fast", 4), small(NetworkKind.RECURRENT, num_envs=4))
    task = make("fast", 4)
    policy = network_policy(trainer.checkpoint(), task)
    observations = {"policy": torch.ones(4, 2)}
    first = policy(observations).clone()
    second = policy(observations).clone()
    assert not torch.equal(first, second)
    policy.reset_memory(torch.tensor([True, False, False, False]))
    third = policy(observations)
    torch.testing.assert_close(third[0], first[0])
    assert not torch.allclose(third[1], first[1])
    policy.reset_memory()
    torch.testing.assert_close(policy(observations), first)
    # An evaluation starts with an empty memory, and is the same twice
    assert evaluate(task, policy, 4, seed=3) == evaluate(task, policy, 4, seed=3)


@pytest.mark.parametrize(
    ("kind", "config", "message"),
    [
        (NetworkKind.MLP, {}, r"observation 'camera' .* takes \(N,\) float32 groups; try --network.kind late-fusion"),
        (NetworkKind.NATURE_CNN, {}, "observation 'policy'.*takes images.*try --network.kind"),
        (NetworkKind.EARLY_FUSION, {"images": False}, "needs an image group"),
        (NetworkKind.LATE_FUSION, {"vectors": False}, "needs a vector group"),
    ],
)
def test_a_network_that_cannot_see_the_task_is_refused(camera_task, kind, config, message):
    with pytest.raises(InputError, match=message):
        Trainer(make(camera_task, 8, **config), small(kind))


def test_too_few_worlds_for_a_recurrent_network_are_refused():
    with pytest.raises(InputError, match="num-envs must be at least 8"):
        replace_fields(default_config(task_class("fast")), {"network.kind": NetworkKind.RECURRENT, "num_envs": 6})
