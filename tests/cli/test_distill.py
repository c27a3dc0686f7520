"""``simwarp distill``: the keys of its results, who teaches, going on, and what a user may get wrong."""

import json
from pathlib import Path

import pytest
import torch

from simwarp import cli
from simwarp.tasks import config_to_train_in, task_class
from simwarp.tasks.driving.conditions import Conditions
from simwarp.tasks.driving.convoy import ConvoyConfig
from simwarp.tasks.driving.hallway import HallwayConfig
from simwarp.train.runs.checkpoint import load_checkpoint

TASK = f"{Path(__file__).parents[1] / 'train' / 'algorithm' / 'two_sights.py'}:TwoSights"
SMALL = ["--num-envs", "8", "--iterations", "2", "--steps-per-iteration", "4", "--device", "cpu", "--threads", "1"]
KEYS = {"run", "iterations", "env_steps", "env_steps_per_s", "wall_s", "mean_reward", "mean_episode_length"}


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    """A folder with a run of the task by place."""
    folder = tmp_path_factory.mktemp("distill")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert cli.main(["train", TASK, "--obs", "place", *SMALL]) == 0
    return folder


@pytest.fixture
def simwarp(taught, monkeypatch, command):
    """Run the command in that folder: exit code, standard output, standard error."""
    monkeypatch.chdir(taught)
    return command


def test_a_student_is_taught_by_the_newest_run_goes_on_and_is_evaluated(simwarp):
    code, out, err = simwarp("distill", TASK, "--teacher", "place", *SMALL, "--json", "result.json")
    assert (code, err) == (0, "")
    assert "teacher         newest run" in out
    result = json.loads(Path("result.json").read_text(encoding="utf-8"))
    assert set(result) >= KEYS
    assert (result["iterations"], result["env_steps"]) == (2, 2 * 8 * 4)
    config = json.loads((Path(result["run"]) / "config.json").read_text(encoding="utf-8"))
    assert config["task_config"]["obs"] == "readings"
    assert config["distillation"]["config"]["epochs"] == 2
    head = (Path(result["run"]) / "progress.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "loss/behavior" in head
    for command in ("distill", "train"):  # a run is gone on with as what it is
        code, out, err = simwarp(command, TASK, "--resume", result["run"], "--iterations", "3", "--json", "-")
        assert (code, json.loads(out)["iterations"]) == (0, 3)
        (Path(result["run"]) / "checkpoints" / "iteration_000003.pt").unlink()
    code, out, err = simwarp("eval", TASK, "--checkpoint", result["run"], "--episodes", "4", "--json", "-")
    assert code == 0
    code, out, err = simwarp("export", result["run"])
    assert code == 0, err


def test_both_begin_with_what_a_task_is_trained_in(simwarp, monkeypatch):
    monkeypatch.setattr(task_class(TASK), "trained_in", {"max_episode_steps": 7})
    monkeypatch.setattr(task_class(TASK), "distilled_in", {"max_episode_steps": 8})
    for usual, words in ((7, ["train", TASK, "--obs", "place"]), (8, ["distill", TASK, "--teacher", "place"])):
        for said, steps in (([], usual), (["--task.max-episode-steps", "9"], 9)):
            code, out, err = simwarp(*words, *SMALL, *said, "--json", "-", "--runs", "others")
            assert code == 0, err
            config = json.loads((Path(json.loads(out)["run"]) / "config.json").read_text(encoding="utf-8"))
            assert config["task_config"]["max_episode_steps"] == steps
    convoy = config_to_train_in(task_class("convoy"))
    assert isinstance(convoy, ConvoyConfig)
    assert convoy.conditions is Conditions.RANDOM
    hallway = config_to_train_in(task_class("hallway"), student=True)
    assert isinstance(hallway, HallwayConfig)
    assert hallway.tracks == 16
    assert ConvoyConfig().conditions is Conditions.NOMINAL


def test_a_student_may_be_told_the_same_as_its_teacher(simwarp):
    run = next(Path("runs/two-sights").iterdir())
    code, _, err = simwarp("distill", TASK, "--teacher", str(run), "--student", "place", *SMALL)
    assert (code, err) == (0, "")


def test_a_student_learns_on_from_what_it_was_taught_before(simwarp):
    teacher = str(next(path for path in Path("runs/two-sights").iterdir() if _is_by_place(path)))
    _, out, _ = simwarp("distill", TASK, "--teacher", teacher, *SMALL, "--network.hidden", "7", "--json", "-")
    first = load_checkpoint(Path(json.loads(out)["checkpoint"]))["actor_state_dict"]
    start = ["--warm-start", json.loads(out)["run"], "--distillation.learning-rate", "1e-12"]
    code, out, err = simwarp("distill", TASK, "--teacher", teacher, *SMALL, *start, "--json", "-")
    assert code == 0, err
    second = load_checkpoint(Path(json.loads(out)["checkpoint"]))["actor_state_dict"]
    for name, value in first.items():
        if "normalizer" not in name:
            torch.testing.assert_close(second[name], value, atol=1e-9, rtol=0.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "usage: simwarp distill"),
        (["--teacher", "place", "--resume", "runs"], "--teacher begins a new run and --resume goes on with one"),
        (["--teacher", "nobody"], "nobody"),
        (["--teacher", "zero"], "nothing is to be learnt from it"),
        (["--teacher", "readings", "--runs", "empty"], "no policy for task 'two-sights' with readings observations"),
        (["--teacher", "place", "--student", "sonar"], "--student of task 'two-sights' must be place or readings"),
        (["--teacher", "place", "--ppo.gamma", "0.9"], "--ppo options are those of `simwarp train`"),
        (["--teacher", "place", "--critic-warmup", "3"], "lessons have no critic"),
        (["--teacher", "place", "--distillation.epochs", "0"], "distillation.epochs must be at least 1, got 0"),
        (["--resume", "RUN"], "has no teacher: go on with `simwarp train"),
    ],
)
@pytest.mark.sweep
def test_a_mistake_gets_one_line_and_exit_code_2(simwarp, arguments, message):
    run = next(path for path in Path("runs/two-sights").iterdir() if _is_by_place(path))
    code, out, err = simwarp("distill", TASK, *(str(run) if word == "RUN" else word for word in arguments))
    assert code == 2
    assert message in err
    assert err.startswith("simwarp: ")
    assert err.count("\n") == 1
    assert "Traceback" not in out + err


def _is_by_place(run):
    config = json.loads((run / "config.json").read_text(encoding="utf-8"))
    return "distillation" not in config and config["task_config"]["obs"] == "place"
