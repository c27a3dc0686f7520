"""A run: it learns, it leaves a complete folder, and it goes on exactly where it stopped."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from rich.console import Console

from simwarp.tasks import InputError, config_to_plain, make, replace_fields, task_class
from simwarp.train.algorithm.learner import TrainingError
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import (
    default_config,
    rsl_rl_config,
    task_config_from_plain,
    train_config_from_plain,
)
from simwarp.train.runs.checkpoint import load_checkpoint, save_checkpoint
from simwarp.train.runs.progress_table import ProgressTable, read_progress
from simwarp.train.runs.run_folder import latest_run, open_run
from simwarp.train.runs.training import train

QUIET = Console(quiet=True)


def small(**changes):
    settings = {"num_envs": 16, "iterations": 4, "steps_per_iteration": 8, "device": "cpu", "save_interval": 2}
    return replace_fields(default_config(task_class("fast")), settings | changes)


def run(root, resume=None, **changes):
    config = task_class("fast").config_type(max_episode_steps=12)
    return train("fast", small(**changes), config, root=root, resume=resume, console=QUIET)


def open_run_path(result):
    return Path(result.run)


def parameters(path):
    content = load_checkpoint(Path(path))
    return dict(content["actor_state_dict"]) | {
        f"critic {name}": tensor for name, tensor in content["critic_state_dict"].items()
    }


@pytest.mark.slow
def test_the_fast_task_is_learnt(tmp_path):
    result = train(
        "fast", replace_fields(default_config(task_class("fast")), {"device": "cpu"}), task_class("fast").config_type(),
        root=tmp_path, console=QUIET,
    )  # fmt: skip
    # Standing still earns 14 of 64 on average; at the origin from the first step on it would be 64
    assert (result.mean_reward or 0.0) > 45.0
    assert result.mean_episode_length == 64.0


def test_the_run_folder_is_complete(tmp_path):
    result = run(tmp_path)
    folder = open_run(tmp_path / "fast" / os.path.basename(result.run))
    assert [path.name for path in folder.checkpoint_files()] == ["iteration_000002.pt", "iteration_000004.pt"]
    assert result.checkpoint == str(folder.latest_checkpoint())
    assert (folder.path / "learning_curve.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    rows = read_progress(folder.progress)
    assert [int(row["iteration"]) for row in rows] == [1, 2, 3, 4]
    assert int(rows[-1]["env_steps"]) == result.env_steps == 4 * 16 * 8
    assert {"mean_reward", "mean_episode_length", "reward/near", "end/time_limit", "loss/value"} <= set(rows[0])
    assert list(folder.path.glob("events.out.tfevents.*"))
    provenance = json.loads((folder.path / "provenance.json").read_text(encoding="utf-8"))
    assert provenance["versions"]["torch"] == torch.__version__
    assert set(provenance) >= {"command", "git", "started"}
    saved = folder.load_config()
    assert train_config_from_plain(saved["train_config"]) == small(threads=1)
    assert task_config_from_plain(task_class("fast"), saved["task_config"]).max_episode_steps == 12
    assert latest_run(tmp_path, "fast") == folder
    assert latest_run(tmp_path, "pendulum") is None


def test_two_runs_with_one_seed_are_equal_and_another_seed_differs(tmp_path):
    first, second = (parameters(run(tmp_path / name).checkpoint) for name in "ab")
    assert all(torch.equal(first[name], second[name]) for name in first)
    other = parameters(run(tmp_path / "c", seed=1).checkpoint)
    assert any(not torch.equal(first[name], other[name]) for name in first)


def test_a_resumed_run_equals_an_uninterrupted_one(tmp_path):
    whole = run(tmp_path / "whole", iterations=6)
    part = run(tmp_path / "part", iterations=2)
    resumed = run(tmp_path / "part", resume=open_run_path(part), iterations=6)
    assert resumed.run == part.run
    expected, got = parameters(whole.checkpoint), parameters(resumed.checkpoint)
    assert all(torch.equal(expected[name], got[name]) for name in expected)
    left, right = load_checkpoint(Path(whole.checkpoint)), load_checkpoint(Path(resumed.checkpoint))
    assert torch.equal(left["worlds"]["extra"]["position"], right["worlds"]["extra"]["position"])
    assert torch.equal(left["worlds"]["episode_index"], right["worlds"]["episode_index"])
    assert left["window"] == right["window"]
    rows = read_progress(open_run(open_run_path(resumed)).progress)
    assert [int(row["iteration"]) for row in rows] == [1, 2, 3, 4, 5, 6]


def test_resuming_with_another_number_of_worlds_keeps_the_networks(tmp_path):
    part = run(tmp_path, iterations=2)
    resumed = run(tmp_path, resume=open_run_path(part), iterations=3, num_envs=8)
    assert resumed.iterations == 3
    rows = read_progress(open_run(open_run_path(resumed)).progress)
    assert [int(row["env_steps"]) for row in rows] == [128, 256, 256 + 8 * 8]
    assert resumed.env_steps == 320


def test_a_checkpoint_that_does_not_tell_its_steps_tells_how_it_was_trained(tmp_path):
    part = run(tmp_path, iterations=2)
    content = load_checkpoint(Path(part.checkpoint))
    assert content.pop("env_steps") == 256
    save_checkpoint(Path(part.checkpoint), content)
    assert run(tmp_path, resume=open_run_path(part), iterations=3, num_envs=8).env_steps == 320


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"iterations": 2}, "already has 2 iterations"),
        ({"iterations": 3, "network.hidden": (8,)}, "other networks"),
    ],
)
def test_what_cannot_be_resumed_is_refused(tmp_path, changes, message):
    part = run(tmp_path, iterations=2)
    with pytest.raises(InputError, match=message):
        run(tmp_path, resume=open_run_path(part), **changes)


def test_resuming_another_task_or_no_run_is_refused(tmp_path):
    part = run(tmp_path, iterations=2)
    with pytest.raises(InputError, match="is of task 'fast', not 'pendulum'"):
        train("pendulum", small(), task_class("pendulum").config_type(), resume=open_run_path(part), console=QUIET)
    with pytest.raises(InputError, match="does not exist"):
        run(tmp_path, resume=tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="is it a run folder"):
        run(tmp_path, resume=tmp_path / "empty")


def test_old_checkpoints_are_dropped(tmp_path):
    result = run(tmp_path, save_interval=1, keep_checkpoints=2)
    names = [path.name for path in open_run(open_run_path(result)).checkpoint_files()]
    assert names == ["iteration_000003.pt", "iteration_000004.pt"]


@pytest.mark.parametrize("kept", [0, 1, 100, 3000, -1])
@pytest.mark.sweep
def test_a_truncated_checkpoint_is_refused(tmp_path, kept):
    result = run(tmp_path)
    data = open_run(open_run_path(result)).latest_checkpoint().read_bytes()
    broken = tmp_path / "broken.pt"
    broken.write_bytes(data[:kept])
    with pytest.raises(InputError, match="truncated or not a checkpoint"):
        load_checkpoint(broken)


def test_foreign_and_missing_checkpoints_are_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        load_checkpoint(tmp_path / "none.pt")
    torch.save({"weights": torch.zeros(1)}, tmp_path / "foreign.pt")
    with pytest.raises(InputError, match="no simwarp checkpoint"):
        load_checkpoint(tmp_path / "foreign.pt")


class Evil:
    def __reduce__(self):
        return os.mkdir, ("evil",)


def test_a_checkpoint_cannot_run_code(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_checkpoint(tmp_path / "evil.pt", {"task": Evil()})
    with pytest.raises(InputError):
        load_checkpoint(tmp_path / "evil.pt")
    assert not (tmp_path / "evil").exists()


def test_half_a_line_of_progress_is_ignored(tmp_path):
    path = tmp_path / "progress.csv"
    table = ProgressTable(path, ["iteration", "env_steps", "mean_reward"])
    for iteration in (1, 2, 3):
        table.append({"iteration": iteration, "env_steps": 10 * iteration, "mean_reward": 0.5})
    with path.open("a", encoding="utf-8") as file:
        file.write("4,4")
    assert [row["iteration"] for row in read_progress(path)] == ["1", "2", "3"]
    ProgressTable(path, ["iteration", "env_steps", "mean_reward"], keep_below=2)
    assert [row["iteration"] for row in read_progress(path)] == ["1", "2"]


def test_divergence_is_reported(tmp_path):
    trainer = Trainer(make("fast", 16), small())
    trainer.iterate()
    for parameter in trainer.algorithm.critic.parameters():
        parameter.data.fill_(float("nan"))
    with pytest.raises(TrainingError, match=r"diverged in iteration 2.*learning-rate"):
        trainer.iterate()


def test_every_key_for_rsl_rl_is_one_it_knows():
    # rsl-rl ignores unknown keys at the top and fails on unknown ones below: hold ours to its signatures.
    import inspect

    from rsl_rl.algorithms import PPO
    from rsl_rl.models import MLPModel

    from simwarp.train.networks.networks import Perceptron

    settings = rsl_rl_config(small(), ["policy"])
    ppo, model = (
        set(inspect.signature(PPO).parameters),
        set(inspect.signature(MLPModel).parameters) | set(inspect.signature(Perceptron).parameters),
    )
    assert set(settings["algorithm"]) - {"class_name"} <= ppo
    assert set(settings["actor"]) - {"class_name"} <= model
    assert set(settings["critic"]) - {"class_name"} <= model
    assert set(settings) == {"num_steps_per_env", "save_interval", "obs_groups", "algorithm", "actor", "critic"}


def test_configuration_round_trip_and_unknown_names():
    config = small(**{"ppo.gamma": 0.9, "network.hidden": (7, 5)})
    assert train_config_from_plain(json.loads(json.dumps(config_to_plain(config)))) == config
    with pytest.raises(InputError, match="no field 'gama'; did you mean gamma"):
        replace_fields(config, {"ppo.gama": 0.9})
    for key, value in (("num_envs", -1), ("ppo.gamma", 0.0), ("ppo.clip", -0.1), ("network.hidden", ())):
        with pytest.raises(InputError, match=key.split(".")[-1].replace("_", "-")):
            replace_fields(config, {key: value})


def start(folder, *arguments):
    command = [sys.executable, "-m", "simwarp", "train", "fast", "--device", "cpu", "--num-envs", "16", *arguments]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for_checkpoint(folder, count=1):
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        if len(list(folder.glob("runs/fast/*/checkpoints/iteration_*.pt"))) >= count:
            return
        time.sleep(0.02)
    raise AssertionError("no checkpoint appeared")


def newest(folder):
    run_folder = latest_run(folder / "runs", "fast")
    assert run_folder is not None
    return run_folder


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_an_interrupted_run_is_saved_and_can_go_on(tmp_path, number):
    process = start(tmp_path, "--iterations", "100000", "--save-interval", "20", "--keep-checkpoints", "1")
    wait_for_checkpoint(tmp_path)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "interrupted and saved" in out
    assert "--resume" in out
    assert "next            simwarp play fast  or  simwarp eval fast\n" in out
    folder = newest(tmp_path)
    done = load_checkpoint(folder.latest_checkpoint())["iteration"]
    assert done == len(read_progress(folder.progress))
    resumed = start(tmp_path, "--resume", str(folder.path), "--iterations", str(done + 2))
    out, err = resumed.communicate(timeout=120)
    assert resumed.returncode == 0, err
    assert load_checkpoint(folder.latest_checkpoint())["iteration"] == done + 2


def test_a_resumed_run_over_physics_equals_an_uninterrupted_one(tmp_path):
    def pendulum(root, iterations, resume=None):
        settings = {"num_envs": 8, "steps_per_iteration": 16, "save_interval": 1, "iterations": iterations}
        config = replace_fields(default_config(task_class("pendulum")), settings | {"device": "cpu"})
        task_config = task_class("pendulum").config_type(max_episode_steps=40)
        return train("pendulum", config, task_config, root=root, resume=resume, console=QUIET)

    whole = pendulum(tmp_path / "whole", 5)
    part = pendulum(tmp_path / "part", 2)
    resumed = pendulum(tmp_path / "part", 5, resume=open_run_path(part))
    left, right = (load_checkpoint(Path(result.checkpoint)) for result in (whole, resumed))
    assert all(torch.equal(left["actor_state_dict"][k], right["actor_state_dict"][k]) for k in left["actor_state_dict"])
    states = left["worlds"]["simulation"]["state"], right["worlds"]["simulation"]["state"]
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])


def test_a_run_ends_when_its_minutes_are_used_up(tmp_path, monkeypatch):
    """By a clock that goes on by 20 min in each iteration, so that the third is the last within an hour."""
    late, clock = [0.0], time.perf_counter
    iterate = Trainer.iterate

    def timed(self):
        report = iterate(self)
        late[0] += 1200.0
        return report

    monkeypatch.setattr(Trainer, "iterate", timed)
    monkeypatch.setattr(time, "perf_counter", lambda: clock() + late[0])
    result = run(tmp_path, minutes=60.0, iterations=9)
    assert (result.iterations, result.interrupted) == (3, False)
    assert result.checkpoint.endswith("000003.pt")  # between two save intervals, and saved all the same
    resumed = run(tmp_path, resume=open_run_path(result), minutes=60.0, iterations=9)
    assert resumed.iterations == 6  # an hour more
    whole = run(tmp_path / "whole", iterations=6)
    torch.testing.assert_close(parameters(resumed.checkpoint), parameters(whole.checkpoint), rtol=0.0, atol=0.0)


def test_iterations_end_a_run_with_minutes_left(tmp_path):
    assert run(tmp_path, minutes=60.0).iterations == 4


def test_a_run_without_time_is_refused():
    with pytest.raises(InputError, match="minutes must be"):
        small(minutes=0.0)
