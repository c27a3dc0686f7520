"""What a dataset of LeRobot is made of: its files, its features, and where observation groups go.

Format v3.0 of https://github.com/huggingface/lerobot, as of lerobot 0.4.4 and 0.6.1: episodes lie one after the other
in numbered files of rows (Parquet) and of images (MP4); tables under ``meta`` say where each begins.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

from simwarp.tasks import InputError, Task

VERSION: Final = "v3.0"
FILES_PER_CHUNK: Final = 1000
DATA_MEGABYTES: Final = 100
VIDEO_MEGABYTES: Final = 200
"""Sizes after which LeRobot begins a new file."""

INFO: Final = Path("meta/info.json")
STATISTICS: Final = Path("meta/stats.json")
TASKS: Final = Path("meta/tasks.parquet")
OURS: Final = Path("meta/simwarp.json")
"""What LeRobot has no place for: the task's configuration, and which feature is which observation group."""
DATA_PATH: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES_PATH: Final = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH: Final = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"

ACTION: Final = "action"
STATE: Final = "observation.state"
REWARD: Final = "next.reward"
DONE: Final = "next.done"
TRUNCATED: Final = "next.truncated"
COUNTED: Final[Mapping[str, str]] = {
    "timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64", "task_index": "int64",
}  # fmt: skip
"""Columns that every dataset has: of each row the time in its episode [s], its number in the episode, that of the
episode, its number in the dataset, and that of its instruction."""
WORLD: Final = "simwarp/world"
NUMBER: Final = "simwarp/episode"
SEED: Final = "simwarp/seed"
"""Further columns of episodes: with the same seed, this episode of this world begins in the same way."""

_FRACTION: Final = 10_000
"""Largest denominator of a rate [images/s]."""


@dataclasses.dataclass(frozen=True)
class Feature:
    """An observation group in a dataset.

    Attributes:
        group: its name in the task.
        key: its name in the dataset.
        shape: of one world's observation.
        dtype: of its numbers.
        video: whether it is a video.
    """

    group: str
    key: str
    shape: tuple[int, ...]
    dtype: str
    video: bool

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a video [pixels]."""
        return self.shape[1], self.shape[0]

    @property
    def count(self) -> int:
        """Numbers of one observation."""
        return math.prod(self.shape)


def features_of(task: Task[Any]) -> list[Feature]:
    """Return where the observation groups of a task go.

    Images (height, width, 1 or 3) of whole bytes become videos. ``policy``, or the only row of numbers, becomes the
    robot's state.

    Raises:
        InputError: two groups would have the same name, or one has a name or a type that datasets do not know.
    """
    shapes = task.observation_shapes
    rows = [name for name, shape in shapes.items() if len(shape) == 1]
    state = "policy" if "policy" in rows else rows[0] if len(rows) == 1 else None
    found = [_feature(task, name, name == state) for name in shapes]
    keys = [feature.key for feature in found]
    for feature in found:
        if keys.count(feature.key) > 1 or "/" in feature.group or feature.dtype in ("bfloat16", "float16"):
            raise InputError(
                f"format lerobot: group '{feature.group}' of task '{task.name}' cannot be feature '{feature.key}' of "
                f"{feature.dtype}; rename it or change its type in the task, or record with --format npz"
            )
    return found


def _feature(task: Task[Any], name: str, state: bool) -> Feature:
    shape, dtype = task.observation_shapes[name], str(task.observation_dtypes[name]).removeprefix("torch.")
    video = len(shape) == 3 and shape[2] in (1, 3) and dtype == "uint8"
    key = STATE if state else f"observation.images.{name}" if video else f"observation.{name}"
    return Feature(name, key, tuple(shape), dtype, video)


def rate_of(task: Task[Any]) -> Fraction:
    """Return the control steps per second of simulated time."""
    return 1 / Fraction(task.config.control_dt).limit_denominator(_FRACTION)


def plain_rate(rate: Fraction) -> int | float:
    """Return a rate as datasets write it: whole where it is whole."""
    return rate.numerator if rate.denominator == 1 else float(rate)


def described(
    features: Sequence[Feature], task: Task[Any], rate: Fraction, pixels: Mapping[str, str]
) -> dict[str, dict[str, Any]]:
    """Return the features of a dataset as ``info.json`` has them.

    Args:
        features: of the observations.
        task: has the names of components.
        rate: control steps per second.
        pixels: key of a video -> format of its pixels.
    """
    found: dict[str, dict[str, Any]] = {}
    for feature in features:
        names = list(task.observation_names.get(feature.group, ())) or _numbered(feature.group, feature.shape)
        found[feature.key] = {"dtype": feature.dtype, "shape": list(feature.shape), "names": names}
        if feature.video:
            width, height = feature.size
            info = {
                "video.height": height, "video.width": width, "video.codec": "h264",
                "video.pix_fmt": pixels[feature.key], "video.is_depth_map": False,
                "video.fps": plain_rate(rate), "video.channels": 3, "has_audio": False,
            }  # fmt: skip
            names, shape = ["height", "width", "channels"], [height, width, 3]
            found[feature.key] = {"dtype": "video", "shape": shape, "names": names, "info": info}
    actions = list(task.action_names) or _numbered(ACTION, (task.action_size,))
    found[ACTION] = {"dtype": "float32", "shape": [task.action_size], "names": actions}
    for key, dtype in {REWARD: "float32", DONE: "bool", TRUNCATED: "bool", **COUNTED}.items():
        found[key] = {"dtype": dtype, "shape": [1], "names": None}
    return found


def _numbered(name: str, shape: tuple[int, ...]) -> list[str] | None:
    return [f"{name}_{index}" for index in range(shape[0])] if len(shape) == 1 else None


def place_of(number: int) -> dict[str, int]:
    """Return chunk and file of the file with a number, counted from 0."""
    return {"chunk_index": number // FILES_PER_CHUNK, "file_index": number % FILES_PER_CHUNK}
