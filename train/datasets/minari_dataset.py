"""Datasets of Minari, written and read by its library: one folder per episode, images as they are."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import minari
import numpy as np
import pyarrow as pa
import warp as wp
from minari.data_collector.episode_buffer import EpisodeBuffer
from minari.dataset._storages.arrow_storage import ArrowStorage
from minari.dataset.minari_storage import MinariStorage

from simwarp.core.files import FileError, read_json, write_file
from simwarp.core.memory import check_fits
from simwarp.tasks import Task
from simwarp.tasks.adapters.gym_env import action_space, observation_boxes

from .disk_errors import writing
from .episodes import Episode, about_of
from .trajectories import Trajectories, checked, checked_about

DATA: Final = "data"
"""Folder within that of a dataset in which Minari looks for it."""
METADATA: Final = "metadata.json"
OURS: Final = "simwarp"
"""Key of the metadata that Minari has no place for."""


class _Storage(ArrowStorage):
    """Minari's storage of one folder per episode, whose metadata are replaced as a whole.

    Minari writes them in place, several times per episode: killed meanwhile, none of the episodes could be opened.
    """

    bytes_written = 0

    def update_metadata(self, metadata: dict[str, Any]) -> None:
        """Add to the metadata."""
        content = MinariStorage.read_raw_metadata(self.data_path) | metadata
        write_file(Path(self.data_path) / METADATA, json.dumps(content, default=sorted))

    def get_size(self) -> float:
        """Return the size of the dataset [MB]: counted along, since Minari asks for it with each episode."""
        return round(self.bytes_written / 1e6, 1)


class MinariWriter:
    """A dataset that grows; what it counts is complete after every episode.

    Args:
        folder: to be made; its name is that of the dataset.
        task: whose episodes come.
        instruction: what the policy was to do, in words.
        seed: of the worlds.
        about: metadata to keep.

    Raises:
        OutputError: the disk did not take it.
    """

    def __init__(self, folder: Path, task: Task[Any], instruction: str, seed: int, about: dict[str, Any]) -> None:
        self._folder, self._seed = folder, seed
        self.episodes = self.rows = 0
        space, actions = gym.spaces.Dict(observation_boxes(task)), action_space(task)
        metadata = {
            "dataset_id": folder.name, "minari_version": minari.__version__, "algorithm_name": str(about["policy"]),
            "description": instruction, "instruction": instruction,
            OURS: about_of(task, about | {"instruction": instruction, "seed": seed}),
        }  # fmt: skip
        with writing(folder):
            folder.mkdir()
            MinariStorage.new(folder / DATA, space, actions, data_format=ArrowStorage.FORMAT, jpeg_encoding=False)
            self._storage = _Storage(folder / DATA, space, actions, jpeg_encoding=False)
            self._storage.update_metadata(json.loads(json.dumps(metadata, default=str)))

    def add(self, episode: Episode) -> None:
        """Add an episode.

        Raises:
            OutputError: the disk did not take it.
        """
        # Minari has one observation more than actions
        seen = {name: np.concatenate([group, episode.last[name][None]]) for name, group in episode.observations.items()}
        buffer = EpisodeBuffer(
            seed=self._seed, options={"world": episode.world, "episode": episode.number}, observations=seen,
            actions=episode.actions, rewards=episode.rewards, terminations=episode.terminated,
            truncations=episode.truncated,
        )  # fmt: skip
        self._storage.bytes_written += sum(group.nbytes for group in seen.values()) + episode.actions.nbytes
        with writing(self._folder):
            self._storage.update_episodes([buffer])
        self.episodes, self.rows = self.episodes + 1, self.rows + episode.steps

    def commit(self) -> None:
        """Nothing is left to do: each episode is complete when it is added."""

    def end(self) -> None:
        """Drop an episode that is not complete; without a complete one, the folder too."""
        shutil.rmtree(self._folder / DATA / str(self.episodes), ignore_errors=True)
        if not self.episodes:
            shutil.rmtree(self._folder, ignore_errors=True)


def read_minari(folder: Path, task_name: str) -> Trajectories:
    """Read a dataset that `simwarp record` wrote, world by world; runs no code from it.

    Raises:
        FileError: it is damaged, or something else wrote it.
        InputError: it is of another task, or its columns are not what they should be.
    """
    where = f"trajectories '{folder}'"
    metadata = read_json(folder / DATA / METADATA, "file of a dataset")
    ours = metadata.get(OURS) if isinstance(metadata, dict) else None
    if not isinstance(ours, dict):
        raise FileError(f"{where}: '{OURS}' is missing in its metadata, which `simwarp record --format minari` writes")
    about = checked_about(ours, task_name, where)
    # Without spaces Minari would make the environment that the file names
    if not {"observation_space", "action_space"} <= metadata.keys() or metadata.get("data_format") != "arrow":
        raise FileError(f"{where}: the dataset is damaged: its metadata name no spaces, or another format than arrow")
    try:
        return _read(folder, metadata, about, where)
    except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, pa.ArrowException) as error:
        if type(error).__module__.startswith("simwarp"):
            raise
        reason = f"{type(error).__name__}: {''.join(str(error).splitlines()[:1])[:200]}"
        raise FileError(f"{where}: the dataset is damaged: {reason}; record it again") from error


def _read(folder: Path, metadata: dict[str, Any], about: dict[str, Any], where: str) -> Trajectories:
    total, parts = metadata["total_episodes"], list((folder / DATA).glob("*/*.arrow"))
    if not isinstance(total, int) or not 0 < total <= len(parts):
        raise ValueError(f"it counts {total} episodes, and {len(parts)} are there")
    room = 2 * sum(part.stat().st_size for part in parts)
    check_fits(f"{where}: {total} episodes", room, wp.get_device("cpu"), "take fewer episodes")
    dataset = minari.MinariDataset(folder / DATA)
    options = [one["options"] for one in dataset.storage.get_episode_metadata(range(dataset.total_episodes))]
    places = [(int(one["world"]), int(one["episode"])) for one in options]
    found = [next(dataset.iterate_episodes([place])) for place in sorted(range(len(places)), key=places.__getitem__)]
    groups = {name: np.concatenate([one.observations[name][:-1] for one in found]) for name in found[0].observations}
    arrays = {
        "actions": np.concatenate([one.actions for one in found]),
        "rewards": np.concatenate([one.rewards for one in found]),
        "episode": np.repeat(np.arange(len(found)), [len(one) for one in found]),
        "terminated": np.concatenate([one.terminations for one in found]),
        "truncated": np.concatenate([one.truncations for one in found]),
    }
    read = checked(groups, arrays, about, where)
    read.add_totals()
    return read
