"""Datasets of both formats: what is written is read, also after a crash; whatever is wrong is one line."""

import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch

from simwarp import cli
from simwarp.core.files import FileError, OutputError
from simwarp.core.stopping import StopRequest
from simwarp.tasks import InputError, make
from simwarp.train.algorithm.learner import TrainingError
from simwarp.train.datasets import lerobot_writer
from simwarp.train.datasets.dataset_formats import instruction_of, load_trajectories, record_dataset
from simwarp.train.datasets.dataset_kinds import DatasetFormat, check_dataset
from simwarp.train.datasets.episodes import episodes_of, record
from simwarp.train.networks.policies import zero_policy
from tests.train.datasets.recorded_task import RecordedTask, by_noise, recorded_task
from tests.train.full_disks import largest_file, small_disk

minari_dataset = pytest.importorskip("simwarp.train.datasets.minari_dataset", exc_type=ImportError)
__all__ = ["recorded_task", "small_disk"]
FORMATS = [DatasetFormat.MINARI, DatasetFormat.LEROBOT]
COLUMNS = ("actions", "rewards", "episode", "terminated", "truncated")
both = pytest.mark.parametrize("kind", FORMATS, ids=lambda kind: kind.value)


def written(path, kind, episodes=11, policy=by_noise, config=None, **options):
    task = make("recorded-test", 4, **(config or {}))
    return record_dataset(task, policy, episodes, 3, path, kind, about={"policy": "by hand"}, **options)


def assert_same(read, data, groups=None):
    for name in COLUMNS:
        assert np.array_equal(getattr(read, name), getattr(data, name)), name
        assert getattr(read, name).dtype == getattr(data, name).dtype, name
    for name in groups or data.observations:
        assert np.array_equal(read.observations[name], data.observations[name]), name
        assert read.observations[name].dtype == data.observations[name].dtype, name


# ---- what is written is read -----------------------------------------------------------------------------------------


@both
def test_it_is_read_as_npz_would_be(recorded_task, tmp_path, kind):
    data = record(make(recorded_task, 4), by_noise, 11, 3, {"policy": "by hand"})
    told = written(tmp_path / "d-v0", kind, quality=0)
    read = load_trajectories(tmp_path / "d-v0", recorded_task)
    assert_same(read, data)
    assert (told.episodes, told.steps) == (11, data.steps)
    assert told.mean_return == pytest.approx(data.about["mean_return"], rel=1e-12)
    assert read.about == json.loads(json.dumps(data.about)) | {"instruction": "Count to the end.", "seed": 3}


def test_a_video_with_loss_changes_nothing_but_images(recorded_task, tmp_path):
    data = record(make(recorded_task, 4), by_noise, 11, 3, {})
    written(tmp_path / "d", DatasetFormat.LEROBOT)
    read = load_trajectories(tmp_path / "d", recorded_task)
    assert_same(read, data, ("policy", "one", "flags", "depth", "beams"))
    for name in ("camera", "grey"):
        error = np.abs(read.observations[name].astype(float) - data.observations[name])
        # At quality 18 the quantiser's step is 5 levels; limited range, 219 levels for 256, and colours at half the
        # resolution of slow ramps add a level each. Measured: 1.6 in the mean, 6 at most.
        assert 0.0 < error.mean() < 2.5
        assert error.max() < 12.0


@pytest.mark.parametrize("size", [(37, 41), (36, 41)])
def test_images_of_odd_sides_keep_their_size(recorded_task, tmp_path, size):
    config = {"height": size[0], "width": size[1]}
    data = record(make(recorded_task, 4, **config), by_noise, 5, 3, {})
    written(tmp_path / "d", DatasetFormat.LEROBOT, 5, config=config)
    read = load_trajectories(tmp_path / "d", recorded_task)
    assert read.observations["camera"].shape == data.observations["camera"].shape
    assert np.abs(read.observations["camera"].astype(float) - data.observations["camera"]).mean() < 2.5


