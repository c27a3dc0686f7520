"""`simwarp new-task`: the package it writes installs, passes its own test and is found; and `simwarp replay`."""

import json
import os
import subprocess
import sys

import pytest

from simwarp import cli


def python(*arguments, cwd, path=None):
    environment = os.environ | ({"PYTHONPATH": str(path)} if path else {})
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, timeout=300
    )


@pytest.mark.slow
def test_the_package_passes_its_own_test(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new-task", "my-arm", "--json", "out.json"]) == 0
    files = {str(path.relative_to(tmp_path / "my-arm")) for path in (tmp_path / "my-arm").rglob("*") if path.is_file()}
    assert files == {"pyproject.toml", "README.md", "my_arm/__init__.py", "my_arm/task.py", "tests/test_my_arm.py"}
    assert sorted(files) == json.loads((tmp_path / "out.json").read_text())["files"]
    assert "@" not in "".join((tmp_path / "my-arm" / name).read_text() for name in files if name.endswith(".toml"))
    done = python("-m", "pytest", "-q", "-p", "no:cacheprovider", cwd=tmp_path / "my-arm")
    assert done.returncode == 0, done.stdout[-4000:]
    assert "5 passed" in done.stdout


@pytest.mark.slow
def test_the_package_installs_and_the_command_finds_its_task(tmp_path):
    assert cli.main(["new-task", "my-arm", "--output", str(tmp_path / "package")]) == 0
    site = tmp_path / "site"
    pip = ["-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--target", str(site)]
    done = python(*pip, str(tmp_path / "package"), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    done = python("-m", "simwarp", "list", cwd=tmp_path, path=site)
    assert "my-arm" in done.stdout, done.stderr
    options = ["--iterations", "40", "--device", "cpu", "--json", "train.json"]
    done = python("-m", "simwarp", "train", "my-arm", *options, cwd=tmp_path, path=site)
    assert done.returncode == 0, done.stderr
    # Doing nothing earns about 48 of 200
    assert json.loads((tmp_path / "train.json").read_text())["mean_reward"] > 120.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["new-task"], "usage: simwarp new-task NAME"),
        (["new-task", "My Task"], "lower-case letters, digits and single hyphens"),
        (["new-task", "a--b"], "lower-case letters, digits and single hyphens"),
        (["new-task", "fast"], "there is a task 'fast' already"),
        (["new-task", "json"], "there is a Python module 'json' already"),
        (["new-task", "class"], "there is a Python module 'class' already"),
        (["new-task", "mine", "--output", "full"], "exists and is not an empty folder"),
        (["new-task", "mine", "--output", "full/file"], "exists and is not an empty folder"),
        (["new-task", "mine", "--ouput", "x"], "did you mean --output?"),
        (["replay"], "usage: simwarp replay FILE"),
        (["replay", "none.npz"], "none.npz"),
        (["replay", "full/file"], "full/file"),
    ],
)
def test_mistakes_get_one_line(tmp_path, monkeypatch, capfd, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine")
    assert cli.main(arguments) == 2
    err = capfd.readouterr().err
    assert message in err
    assert err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "full"]


@pytest.mark.parametrize("command", ["export", "new-task", "replay", "record", "clone"])
def test_help(capfd, command):
    assert cli.main([command, "--help"]) == 0
    assert "usage: simwarp" in capfd.readouterr().out


def test_replay_says_whether_it_broke_again(tmp_path, monkeypatch, capfd):
    import dataclasses

    from simwarp.tasks.framework import replay

    @dataclasses.dataclass(frozen=True)
    class Report:
        reproduced: bool
        broke_at: int | None
        problems: list[str]

    for again in (True, False):
        monkeypatch.setattr(replay, "replay", lambda path, device, again=again: Report(again, None, []))
        assert cli.main(["replay", "a.npz", "--json", "-"]) == (0 if again else 1)
        assert json.loads(capfd.readouterr().out)["reproduced"] is again
