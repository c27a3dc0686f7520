"""PPO with a KL penalty: its rule, its objective, and that it learns."""

import math

import pytest
import torch
from rich.console import Console

from simwarp.tasks import make, replace_fields, task_class
from simwarp.train.algorithm.kl_penalty import KLPenaltyPPO, Penalty
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import Objective, default_config
from simwarp.train.runs.checkpoint import load_checkpoint
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.runs.training import train

QUIET = Console(quiet=True)


def config(**changes):
    settings = {"device": "cpu", "ppo.objective": Objective.KL_PENALTY}
    return replace_fields(default_config(task_class("fast")), settings | changes)


@pytest.mark.parametrize(
    ("before", "divergence", "after"),
    [
        (Penalty(1.0), 0.01, Penalty(1.0)),  # on target
        (Penalty(1.0), 0.0201, Penalty(1.5)),
        (Penalty(1.0), 0.0049, Penalty(1 / 1.5)),
        (Penalty(30.0), 1.0, Penalty(35.0, 1 / 1.5)),  # bound reached: the step shrinks
        (Penalty(35.0, 0.09), 1.0, Penalty(35.0, 0.09)),  # but not below a tenth
        (Penalty(1 / 30), 0.0, Penalty(1 / 35, 1.5)),
        (Penalty(1 / 35, 10.5), 0.0, Penalty(1 / 35, 10.5)),
    ],
)
def test_the_weight_follows_the_divergence(before, divergence, after):
    got = before.after(divergence, 0.01)
    assert got.beta == pytest.approx(after.beta)
    assert got.multiplier == pytest.approx(after.multiplier)


def test_the_first_gradient_is_that_of_the_plain_policy_gradient():
    # Old and new policy are equal then: ratio 1, penalty and hinge flat
    trainer = Trainer(make("fast", 16), config(num_envs=16, **{"ppo.mini_batches": 1, "ppo.max_grad_norm": 1e9}))
    trainer.collect()
    algorithm = trainer.algorithm
    assert isinstance(algorithm, KLPenaltyPPO)
    batch = next(trainer.storage.mini_batch_generator(1, 1))
    algorithm._learn(batch, True)
    got = [parameter.grad.clone() for parameter in algorithm.actor.parameters() if parameter.grad is not None]
    trainer = Trainer(make("fast", 16), config(num_envs=16))
    trainer.algorithm.actor(batch.observations, stochastic_output=True)
    gain = trainer.algorithm.actor.get_output_log_prob(batch.actions) * batch.advantages.squeeze(-1)
    (-gain.mean()).backward()
    wanted = [parameter.grad for parameter in trainer.algorithm.actor.parameters() if parameter.grad is not None]
    assert len(got) == len(wanted) > 0
    for mine, plain in zip(got, wanted, strict=True):
        torch.testing.assert_close(mine, plain, atol=1e-6, rtol=1e-4)


def test_the_reported_divergence_is_that_of_gaussians():
    trainer = Trainer(make("fast", 16), config(num_envs=16))
    trainer.collect()
    algorithm = trainer.algorithm
    assert isinstance(algorithm, KLPenaltyPPO)
    with torch.no_grad():
        algorithm.actor.distribution.std_param *= 2.0
    # Per component: log 2 + 1 / 8 - 1 / 2
    assert algorithm._divergence_now() == pytest.approx(2 * (math.log(2.0) + 0.125 - 0.5), rel=1e-4)


def test_the_policy_stops_once_it_has_moved_too_far_and_the_critic_goes_on():
    trainer = Trainer(make("fast", 16), config(num_envs=16, **{"ppo.learning_rate": 0.1, "ppo.epochs": 4}))
    values = trainer.iterate().values
    assert values["loss/kl"] > 0.04
    assert values["loss/policy_epochs"] < 4
    assert values["loss/kl_beta"] == 1.5


@pytest.mark.slow
def test_it_learns(tmp_path):
    result = train("fast", config(), task_class("fast").config_type(), root=tmp_path, console=QUIET)
    # Standing still earns 14 of 64
    assert (result.mean_reward or 0.0) > 40.0
    rows = read_progress(RunFolder(tmp_path / "fast" / result.run.rsplit("/", 1)[1]).progress)
    assert sum(float(row["loss/kl"]) for row in rows[5:]) / len(rows[5:]) == pytest.approx(0.01, rel=1.0)


def test_a_resumed_run_keeps_the_penalty(tmp_path):
    task_config = task_class("fast").config_type(max_episode_steps=12)

    def run(name, iterations, resume=None):
        settings = config(num_envs=16, iterations=iterations, steps_per_iteration=8, save_interval=1)
        result = train("fast", settings, task_config, root=tmp_path / name, resume=resume, console=QUIET)
        return RunFolder(tmp_path / name / "fast" / result.run.rsplit("/", 1)[1])

    whole = run("whole", 6)
    resumed = run("part", 6, resume=run("part", 3).path)
    left, right = (load_checkpoint(folder.latest_checkpoint()) for folder in (whole, resumed))
    assert left["kl_penalty"] == right["kl_penalty"] != {"beta": 1.0, "multiplier": 1.0}
    assert all(torch.equal(left["actor_state_dict"][k], right["actor_state_dict"][k]) for k in left["actor_state_dict"])