def test_many_files_are_one_dataset(recorded_task, tmp_path, monkeypatch):
    monkeypatch.setattr(lerobot_writer, "LONGEST_WAIT", 0.0)  # each episode ends its files
    monkeypatch.setattr("simwarp.train.datasets.lerobot_layout.FILES_PER_CHUNK", 4)
    written(tmp_path / "d", DatasetFormat.LEROBOT, quality=0)
    for kind in ("data", "meta/episodes", "videos/observation.images.camera"):
        places = [
            path.relative_to(tmp_path / "d" / kind).with_suffix("") for path in (tmp_path / "d" / kind).rglob("file*")
        ]
        assert sorted(map(str, places)) == [f"chunk-{n // 4:03d}/file-{n % 4:03d}" for n in range(11)]
    data = record(make(recorded_task, 4), by_noise, 11, 3, {})
    assert_same(load_trajectories(tmp_path / "d", recorded_task), data)


def test_no_video_is_longer_than_times_in_float32_allow(recorded_task, tmp_path, monkeypatch):
    monkeypatch.setattr(lerobot_writer, "LONGEST_VIDEO", 0.6)  # 20 steps of 0.03 s
    written(tmp_path / "d", DatasetFormat.LEROBOT, quality=0)
    rows = pa.concat_tables([pq.read_table(path) for path in sorted((tmp_path / "d/meta/episodes").rglob("*.parquet"))])
    ends = rows.column("videos/observation.images.camera/to_timestamp").to_pylist()
    files = rows.column("videos/observation.images.camera/file_index").to_pylist()
    assert max(ends) <= 0.6 + 1e-12
    assert len(set(files)) > 3
    assert_same(load_trajectories(tmp_path / "d", recorded_task), record(make(recorded_task, 4), by_noise, 11, 3, {}))


def test_the_instruction_is_the_given_one_the_tasks_own_or_its_summary(recorded_task, tmp_path, monkeypatch):
    task = make(recorded_task, 1)
    assert instruction_of(task, "Stop.") == "Stop."
    assert instruction_of(task) == "Count to the end."
    monkeypatch.setattr(RecordedTask, "instruction", "")
    assert instruction_of(task) == recorded_task
    monkeypatch.setattr(RecordedTask, "summary", "a counter")
    assert instruction_of(task) == "a counter"
    for wrong in ("", " ", "two\nlines"):
        with pytest.raises(InputError, match="instruction must be a sentence on one line"):
            instruction_of(task, wrong)


@both
def test_progress_is_told_of_each_episode(recorded_task, tmp_path, kind):
    """Of many that end in one step, too."""
    seen: list[int] = []
    written(tmp_path / "d-v0", kind, report=seen.append)
    assert seen == sorted(seen)
    assert set(seen) == set(range(12))


# ---- what goes wrong meanwhile ---------------------------------------------------------------------------------------


@both
def test_an_interruption_keeps_what_has_ended(recorded_task, tmp_path, kind):
    stop = StopRequest()
    report = lambda ended: stop.ask() if ended >= 5 and not stop.requested else None  # noqa: E731
    told = written(tmp_path / "d-v0", kind, 400, stop=stop, report=report, quality=0)
    read = load_trajectories(tmp_path / "d-v0", recorded_task)
    assert 5 <= told.episodes == read.episodes < 400
    assert not list((tmp_path / "d-v0").rglob(".simwarp*"))


@both
def test_an_interruption_before_an_episode_leaves_no_folder(recorded_task, tmp_path, kind):
    stop = StopRequest()
    stop.ask()
    with pytest.raises(KeyboardInterrupt):
        written(tmp_path / "d-v0", kind, stop=stop)
    assert not list(tmp_path.iterdir())


