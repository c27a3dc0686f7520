"""Networks that are symmetric by construction: mirrored on what is mirrored, in training, in files, and refusals."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from simwarp.tasks import InputError, Mirror, Reflection, make, replace_fields
from simwarp.train.algorithm import mini_batch_shares
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import NetworkKind, Objective, Symmetry, TrainConfig
from simwarp.train.networks.export import ExportFormat, export_policy, load_exported
from simwarp.train.networks.policies import network_policy
from simwarp.train.networks.symmetric import SymmetricPerceptron
from simwarp.train.runs.checkpoint import save_checkpoint

WORLDS, STEPS = 12, 8
ROWS = Reflection((1, 0, 2, 3), (1.0, 1.0, -1.0, 1.0))
MORE = Reflection((0, 2, 1), (-1.0, -1.0, -1.0))
ACTIONS = Reflection((1, 0, 2), (-1.0, -1.0, -1.0))


def settings(threads=1, **changes):
    small = {
        "num_envs": WORLDS, "steps_per_iteration": STEPS, "device": "cpu", "threads": threads,
        "network.symmetric": True, "ppo.epochs": 2, "ppo.mini_batches": 2,
    }  # fmt: skip
    return replace_fields(TrainConfig(), small | changes)


def trainer(threads=1, **changes):
    return Trainer(make("fast", WORLDS, seed=3, max_episode_steps=5), settings(threads, **changes))


def observations(rows=50):
    return TensorDict(
        {"policy": torch.randn(rows, 4, dtype=torch.float64) + 0.5, "more": torch.randn(rows, 3, dtype=torch.float64)},
        batch_size=[rows],
    )


def image(rows, reflection):
    return rows[..., list(reflection.sources)] * torch.tensor(reflection.signs, dtype=rows.dtype)


def imaged(obs):
    return TensorDict({"policy": image(obs["policy"], ROWS), "more": image(obs["more"], MORE)}, batch_size=obs.shape)


def network(acts, **options):
    obs = observations()
    made = SymmetricPerceptron(
        obs, {"set": ["policy", "more"]}, "set", 3 if acts else 1, [16, 8],
        mirror=Mirror({"policy": ROWS, "more": MORE}, ACTIONS), obs_normalization=True,
        distribution_cfg={"class_name": "GaussianDistribution", "init_std": 0.5} if acts else None, **options,
    )  # fmt: skip
    made.double()
    made.update_normalization(obs)
    return made


@pytest.mark.parametrize("options", [{}, {"tanh_output": True}, {"init_mean": [0.2, -0.2, 0.0]}])
def test_whatever_the_weights_it_acts_mirrored_on_what_is_mirrored(options):
    made, obs = network(acts=True, **options), observations()
    with torch.no_grad():
        given, other = made(obs), made(imaged(obs))
    assert given.shape == (50, 3)
    # sums of a few dozen products of 53 bits
    torch.testing.assert_close(other, image(given, ACTIONS), rtol=0.0, atol=1e-13)
    assert float(given.std(dim=0).min()) > 1e-4  # it looks at what it sees


def test_a_value_has_no_left_and_right():
    made, obs = network(acts=False), observations()
    with torch.no_grad():
        given = made(obs)
        torch.testing.assert_close(made(imaged(obs)), given, rtol=0.0, atol=1e-13)
    assert float(given.std()) > 1e-3


def test_it_is_the_mean_over_its_layers():
    """Against the definition, with the layers as rsl-rl calls them, and a normaliser of one image at a time."""
    made, obs = network(acts=True), observations()
    layers, rows = torch.nn.Sequential(*list(made.mlp)[:-1]), torch.cat([obs["policy"], obs["more"]], dim=-1)
    other = torch.cat([image(obs["policy"], ROWS), image(obs["more"], MORE)], dim=-1)
    with torch.no_grad():
        expected = 0.5 * (layers(made.obs_normalizer(rows)) + image(layers(made.obs_normalizer(other)), ACTIONS))
        torch.testing.assert_close(made(obs), expected, rtol=0.0, atol=1e-13)


def test_the_normaliser_knows_both_images():
    made = network(acts=True)
    mean, deviation = made.obs_normalizer.mean, made.obs_normalizer.std
    joined = Reflection((1, 0, 2, 3, 4, 6, 5), (1.0, 1.0, -1.0, 1.0, -1.0, -1.0, -1.0))
    torch.testing.assert_close(image(mean, joined), mean, rtol=0.0, atol=1e-13)
    torch.testing.assert_close(deviation[list(joined.sources)], deviation, rtol=0.0, atol=1e-13)


def test_a_policy_stays_symmetric_while_it_learns():
    made = trainer()
    for _ in range(2):
        made.collect()
        made._learn()
    seen = TensorDict({"policy": torch.randn(9, 2)}, batch_size=[9])
    turned = TensorDict({"policy": seen["policy"] * torch.tensor([1.0, -1.0])}, batch_size=[9])
    with torch.no_grad():
        actor, critic = made.algorithm.actor, made.algorithm.critic
        torch.testing.assert_close(actor(turned), actor(seen) * torch.tensor([1.0, -1.0]), rtol=0.0, atol=1e-6)
        torch.testing.assert_close(critic(turned), critic(seen), rtol=0.0, atol=1e-6)


def test_threads_learn_from_the_same_gradient(monkeypatch):
    """In float64, so that only mistakes are left of the difference; see the tests of shared PPO."""
    monkeypatch.setattr(mini_batch_shares, "LEAST_NUMBERS", 8)
    found = []
    for threads in (1, 3):
        made = trainer(threads, **{"ppo.epochs": 1, "ppo.mini_batches": 1})
        made.collect()
        torch.manual_seed(1)
        made.algorithm.update()
        found.append(torch.cat([one.detach().flatten() for one in made.algorithm.actor.parameters()]))
    torch.testing.assert_close(*found, rtol=0.0, atol=1e-5)  # one step of Adam, 1e-3, of gradients in float32


@pytest.mark.parametrize("form", [ExportFormat.TORCHSCRIPT, ExportFormat.ONNX])
def test_a_checkpoint_and_an_exported_file_act_as_the_network(tmp_path, form):
    made = trainer()
    made.collect()
    made._learn()
    path = tmp_path / "symmetric.pt"
    save_checkpoint(path, made.checkpoint())
    seen = {"policy": torch.randn(5, 2)}
    policy = network_policy(made.checkpoint(), made.task)
    with torch.no_grad():
        made.algorithm.actor.eval()
        expected = made.algorithm.actor(TensorDict(dict(seen), batch_size=[5]))
    assert torch.equal(policy(seen), expected)
    exported = export_policy(path, form, tmp_path / "policy")
    (actions, *_) = load_exported(tmp_path / "policy", form)(seen["policy"])
    torch.testing.assert_close(actions, expected, rtol=0.0, atol=1e-5)
    assert exported.max_difference <= 1e-5


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"network.kind": NetworkKind.RECURRENT}, "symmetric must be off for other networks than mlp"),
        ({"network.kind": NetworkKind.MULTI_INPUT}, "symmetric must be off for other networks than mlp"),
        ({"network.class_": "torch.nn:Identity"}, "symmetric must be off for other networks than mlp"),
        ({"ppo.symmetry": Symmetry.LOSS}, "symmetry must be none for a network that is symmetric by construction"),
    ],
)
def test_what_it_does_not_go_with(changes, words):
    with pytest.raises(InputError, match=words) as caught:
        settings(**changes)
    assert "\n" not in str(caught.value)


def test_it_goes_with_the_kl_penalty_and_sized_layers():
    made = trainer(**{"ppo.objective": Objective.KL_PENALTY, "network.kind": NetworkKind.THESIS_MLP})
    made.collect()
    assert made._learn()["kl"] >= 0.0


def test_a_mean_action_that_is_not_its_own_image():
    with pytest.raises(InputError, match=r"init-mean must be its own mirror image, got 0\.3 for action 1"):
        trainer(**{"network.init_mean": (0.1, 0.3)})


def test_a_task_without_a_mirror(monkeypatch):
    task = make("fast", WORLDS, seed=3)
    monkeypatch.setattr(type(task), "mirror", lambda self: None)
    with pytest.raises(InputError, match=r"--network.symmetric: task 'fast' has no mirror\(\)"):
        Trainer(task, settings())
