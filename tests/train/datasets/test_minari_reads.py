"""Minari opens what is written: by name, as its library looks for datasets, and by folder."""

import numpy as np
import pytest

from simwarp.tasks import make
from simwarp.train.datasets.dataset_formats import DatasetFormat, record_dataset
from simwarp.train.datasets.episodes import episodes_of
from tests.train.datasets.recorded_task import by_noise, recorded_task

minari = pytest.importorskip("minari", reason="needs the extra minari")
__all__ = ["recorded_task"]


@pytest.fixture
def dataset(recorded_task, tmp_path, monkeypatch):
    """Eleven episodes, as Minari loads them."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    about = {"policy": "by hand"}
    record_dataset(make(recorded_task, 4), by_noise, 11, 3, tmp_path / "counts-v2", DatasetFormat.MINARI, about=about)
    return minari.load_dataset("counts-v2")


def test_episodes_are_those_of_the_task(dataset, recorded_task):
    episodes = list(episodes_of(make(recorded_task, 4), by_noise, 11, 3, last=True))
    assert (dataset.total_episodes, dataset.total_steps) == (11, sum(one.steps for one in episodes))
    for found, one in zip(dataset.iterate_episodes(), episodes, strict=True):
        for name, group in one.observations.items():
            read = found.observations[name]
            assert np.array_equal(read[:-1], group), name
            assert np.array_equal(read[-1], one.last[name]), name  # what came of the last action
            assert read.dtype == group.dtype, name
        assert np.array_equal(found.actions, one.actions)
        assert np.array_equal(found.rewards, one.rewards)
        assert np.array_equal(found.terminations, one.terminated)
        assert np.array_equal(found.truncations, one.truncated)


def test_seeds_and_places_are_kept_and_repeat_an_episode(dataset, recorded_task):
    told = list(dataset.storage.get_episode_metadata(range(11)))
    assert {one["seed"] for one in told} == {3}
    assert sorted((one["options"]["world"], one["options"]["episode"]) for one in told)[:2] == [(0, 0), (0, 1)]
    # World 2 of the same seed, alone: its first episode is that of the dataset
    index = next(place for place, one in enumerate(told) if one["options"] == {"world": 2, "episode": 0})
    alone = make(recorded_task, 1, first_world=2)
    again = next(episodes_of(alone, by_noise, 1, 3))
    assert np.array_equal(again.actions, dataset[index].actions)


def test_spaces_and_words_are_there(dataset, tmp_path):
    metadata = dataset.storage.metadata
    assert metadata["instruction"] == metadata["description"] == "Count to the end."
    assert metadata["algorithm_name"] == "by hand"
    assert metadata["simwarp"]["task_config"]["height"] == 36
    assert set(dataset.observation_space) == {"policy", "one", "flags", "camera", "grey", "depth", "beams"}
    assert dataset.observation_space["camera"].dtype == np.uint8
    assert dataset.action_space.shape == (2,)
    episode = dataset[0]
    assert dataset.action_space.contains(episode.actions[0])
    assert dataset.observation_space.contains({name: group[0] for name, group in episode.observations.items()})
    assert "counts-v2" in minari.list_local_datasets()
    assert minari.MinariDataset(tmp_path / "counts-v2" / "data").total_episodes == 11
    failed = dataset.filter_episodes(lambda one: bool(one.terminations[-1]))
    assert 0 < failed.total_episodes < 11
    size = sum(path.stat().st_size for path in (tmp_path / "counts-v2").rglob("*.arrow")) / 1e6
    assert metadata["dataset_size"] == pytest.approx(size, rel=0.3)  # without what Arrow writes beside the numbers


@pytest.mark.slow
def test_a_thousand_episodes_load(recorded_task, tmp_path):
    told = record_dataset(make(recorded_task, 64), by_noise, 1000, 3, tmp_path / "d-v0", DatasetFormat.MINARI)
    dataset = minari.MinariDataset(tmp_path / "d-v0" / "data")
    assert (dataset.total_episodes, dataset.total_steps) == (1000, told.steps)
    episodes = episodes_of(make(recorded_task, 64), by_noise, 1000, 3)
    for found, one in zip(dataset.iterate_episodes(), episodes, strict=True):
        assert np.array_equal(found.observations["camera"][:-1], one.observations["camera"])
        assert np.array_equal(found.actions, one.actions)
