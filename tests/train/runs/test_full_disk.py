"""Full disks, limits of file sizes and folders that vanish: one line, exit code 1, what was there before unharmed."""

import contextlib
import csv
import json
import shutil
import sys
import threading
import types

import numpy as np
import pytest
import torch

from simwarp import cli
from simwarp.core.files import OutputError
from simwarp.tasks import InputError, make
from simwarp.train.algorithm.trainer import Trainer
from simwarp.train.config import LoggerKind
from simwarp.train.evaluation.mp4 import write_mp4
from simwarp.train.evaluation.play import check_video_path
from simwarp.train.runs.checkpoint import inference_only, load_checkpoint, save_checkpoint
from simwarp.train.runs.progress_table import read_progress
from simwarp.train.runs.run_files import append_whole
from simwarp.train.runs.run_folder import RunFolder
from simwarp.train.runs.run_lock import LOCK
from simwarp.train.runs.run_saver import RunSaver
from tests.train.full_disks import largest_file, small_disk
from tests.train.runs.trained_run import run

__all__ = ["small_disk"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    return run(tmp_path_factory.mktemp("trained"), iterations=2)


@pytest.fixture
def folder(trained, tmp_path):
    return RunFolder(shutil.copytree(trained.path, tmp_path / "fast" / "run"))


@pytest.fixture
def policy(trained, tmp_path, monkeypatch):
    """A checkpoint in a working folder of its own."""
    monkeypatch.chdir(tmp_path)
    save_checkpoint(tmp_path / "policy.pt", inference_only(load_checkpoint(trained.latest_checkpoint())))
    return tmp_path


def one_line(capsys):
    err = capsys.readouterr().err
    assert err.count("\n") == 1, err
    return err


# ---- training --------------------------------------------------------------------------------------------------------


def test_a_checkpoint_that_does_not_fit_stops_the_run_and_leaves_the_last_one(folder, capsys):
    size = folder.latest_checkpoint().stat().st_size
    with largest_file(size // 2):
        code = cli.main(["train", "fast", "--resume", str(folder.path), "--iterations", "5"])
    assert code == 1
    err = one_line(capsys)
    assert "iteration_000003.pt': File too large: 0.1" in err
    assert "MB needed" in err
    assert "raise the limit of file sizes" in err
    assert f"run {folder.path} is saved up to iteration_000002.pt" in err
    assert load_checkpoint(folder.latest_checkpoint())["iteration"] == 2
    assert not (folder.path / LOCK).exists()
    assert not list(folder.path.rglob(".*"))
    run(folder.path.parent, resume=folder.path, iterations=3)  # and goes on when there is room
    assert [int(row["iteration"]) for row in read_progress(folder.progress)] == [1, 2, 3]


def test_a_full_disk_stops_the_run_and_leaves_the_last_checkpoint(small_disk, capsys):
    options = ["--num-envs", "256", "--save-interval", "1", "--keep-checkpoints", "0", "--device", "cpu"]
    code = cli.main(["train", "fast", "--runs", str(small_disk), "--iterations", "1000", *options])
    assert code == 1
    err = one_line(capsys)
    assert "No space left on device" in err
    assert "make room and repeat" in err
    (path,) = (small_disk / "fast").iterdir()
    folder = RunFolder(path)
    assert len(folder.checkpoint_files()) >= 1
    for file in folder.checkpoint_files():
        load_checkpoint(file)
    assert f"is saved up to {folder.latest_checkpoint().name}" in err
    assert not (path / LOCK).exists()


@pytest.mark.parametrize("kind", list(LoggerKind)[:2], ids=lambda kind: kind.value)
def test_records_that_do_not_fit_stop_the_run_without_a_thread_that_hangs(tmp_path, kind, monkeypatch):
    before = threading.active_count()
    iterate = Trainer.iterate

    def full_from_the_second(self):
        report = iterate(self)
        if self.iteration == 2:
            limits.enter_context(largest_file(10))
        return report

    with contextlib.ExitStack() as limits:
        monkeypatch.setattr(Trainer, "iterate", full_from_the_second)
        with pytest.raises(OutputError, match=r"progress.csv': File too large.*is saved up to iteration_000001.pt"):
            run(tmp_path, logger=kind)
    assert threading.active_count() == before


@pytest.mark.parametrize("when", [1, 2])
@pytest.mark.parametrize("kind", list(LoggerKind)[:2], ids=lambda kind: kind.value)
def test_a_run_folder_that_is_removed_stops_the_run(tmp_path, kind, when, monkeypatch):
    iterate = Trainer.iterate
    removed = []

    def remove(self):
        report = iterate(self)
        if self.iteration == when:
            removed.extend((tmp_path / "fast").iterdir())
            shutil.rmtree(tmp_path / "fast")
        return report

    monkeypatch.setattr(Trainer, "iterate", remove)
    with pytest.raises(OutputError) as caught:
        run(tmp_path, logger=kind)
    assert f"folder {removed[0]} is gone" in str(caught.value)
    assert f"run {removed[0]} has no checkpoint" in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_run_folder_that_is_removed_before_a_checkpoint_stops_the_run(tmp_path, monkeypatch):
    write = RunSaver._write

    def remove(saver):
        shutil.rmtree(saver.folder.path)
        return write(saver)

    monkeypatch.setattr(RunSaver, "_write", remove)
    with pytest.raises(OutputError, match=r"is gone: 0\.\d+ MB needed; run .* has no checkpoint"):
        run(tmp_path)


def test_no_half_run_folder_is_left_where_none_could_be_made(tmp_path, capsys):
    with largest_file(100):
        code = cli.main(["train", "fast", "--runs", str(tmp_path / "runs"), "--num-envs", "8", "--device", "cpu"])
    assert code == 1
    assert "File too large" in one_line(capsys)
    assert list((tmp_path / "runs" / "fast").iterdir()) == []


def test_appending_is_all_or_nothing(tmp_path):
    path = tmp_path / "log"
    append_whole(path, b"first\n")
    with largest_file(10), pytest.raises(OutputError, match="File too large"):
        append_whole(path, b"second\n")
    assert path.read_bytes() == b"first\n"
    append_whole(path, b"third\n")
    assert path.read_bytes() == b"first\nthird\n"


def test_tensorboard_reads_what_is_written(tmp_path):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    folder = run(tmp_path, logger=LoggerKind.TENSORBOARD)
    run(tmp_path, resume=folder.path, iterations=5, logger=LoggerKind.TENSORBOARD)
    events = EventAccumulator(str(folder.path))
    events.Reload()
    scalars = events.Scalars("loss/value")
    assert [event.step for event in scalars] == [1, 2, 3, 4, 5]
    with folder.progress.open(encoding="utf-8", newline="") as file:
        expected = [float(row["loss/value"]) for row in csv.DictReader(file)]
    assert [event.value for event in scalars] == pytest.approx(expected, rel=1e-6)


# ---- what the other commands write -----------------------------------------------------------------------------------

COMMANDS = {
    "picture.png": ["play", "fast", "--checkpoint", "policy.pt", "--seconds", "0.2", "--num-envs", "1", "--video"],
    "video.gif": ["play", "fast", "--checkpoint", "policy.pt", "--seconds", "0.2", "--num-envs", "1", "--video"],
    "data.npz": ["record", "fast", "--checkpoint", "policy.pt", "--episodes", "2", "--output"],
    "policy.ts": ["export", "policy.pt", "--format", "torchscript", "--output"],
}


@pytest.mark.parametrize("there", [b"old", None])
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.sweep
def test_what_does_not_fit_leaves_the_old_file(policy, capsys, name, there):
    if there is not None:
        (policy / name).write_bytes(there)
    with largest_file(500):
        code = cli.main([*COMMANDS[name], name])
    assert code == 1
    err = one_line(capsys)
    assert f"cannot write '{name}': File too large" in err
    assert "MB needed" in err
    assert str(policy) in err
    assert sorted(path.name for path in policy.iterdir()) == sorted(["policy.pt", *([name] if there else [])])
    assert there is None or (policy / name).read_bytes() == there


def test_a_clone_that_does_not_fit_leaves_nothing(policy, capsys):
    assert cli.main([*COMMANDS["data.npz"], "data.npz"]) == 0
    capsys.readouterr()
    with largest_file(500):
        code = cli.main(["clone", "fast", "--data", "data.npz", "--epochs", "1", "--output", "clone.pt"])
    assert code == 1
    assert "cannot write 'clone.pt': File too large" in one_line(capsys)
    assert not (policy / "clone.pt").exists()


def test_an_evaluation_whose_files_do_not_fit_still_tells_its_results(policy, capsys):
    arguments = ["eval", "fast", "--checkpoint", "policy.pt", "--episodes", "2", "--no-baselines", "--json", "-"]
    with largest_file(100):
        code = cli.main([*arguments, "--plot", "plots"])
    out, err = capsys.readouterr()
    assert code == 1
    assert json.loads(out)["episodes"] == 2
    assert err.splitlines()[-1].startswith("simwarp: cannot write 'plots/")
    assert "File too large" in err.splitlines()[-1]
    assert "Traceback" not in err


def test_a_dump_that_does_not_fit_is_told(tmp_path):
    task = make("pendulum", 2)
    task.views.joint_qd[1] = float("nan")
    assert task.guard is not None
    task.guard.path = tmp_path / "broken.npz"
    task.step(torch.zeros(2, 1))
    with largest_file(100), pytest.raises(OutputError, match=r"broken.npz': File too large"):
        task.drain_statistics()
    assert list(tmp_path.iterdir()) == []
    task.guard.path = tmp_path / "gone" / "broken.npz"
    with pytest.raises(OutputError, match=r"gone.*does not exist"):
        task.drain_statistics()


@pytest.mark.parametrize("output", ["", "folder", "nowhere/x{}", "{}/x{}", "file/x{}"])
@pytest.mark.parametrize("name", [*COMMANDS, "clone.pt"])
def test_outputs_are_looked_at_before_any_work(policy, capsys, monkeypatch, name, output):
    (policy / "folder").mkdir()
    (policy / "file").write_bytes(b"old")
    suffix = name[name.index(".") :]
    path = output.replace("{}/", "x" * 300 + "/").replace("{}", suffix)
    if output == "folder":
        (policy / f"folder{suffix}").mkdir()
        path = f"folder{suffix}"
    before = sorted(str(item) for item in policy.rglob("*"))
    command = COMMANDS.get(name, ["clone", "fast", "--data", "policy.pt", "--output"])
    # replaced where the commands look it up: a module first imported meanwhile would keep a replacement in its source
    for module in ("cli.playing", "cli.view.films", "train.datasets.episodes"):
        monkeypatch.setattr(f"simwarp.{module}.record", lambda *_: pytest.fail("work began"))
    assert cli.main([*command, path]) == 2
    assert "Traceback" not in one_line(capsys)
    assert sorted(str(item) for item in policy.rglob("*")) == before


# ---- mp4 -------------------------------------------------------------------------------------------------------------

ENCODER = """#!{python}
import sys
data = sys.stdin.buffer.read({read})
open(sys.argv[-1], "wb").write(b"video %d" % len(data))
sys.stderr.write({words!r})
sys.exit({code})
"""


@pytest.fixture
def encoder(tmp_path, monkeypatch):
    """Takes the place of ffmpeg."""

    def install(code=0, words="", read=-1):
        path = tmp_path / "ffmpeg"
        path.write_text(ENCODER.format(python=sys.executable, code=code, words=words, read=read), encoding="utf-8")
        path.chmod(0o755)
        module = types.ModuleType("imageio_ffmpeg")
        module.__dict__["get_ffmpeg_exe"] = lambda: str(path)
        monkeypatch.setitem(sys.modules, "imageio_ffmpeg", module)

    return install


IMAGES = [np.full((4, 6, 3), index, np.uint8) for index in range(5)]


def test_a_video_is_written_by_the_encoder(tmp_path, encoder):
    encoder()
    write_mp4(tmp_path / "a.mp4", iter(IMAGES), (6, 4), 25.0)
    assert (tmp_path / "a.mp4").read_bytes() == b"video 360"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mp4", "ffmpeg"]


@pytest.mark.parametrize(
    ("code", "words", "message"),
    [(1, "av_write: No space left on device", "No space left on device"), (1, "File too large", "File too large"),
     (3, "", "ffmpeg ended with code 3: without a word"), (1, "bad\nluck", "ffmpeg ended with code 1: bad")],
)  # fmt: skip
def test_an_encoder_that_fails_leaves_the_old_video(tmp_path, encoder, code, words, message):
    encoder(code, words)
    (tmp_path / "a.mp4").write_bytes(b"old")
    with pytest.raises(OutputError, match=message):
        write_mp4(tmp_path / "a.mp4", iter(IMAGES), (6, 4), 25.0)
    assert (tmp_path / "a.mp4").read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mp4", "ffmpeg"]


def test_an_encoder_that_is_not_there_is_refused_before_any_work(tmp_path, monkeypatch):
    module = types.ModuleType("imageio_ffmpeg")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", module)

    def missing():
        raise RuntimeError("No ffmpeg exe could be found.")

    module.__dict__["get_ffmpeg_exe"] = missing
    with pytest.raises(InputError, match="mp4 needs ffmpeg: No ffmpeg exe could be found"):
        check_video_path(tmp_path / "a.mp4")


def test_an_encoder_that_ends_early_does_not_hang_us(tmp_path, encoder):
    encoder(1, "File too large", read=0)
    many = (np.zeros((400, 600, 3), np.uint8) for _ in range(20))
    with pytest.raises(OutputError, match="File too large"):
        write_mp4(tmp_path / "a.mp4", many, (600, 400), 25.0)
