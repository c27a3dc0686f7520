"""The oracle can fail: every class of failure is seen where it is made on purpose, and nothing else is."""

import json
import operator
import sys
import time
import warnings
from pathlib import Path

import pytest

from simwarp.core.files import FileError
from tests.campaign import oracle
from tests.campaign.hostile import ACCEPT, EITHER, REFUSE
from tests.campaign.oracle import CallAttack, CommandAttack, Outcome, attack_call, attack_command
from tests.campaign.sandbox import Sandbox
from tests.campaign.tally import Tally

ERROR = "simwarp: --seed must be a whole number, got 'x'\n"


@pytest.fixture
def sandbox(tmp_path):
    return Sandbox(tmp_path)


def tell(text, code=2):
    def main(words):
        sys.stderr.write(text)
        return code

    return main


def broken(*_):
    raise ZeroDivisionError("no such thing")


def replaced(*_):
    Path("null").unlink(missing_ok=True)
    Path("null").write_text("a file now")
    return 0


def warned(*_):
    warnings.warn("overflow encountered", RuntimeWarning, stacklevel=1)
    return 0


def left(name):
    def main(words):
        Path(name).write_text("left")
        sys.stderr.write(ERROR)
        return 2

    return main


@pytest.mark.parametrize(
    ("main", "verdict", "failure"),
    [
        (tell(ERROR), REFUSE, ""),
        (tell("", 0), ACCEPT, ""),
        (tell("", 1), EITHER, ""),
        (tell("", 0), REFUSE, "silent acceptance"),
        (tell(ERROR), ACCEPT, "refusal of what is right"),
        (broken, REFUSE, "traceback"),
        (tell("", 3), EITHER, "exit code"),
        (tell(ERROR + "and more\n"), REFUSE, "not one line"),
        (tell("wrong\n"), REFUSE, "not one line"),
        (tell("simwarp: wrong value\n"), REFUSE, "names nothing"),
        (tell(ERROR[:-1] + "9" * 2000 + "\n"), REFUSE, "too long"),
        (replaced, EITHER, "bystander"),
        (warned, EITHER, "warning"),
        (left("new.txt"), REFUSE, "trace of a refusal"),
        (left(".simwarp-abc"), REFUSE, "draft left"),
        (left("notes.txt"), REFUSE, "bystander"),
        (left("../../outside"), REFUSE, "trace of a refusal"),
        (left("link"), REFUSE, "bystander"),
    ],
)
def test_command_lines(main, verdict, failure, sandbox):
    attack = CommandAttack("a try", verdict, ("seed",), ("train", "--seed", "x"))
    assert attack_command(attack, sandbox, main).failure == failure
    assert not sandbox.changes()


def test_what_may_be_written_is_no_bystander(sandbox):
    def main(words):
        Path("notes.txt").write_text("asked for")
        return 0

    attack = CommandAttack("a try", EITHER, (), ("list",), outputs=("notes.txt",))
    assert attack_command(attack, sandbox, main).failure == ""


def test_a_refusal_that_changes_what_it_was_given(sandbox):
    def main(words):
        Path("config.json").write_text("{}")
        return tell(ERROR)(words)

    attack = CommandAttack("a try", REFUSE, ("seed",), ("train",), (("config.json", b"[]"),))
    assert attack_command(attack, sandbox, main).failure == "bystander"


def test_a_hang_is_ended(sandbox, monkeypatch):
    monkeypatch.setattr(oracle, "HANG", 0.05)

    def main(words):
        try:
            time.sleep(5)
        except Exception:  # noqa: BLE001 - what the product might do
            return 0

    assert attack_command(CommandAttack("a try", EITHER), sandbox, main).failure == "hang"


def raises(error):
    def call():
        raise error

    return call


@pytest.mark.parametrize(
    ("call", "verdict", "failure"),
    [
        (raises(FileError("mass must be > 0")), REFUSE, ""),
        (lambda: 1, ACCEPT, ""),
        (raises(FileError("wrong")), REFUSE, "names nothing"),
        (raises(FileError("mass\nwrong")), REFUSE, "not one line"),
        (raises(KeyError("mass")), REFUSE, "traceback"),
        (raises(TypeError("got an unexpected keyword argument 'mass'")), REFUSE, ""),
        (raises(TypeError("mass cannot be copied")), REFUSE, ""),
        (lambda: operator.lt(1, "mass"), REFUSE, "traceback"),
        (lambda: 1, REFUSE, "silent acceptance"),
        (raises(FileError("mass")), ACCEPT, "refusal of what is right"),
        (warned, EITHER, "warning"),
        (lambda: print("noise"), EITHER, "words on the terminal"),
    ],
)
def test_calls(call, verdict, failure):
    assert attack_call(CallAttack("a try", verdict, ("mass",), call)).failure == failure


def test_figures_are_written(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMWARP_CAMPAIGN_REPORT", str(tmp_path / "report.json"))
    for name in ("one", "two", "one"):
        tally = Tally(name, 3)
        tally.add(CallAttack("a try", REFUSE), Outcome("refused"))
        tally.check()
    tally.add(CallAttack("another", REFUSE), Outcome("accepted", "silent acceptance"))
    with pytest.raises(AssertionError, match="1 of 2 failed"):
        tally.check()
    two, one = json.loads((tmp_path / "report.json").read_text())["fronts"]
    assert (two["front"], two["examples"], two["results"], two["seed"]) == ("two", 1, {"refused": 1}, 3)
    assert (one["examples"], one["failures"]) == (2, {"silent acceptance": 1})
