"""Recording, cloning, and training that starts from a clone."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from simwarp import cli
from simwarp.core.files import FileError
from simwarp.tasks import make, replace_fields, task_class
from simwarp.train.algorithm.cloning import CloneConfig, clone
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import NetworkKind, Objective, default_config
from simwarp.train.datasets.dataset_formats import load_trajectories
from simwarp.train.datasets.episodes import record
from simwarp.train.datasets.trajectories import save_trajectories
from simwarp.train.evaluation.evaluation import evaluate
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.checkpoint import load_checkpoint, save_checkpoint
from simwarp.train.runs.training import train
from tests.tasks.framework.camera_task import camera_task
from tests.tasks.framework.samples import counter

__all__ = ["camera_task"]
QUIET = Console(quiet=True)


def to_the_middle(observations):
    return (-5.0 * observations["policy"]).clamp(-1.0, 1.0)


@pytest.fixture(scope="module")
def data():
    return record(make("fast", 32), to_the_middle, 64, 7, {"policy": "by hand"})


def small(**changes):
    settings = {"num_envs": 16, "steps_per_iteration": 8, "iterations": 2, "save_interval": 1, "device": "cpu"}
    return replace_fields(default_config(task_class("fast")), settings | changes)


@pytest.fixture(scope="module")
def cloned(data):
    return clone(make("fast"), data, CloneConfig(epochs=30), default_config(task_class("fast")))


def test_whole_episodes_are_recorded_in_order():
    # Worlds 0, 1 and 2 play 2, 2 and 1 episodes of 5 steps; the count of steps is the observation before each action
    task = counter(3)
    data = record(task, lambda observations: torch.full((3, 2), 7.0), 5, 0, {})
    assert (data.episodes, data.steps) == (5, 25)
    assert data.observations["policy"][:, 0].tolist() == [0, 1, 2, 3, 4] * 5
    assert data.rewards.tolist() == [2, 3, 4, 5, 6] * 5  # one, and the count after the step
    assert data.episode.tolist() == np.repeat(range(5), 5).tolist()
    assert data.truncated.tolist() == [False, False, False, False, True] * 5
    assert not data.terminated.any()
    assert data.observations["camera"].dtype == np.uint8
    assert set(data.actions.flatten().tolist()) == {1.0}  # clipped
    assert data.returns().tolist() == [20.0] * 5
    assert data.about["mean_return"] == 20.0


def test_a_file_holds_all_of_it(tmp_path, data):
    save_trajectories(tmp_path / "a.npz", data)
    read = load_trajectories(tmp_path / "a.npz", "fast")
    assert read.about == json.loads(json.dumps(data.about))
    for name in ("actions", "rewards", "episode", "terminated", "truncated"):
        assert np.array_equal(getattr(read, name), getattr(data, name))
    assert np.array_equal(read.observations["policy"], data.observations["policy"])


def test_the_clone_does_what_it_was_shown(cloned):
    task = make("fast", 64)
    shown, copied = (evaluate(task, policy, 64, 11) for policy in (to_the_middle, network_policy(cloned.content, task)))
    assert cloned.held_out_loss < 0.02
    assert copied.mean_return > 0.95 * shown.mean_return
    assert cloned.content["actor_state_dict"]["distribution.std_param"].tolist() == pytest.approx([0.2, 0.2])


def test_the_same_seed_gives_the_same_clone(data):
    config = CloneConfig(epochs=2)
    first, second = (clone(make("fast"), data, config, default_config(task_class("fast"))).content for _ in range(2))
    assert all(torch.equal(value, second["actor_state_dict"][k]) for k, value in first["actor_state_dict"].items())


def test_images_are_cloned(camera_task):
    task = make(camera_task, 4)
    data = record(task, lambda o: torch.stack([-o["policy"][:, 2], 0 * o["policy"][:, 2]], dim=1), 8, 0, {})
    config = replace_fields(default_config(task_class(camera_task)), {"network.kind": NetworkKind.EARLY_FUSION})
    result = clone(task, data, CloneConfig(epochs=20, batch=32), config)
    assert result.loss < 0.05


@pytest.mark.parametrize("objective", list(Objective), ids=lambda objective: objective.value)
def test_a_warm_start_keeps_the_policy_while_the_critic_warms_up(tmp_path, cloned, objective):
    save_checkpoint(tmp_path / "clone.pt", cloned.content)
    changes = {"critic_warmup": 2, "iterations": 3, "ppo.objective": objective}
    result = train(
        "fast", small(**changes), task_class("fast").config_type(), root=tmp_path, warm_start=tmp_path / "clone.pt",
        console=QUIET,
    )  # fmt: skip
    folder = Path(result.checkpoint).parent
    warm, after = (load_checkpoint(folder / f"iteration_{number:06d}.pt") for number in (2, 3))
    start = cloned.content["actor_state_dict"]
    assert all(torch.equal(warm["actor_state_dict"][name], value) for name, value in start.items())
    assert not torch.equal(after["actor_state_dict"]["mlp.0.weight"], start["mlp.0.weight"])
    fresh = Trainer(make("fast", 16), small()).algorithm.critic.state_dict()
    assert not torch.equal(warm["critic_state_dict"]["mlp.0.weight"], fresh["mlp.0.weight"])
    assert json.loads((folder.parent / "config.json").read_text())["warm_start"] == str(tmp_path / "clone.pt")


def test_the_critic_learns_while_it_warms_up(cloned):
    trainer = Trainer(make("fast", 64), small(num_envs=64, critic_warmup=40))
    trainer.warm_start(cloned.content)
    losses = [trainer.iterate().values["loss/value"] for _ in range(40)]
    assert losses[-1] < 0.3 * losses[0]


def test_a_warm_started_run_begins_where_the_clone_is(tmp_path, cloned):
    save_checkpoint(tmp_path / "clone.pt", cloned.content)
    config = replace_fields(default_config(task_class("fast")), {"iterations": 6, "critic_warmup": 3, "device": "cpu"})
    task_config = task_class("fast").config_type()
    warm = train("fast", config, task_config, root=tmp_path, warm_start=tmp_path / "clone.pt", console=QUIET)
    cold = train("fast", config, task_config, root=tmp_path, console=QUIET)
    assert (warm.mean_reward or 0.0) > 40.0 > (cold.mean_reward or 0.0)


@pytest.fixture
def folder(tmp_path, monkeypatch, data, cloned):
    monkeypatch.chdir(tmp_path)
    save_trajectories(tmp_path / "fast.npz", data)
    save_checkpoint(tmp_path / "clone.pt", cloned.content)
    return tmp_path


def test_the_commands(folder, capfd):
    assert cli.main(["record", "fast", "--checkpoint", "clone.pt", "--episodes", "6", "--json", "r.json"]) == 0
    recorded = json.loads((folder / "r.json").read_text())
    assert {"output": "fast.npz", "episodes": 6, "steps": 6 * 64, "checkpoint": "clone.pt"}.items() <= recorded.items()
    assert (
        cli.main(["clone", "fast", "--data", "fast.npz", "--epochs", "3", "--network.hidden", "8", "--json", "-"]) == 0
    )
    result = json.loads(capfd.readouterr().out.partition("{")[2].join(["{", ""]))
    assert result["output"] == "fast_clone.pt"
    assert result["held_out_loss"] > 0.0
    # The clone's network, not the task's default, is the default of the training that starts from it
    options = ["--num-envs", "8", "--iterations", "2", "--critic-warmup", "1", "--steps-per-iteration", "8"]
    assert cli.main(["train", "fast", "--warm-start", "fast_clone.pt", *options, "--device", "cpu"]) == 0
    assert cli.main(["eval", "fast", "--checkpoint", "fast_clone.pt", "--episodes", "2"]) == 0
    assert cli.main(["export", "fast_clone.pt", "--format", "torchscript"]) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["record", "fast"], "no policy for task 'fast'"),
        (["record", "fast", "--checkpoint", "clone.pt", "--episodes", "0"], "episodes must be at least 1"),
        (["record", "fast", "--checkpoint", "clone.pt", "--output", "a.csv"], "must end in .npz"),
        (["clone", "fast"], "which trajectories?"),
        (["clone", "fast", "--data", "none.npz"], "trajectories 'none.npz': there is no such file or folder"),
        (["clone", "fast", "--data", "clone.pt"], "is no .npz file of arrays"),
        (["clone", "fast", "--data", "short.npz"], "is no .npz file of arrays"),
        (["clone", "pendulum", "--data", "fast.npz"], "are of task 'fast', not 'pendulum'"),
        (["clone", "fast", "--data", "wide.npz"], "the trajectories hold observations"),
        (["clone", "fast", "--data", "nan.npz"], "NaN or infinity in 'policy'"),
        (["clone", "fast", "--data", "fast.npz", "--network.kind", "recurrent"], "recurrent networks cannot be cloned"),
        (["clone", "fast", "--data", "fast.npz", "--epochs", "0"], "epochs must be at least 1"),
        (["train", "fast", "--warm-start", "none.pt"], "checkpoint 'none.pt' does not exist"),
        (["train", "pendulum", "--warm-start", "clone.pt", "--num-envs", "2"], "is of task 'fast', not 'pendulum'"),
        (["train", "fast", "--warm-start", "clone.pt", "--network.hidden", "5"], "has another network"),
        (["train", "fast", "--critic-warmup", "-1"], "critic-warmup must be zero or positive"),
    ],
)
def test_mistakes_get_one_line(folder, data, capfd, arguments, message):
    import dataclasses

    (folder / "short.npz").write_bytes((folder / "fast.npz").read_bytes()[:-300])
    for name, change in (("wide", lambda x: np.hstack([x, x])), ("nan", lambda x: np.where(x > 0.5, np.nan, x))):
        odd = dataclasses.replace(data, observations={"policy": change(data.observations["policy"])})
        save_trajectories(folder / f"{name}.npz", odd)
    assert cli.main(arguments) == 2
    err = capfd.readouterr().err
    assert message in err
    assert err.count("\n") == 1


def test_a_file_cannot_run_code(tmp_path):
    np.savez(tmp_path / "evil.npz", about=np.array([print], dtype=object), actions=np.zeros(1))
    with pytest.raises(FileError, match=r"is no .npz file of arrays"):
        load_trajectories(tmp_path / "evil.npz", "fast")
