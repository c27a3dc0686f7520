"""Learning on several threads: the gradient is that of the whole mini-batch, the same in every run, and one thread's
results are those of rsl-rl."""

from typing import Any

import pytest
import torch
from rsl_rl.algorithms import PPO

from simwarp.tasks import make, replace_fields
from simwarp.train.algorithm import mini_batch_shares
from simwarp.train.algorithm.learner_thread_pool import LearnerThreads
from simwarp.train.algorithm.mini_batch_shares import mini_batches_in_shares, share_count
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import Cell, CriticSees, NetworkKind, Objective, TrainConfig
from tests.tasks.framework.camera_task import CameraTask, camera_task

__all__ = ["camera_task"]
WORLDS, STEPS = 12, 8
RECURRENT: dict[str, Any] = {"network.kind": NetworkKind.RECURRENT, "network.memory": 16}
LSTM = RECURRENT | {"network.cell": Cell.LSTM}


@pytest.fixture
def tiny_shares(monkeypatch):
    """Mini-batches of a test are cut too."""
    monkeypatch.setattr(mini_batch_shares, "LEAST_NUMBERS", 8)


def settings(threads, **changes):
    small = {
        "num_envs": WORLDS, "steps_per_iteration": STEPS, "device": "cpu", "threads": threads,
        "ppo.epochs": 2, "ppo.mini_batches": 2, "ppo.entropy": 0.01,
    }  # fmt: skip
    return replace_fields(TrainConfig(), small | changes)


def trainer(threads, task="fast", **changes):
    episodes: dict[str, Any] = {"max_episode_steps": 5} if task == "fast" else {}
    return Trainer(make(task, WORLDS, seed=3, **episodes), settings(threads, **changes))


def state_of(made):
    return {f"{name} {key}": value for name in ("actor", "critic")
            for key, value in getattr(made.algorithm, name).state_dict().items()}  # fmt: skip


IMAGE = 45 * 80 * 3 + 11


@pytest.mark.parametrize(
    ("samples", "numbers", "parameters", "threads", "count"),
    [
        (4096, 30, 25_000, 2, 2),  # one for each thread
        (4096, 30, 25_000, 3, 3),
        (512, 2, 9000, 2, 1),  # too little work to share
        (2048, 4, 9000, 4, 1),
        (4096, 4, 9000, 4, 2),
        (2**17, 30, 25_000, 2, 16),  # large: as many rounds as it takes
        (2048, IMAGE, 90_000, 2, 8),
        (2048, IMAGE, 90_000, 3, 9),
        (40, IMAGE, 90_000, 16, 5),
        (1, 10**7, 10**7, 2, 1),
    ],
)
def test_number_of_shares(samples, numbers, parameters, threads, count):
    assert share_count(samples, numbers, parameters, threads) == count


def columns(batch):
    """What a mini-batch holds of each sample, and the axis of samples or worlds."""
    axis = 0 if batch.masks is None else 1
    names = ("actions", "values", "advantages", "returns", "old_actions_log_prob")
    found = {name: (getattr(batch, name), axis) for name in names}
    found |= {f"old {place}": (one, axis) for place, one in enumerate(batch.old_distribution_params)}
    found |= {f"observed {name}": (group, axis) for name, group in batch.observations.items()}
    if batch.masks is not None:
        found["masks"] = (batch.masks, 1)
        cells = [cell for memory in batch.hidden_states for cell in (memory if isinstance(memory, tuple) else [memory])]
        found |= {f"memory {place}": (cell, 1) for place, cell in enumerate(cells)}
    return found


@pytest.mark.parametrize("network", [{}, RECURRENT, LSTM], ids=["mlp", "gru", "lstm"])
def test_shares_make_up_the_mini_batches_that_rsl_rl_draws(network):
    made = trainer(1, **network)
    made.collect()
    storage, recurrent = made.storage, bool(network)
    storage.step = 0
    made.collect()  # memories are not zero any more where no episode began
    torch.manual_seed(1)
    make_whole = storage.recurrent_mini_batch_generator if recurrent else storage.mini_batch_generator
    whole = list(make_whole(2, 2))
    torch.manual_seed(1)
    cut = list(mini_batches_in_shares(storage, 2, 2, 4, recurrent=recurrent))
    assert len(cut) == len(whole) == 4
    for batch, shares in zip(whole, cut, strict=True):
        assert len(shares) == 4
        assert sum(share.weight for share in shares) == pytest.approx(1.0, abs=1e-15)
        taken = [columns(share.take()) for share in shares]
        for name, (column, axis) in columns(batch).items():
            assert torch.equal(torch.cat([one[name][0] for one in taken], dim=axis), column), name
        samples = [one["actions"][0][..., 0].numel() for one in taken]
        assert [share.weight for share in shares] == [number / sum(samples) for number in samples]


