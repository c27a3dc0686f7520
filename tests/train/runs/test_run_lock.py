"""One writer per run folder: who may write, whose lock is taken over, and that it is gone afterwards."""

import dataclasses
import fcntl
import json
import multiprocessing
import os
import subprocess
import sys

import pytest
from rich.console import Console

from simwarp import cli
from simwarp.core import operating_system
from simwarp.tasks import InputError
from simwarp.train.algorithm.learner import TrainingError
from simwarp.train.runs.run_lock import LOCK, Writer, started, writing
from simwarp.train.runs.run_saver import RunSaver
from tests.train.runs.trained_run import QUIET, run


def contend(folder, begin, held):
    """Be the writer of the run ten times; a marker shows that nobody else is inside."""
    begin.wait()
    while held.value < 10:
        try:
            with writing(folder) as lock:
                (folder / "inside").mkdir()  # raises where another one is inside
                held.value += 1
                lock.check()
                (folder / "inside").rmdir()
        except InputError as error:
            assert "is being written by process" in str(error)  # noqa: PT017


@pytest.fixture(scope="module")
def dead():
    """The number of a process that is no more."""
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid


def leave(folder, **changes):
    """Leave the lock of another writer."""
    writer = dataclasses.replace(Writer.this(), **changes)
    (folder / LOCK).write_text(json.dumps(dataclasses.asdict(writer)), encoding="utf-8")
    return writer


def test_a_lock_that_goes_while_it_is_looked_at_is_no_other_kind_of_file(tmp_path, monkeypatch):
    """Another writer may remove its lock at any moment, also between two looks at it."""
    monkeypatch.setattr(os.path, "lexists", lambda path: True)
    with writing(tmp_path) as lock:
        lock.check()


def test_the_lock_names_the_process_and_is_gone_afterwards(tmp_path):
    with writing(tmp_path) as lock:
        saved = json.loads((tmp_path / LOCK).read_text(encoding="utf-8"))
        assert (saved["pid"], saved["started"]) == (os.getpid(), started(os.getpid()))
        assert saved["host"] == os.uname().nodename
        assert lock.took_over == ""
        lock.check()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_the_lock_is_released_on_errors(tmp_path, kind):
    with pytest.raises(kind), writing(tmp_path):
        raise kind
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("take_over", [False, True])
def test_a_living_writer_on_this_machine_is_never_taken_over(tmp_path, take_over):
    with writing(tmp_path), pytest.raises(InputError, match=f"is being written by process {os.getpid()} on"):  # noqa: SIM117
        with writing(tmp_path, take_over):
            pass


def test_a_dead_process_of_this_machine_is_taken_over_and_told(tmp_path, dead):
    leave(tmp_path, pid=dead, started="123")
    with writing(tmp_path) as lock:
        assert f"was of process {dead} on" in lock.took_over
        assert "which is dead; taken over" in lock.took_over


def test_a_number_that_was_used_again_is_not_mistaken_for_the_writer(tmp_path):
    leave(tmp_path, started="1")  # this very process's number
    with writing(tmp_path) as lock:
        assert "which is dead" in lock.took_over


def test_a_machine_that_was_started_anew_since_has_no_old_writers(tmp_path, monkeypatch):
    monkeypatch.setattr(Writer, "this", classmethod(lambda kind: kind("a", "m", "boot1 pid:[1]", os.getpid(), "5")))
    leave(tmp_path, boot="boot0 pid:[1]")
    with writing(tmp_path) as lock:
        assert "which is dead" in lock.took_over


@pytest.mark.parametrize(
    "changes",
    [{"host": "elsewhere"}, {"machine": "another of this name"}, {"boot": "{boot} pid:[0]"}],
    ids=["another host", "another machine", "another container"],
)
def test_a_writer_that_cannot_be_seen_is_only_taken_over_on_demand(tmp_path, dead, changes):
    boot = Writer.this().boot.split()[0]
    changes = {name: value.format(boot=boot) for name, value in changes.items()}
    writer = leave(tmp_path, pid=dead, **changes)
    with pytest.raises(InputError, match=f"is locked by process {dead} on {writer.host}.*give --take-over"):
        writing(tmp_path).__enter__()
    assert json.loads((tmp_path / LOCK).read_text(encoding="utf-8")) == dataclasses.asdict(writer)
    with writing(tmp_path, take_over=True) as lock:
        assert lock.took_over.endswith("taken over")


@pytest.mark.parametrize("text", [b"hello", b"{}", b"\xff\xfe", b'{"host": null}', b"[" * 5000])
def test_an_unreadable_lock_is_only_taken_over_on_demand(tmp_path, text):
    (tmp_path / LOCK).write_bytes(text)
    with pytest.raises(InputError, match="is unreadable; if no process writes the run, give --take-over"):
        writing(tmp_path).__enter__()
    with writing(tmp_path, take_over=True):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)])
