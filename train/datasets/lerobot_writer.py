"""Datasets of LeRobot, written episode by episode without its library.

Episodes go into files of a hidden folder first. A set of files, rows and images of the same episodes, is moved to its
place when it is complete, and ``info.json`` counts its episodes last: whoever opens the folder, also after a crash,
finds whole episodes.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import time
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from simwarp.core.files import DRAFT_PREFIX, write_file
from simwarp.tasks import Task

from ..evaluation.mp4 import Encoder
from . import lerobot_layout as layout
from .disk_errors import writing
from .episode_statistics import Statistics, merged, of_images, of_rows
from .episodes import Episode, about_of
from .lerobot_layout import Feature

LONGEST_VIDEO: Final = 1000.0
"""Of a file [s]: LeRobot compares times in float32 to 1e-4 s, whose steps are 6.1e-5 s up to 1024 s."""
LONGEST_WAIT: Final = 30.0
"""Time after which a set of files is closed when its next episode has ended [s]: what a crash can cost."""
SMALL: Final = 320 * 240
"""Pixels of images up to which threads of an encoder cost more than they save: a fourth of its processor time."""
LOSSLESS: Final = 0
"""Quality of videos that keep every bit."""


class LeRobotWriter:
    """A dataset that grows.

    Args:
        folder: to be made.
        task: whose episodes come.
        instruction: what the policy was to do, in words.
        seed: of the worlds.
        about: metadata to keep.
        quality: of H.264, from 0, without loss, to 51.

    Raises:
        InputError: an observation group has no place in such a dataset.
        OutputError: the disk did not take it.
    """

    def __init__(
        self, folder: Path, task: Task[Any], instruction: str, seed: int, about: dict[str, Any], quality: int
    ) -> None:
        self._features = layout.features_of(task)
        self._folder, self._seed, self._quality, self._rate = folder, seed, quality, layout.rate_of(task)
        self._instruction, self._films = instruction, any(feature.video for feature in self._features)
        pixels = {feature.key: _pixel_format(feature, quality) for feature in self._features if feature.video}
        self._info = layout.described(self._features, task, self._rate, pixels)
        self._statistics: dict[str, Statistics] = {}
        self.episodes = self.rows = self._files = 0
        self._open: _Files | None = None
        groups = {
            feature.group: {"feature": feature.key, "shape": list(feature.shape), "dtype": feature.dtype}
            for feature in self._features
        }
        content = {"groups": groups, "about": about_of(task, about | {"instruction": instruction, "seed": seed})}
        with writing(folder):
            folder.mkdir()
            (folder / "meta").mkdir()
            write_file(folder / layout.OURS, json.dumps(content, indent=2, default=str) + "\n")
            _write_table(_tasks(instruction), folder / layout.TASKS)

    def add(self, episode: Episode) -> None:
        """Add an episode.

        Raises:
            OutputError: the disk did not take it.
        """
        longest = LONGEST_VIDEO * self._rate
        if self._films and self._open is not None and self._open.rows + episode.steps > longest:
            self.commit()
        if self._open is None:
            draft = self._folder / f"{DRAFT_PREFIX}{self._files}"
            self._open = _Files(draft, self._features, self._rate, self._quality, self._files, self.rows, self.episodes)
        with writing(self._folder):
            self._open.add(episode, self._instruction, self._seed)
        if self._open.full():
            self.commit()

    def commit(self) -> None:
        """Close the files that are open, and count their episodes.

        Raises:
            OutputError: the disk did not take them.
        """
        files, self._open = self._open, None
        if files is None:
            return
        try:
            with writing(self._folder):
                files.finish(self._folder)
        finally:
            files.end()
        statistics = self._statistics
        for own in files.statistics:
            statistics = {key: merged(statistics[key], found) if statistics else found for key, found in own.items()}
        rows, episodes = self.rows + files.rows, self.episodes + len(files.episodes)
        lists = {key: {name: value.tolist() for name, value in found.items()} for key, found in statistics.items()}
        write_file(self._folder / layout.STATISTICS, json.dumps(lists, indent=4))
        info = json.dumps(self._totals(rows, episodes), indent=4, ensure_ascii=False)
        write_file(self._folder / layout.INFO, info)
        self._statistics, self.rows, self.episodes = statistics, rows, episodes
        self._files += 1

    def _totals(self, rows: int, episodes: int) -> dict[str, Any]:
        return {
            "codebase_version": layout.VERSION, "robot_type": None, "total_episodes": episodes,
            "total_frames": rows, "total_tasks": 1, "chunks_size": layout.FILES_PER_CHUNK,
            "data_files_size_in_mb": layout.DATA_MEGABYTES, "video_files_size_in_mb": layout.VIDEO_MEGABYTES,
            "fps": layout.plain_rate(self._rate), "splits": {"train": f"0:{episodes}"},
            "data_path": layout.DATA_PATH, "video_path": layout.VIDEO_PATH if self._films else None,
            "features": self._info,
        }  # fmt: skip

    def end(self) -> None:
        """Drop the files that are open; without a complete episode, the folder too."""
        if self._open is not None:
            self._open.end()
            self._open = None
        if not self.episodes:
            shutil.rmtree(self._folder, ignore_errors=True)


class _Files:
    """A set of files that is written: rows, images and where each episode is in them.

    Args:
        draft: folder to write them in.
        features: of the observations.
        rate: control steps per second.
        quality: of the videos.
        number: of the set.
        first_row: number of its first row in the dataset.
        first_episode: number of its first episode.
    """

    def __init__(
        self, draft: Path, features: Sequence[Feature], rate: Fraction, quality: int, number: int,
        first_row: int, first_episode: int,
    ) -> None:  # fmt: skip
        self._draft, self._features, self._rate = draft, features, rate
        self._place, self._first_row, self._first_episode = layout.place_of(number), first_row, first_episode
        self._quality, self._begun = quality, time.monotonic()
        self._table: pq.ParquetWriter | None = None
        self._sink: pa.OSFile | None = None
        self._encoders: dict[str, Encoder] = {}
        self.rows = 0
        self.episodes: list[dict[str, Any]] = []
        self.statistics: list[dict[str, Statistics]] = []

    def add(self, episode: Episode, instruction: str, seed: int) -> None:
        """Write an episode."""
        columns = self._columns(episode)
        table = pa.table({key: _array(values) for key, values in columns.items()})
        if self._table is None:
            self._draft.mkdir(exist_ok=True)
            self._sink = pa.OSFile(str(self._draft / "rows.parquet"), "wb")
            self._table = pq.ParquetWriter(self._sink, table.schema)
        self._table.write_table(table)
        statistics = {key: of_rows(values) for key, values in columns.items()}
        for feature in self._features:
            if feature.video:
                images = _three_channels(episode.observations[feature.group])
                statistics[feature.key] = of_images(images)
                self._encode(feature, images)
        self.statistics.append(statistics)
        self.episodes.append(self._row(episode, instruction, seed, statistics))
        self.rows += episode.steps

    def _columns(self, episode: Episode) -> dict[str, npt.NDArray[Any]]:
        """Return all but the videos, by their names in the dataset: (N,), or (N, ...) of several numbers."""
        count = episode.steps
        frames = np.arange(count)
        columns: dict[str, npt.NDArray[Any]] = {
            feature.key: episode.observations[feature.group] for feature in self._features if not feature.video
        }
        columns[layout.ACTION] = episode.actions
        columns |= {
            layout.REWARD: episode.rewards, layout.DONE: episode.terminated | episode.truncated,
            layout.TRUNCATED: episode.truncated, "timestamp": (frames / float(self._rate)).astype(np.float32),
            "frame_index": frames, "episode_index": np.full(count, self._first_episode + len(self.episodes)),
            "index": self._first_row + self.rows + frames, "task_index": np.zeros(count, np.int64),
        }  # fmt: skip
        return columns

    def _encode(self, feature: Feature, images: npt.NDArray[np.uint8]) -> None:
        if feature.key not in self._encoders:
            path = self._video(feature)
            options = _options(feature, self._quality)
            self._encoders[feature.key] = Encoder(path, feature.size, str(self._rate), options)
        encoder = self._encoders[feature.key]
        if not encoder.add(images):
            raise encoder.finish() or OSError(f"ffmpeg has ended before '{feature.key}' was complete")

    def _row(self, episode: Episode, instruction: str, seed: int, statistics: dict[str, Statistics]) -> dict[str, Any]:
        """Return the row of an episode in the table of episodes."""
        chunk, file = self._place["chunk_index"], self._place["file_index"]
        first = self._first_row + self.rows
        row: dict[str, Any] = {
            "episode_index": self._first_episode + len(self.episodes), "tasks": [instruction],
            "length": episode.steps, "dataset_from_index": first, "dataset_to_index": first + episode.steps,
            "data/chunk_index": chunk, "data/file_index": file, "meta/episodes/chunk_index": chunk,
            "meta/episodes/file_index": file, layout.WORLD: episode.world, layout.NUMBER: episode.number,
            layout.SEED: seed,
        }  # fmt: skip
        for feature in self._features:
            if feature.video:
                where = f"videos/{feature.key}"
                row |= {f"{where}/chunk_index": chunk, f"{where}/file_index": file}
                row[f"{where}/from_timestamp"] = float(self.rows / self._rate)
                row[f"{where}/to_timestamp"] = float((self.rows + episode.steps) / self._rate)
        for key, found in statistics.items():
            row |= {f"stats/{key}/{name}": value.tolist() for name, value in found.items()}
        return row

    def full(self) -> bool:
        """Return True if another set should begin."""
        limits = {"rows.parquet": layout.DATA_MEGABYTES} | {
            self._video(feature).name: layout.VIDEO_MEGABYTES for feature in self._features if feature.video
        }
        sizes = {path.name: path.stat().st_size / 2**20 for path in self._draft.iterdir()}
        if any(sizes.get(name, 0.0) >= limit for name, limit in limits.items()):
            return True
        return time.monotonic() - self._begun >= LONGEST_WAIT

    def finish(self, folder: Path) -> None:
        """Complete the files, and move them to their places in the dataset."""
        for encoder in self._encoders.values():
            error = encoder.finish()
            if error is not None:
                raise error
        assert self._table is not None
        assert self._sink is not None
        self._table.close()
        self._sink.close()
        _write_table(pa.Table.from_pylist(self.episodes), self._draft / "episodes.parquet")
        places = {
            self._draft / "rows.parquet": layout.DATA_PATH.format(**self._place),
            self._draft / "episodes.parquet": layout.EPISODES_PATH.format(**self._place),
        }
        videos = {
            self._video(feature): layout.VIDEO_PATH.format(video_key=feature.key, **self._place)
            for feature in self._features
            if feature.video
        }
        for draft, place in (videos | places).items():
            with draft.open("rb") as file:
                os.fsync(file.fileno())
            target = folder / place
            target.parent.mkdir(parents=True, exist_ok=True)
            draft.replace(target)

    def end(self) -> None:
        """Drop what was not moved."""
        for encoder in self._encoders.values():
            encoder.end()
        for part in (self._table, self._sink):
            with contextlib.suppress(OSError, pa.ArrowException):
                if part is not None:
                    part.close()
        shutil.rmtree(self._draft, ignore_errors=True)

    def _video(self, feature: Feature) -> Path:
        return self._draft / f"{feature.key}.mp4"


def _write_table(table: pa.Table, path: Path) -> None:
    """Write a table; a file that pyarrow opens stays open where the disk is full."""
    with pa.OSFile(str(path), "wb") as sink:
        pq.write_table(table, sink)


def _tasks(instruction: str) -> pa.Table:
    """Return the table of instructions, whose index pandas, and LeRobot by it, finds in the metadata."""
    index = "__index_level_0__"
    columns = [
        {"name": name, "field_name": field, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
        for name, field, kind, numpy in (
            ("task_index", "task_index", "int64", "int64"), (None, index, "unicode", "object")
        )
    ]  # fmt: skip
    about = {"index_columns": [index], "column_indexes": [], "columns": columns, "pandas_version": "2.2.0"}
    table = pa.table({"task_index": pa.array([0], pa.int64()), index: pa.array([instruction], pa.string())})
    return table.replace_schema_metadata({b"pandas": json.dumps(about).encode()})


def _array(values: npt.NDArray[Any]) -> pa.Array:
    """Return a column of numbers (N,), or of lists of them; a list of one number is a number in such datasets."""
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    shape = values.shape[1:]
    if shape in ((), (1,)):
        return flat
    if len(shape) == 1:
        return pa.FixedSizeListArray.from_arrays(flat, shape[0])
    for length in reversed(shape):
        offsets = pa.array(np.arange(0, len(flat) + 1, length), pa.int32())
        flat = pa.ListArray.from_arrays(offsets, flat)
    return flat


def _three_channels(images: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    return np.repeat(images, 3, axis=-1) if images.shape[-1] == 1 else images


def _pixel_format(feature: Feature, quality: int) -> str:
    """Return the format of the pixels of a video: colours at half the resolution where its sides are even."""
    even = all(side % 2 == 0 for side in feature.size)
    return "gbrp" if quality == LOSSLESS else "yuv420p" if even else "yuv444p"


def _options(feature: Feature, quality: int) -> list[str]:
    """Return the options of ffmpeg: every second image stands by itself, as LeRobot jumps to any of them."""
    width, height = feature.size
    threads = ["-threads", "1"] if width * height <= SMALL else []
    jumps = ["-g", "2", "-bf", "0", *threads, "-movflags", "+faststart"]
    if quality == LOSSLESS:
        return ["-vcodec", "libx264rgb", "-preset", "veryfast", "-qp", "0", *jumps]
    form = _pixel_format(feature, quality)
    return ["-vcodec", "libx264", "-preset", "veryfast", "-crf", str(quality), "-pix_fmt", form, *jumps]
