"""Files that commands write: looked at before any work, whole or not at all, and never another thing's."""

import dataclasses
import json
import os
import resource
import stat
import threading
from pathlib import Path

import pytest

from simwarp import cli
from simwarp.cli import UsageError, new_task
from simwarp.cli.options import CommonOptions
from simwarp.core.files import DRAFT_PREFIX, FileError, OutputError
from simwarp.vehicle.spec.vehicle_files import load_vehicle, save_vehicle

SHORT = ["--maneuver", "slope-hold", "--duration", "0.05", "--device", "cpu"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def drive(folder, capfd):
    """Run a short drive with further options: exit code and standard error."""

    def run(*arguments, vehicle="gator"):
        code = cli.main(["drive", vehicle, *SHORT, *arguments])
        return code, capfd.readouterr().err

    return run


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"csv": "a.out", "plot": "./a.out"}, "--plot would overwrite './a.out', which is --csv too"),
        ({"csv": "link", "plot": "target"}, "--plot would overwrite 'target', which is --csv too"),
        ({"csv": "mine.json"}, "--csv would overwrite 'mine.json', which is --json too"),
        ({"csv": "car.json"}, "--csv would overwrite 'car.json', which is an input too"),
        ({"some_file": "x" * 256}, "--some-file: the name"),
        ({"csv": ""}, "--csv must name a file"),
        ({"csv": "none/a"}, "--csv: cannot write 'none/a': folder none does not exist"),
    ],
)
def test_files_that_cannot_be_written_are_told_before_any_work(folder, files, words):
    (folder / "target").write_text("old")
    (folder / "link").symlink_to("target")
    (folder / "car.json").write_text("{}")
    with pytest.raises((UsageError, FileError)) as caught:
        CommonOptions(json="mine.json").check("car.json", None, **files)
    assert words in str(caught.value)


def test_devices_may_be_named_twice_and_standard_output_is_none(folder):
    CommonOptions(json="/dev/null").check(csv="/dev/null", plot=None)
    CommonOptions(json="-").check("car.json")
    assert list(folder.iterdir()) == []


def test_a_vehicle_and_a_recorded_run_are_not_written_over(drive, folder):
    save_vehicle(load_vehicle("gator"), folder / "car.json")
    (folder / "run.csv").write_text("t_s,steer\n0,0\n0.05,0\n")
    before = (folder / "car.json").read_bytes()
    assert drive("--json", "car.json", vehicle="car.json")[0] == 2
    code = cli.main(["drive", "gator", "--maneuver", "run.csv", "--csv", "run.csv"])
    assert code == 2
    assert (folder / "car.json").read_bytes() == before
    assert (folder / "run.csv").read_text().startswith("t_s,steer")


def test_symlinks_devices_and_fifos_stay_what_they_are(drive, folder):
    (folder / "target.csv").write_text("old")
    (folder / "link.csv").symlink_to("target.csv")
    os.mkfifo(folder / "pipe")
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append((folder / "pipe").read_bytes()))
    reader.start()
    assert drive("--csv", "link.csv", "--json", "pipe") == (0, "")
    reader.join(timeout=30)
    assert (folder / "link.csv").is_symlink()
    assert (folder / "target.csv").read_text().startswith("t_s,")
    assert stat.S_ISFIFO((folder / "pipe").stat().st_mode)
    assert json.loads(got[0])["vehicle"] == "gator"


def test_names_in_brackets_and_between_colons_are_printed_as_they_are(folder, capfd):
    spec = dataclasses.replace(load_vehicle("gator"), name="[/x] [bold]my:car:")
    save_vehicle(spec, folder / "car.json")
    assert cli.main(["drive", "car.json", *SHORT, "--csv", "[a]:x:.csv"]) == 0
    out = capfd.readouterr().out
    assert out.startswith("[/x] [bold]my:car:, slope-hold")
    assert "wrote [a]:x:.csv" in out


@pytest.mark.parametrize("option", ["--csv", "--json", "--plot"])
def test_a_full_disk_is_one_line_and_the_old_file_stays(drive, folder, option):
    name = {"--plot": "a.svg", "--csv": "a.csv"}.get(option, "a.out")
    (folder / name).write_text("old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (512, hard))
    try:
        code, err = drive(option, name)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert code == 1
    assert err.startswith(f"simwarp: cannot write '{name}': File too large: ")
    assert f"are free in {folder}" in err
    assert err.count("\n") == 1
    assert [path.name for path in folder.iterdir()] == [name]
    assert (folder / name).read_text() == "old"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
def test_a_device_that_is_full_is_one_line(drive):
    code, err = drive("--csv", "/dev/full")
    assert code == 1
    assert err.startswith("simwarp: cannot write '/dev/full': No space left on device")
    assert err.count("\n") == 1


# ---- new-task --------------------------------------------------------------------------------------------------------


def test_a_package_that_cannot_be_written_leaves_nothing(folder, capfd):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))  # the task itself is larger, what comes before it is not
    try:
        code = cli.main(["new-task", "my-arm", "--output", "a/b"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    err = capfd.readouterr().err
    assert code == 1
    assert "File too large" in err
    assert err.count("\n") == 1
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(28, "No space left on device"), ZeroDivisionError])
def test_whatever_stops_it_a_package_is_whole_or_not_there(folder, monkeypatch, error):
    (folder / "empty").mkdir()
    write, calls = Path.write_text, []

    def stopped(self, *arguments, **options):
        calls.append(self)
        if len(calls) == 4:
            raise error
        return write(self, *arguments, **options)

    monkeypatch.setattr(Path, "write_text", stopped)
    expected = OutputError if isinstance(error, OSError) else error
    with pytest.raises(expected):
        new_task.write_package(Path("empty"), new_task.files("my-arm"))
    assert [str(path.relative_to(folder)) for path in folder.rglob("*")] == ["empty"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a" * 65], "at most 64 characters"),
        (["x" * 100_000], "got 'xxxx"),
        (["tests"], "a Python module 'tests' already"),
        (["é"], "lower-case letters"),
        (["a\n"], "lower-case letters"),
        ([".."], "lower-case letters"),
        (["import"], "a Python module 'import' already"),
        (["mine", "--output", "file"], "exists and is not an empty folder"),
        (["mine", "--output", "file/x"], "Not a directory"),
        (["mine", "--output", "loop"], "exists and is not an empty folder"),
        (["mine", "--output", "/dev/null"], "exists and is not an empty folder"),
        (["mine", "--output", "pipe"], "exists and is not an empty folder"),
        (["mine", "--output", "x" * 256], "--output must be a path whose names have at most 255 bytes"),
    ],
)
def test_names_and_folders_that_no_package_can_have(folder, capfd, arguments, words):
    (folder / "file").write_text("mine")
    (folder / "loop").symlink_to("loop")
    os.mkfifo(folder / "pipe")
    assert cli.main(["new-task", *arguments]) == 2
    err = capfd.readouterr().err
    assert words in err
    assert err.count("\n") == 1
    assert sorted(path.name for path in folder.iterdir()) == ["file", "loop", "pipe"]
    assert not list(folder.glob(f"{DRAFT_PREFIX}*"))