def test_what_is_no_file_is_no_lock(tmp_path, make):
    make(tmp_path / LOCK)
    with pytest.raises((InputError, RuntimeError), match=LOCK):
        writing(tmp_path).__enter__()


@pytest.mark.parametrize("windows", [False, True])
def test_of_processes_that_find_the_same_lock_one_at_a_time_is_inside(tmp_path, dead, windows, monkeypatch):
    """On Windows the lock of the system is on a file beside it, which goes with it there."""
    if windows:
        monkeypatch.setattr(operating_system, "WINDOWS", True)
    leave(tmp_path, pid=dead, started="1")
    context = multiprocessing.get_context("fork")
    begin, counts = context.Barrier(3), [context.Value("i", 0) for _ in range(3)]
    processes = [context.Process(target=contend, args=(tmp_path, begin, held)) for held in counts]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60.0)
    assert [process.exitcode for process in processes] == [0, 0, 0]
    assert [held.value for held in counts] == [10, 10, 10]
    left = {path.name for path in tmp_path.iterdir()}
    assert left <= ({"writer.lock"} if windows else set())


def test_a_lock_that_another_process_replaced_at_the_last_moment_is_looked_at_anew(tmp_path, dead, monkeypatch):
    leave(tmp_path, pid=dead, started="1")
    flock = fcntl.flock

    def slow_flock(handle, how):
        if json.loads((tmp_path / LOCK).read_text(encoding="utf-8"))["pid"] == dead:
            (tmp_path / LOCK).unlink()
            leave(tmp_path)  # of a living process
        flock(handle, how)

    monkeypatch.setattr(fcntl, "flock", slow_flock)
    with pytest.raises(InputError, match=f"is being written by process {os.getpid()} on"):
        writing(tmp_path).__enter__()


# ---- in training -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return run(tmp_path_factory.mktemp("runs"), iterations=1)


@pytest.fixture
def locked(folder):
    yield folder
    (folder.path / LOCK).unlink(missing_ok=True)


def test_a_run_is_locked_while_it_is_written_and_free_afterwards(tmp_path, monkeypatch):
    seen = []
    write = RunSaver._write

    def look(saver):
        seen.append(saver.lock is not None and saver.lock.is_own())
        return write(saver)

    monkeypatch.setattr(RunSaver, "_write", look)
    folder = run(tmp_path, iterations=2)
    assert seen == [True, True]
    assert not (folder.path / LOCK).exists()
    run(tmp_path, resume=folder.path, iterations=3)
    assert seen == [True, True, True]
    assert not (folder.path / LOCK).exists()


def test_a_run_that_is_being_written_is_not_resumed(locked, capfd):
    before = {path: path.read_bytes() for path in locked.path.rglob("*") if path.is_file()}
    with writing(locked.path):
        for more in ([], ["--take-over"]):
            assert cli.main(["train", "fast", "--resume", str(locked.path), "--iterations", "9", *more]) == 2
            err = capfd.readouterr().err
            assert err.count("\n") == 1
            assert f"is being written by process {os.getpid()} on" in err
    assert {path: path.read_bytes() for path in locked.path.rglob("*") if path.is_file()} == before


def test_who_was_taken_over_is_told(locked, dead, capfd):
    leave(locked.path, pid=dead, started="1")
    run(locked.path.parent, resume=locked.path, iterations=2, console=Console(width=500))
    assert f"its lock was of process {dead} on" in capfd.readouterr().out
    leave(locked.path, host="elsewhere")
    with pytest.raises(InputError, match="give --take-over"):
        run(locked.path.parent, resume=locked.path, iterations=3)
    run(locked.path.parent, resume=locked.path, iterations=3, take_over=True, console=QUIET)


def test_a_writer_that_was_taken_over_stops_when_the_other_has_finished(tmp_path):
    with writing(tmp_path) as lock:
        leave(tmp_path, host="elsewhere")
        assert not lock.is_own()
        (tmp_path / LOCK).unlink()
        with pytest.raises(TrainingError, match="was taken over by another process"):
            lock.check()


def test_a_folder_that_is_gone_is_for_the_disk_to_tell(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    with writing(folder) as lock:
        (folder / LOCK).unlink()
        folder.rmdir()
        lock.check()


def test_a_writer_that_was_taken_over_stops_and_leaves_the_lock_to_the_other(tmp_path, monkeypatch):
    folders = []

    def take_away(saver):
        folders.append(saver.folder)
        leave(saver.folder.path, host="elsewhere")
        return write(saver)

    write = RunSaver._write
    monkeypatch.setattr(RunSaver, "_write", take_away)
    with pytest.raises(TrainingError, match="was taken over by another process"):
        run(tmp_path)
    assert folders[0].checkpoint_files() == []
    assert json.loads((folders[0].path / LOCK).read_text(encoding="utf-8"))["host"] == "elsewhere"
