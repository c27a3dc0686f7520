"""Cloning from any format is cloning from .npz: bit by bit, but for what a video with loss does to images."""

import json
from typing import Any

import numpy as np
import pytest
import torch

from simwarp import cli
from simwarp.tasks import make, replace_fields, task_class
from simwarp.train.algorithm.cloning import CloneConfig, clone
from simwarp.train.config import NetworkKind, default_config
from simwarp.train.datasets.dataset_formats import DatasetFormat, load_trajectories, record_dataset
from simwarp.train.datasets.episodes import record
from simwarp.train.datasets.trajectories import save_trajectories
from simwarp.train.networks.policies import network_policy
from simwarp.train.runs.checkpoint import load_checkpoint
from tests.train.algorithm.test_cloning import to_the_middle
from tests.train.datasets.recorded_task import by_noise, recorded_task

pytest.importorskip("minari", reason="needs the extra minari")
__all__ = ["recorded_task"]
FORMATS = {"minari": 18, "lerobot": 18, "lossless": 0}
"""Name -> quality of videos."""


def kind_of(name):
    return DatasetFormat.MINARI if name == "minari" else DatasetFormat.LEROBOT


def weights(content):
    return content["actor_state_dict"]


def same(first, second):
    return first.keys() == second.keys() and all(torch.equal(value, second[name]) for name, value in first.items())


def test_the_commands_make_the_same_policy_of_all_formats(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    task = make("fast", 5, max_episode_steps=30)
    save_trajectories(tmp_path / "fast.npz", record(task, to_the_middle, 12, 7, {"policy": "by hand"}))
    for name in ("minari", "lerobot"):
        record_dataset(
            make("fast", 5, max_episode_steps=30), to_the_middle, 12, 7, tmp_path / f"{name}-v0", kind_of(name)
        )
    made, told = [], []
    for source in ("fast.npz", "minari-v0", "lerobot-v0"):
        words = ["clone", "fast", "--data", source, "--epochs", "2", "--output", f"{source}.pt", "--json", "c.json"]
        assert cli.main(words) == 0
        made.append(load_checkpoint(tmp_path / f"{source}.pt"))
        told.append(json.loads((tmp_path / "c.json").read_text()))
    assert same(weights(made[0]), weights(made[1]))
    assert same(weights(made[0]), weights(made[2]))
    assert made[0]["task_config"] == made[1]["task_config"] == made[2]["task_config"]
    assert [one["steps"] for one in told] == [330] * 3  # eleven of twelve episodes of 30 steps
    assert told[0]["held_out_loss"] == told[1]["held_out_loss"] == told[2]["held_out_loss"] > 0.0


@pytest.fixture
def data(recorded_task, tmp_path):
    """The same episodes, with images, from a file of arrays and from each dataset."""
    config: Any = {"flags": False}
    found = {"npz": record(make(recorded_task, 4, **config), by_noise, 16, 3, {})}
    for name, quality in FORMATS.items():
        path = tmp_path / f"{name}-v0"
        record_dataset(make(recorded_task, 4, **config), by_noise, 16, 3, path, kind_of(name), quality=quality)
        found[name] = load_trajectories(path, recorded_task)
    return found


def cloned(name, trajectories):
    config = replace_fields(default_config(task_class(name)), {"network.kind": NetworkKind.MULTI_INPUT})
    return clone(make(name, flags=False), trajectories, CloneConfig(epochs=3, batch=32), config)


def test_images_without_loss_make_the_same_policy_bit_by_bit(data, recorded_task):
    expected = cloned(recorded_task, data["npz"])
    for name in ("minari", "lossless"):
        found = cloned(recorded_task, data[name])
        assert same(weights(found.content), weights(expected.content)), name
        assert (found.steps, found.loss, found.held_out_loss) == (expected.steps, expected.loss, expected.held_out_loss)


def test_a_video_with_loss_makes_nearly_the_same_policy(data, recorded_task):
    expected, found = cloned(recorded_task, data["npz"]), cloned(recorded_task, data["lerobot"])
    rows = np.flatnonzero(data["npz"].episode < 4)
    task = make(recorded_task, len(rows), flags=False)
    groups = {name: torch.from_numpy(group[rows]) for name, group in data["npz"].observations.items()}
    with torch.no_grad():
        actions = [network_policy(one.content, task)(groups) for one in (expected, found)]
    # Images differ by 1.6 levels of 255 in the mean, 0.6 %, and the other groups not at all: so may what is learnt from
    # them, with a factor for weights that are not small. Measured: 1.1 % of the mean action, 0.02 % of the loss.
    difference = float((actions[0] - actions[1]).abs().mean() / actions[0].abs().mean())
    assert found.steps == expected.steps
    assert 0.0 < difference < 0.05
    assert found.loss == pytest.approx(expected.loss, rel=0.01)