@both
def test_a_policy_that_loses_its_numbers_costs_only_its_own_episodes(recorded_task, tmp_path, kind):
    calls = []

    def sick(observations):
        calls.append(1)
        return by_noise(observations) if len(calls) < 30 else torch.full((4, 2), torch.nan)

    with pytest.raises(TrainingError, match=r"the episodes before it are in '.*d-v0'"):
        written(tmp_path / "d-v0", kind, 400, sick)
    assert load_trajectories(tmp_path / "d-v0", recorded_task).episodes >= 4


class Killed(BaseException):
    """The process is gone: nothing is tidied up."""


@both
def test_killed_at_any_write_the_folder_opens(recorded_task, tmp_path, monkeypatch, kind):
    """Between any two changes of files that others see, what is there is whole."""
    monkeypatch.setattr(lerobot_writer, "LONGEST_WAIT", 0.0)
    order = list(episodes_of(make(recorded_task, 4, images=False), by_noise, 3, 3))
    left = [0]
    replace, write = Path.replace, Path.write_bytes

    def counted(function):
        def call(self, *arguments):
            if self.is_relative_to(tmp_path):
                left[0] -= 1
                if left[0] < 0:
                    raise Killed
            return function(self, *arguments)

        return call

    monkeypatch.setattr(Path, "replace", counted(replace))
    monkeypatch.setattr(Path, "write_bytes", counted(write))
    for writer in (lerobot_writer.LeRobotWriter, minari_dataset.MinariWriter):
        monkeypatch.setattr(writer, "end", lambda self: None)
    opened: list[int] = []
    for writes in range(200):
        path = tmp_path / f"d{writes}-v0"
        left[0] = writes
        try:
            written(path, kind, 3, config={"images": False})
        except Killed:
            pass
        else:
            break
        left[0] = 10**9
        try:
            read = load_trajectories(path, recorded_task)
        except (FileError, InputError):
            assert not opened, f"after {writes} writes what could be opened before cannot be opened"
            continue
        opened.append(read.episodes)
        there = sorted(order[: read.episodes], key=lambda one: (one.world, one.number))
        assert np.array_equal(read.actions, np.concatenate([one.actions for one in there]))
    assert opened == sorted(opened)
    assert set(opened) >= {1, 2}


SCRIPT = """
import sys, time
from pathlib import Path
sys.path.insert(0, {root!r})
from simwarp.tasks import make
from simwarp.tasks.framework import registry
from simwarp.train.datasets import lerobot_writer
from simwarp.train.datasets.dataset_formats import DatasetFormat, record_dataset
from tests.train.datasets.recorded_task import RecordedTask, by_noise
registry.task_names()
RecordedTask.name = "recorded-test"
registry._tasks["recorded-test"] = RecordedTask
lerobot_writer.LONGEST_WAIT = 0.1
record_dataset(make("recorded-test", 4), by_noise, 10**6, 3, Path(sys.argv[1]), DatasetFormat(sys.argv[2]), quality=0)
"""


@both
def test_a_killed_process_leaves_whole_episodes(recorded_task, tmp_path, kind):
    path = tmp_path / "d-v0"
    words = [sys.executable, "-c", SCRIPT.format(root=os.getcwd()), str(path), kind.value]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        deadline = time.monotonic() + 120.0
        mark = path / ("meta/info.json" if kind is DatasetFormat.LEROBOT else "data/3/metadata.json")
        while not mark.exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(0.3)
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert process.stderr is not None
        said = process.stderr.read().decode()
    assert process.returncode == -signal.SIGKILL, said
    read = load_trajectories(path, recorded_task)
    assert read.episodes >= 3
    whole = record(make(recorded_task, 4), by_noise, 4 * read.episodes, 3, {})
    # World 0 begins with its first episodes, which are those of a recording that was not killed
    rows = read.episode == 0
    assert_first = whole.episode == 0
    assert np.array_equal(read.observations["camera"][rows], whole.observations["camera"][assert_first])


