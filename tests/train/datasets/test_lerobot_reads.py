"""lerobot itself opens what is written, without its hub: in an environment that has it (lerobot_requirements.txt)."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from simwarp.tasks import make
from simwarp.train.datasets import lerobot_writer
from simwarp.train.datasets.dataset_formats import DatasetFormat, record_dataset
from simwarp.train.datasets.episodes import episodes_of
from tests.train.datasets.recorded_task import by_noise, recorded_task

__all__ = ["recorded_task"]
VARIABLE = "SIMWARP_LEROBOT"
SCRIPT = Path(__file__).with_name("read_by_lerobot.py")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        VARIABLE not in os.environ, reason=f"{VARIABLE} names no Python that has lerobot: see lerobot_requirements.txt"
    ),
]


def read(folder, tmp_path, every=1):
    """What lerobot finds: arrays, and what is known about them."""
    environment = os.environ | {"HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "hub")}
    environment.pop("PYTHONPATH", None)
    words = [os.environ[VARIABLE], str(SCRIPT), str(folder), str(tmp_path / "read.npz"), str(every)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr[-3000:]
    with np.load(tmp_path / "read.npz") as arrays:
        return json.loads(str(arrays["about"])), {name: arrays[name] for name in arrays.files}


@pytest.mark.parametrize("wait", [30.0, 0.0], ids=["one set of files", "a set per episode"])
@pytest.mark.parametrize("quality", [0, 18])
def test_all_of_it_is_read(recorded_task, tmp_path, monkeypatch, quality, wait):
    monkeypatch.setattr(lerobot_writer, "LONGEST_WAIT", wait)
    told = record_dataset(
        make(recorded_task, 4), by_noise, 11, 3, tmp_path / "d", DatasetFormat.LEROBOT, quality=quality
    )
    about, found = read(tmp_path / "d", tmp_path)
    episodes = list(episodes_of(make(recorded_task, 4), by_noise, 11, 3))  # in the same order: as they ended
    assert (about["episodes"], about["rows"]) == (told.episodes, told.steps) == (11, sum(one.steps for one in episodes))
    assert about["lengths"] == [one.steps for one in episodes]
    assert about["worlds"] == [[one.world, one.number, 3] for one in episodes]
    assert about["tasks"] == ["Count to the end."]
    assert about["fps"] == pytest.approx(1.0 / 0.03, rel=1e-12)
    assert about["names"]["action"] == ["left", "right"]
    assert about["names"]["observation.state"] == ["step", "noise"]

    names = episodes[0].observations
    groups = {name: np.concatenate([one.observations[name] for one in episodes]) for name in names}
    for key, group in {
        "observation.state": groups["policy"], "observation.one": groups["one"][:, 0],
        "observation.flags": groups["flags"], "observation.depth": groups["depth"],
        "observation.beams": groups["beams"],
        "action": np.concatenate([one.actions for one in episodes]),
        "next.reward": np.concatenate([one.rewards for one in episodes]),
        "next.done": np.concatenate([one.terminated | one.truncated for one in episodes]),
        "next.truncated": np.concatenate([one.truncated for one in episodes]),
        "frame_index": np.concatenate([np.arange(one.steps) for one in episodes]),
        "episode_index": np.repeat(np.arange(11), about["lengths"]),
    }.items():  # fmt: skip
        assert np.array_equal(found[key], group), key
        assert found[key].dtype == group.dtype, key
    assert np.allclose(found["timestamp"], 0.03 * found["frame_index"], rtol=1e-6, atol=0.0)

    for name in ("camera", "grey"):
        images = found[f"observation.images.{name}"]
        assert images.shape[1] == 3  # channels first, in [0, 1]
        levels = 255.0 * np.moveaxis(images, 1, -1)
        error = np.abs(levels - groups[name])
        # Its decoder rounds by itself: without loss a level is right to rounding in float32, with loss as in our own
        assert error.max() < (1e-3 if quality == 0 else 12.0)
        assert error.mean() < (1e-4 if quality == 0 else 2.5)
        statistics = about["statistics"][f"observation.images.{name}"]
        exact = groups[name].astype(float).mean(axis=(0, 1, 2)) / 255.0
        assert np.allclose(np.ravel(statistics["mean"]), exact, rtol=1e-12)
    state = about["statistics"]["observation.state"]
    assert np.allclose(state["mean"], groups["policy"].astype(float).mean(axis=0), rtol=1e-12)
    assert np.allclose(state["std"], groups["policy"].astype(float).std(axis=0), rtol=1e-9)
    assert state["count"] == [told.steps]


def test_a_thousand_episodes_load(recorded_task, tmp_path):
    path, kind = tmp_path / "d", DatasetFormat.LEROBOT
    told = record_dataset(make(recorded_task, 64), by_noise, 1000, 3, path, kind)
    about, found = read(path, tmp_path, 37)
    assert (about["episodes"], about["rows"]) == (1000, told.steps)
    episodes = list(episodes_of(make(recorded_task, 64), by_noise, 1000, 3))
    assert about["lengths"] == [one.steps for one in episodes]
    images = np.concatenate([one.observations["camera"] for one in episodes])[::37]
    states = np.concatenate([one.observations["policy"] for one in episodes])[::37]
    assert np.array_equal(found["observation.state"], states)
    assert np.abs(255.0 * np.moveaxis(found["observation.images.camera"], 1, -1) - images).mean() < 2.5