def gradients(algorithm, threads):
    """The gradient of the whole rollout as one mini-batch, at the parameters that there are."""
    penalty = getattr(algorithm, "penalty", None)
    kept = [{k: v.clone() for k, v in model.state_dict().items()} for model in (algorithm.actor, algorithm.critic)]
    algorithm.threads = threads
    algorithm.update()
    found = [parameter.grad for model in (algorithm.actor, algorithm.critic) for parameter in model.parameters()]
    for model, state in zip((algorithm.actor, algorithm.critic), kept, strict=True):
        model.load_state_dict(state)
    algorithm.penalty = penalty
    return found


CASES: dict[str, dict[str, Any]] = {
    "clip": {},
    "clipped-values": {"ppo.clip_value_loss": True},
    "kl-penalty": {"ppo.objective": Objective.KL_PENALTY},
    "gru": RECURRENT,
    "lstm-kl-penalty": {**LSTM, "ppo.objective": Objective.KL_PENALTY},
    "images": {"network.kind": NetworkKind.EARLY_FUSION},
    "privileged": {"network.kind": NetworkKind.LATE_FUSION, "network.critic": CriticSees.PRIVILEGED},
}


@pytest.mark.parametrize("case", CASES)
def test_the_gradient_is_that_of_the_whole_mini_batch(tiny_shares, camera_task, monkeypatch, case):
    monkeypatch.setattr(CameraTask, "privileged", lambda task: task.x.unsqueeze(1))
    task = camera_task if case in ("images", "privileged") else "fast"
    whole: dict[str, Any] = {"ppo.mini_batches": 1, "ppo.epochs": 1, "ppo.max_grad_norm": 1e9}
    made = trainer(1, task, **whole | CASES[case])
    made.collect()
    algorithm, storage = made.algorithm, made.storage
    # In float64, so that only mistakes are left of the difference
    algorithm.actor.double(), algorithm.critic.double()
    for name, value in vars(storage).items():
        if name == "observations":
            storage.observations = value.double()
        elif isinstance(value, torch.Tensor) and value.is_floating_point():
            setattr(storage, name, value.double())
        elif isinstance(value, tuple | list) and value and isinstance(value[0], torch.Tensor):
            setattr(storage, name, type(value)(one.double() for one in value))
    with torch.no_grad():
        algorithm.actor.distribution.std_param *= 1.3  # far enough for clipped ratios, and for the hinge
    monkeypatch.setattr(algorithm.optimizer, "step", lambda: None)
    expected = gradients(algorithm, None)
    algorithm.threads = threads = LearnerThreads(5)
    assert [len(shares) for shares in algorithm.shared_batches(1)] == [5]
    got = gradients(algorithm, threads)
    threads.close()
    assert len(got) == len(expected) > 5
    for mine, plain in zip(got, expected, strict=True):
        # Sums of some hundred numbers of 53 bits in another order
        torch.testing.assert_close(mine, plain, rtol=0.0, atol=1e-12 * max(1.0, float(plain.abs().max())))
        assert float(plain.abs().max()) > 1e-9


def test_the_first_update_is_that_of_one_thread(tiny_shares):
    """Mini-batches are the same, and so are learning rates: the divergence is that of all shares."""
    results = []
    for threads in (1, 3):
        made = trainer(threads, **{"ppo.epochs": 1, "ppo.mini_batches": 4})
        made.collect()
        with torch.no_grad():
            made.algorithm.actor.distribution.std_param *= 1.3
        results.append((made._learn(), made.algorithm.learning_rate, state_of(made)))
        made.close()
    (losses, rate, state), (shared_losses, shared_rate, shared_state) = results
    assert rate == shared_rate == pytest.approx(1e-3 / 1.5**4)
    for name in losses:
        # The surrogate is a mean of advantages of both signs, of about 1
        assert shared_losses[name] == pytest.approx(losses[name], rel=1e-5, abs=1e-6)
    for name in state:
        # Adam divides by the gradient's size: where that is rounding, one of four steps may point the other way
        torch.testing.assert_close(shared_state[name], state[name], rtol=1e-5, atol=4e-3)
    moved = trainer(1).algorithm.actor.state_dict()["mlp.0.weight"]
    assert float((state["actor mlp.0.weight"] - moved).abs().max()) > 1e-3


