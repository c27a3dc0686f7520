"""What `simwarp train` says comes next: words that can be taken over as they are, and mean the run that was trained."""

import json
import shlex
from pathlib import Path

import pytest
from rich.console import Console

from simwarp import cli
from simwarp.cli.training import report_result
from simwarp.train.runs.training import TrainResult

SMALL = ["--device", "cpu", "--num-envs", "8", "--steps-per-iteration", "8", "--logger", "csv"]


def train(capfd, *arguments):
    """Train the fast task; return its output and its result."""
    assert cli.main(["train", "fast", *SMALL, *arguments, "--json", "train.json"]) == 0
    return capfd.readouterr().out, json.loads(Path("train.json").read_text(encoding="utf-8"))


def hinted(out, word):
    """The arguments of a command that the output names."""
    lines = [line for line in out.splitlines() if line.startswith(("next ", "go on with "))]
    said = [part.partition("simwarp ")[2] for line in lines for part in line.split("  or  ")]
    (words,) = (shlex.split(each) for each in said if each.startswith(f"{word} "))
    return words


@pytest.mark.parametrize("runs", ["runs", "my [runs]"])
def test_a_resumed_run_is_what_the_hints_mean(tmp_path, monkeypatch, capfd, runs):
    """It is not the newest one, and need not be where runs are looked for."""
    monkeypatch.chdir(tmp_path)
    _, older = train(capfd, "--iterations", "1", "--runs", runs)
    out, newer = train(capfd, "--iterations", "1", "--runs", runs)
    assert cli.main([*hinted(out, "eval"), "--episodes", "2", "--json", "-"]) == 0
    assert newer["run"] in json.loads(capfd.readouterr().out)["checkpoint"]
    out, again = train(capfd, "--resume", older["run"], "--iterations", "2")
    assert again["run"] == older["run"]
    for word, more in (("eval", ["--episodes", "2"]), ("play", ["--seconds", "0.1", "--video", "a.png"])):
        assert cli.main([*hinted(out, word), *more, "--json", "-"]) == 0
        assert json.loads(capfd.readouterr().out)["checkpoint"] == again["checkpoint"]


def test_a_run_beside_a_task_of_its_name_is_hinted_as_a_path(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    _, first = train(capfd, "--iterations", "1")
    Path(first["run"]).rename("pendulum")
    out, again = train(capfd, "--resume", "pendulum", "--iterations", "2")
    assert cli.main([*hinted(out, "eval"), "--episodes", "2", "--json", "-"]) == 0
    assert json.loads(capfd.readouterr().out)["checkpoint"] == again["checkpoint"]


@pytest.mark.parametrize("film", [None, 5])
def test_an_interrupted_run_goes_on_with_the_words_of_its_hint(capsys, film):
    result = TrainResult(
        "fast", "my [runs]/it's", "c.pt", None, 3, 4, 1.0, 1.0, None, None, interrupted=True
    )  # fmt: skip
    assert report_result(Console(width=40), "fast", result, Path("my [runs]"), "train", film=film) == cli.INTERRUPTED
    films = [] if film is None else ["--film", "5"]
    out = capsys.readouterr().out
    assert hinted(out, "train") == ["train", "fast", "--resume", "my [runs]/it's", *films]
    assert hinted(out, "play") == ["play", "fast", "--runs", "my [runs]"]


def test_the_replay_of_a_break_is_hinted_in_quotes(capsys):
    result = TrainResult(
        "fast", "my runs/a", "c.pt", None, 3, 4, 1.0, 1.0, None, None, interrupted=False, broken_iterations=1
    )  # fmt: skip
    assert report_result(Console(), "fast", result, Path("my runs"), "train") == cli.FELL_SHORT
    assert "`simwarp replay 'my runs/a/broken.npz'`" in capsys.readouterr().err