@both
def test_a_full_disk_is_one_line_and_what_was_complete_opens(recorded_task, small_disk, kind, monkeypatch):
    monkeypatch.setattr(lerobot_writer, "LONGEST_WAIT", 0.0)

    def loud(observations):
        return torch.rand(4, 2) - 0.5

    with pytest.raises(OutputError, match=r"No space left on device.*make room and repeat") as caught:
        written(small_disk / "d-v0", kind, 4000, loud)
    assert "\n" not in str(caught.value)
    assert load_trajectories(small_disk / "d-v0", recorded_task).episodes >= 1
    assert not list((small_disk / "d-v0").rglob(".simwarp*"))


@both
@pytest.mark.parametrize("size", [10, 3000])
def test_a_limit_of_file_sizes_is_one_line(recorded_task, tmp_path, kind, size):
    with largest_file(size), pytest.raises(OutputError, match=r"File too large") as caught:
        written(tmp_path / "d-v0", kind, 40)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "d-v0").exists()


# ---- what is asked for wrongly ---------------------------------------------------------------------------------------


@both
def test_what_exists_is_not_written_over(recorded_task, tmp_path, kind):
    (tmp_path / "d-v0").mkdir()
    (tmp_path / "f-v0").write_text("mine", encoding="utf-8")
    (tmp_path / "l-v0").symlink_to(tmp_path / "nowhere")
    for name in ("d-v0", "f-v0", "l-v0"):
        with pytest.raises(FileError, match=rf"path.*'.*{name}'|path.*{name}"):
            written(tmp_path / name, kind)
    assert (tmp_path / "f-v0").read_text(encoding="utf-8") == "mine"
    assert not list((tmp_path / "d-v0").iterdir())


@pytest.mark.parametrize("name", ["d", "d-v", "d v0", "ü-v0", ".-v0.", "-v0"])
def test_minari_needs_a_version_in_the_name(tmp_path, name):
    with pytest.raises(InputError, match=r"letters, digits, - and _, and a version, such as 'pendulum-v0'"):
        check_dataset(DatasetFormat.MINARI, tmp_path / name, 18)


@both
def test_a_format_that_is_not_installed_names_its_extra(tmp_path, monkeypatch, kind):
    find = importlib.util.find_spec
    missing = {"lerobot": "pyarrow", "minari": "minari"}[kind.value]
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == missing else find(name, *rest))
    with pytest.raises(InputError) as caught:
        check_dataset(kind, tmp_path / "d-v0", 18)
    assert str(caught.value) == (
        f"format {kind.value} must have module '{missing}', got none; pip install 'simwarp[{kind.value}]'"
    )


def test_npz_is_not_a_folder(recorded_task, tmp_path):
    with pytest.raises(InputError, match="use record"):
        written(tmp_path / "d", DatasetFormat.NPZ)


# ---- what is no dataset ----------------------------------------------------------------------------------------------


@pytest.fixture(params=FORMATS, ids=lambda kind: kind.value)
def folder(request, recorded_task, tmp_path, monkeypatch):
    """A dataset to spoil, as the folder `d-v0` of the working folder."""
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "d-v0", request.param, 3)
    return tmp_path / "d-v0"


def refused(path, name="recorded-test"):
    with pytest.raises((FileError, InputError)) as caught:
        load_trajectories(path, name)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 900
    return text


def test_another_task_is_refused(folder):
    assert "are of task 'recorded-test', not 'fast'" in refused(folder, "fast")


def test_a_folder_of_something_else_is_refused(folder, tmp_path):
    (tmp_path / "other").mkdir()
    assert "holds no dataset" in refused(tmp_path / "other")
    for name in ("meta/simwarp.json", "data/metadata.json"):
        if (folder / name).exists():
            (folder / name).write_text('{"minari_version": "0.5.4", "total_episodes": 1}', encoding="utf-8")
    assert re.search("'about' names no format|'simwarp' is missing in its metadata", refused(folder))
    shutil.rmtree(folder / "meta", ignore_errors=True)
    (folder / "meta").mkdir()
    assert "meta/simwarp.json is missing, which `simwarp record --format lerobot` writes" in refused(folder)