@pytest.mark.parametrize("network", [{}, RECURRENT], ids=["mlp", "gru"])
def test_one_thread_learns_as_rsl_rl_does_bit_by_bit(network):
    states = []
    for kind in (None, PPO):
        made = trainer(1, **network)
        if kind is not None:
            made.algorithm.__class__ = kind
        for _ in range(3):
            made.iterate()
        states.append(state_of(made))
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])


@pytest.mark.parametrize("case", ["clip", "images"])
def test_actions_drawn_in_shares_are_those_of_the_policy(tiny_shares, camera_task, case):
    made = trainer(3, camera_task if case == "images" else "fast", **CASES[case])
    assert made.algorithm._share_count(WORLDS) == 3
    made.collect()
    made.close()
    algorithm, storage = made.algorithm, made.storage
    with torch.no_grad():
        seen = storage.observations.flatten(0, 1)
        mean, values = algorithm.actor(seen), algorithm.critic(seen)
    means, deviations = (one.flatten(0, 1) for one in storage.distribution_params)
    # Products of a network's layers in batches of another size: float32 of numbers about 1
    torch.testing.assert_close(means, mean, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(storage.values.flatten(0, 1), values, rtol=1e-5, atol=1e-5)
    assert torch.equal(deviations, algorithm.actor.distribution.std_param.detach().expand_as(means))
    actions = storage.actions.flatten(0, 1)
    expected = torch.distributions.Normal(means, deviations).log_prob(actions).sum(dim=1, keepdim=True)
    torch.testing.assert_close(storage.actions_log_prob.flatten(0, 1), expected)
    drawn = (actions - means) / deviations
    assert float(drawn.mean().abs()) < 4.0 / drawn.numel() ** 0.5  # four times its deviation
    assert float(drawn.std()) == pytest.approx(1.0, abs=4.0 / (2.0 * drawn.numel()) ** 0.5)


def test_threads_that_only_warm_the_critic_leave_the_actor(tiny_shares):
    states = []
    for threads in (1, 3):
        made = trainer(threads, critic_warmup=1, **{"ppo.epochs": 1, "ppo.mini_batches": 1})
        before = state_of(made)
        losses = made.iterate().values
        made.close()
        after = state_of(made)
        assert all(torch.equal(before[name], after[name]) for name in before if name.startswith("actor"))
        states.append((losses["loss/value"], after))
    (loss, state), (shared_loss, shared_state) = states
    assert shared_loss == pytest.approx(loss, rel=1e-5)
    assert any(not torch.equal(before[name], state[name]) for name in before)
    for name in state:
        torch.testing.assert_close(shared_state[name], state[name], rtol=1e-5, atol=1e-3)  # one step of Adam


@pytest.mark.parametrize("rest", [False, True])
def test_under_the_penalty_a_policy_that_moved_too_far_rests_on_threads_too(tiny_shares, rest):
    changes = {"ppo.objective": Objective.KL_PENALTY, "ppo.epochs": 4, "ppo.learning_rate": 0.1 if rest else 1e-6}
    made = trainer(3, **changes)
    values = made.iterate().values
    made.close()
    assert (values["loss/kl"] > 0.04) == rest
    assert (values["loss/policy_epochs"] < 4) == rest
    assert values["loss/kl_beta"] == (1.5 if rest else pytest.approx(1.0 / 1.5))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.sweep
def test_two_runs_on_two_threads_are_equal_bit_by_bit(tiny_shares, camera_task, monkeypatch, case):
    monkeypatch.setattr(CameraTask, "privileged", lambda task: task.x.unsqueeze(1))
    task = camera_task if case in ("images", "privileged") else "fast"
    states = []
    for _ in range(2):
        made = trainer(2, task, **CASES[case])
        for _ in range(3):
            made.iterate()
        made.close()
        states.append(state_of(made))
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])
    assert all(bool(value.isfinite().all()) for value in states[0].values())
