"""Symmetry in training: mirror images by names, batches with their mirror images, losses of threads, and refusals."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from simwarp.tasks import InputError, Mirror, Reflection, make, reflection, replace_fields
from simwarp.train.algorithm import mini_batch_shares
from simwarp.train.algorithm.symmetry import MirrorImages
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import NetworkKind, Objective, Symmetry, TrainConfig

WORLDS, STEPS = 12, 8
LEGS = (("FL", "FR"), ("RL", "RR"))
NAMES = ["velocity x", "velocity y", "turning x", "turning y", "turning z",
         *(f"{leg}_{part}" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh"))]  # fmt: skip
FLIPS = ["velocity y", "turning [xz]", "*_hip"]


def settings(threads=1, **changes):
    small = {
        "num_envs": WORLDS, "steps_per_iteration": STEPS, "device": "cpu", "threads": threads,
        "ppo.epochs": 1, "ppo.mini_batches": 1, "ppo.entropy": 0.01,
    }  # fmt: skip
    return replace_fields(TrainConfig(), small | changes)


def trainer(threads=1, task=None, **changes):
    task = make("fast", WORLDS, seed=3, max_episode_steps=5) if task is None else task
    return Trainer(task, settings(threads, **changes))


def state_of(made):
    return {f"{name} {key}": value.clone() for name in ("actor", "critic")
            for key, value in getattr(made.algorithm, name).state_dict().items()}  # fmt: skip


def test_a_reflection_by_names():
    made = reflection(NAMES, swap=LEGS, flip=FLIPS)
    assert made.problem(len(NAMES)) == ""
    row = torch.arange(1.0, 14.0)
    seen = row[list(made.sources)] * torch.tensor(made.signs)
    assert seen.tolist() == [1, -2, -3, 4, -5, -8, 9, -6, 7, -12, 13, -10, 11]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"names": ["a", "a"]}, "names must be different"),
        ({"names": []}, "names must be different"),
        ({"names": ["FL_hip"], "swap": LEGS}, "'FL_hip' must have the partner 'FR_hip'"),
        ({"names": ["a"], "flip": ["b*"]}, "flip has 'b\\*', which no name matches"),
    ],
)
def test_names_without_partners(options, words):
    with pytest.raises(InputError, match=words) as caught:
        reflection(**options)
    assert "\n" not in str(caught.value)


def images() -> MirrorImages:
    turned = reflection(NAMES, swap=LEGS, flip=FLIPS)
    hips = reflection(NAMES[5:], swap=LEGS, flip=["*_hip"])
    return MirrorImages(Mirror({"policy": turned}, hips), "cpu")


def test_a_batch_has_its_mirror_image_appended_and_twice_is_itself():
    made = images()
    obs = TensorDict({"policy": torch.randn(7, 13)}, batch_size=[7])
    actions = torch.randn(7, 8)
    seen, done = made(None, obs, actions)
    assert seen is not None
    assert done is not None
    assert seen["policy"].shape == (14, 13)
    assert done.shape == (14, 8)
    assert torch.equal(seen["policy"][:7], obs["policy"])
    assert torch.equal(made.group("policy", seen["policy"][7:]), obs["policy"])
    assert torch.equal(made.actions(done[7:]), actions)
    assert made(None, None, actions)[0] is None
    assert made(None, obs, None)[1] is None


def test_a_policy_made_symmetric_acts_mirrored_on_what_is_mirrored():
    made = images()
    network = torch.nn.Sequential(torch.nn.Linear(13, 32), torch.nn.ELU(), torch.nn.Linear(32, 8)).double()

    def policy(seen):
        return 0.5 * (network(seen) + made.actions(network(made.group("policy", seen))))

    seen = torch.randn(50, 13, dtype=torch.float64)
    with torch.no_grad():
        torch.testing.assert_close(
            policy(made.group("policy", seen)), made.actions(policy(seen)), rtol=0.0, atol=1e-12
        )  # sums of 53 bits
        assert float((network(made.group("policy", seen)) - made.actions(network(seen))).abs().max()) > 0.01


def test_augmentation_doubles_the_batch_as_rsl_rl_does():
    made = trainer(**{"ppo.symmetry": Symmetry.AUGMENT})
    made.collect()
    seen = []
    inner = made.algorithm.critic.forward

    def noted(observations, *arguments, **options):
        seen.append(observations["policy"].clone())
        return inner(observations, *arguments, **options)

    made.algorithm.critic.forward = noted
    losses = made._learn()
    (batch,) = seen
    assert batch.shape == (2 * WORLDS * STEPS, 2)
    half = WORLDS * STEPS
    assert torch.equal(batch[half:, 0], batch[:half, 0])
    assert torch.equal(batch[half:, 1], -batch[:half, 1])
    assert losses["symmetry"] > 0.0


@pytest.mark.parametrize("kind", [Symmetry.AUGMENT, Symmetry.LOSS])
def test_threads_learn_from_the_same_gradient(monkeypatch, kind):
    """In float64, so that only mistakes are left of the difference; see the tests of shared PPO."""
    monkeypatch.setattr(mini_batch_shares, "LEAST_NUMBERS", 8)
    found = []
    for threads in (1, 3):
        made = trainer(threads, **{"ppo.symmetry": kind, "ppo.mirror_loss": 0.7, "ppo.max_grad_norm": 1e9})
        made.collect()
        algorithm, storage = made.algorithm, made.storage
        algorithm.actor.double(), algorithm.critic.double()
        for name, value in vars(storage).items():
            if name == "observations":
                storage.observations = value.double()
            elif isinstance(value, torch.Tensor) and value.is_floating_point():
                setattr(storage, name, value.double())
            elif isinstance(value, tuple | list) and value and isinstance(value[0], torch.Tensor):
                setattr(storage, name, type(value)(one.double() for one in value))
        with torch.no_grad():
            algorithm.actor.distribution.std_param *= 1.3
        monkeypatch.setattr(algorithm.optimizer, "step", lambda: None)
        if threads > 1:
            assert [len(shares) for shares in algorithm.shared_batches(1)] == [3]
        torch.manual_seed(4)
        losses = made._learn()
        found.append((losses, [p.grad for m in (algorithm.actor, algorithm.critic) for p in m.parameters()]))
        made.close()
    (losses, plain), (shared_losses, shared) = found
    assert set(losses) == set(shared_losses) == {"value", "surrogate", "entropy", "symmetry"}
    for name, value in losses.items():
        assert shared_losses[name] == pytest.approx(value, rel=1e-5, abs=1e-6)  # sums are float32 there
    for mine, theirs in zip(shared, plain, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=0.0, atol=1e-12 * max(1.0, float(theirs.abs().max())))
        assert float(theirs.abs().max()) > 1e-9


def test_what_is_learned_depends_on_the_symmetry():
    states = {}
    for kind in Symmetry:
        made = trainer(**{"ppo.symmetry": kind})
        for _ in range(2):
            made.iterate()
        states[kind] = state_of(made)
    names = [name for name in states[Symmetry.NONE] if name.startswith("actor mlp")]
    for kind in (Symmetry.AUGMENT, Symmetry.LOSS):
        assert any(not torch.equal(states[kind][name], states[Symmetry.NONE][name]) for name in names)


@pytest.mark.parametrize("threads", [1, 2])
def test_the_mirror_loss_makes_a_policy_symmetric(monkeypatch, threads):
    monkeypatch.setattr(mini_batch_shares, "LEAST_NUMBERS", 8)
    seen = torch.linspace(-1.0, 1.0, 40).repeat(2).view(40, 2)[torch.randperm(40)]
    errors = {}
    for kind in (Symmetry.NONE, Symmetry.LOSS):
        changes = {"ppo.symmetry": kind, "ppo.mirror_loss": 10.0, "ppo.epochs": 5, "network.normalise": False}
        made = trainer(threads, **changes)
        for _ in range(15):
            made.iterate()
        made.close()
        actor = made.algorithm.actor

        def act(rows, actor=actor):
            with torch.no_grad():
                return actor(TensorDict({"policy": rows}, batch_size=[len(rows)]))

        turned = torch.tensor([1.0, -1.0])
        errors[kind] = float((act(seen * turned) - act(seen) * turned).square().mean())
    assert errors[Symmetry.LOSS] < 0.2 * errors[Symmetry.NONE]


def fast_with(monkeypatch, mirror: Any):
    task = make("fast", WORLDS, seed=3)
    monkeypatch.setattr(type(task), "mirror", lambda task: mirror)
    return task


@pytest.mark.parametrize(
    ("mirror", "words"),
    [
        (None, "--ppo.symmetry augment: task 'fast' has no mirror"),
        ("left", "must be a Mirror"),
        (Mirror({}, Reflection((0, 1), (1.0, 1.0))), "must have all groups, got none for 'policy'"),
        (Mirror({"policy": Reflection((0,), (1.0,))}, Reflection((0, 1), (1.0, 1.0))), "must have 2 components, got 1"),
        (
            Mirror({"policy": Reflection((0, 0), (1.0, 1.0))}, Reflection((0, 1), (1.0, 1.0))),
            "must take each component once",
        ),
        (
            Mirror({"policy": Reflection((1, 0), (1.0, -1.0))}, Reflection((0, 1), (1.0, 1.0))),
            "mirrored twice, component 0 must be itself again",
        ),
        (
            Mirror({"policy": Reflection((0, 1), (1.0, -1.0))}, Reflection((0,), (1.0,))),
            "reflection of actions: it must have 2 components",
        ),
    ],
)
def test_mirrors_that_do_not_fit(monkeypatch, mirror, words):
    with pytest.raises(InputError, match=words) as caught:
        trainer(task=fast_with(monkeypatch, mirror), **{"ppo.symmetry": Symmetry.AUGMENT})
    assert "\n" not in str(caught.value)


def test_a_task_without_a_mirror_trains_without_the_option(monkeypatch):
    made = trainer(task=fast_with(monkeypatch, None))
    before = state_of(made)
    made.iterate()
    after = state_of(made)
    assert any(not torch.equal(before[name], after[name]) for name in before if "weight" in name)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ppo.objective": Objective.KL_PENALTY}, "symmetry must be none under the KL penalty"),
        ({"network.kind": NetworkKind.RECURRENT}, "symmetry must be none for a recurrent network"),
    ],
)
def test_what_does_not_go_together(changes, words):
    with pytest.raises(InputError, match=words):
        settings(**{"ppo.symmetry": Symmetry.AUGMENT, **changes})


def test_a_batch_without_symmetry_is_left_alone():
    made = trainer()
    assert made.algorithm.symmetry is None
    made.collect()
    assert set(made._learn()) == {"value", "surrogate", "entropy"}
    assert isinstance(made.storage, RolloutStorage)