def test_no_file_that_is_cut_changed_or_missing_escapes(folder):
    """Every file, spoiled in some ways: one line, or what was there."""
    good = load_trajectories(folder, "recorded-test")
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        data = path.read_bytes()
        spoilt = [None, b"", data[: len(data) // 2], b"\0" * len(data), b"{}", b"[]", b"null"]
        for place in range(0, len(data), len(data) // 5 + 1):
            spoilt.append(data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :])
        for content in spoilt:
            path.unlink() if content is None else path.write_bytes(content)
            try:
                read = load_trajectories(folder, "recorded-test")
            except (FileError, InputError) as error:
                assert "\n" not in str(error)  # noqa: PT017
            else:
                assert read.steps == good.steps or path.name == "metadata.json", path
        path.write_bytes(data)
    assert_same(load_trajectories(folder, "recorded-test"), good)


@pytest.mark.parametrize("count", [-1, 0, 2, 4, 10**15, "3", None, [3], 2.5])
def test_a_wrong_number_of_episodes_is_refused_or_cuts_them(folder, count):
    path = folder / ("meta/info.json" if (folder / "meta").exists() else "data/metadata.json")
    content = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(content | {"total_episodes": count}), encoding="utf-8")
    try:
        assert load_trajectories(folder, "recorded-test").episodes in (2, 3)
    except (FileError, InputError) as error:
        assert "\n" not in str(error)  # noqa: PT017


@both
def test_clone_refuses_observations_of_another_shape(recorded_task, tmp_path, monkeypatch, capsys, kind):
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "d-v0", kind, 3, config={"flags": False})
    path = tmp_path / "d-v0" / ("meta/simwarp.json" if kind is DatasetFormat.LEROBOT else "data/metadata.json")
    text = path.read_text(encoding="utf-8")
    assert '"height": 36' in text
    path.write_text(text.replace('"height": 36', '"height": 38'), encoding="utf-8")
    words = ["--epochs", "1", "--network.kind", "multi-input"]
    assert cli.main(["clone", recorded_task, "--data", "d-v0", *words]) == 2
    err = capsys.readouterr().err
    assert "the trajectories hold observations" in err
    assert err.count("\n") == 1


# ---- the commands ----------------------------------------------------------------------------------------------------


@both
def test_the_command_writes_and_says_so(tmp_path, monkeypatch, capsys, kind):
    monkeypatch.chdir(tmp_path)
    words = ["record", "fast", "--checkpoint", "zero", "--episodes", "3", "--format", kind.value]
    assert cli.main([*words, "--instruction", "Go home.", "--json", "r.json"]) == 0
    name = {"minari": "fast-v0", "lerobot": "fast_lerobot"}[kind.value]
    told = json.loads(Path("r.json").read_text())
    assert {
        "output": name,
        "file": name,
        "format": kind.value,
        "episodes": 3,
        "interrupted": False,
    }.items() <= told.items()
    assert f"wrote {name}" in capsys.readouterr().out
    read = load_trajectories(Path(name), "fast")
    assert read.about["instruction"] == "Go home."
    assert_same(read, record(make("fast", 3), zero_policy(make("fast", 3)), 3, 2_000_003, {}))
    assert cli.main(words) == 2
    assert f"'{name}' exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--format", "hdf5"], "hdf5"),
        (["--format", "minari", "--output", "fast"], "and a version, such as"),
        (["--format", "lerobot", "--output", "missing/x"], "missing does not exist"),
        (["--format", "lerobot", "--video-quality", "52"], "video-quality must be from 0 to 51, got 52"),
        (["--format", "lerobot", "--instruction", " "], "instruction must be a sentence"),
        (["--format", "npz", "--output", "fast"], "must end in .npz"),
    ],
)
def test_wrong_words_are_one_line(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["record", "fast", "--checkpoint", "zero", "--episodes", "1", *words]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())
