"""Trajectories from datasets of LeRobot that `simwarp record` wrote."""

from __future__ import annotations

import importlib
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq
import warp as wp

from simwarp.core.files import FileError, check_input, read_json
from simwarp.core.memory import check_fits

from . import lerobot_layout as layout
from .lerobot_layout import Feature
from .trajectories import Trajectories, checked, checked_about

Column = npt.NDArray[Any]


def read_lerobot(folder: Path, task_name: str) -> Trajectories:
    """Read a dataset, world by world.

    Raises:
        FileError: it is damaged, or something else wrote it.
        InputError: it is of another task, or its columns are not what they should be.
    """
    where = f"trajectories '{folder}'"
    if not (folder / layout.OURS).exists():
        raise FileError(f"{where}: {layout.OURS} is missing, which `simwarp record --format lerobot` writes")
    ours = read_json(folder / layout.OURS, "file of a dataset")
    about = checked_about(ours.get("about") if isinstance(ours, dict) else None, task_name, where)
    try:
        return _read(folder, ours["groups"], about, where)
    except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, pa.ArrowException) as error:
        if isinstance(error, FileError) or type(error).__module__.startswith("simwarp"):
            raise
        reason = f"{type(error).__name__}: {''.join(str(error).splitlines()[:1])[:200]}"
        raise FileError(f"{where}: the dataset is damaged: {reason}; record it again") from error


def _read(folder: Path, groups: Any, about: dict[str, Any], where: str) -> Trajectories:
    features = [_feature(group, described) for group, described in groups.items()]
    info = read_json(folder / layout.INFO, "file of a dataset")
    episodes = _episodes(folder, int(info["total_episodes"]))
    total = sum(int(row["length"]) for row in episodes)
    room = sum(feature.count * np.dtype(feature.dtype).itemsize for feature in features)
    check_fits(f"{where}: {total} steps", 2 * total * room, wp.get_device("cpu"), "take fewer episodes")
    worlds = [(int(row[layout.WORLD]), int(row[layout.NUMBER])) for row in episodes]
    order = sorted(range(len(episodes)), key=worlds.__getitem__)
    first = [int(row["dataset_from_index"]) for row in episodes]
    if first != np.cumsum([0, *(int(row["length"]) for row in episodes[:-1])]).tolist():
        raise ValueError("episodes do not follow each other")
    rows = np.concatenate([np.arange(first[place], first[place] + int(episodes[place]["length"])) for place in order])
    columns = _columns(folder, episodes, features, total)
    images = {one.group: _images(folder, episodes, one, total)[rows] for one in features if one.video}
    read = {one.group: columns[one.key].reshape(total, *one.shape)[rows] for one in features if not one.video}
    done, truncated = columns[layout.DONE][rows], columns[layout.TRUNCATED][rows]
    arrays = {
        "actions": columns[layout.ACTION].reshape(total, -1)[rows], "rewards": columns[layout.REWARD][rows],
        "episode": np.repeat(np.arange(len(order)), [int(episodes[place]["length"]) for place in order]),
        "terminated": done & ~truncated, "truncated": truncated,
    }  # fmt: skip
    found = checked({one.group: (images | read)[one.group] for one in features}, arrays, about, where)
    found.add_totals()
    return found


def _feature(group: str, described: Any) -> Feature:
    shape = tuple(int(length) for length in described["shape"])
    key = str(described["feature"])
    return Feature(group, key, shape, str(np.dtype(described["dtype"])), key.startswith("observation.images."))


def _episodes(folder: Path, total: int) -> list[dict[str, Any]]:
    """Return the rows of the episodes that are counted, in the order of the dataset."""
    paths = sorted((folder / layout.EPISODES_PATH).parent.parent.glob("*/*.parquet"))
    found: list[dict[str, Any]] = []
    for path in paths:
        schema = pq.read_schema(path)
        found += pq.read_table(path, columns=[name for name in schema.names if "stats/" not in name]).to_pylist()
    found = sorted(found, key=lambda row: int(row["episode_index"]))[:total]
    if len(found) != total or [row["episode_index"] for row in found] != list(range(total)):
        raise ValueError(f"info.json counts {total} episodes, and {len(found)} are there")
    return found


def _columns(folder: Path, episodes: list[dict[str, Any]], features: list[Feature], total: int) -> dict[str, Column]:
    """Return the columns that are no videos: those of lists flat."""
    names = [feature.key for feature in features if not feature.video]
    names += [layout.ACTION, layout.REWARD, layout.DONE, layout.TRUNCATED, "index"]
    places = {(int(row["data/chunk_index"]), int(row["data/file_index"])) for row in episodes}
    paths = [layout.DATA_PATH.format(chunk_index=chunk, file_index=file) for chunk, file in sorted(places)]
    table = pa.concat_tables([pq.read_table(_present(folder, path), columns=names) for path in paths])
    columns = {name: _flat(table.column(name)) for name in names}
    if not np.array_equal(columns["index"], np.arange(total)):
        raise ValueError(f"{total} rows are counted, and other rows are there")
    return columns


def _present(folder: Path, name: str) -> Path:
    return check_input(folder / name, "file of a dataset")


def _flat(column: pa.ChunkedArray) -> Column:
    flat = column.combine_chunks()
    while pa.types.is_list(flat.type) or pa.types.is_fixed_size_list(flat.type):
        flat = flat.flatten()
    array: Column = flat.to_numpy(zero_copy_only=False)
    return array.copy() if not array.flags.writeable else array


def _images(folder: Path, episodes: list[dict[str, Any]], feature: Feature, total: int) -> npt.NDArray[np.uint8]:
    """Return the images (N, height, width, C) of a feature: the episodes of a file lie in it one after the other."""
    images = np.empty((total, *feature.shape), np.uint8)
    where = f"videos/{feature.key}"
    files: dict[tuple[int, int], list[dict[str, Any]]] = {}
    for row in episodes:
        files.setdefault((int(row[f"{where}/chunk_index"]), int(row[f"{where}/file_index"])), []).append(row)
    for (chunk, file), own in sorted(files.items()):
        name = layout.VIDEO_PATH.format(video_key=feature.key, chunk_index=chunk, file_index=file)
        first, count = int(own[0]["dataset_from_index"]), sum(int(row["length"]) for row in own)
        place = first
        for image in _frames(_present(folder, name), feature):
            if place < first + count:
                images[place] = image[..., : feature.shape[2]]
            place += 1
        if place != first + count:
            raise ValueError(f"{name} has {place - first} images, and {count} steps")
    return images


def _frames(path: Path, feature: Feature) -> Iterator[npt.NDArray[np.uint8]]:
    """Yield the images (height, width, 3) of a video."""
    program: Any = importlib.import_module("imageio_ffmpeg")
    width, height = feature.size
    command = [
        program.get_ffmpeg_exe(), "-v", "error", "-nostats", "-protocol_whitelist", "file,pipe", "-f", "mp4",
        "-i", str(path), "-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", "rgb24", "-",
    ]  # fmt: skip
    size = 3 * width * height
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            while len(data := process.stdout.read(size)) == size:
                yield np.frombuffer(data, np.uint8).reshape(height, width, 3)
            said = process.stderr.read().decode(errors="replace")
        except BaseException:
            process.kill()
            raise
    if data or process.returncode:
        raise ValueError(f"{path.name} cannot be decoded: {said.strip()[-200:] or 'it breaks off'}")
