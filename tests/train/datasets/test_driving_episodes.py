"""A thousand episodes of a driving task by camera, under the policy that is shipped for it, in all formats."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simwarp.tasks import config_from_plain, make, task_class
from simwarp.train import Trajectories
from simwarp.train.datasets.dataset_formats import record_dataset
from simwarp.train.datasets.dataset_kinds import DatasetFormat
from simwarp.train.datasets.episodes import record
from simwarp.train.networks.policies import find_policy
from tests.train.datasets.test_lerobot_reads import VARIABLE, read

minari = pytest.importorskip("minari", reason="needs the extra minari")
TASK, EPISODES, WORLDS, SEED = "obstacle-avoidance", 1000, 50, 11
EVERY = 37
pytestmark = pytest.mark.slow


def driving() -> tuple[Any, Any]:
    """Worlds whose episodes are short, and the policy."""
    source = find_policy(TASK, Path("shipped"), obs="camera")
    config = config_from_plain(task_class(TASK).config_type, source.content["task_config"], "config")
    task = make(TASK, WORLDS, device="cpu", seed=SEED, config=config, max_episode_steps=12)
    return task, source.policy(task)


@pytest.fixture(scope="module")
def in_memory() -> Trajectories:
    return record(*driving(), EPISODES, SEED, {})


def rows_of(data: Trajectories, places: list[tuple[int, int]]) -> Iterator[slice]:
    """Rows of the episodes that are the given ones of the given worlds: trajectories go world by world."""
    first = np.searchsorted(data.episode, np.arange(data.episodes + 1))
    each = EPISODES // WORLDS
    for world, number in places:
        yield slice(first[world * each + number], first[world * each + number + 1])


def test_minari_holds_them_to_the_last_bit(in_memory: Trajectories, tmp_path: Path) -> None:
    task, policy = driving()
    told = record_dataset(task, policy, EPISODES, SEED, tmp_path / "d-v0", DatasetFormat.MINARI)
    dataset = minari.MinariDataset(tmp_path / "d-v0" / "data")
    assert (told.episodes, told.steps) == (EPISODES, in_memory.steps)
    assert (dataset.total_episodes, dataset.total_steps) == (EPISODES, in_memory.steps)
    options = [one["options"] for one in dataset.storage.get_episode_metadata(range(EPISODES))]
    places = [(one["world"], one["episode"]) for one in options]
    assert len(set(places)) == EPISODES
    for found, rows in zip(dataset.iterate_episodes(), rows_of(in_memory, places), strict=True):
        for name, group in in_memory.observations.items():
            assert np.array_equal(found.observations[name][:-1], group[rows]), name
        assert np.array_equal(found.actions, in_memory.actions[rows])
        assert np.array_equal(found.rewards, in_memory.rewards[rows])
        assert np.array_equal(found.terminations, in_memory.terminated[rows])
        assert np.array_equal(found.truncations, in_memory.truncated[rows])


@pytest.mark.skipif(
    VARIABLE not in os.environ, reason=f"{VARIABLE} names no Python that has lerobot: see lerobot_requirements.txt"
)
def test_lerobot_holds_all_but_images_to_the_last_bit(in_memory: Trajectories, tmp_path: Path) -> None:
    task, policy = driving()
    told = record_dataset(task, policy, EPISODES, SEED, tmp_path / "d", DatasetFormat.LEROBOT)
    about, found = read(tmp_path / "d", tmp_path, EVERY)
    assert (about["episodes"], about["rows"]) == (told.episodes, told.steps) == (EPISODES, in_memory.steps)
    places = [(world, number) for world, number, _ in about["worlds"]]
    spans = list(rows_of(in_memory, places))
    assert about["lengths"] == [rows.stop - rows.start for rows in spans]
    order = np.concatenate([np.arange(rows.start, rows.stop) for rows in spans])
    assert sorted(order.tolist()) == list(range(in_memory.steps))
    rows = order[::EVERY]
    for key, group in {
        "observation.state": in_memory.observations["policy"], "action": in_memory.actions,
        "next.reward": in_memory.rewards, "next.done": in_memory.terminated | in_memory.truncated,
        "next.truncated": in_memory.truncated,
    }.items():  # fmt: skip
        assert np.array_equal(found[key], group[rows]), key
    levels = 255.0 * np.moveaxis(found["observation.images.camera"], 1, -1)
    # Colours at half the resolution change single pixels at edges by tens of levels; measured in the mean: 1.2
    assert np.abs(levels - in_memory.observations["camera"][rows]).mean() < 2.5
