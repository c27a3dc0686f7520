"""What is not finite is told while it happens, and the exit code says in the end that nothing came of it."""

import json

import pytest
import torch

from simwarp import cli
from simwarp.tasks.pendulum import PendulumTask
from simwarp.train.runs.checkpoint import inference_only, load_checkpoint, save_checkpoint
from tests.train.runs.trained_run import run

TRAIN = ["--device", "cpu", "--num-envs", "4", "--steps-per-iteration", "4", "--logger", "csv"]


@pytest.fixture(scope="module")
def broken_policies(tmp_path_factory):
    """Checkpoints of policies that return NaN: one everywhere, one where the observation is large."""
    folder = run(tmp_path_factory.mktemp("trained"), iterations=1)
    content = inference_only(load_checkpoint(folder.latest_checkpoint()))
    everywhere = {name: value * torch.nan if "bias" in name else value for name, value in
                  content["actor_state_dict"].items()}  # fmt: skip
    path = folder.path / "nan.pt"
    save_checkpoint(path, content | {"actor_state_dict": everywhere})
    return path


def test_worlds_that_all_break_down_are_told_and_end_in_code_1(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(PendulumTask, "apply", lambda self, action: self.views.joint_force.fill_(torch.nan))
    assert cli.main(["train", "pendulum", *TRAIN, "--iterations", "2", "--json", "out.json"]) == 1
    out, err = capsys.readouterr()
    assert out.count("iteration 1: the physics of all worlds broke down in it") == 1
    assert err.count("\n") == 1
    assert "the physics of all worlds broke down in 2 iterations" in err
    result = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert result["broken_iterations"] == 2
    assert (tmp_path / result["run"] / "broken.npz").is_file()


def test_some_worlds_that_break_down_do_not_end_a_training(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    apply = PendulumTask.apply

    def first_breaks(self, action):
        apply(self, action)
        self.views.joint_force[0] = torch.nan

    monkeypatch.setattr(PendulumTask, "apply", first_breaks)
    assert cli.main(["train", "pendulum", *TRAIN, "--iterations", "1"]) == 0
    assert "broke down" not in "".join(capsys.readouterr())


def test_a_policy_that_diverges_while_it_collects_is_told(tmp_path, broken_policies, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["train", "fast", "--warm-start", str(broken_policies), *TRAIN, "--iterations", "1"]) == 1
    err = capsys.readouterr().err
    assert err == "simwarp: learning diverged in iteration 1; try a lower --ppo.learning-rate\n"


def test_an_evaluation_of_a_policy_that_returns_nan_ends_in_code_1(tmp_path, broken_policies, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = ["eval", "fast", "--checkpoint", str(broken_policies), "--episodes", "3", "--json", "out.json"]
    assert cli.main(arguments) == 1
    out, err = capsys.readouterr()
    assert out.count("policy: the policy returns NaN or infinity, since step 25 or before") == 1
    assert err.count("\n") == 1
    assert "the policy returned NaN or infinity" in err
    result = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert result["bad_actions"] >= 3 * 25
    assert result["baselines"]["zero"]["bad_actions"] == 0


def test_an_evaluation_in_which_all_worlds_break_down_ends_in_code_1(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(PendulumTask, "apply", lambda self, action: self.views.joint_force.fill_(torch.nan))
    assert cli.main(["eval", "pendulum", "--checkpoint", "shipped", "--episodes", "2", "--no-baselines"]) == 1
    out, err = capsys.readouterr()
    assert "policy: the physics of all 2 episodes broke down" in out
    assert err == "simwarp: the physics of all 2 episodes broke down\n"


@pytest.mark.parametrize(
    "command",
    [["play", "fast", "--seconds", "0.2"], ["play", "fast", "--seconds", "0.2", "--video", "a.gif"],
     ["record", "fast", "--episodes", "2"]],
)  # fmt: skip
def test_nothing_is_made_of_a_policy_that_returns_nan(tmp_path, broken_policies, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    assert cli.main([*command, "--checkpoint", str(broken_policies)]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "the policy returned NaN or infinity in" in err
    assert list(tmp_path.iterdir()) == []


def test_a_policy_that_returns_nan_is_not_exported(tmp_path, broken_policies, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["export", str(broken_policies), "--format", "torchscript"]) == 1
    assert "nothing was written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
