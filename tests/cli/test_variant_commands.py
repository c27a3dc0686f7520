"""Variants of tasks on the command line: what trains, what goes on, what plays, and what is refused in one line."""

import json
from pathlib import Path
from typing import Any

import pytest

from simwarp import cli
from simwarp.cli.options import config_of_variant
from simwarp.cli.view.policy_choice import find_actor
from simwarp.tasks import task_class
from simwarp.train.runs.run_folder import open_run

THESIS = ["--task.variant", "thesis"]
SMALL = ["--device", "cpu", "--num-envs", "2", "--steps-per-iteration", "4", "--ppo.mini-batches", "2", "--ppo.epochs",
         "1", "--logger", "csv"]  # fmt: skip


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def train(task, *arguments):
    assert cli.main(["train", task, *SMALL, *arguments, "--json", "train.json"]) == 0
    return json.loads(Path("train.json").read_text(encoding="utf-8"))


def saved(run):
    return open_run(Path(run)).load_config()


def refused(capfd, *words):
    """The one line of an error."""
    assert cli.main([*words]) == 2
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("simwarp: ")]
    assert len(lines) == 1
    return lines[0]


@pytest.mark.parametrize("command", ["play", "eval"])
def test_no_shipped_policy_fits(capfd, command):
    for more in ([], ["--checkpoint", "shipped"], ["--obs", "camera"]):
        line = refused(capfd, command, "obstacle-avoidance", *THESIS, *more)
        assert "in variant 'thesis'" in line
        assert "no shipped one fits" in line
        assert "`simwarp train obstacle-avoidance" in line
        assert "--task.variant thesis`" in line
    line = refused(capfd, command, "obstacle-avoidance", *THESIS, "--checkpoint", "obstacle-avoidance.camera")
    assert "was trained in variant 'simwarp' of task 'obstacle-avoidance', not 'thesis', for which none is" in line


@pytest.mark.parametrize("command", ["train", "play", "eval", "distill", "view"])
def test_what_is_no_variant_is_refused(capfd, command):
    more = ["--teacher", "state"] if command == "distill" else []
    line = refused(capfd, command, "off-road", "--task.variant", "chrono", *more)
    assert "--task.variant of task 'off-road' must be simwarp or thesis, got 'chrono'" in line
    line = refused(capfd, command, "pendulum", *THESIS, *more)
    assert "task 'pendulum' has no variants: leave --task.variant away" in line


def test_a_run_goes_on_in_its_own_variant(capfd):
    run = train("ant", *THESIS, "--iterations", "1")["run"]
    task = saved(run)["task_config"]
    assert task["variant"] == "thesis"
    assert task["reward"] == "thesis"
    assert saved(run)["train_config"]["network"]["kind"] == "thesis-mlp"
    line = refused(capfd, "train", "ant", "--resume", run, "--task.variant", "simwarp", "--iterations", "2")
    assert f"--task.variant must be 'thesis', as run {run} began, got 'simwarp': leave it away" in line
    for more, iterations in (([], "2"), (THESIS, "3")):
        assert train("ant", "--resume", run, *more, "--iterations", iterations)["iterations"] == int(iterations)
    assert saved(run)["task_config"] == task
    usual = train("ant", "--iterations", "1")["run"]
    line = refused(capfd, "train", "ant", "--resume", usual, *THESIS, "--iterations", "2")
    assert "must be 'simwarp'" in line
    for variant, folder in (("thesis", run), ("simwarp", usual)):  # the newest of it, not the newest of all
        found = find_actor("ant", ["--task.variant", variant])
        assert str(found.run) == folder
        assert found.config.variant.value == variant


def test_options_come_before_what_a_variant_sets(capfd):
    run = train("ant", *THESIS, "--task.decimation", "2", "--task.rewards.alive", "0.5", "--iterations", "1")["run"]
    task = saved(run)["task_config"]
    assert (task["decimation"], task["rewards"]["alive"], task["rewards"]["joint_pos_limits"]) == (2, 0.5, -3.0)
    assert task["max_episode_steps"] == 10_000


@pytest.mark.parametrize("name", ["obstacle-avoidance", "hallway"])
def test_images_alone_train_a_network_from_nothing(name, capfd):
    run = train(name, *THESIS, "--network.kind", "nature-cnn", "--iterations", "2", "--task.decimation", "2")["run"]
    network = saved(run)["train_config"]["network"]
    assert (network["kind"], network["critic"], network["tanh_output"]) == ("nature-cnn", "same", True)
    assert cli.main(["eval", name, "--episodes", "1", "--task.max-episode-steps", "2", "--device", "cpu"]) == 0
    # beside numbers it is refused as ever
    line = refused(capfd, "train", name, *SMALL, "--network.kind", "nature-cnn", "--iterations", "1")
    assert "observation 'policy'" in line
    assert "network 'nature-cnn' takes images" in line


def test_an_arm_learns_a_fixed_target_and_goes_on_with_random_ones():
    first = train("racer3-reach", *THESIS, "--task.fixed-target", "--iterations", "1")["run"]
    again = train("racer3-reach", "--resume", first, "--task.no-fixed-target", "--iterations", "2")
    assert (again["run"], again["iterations"]) == (first, 2)
    assert saved(first)["task_config"]["fixed_target"] is False
    assert saved(first)["task_config"]["variant"] == "thesis"


def test_a_view_without_a_policy_shows_the_variant():
    cls: Any = task_class("off-road")
    actor = find_actor("off-road", THESIS)
    assert (actor.kind, actor.config) == ("random", None)
    assert config_of_variant(THESIS, cls) == cls.config_type(variant="thesis")
    assert config_of_variant([], cls) == cls.config_type()
