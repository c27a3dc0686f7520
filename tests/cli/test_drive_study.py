"""`simwarp drive --vary` and `--search`: tables, files, interruptions, and what is refused in one line."""

import csv
import json
import os
import signal
import sys

import pytest

from simwarp.cli.drive.study_progress import StudyBar

SHORT = ("drive", "sedan", "--maneuver", "iso-3888-2", "--speed", "14", "--duration", "0.2", "--dt", "0.002",
         "--device", "cpu")  # fmt: skip
MASS = ("--vary", "chassis.components[0].mass=1400..1700")
SEARCH = ("drive", "sedan", "--maneuver", "iso-3888-2", "--duration", "0.2", "--dt", "0.002", "--device", "cpu",
          "--search", "chassis.components[0].mass=1400..1700")  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((*SHORT, *MASS), "--worlds: must be from 2 to 1000000 beside --vary, got 1; 512 is a good beginning"),
        ((*SHORT, *MASS, "--worlds", "0"), "worlds must be at least 1, got 0"),
        ((*SHORT, "--worlds", "4", "--vary", "mass=1..2"), "--vary 'mass': unknown; "),
        ((*SHORT, "--worlds", "4", "--vary", "ground.friction=1..0.5"), "the first number must be below the second"),
        ((*SHORT, "--worlds", "4", "--vary", "axles[1].antiroll_bar.stiffness=1..2"), "unknown; did you mean"),
        ((*SHORT, "--worlds", "4", "--vary", "chassis.components[0].mass=-5..5"), "must be positive, got -5"),
        ((*SHORT, *MASS, "--worlds", "4", "--worst-by", "peak_roll"), "--worst-by: needs --worst"),
        ((*SHORT, *MASS, "--worlds", "4", "--worst", "5"), "--worst must be at most --worlds, got 5 of 4"),
        ((*SHORT, *MASS, "--worlds", "4", "--worst", "99"), "--worst must be from 0 to 20, got 99"),
        ((*SHORT, *MASS, "--worlds", "4", "--batch", "0"), "--batch must be from 1 to"),
        ((*SHORT, *MASS, "--worlds", "4", "--video", "a.mp4"), "--video: is of one run, not of a study"),
        ((*SHORT, *MASS, "--worlds", "4", "--maximise", "margin"), "--maximise: is of --search KEY=LOW..HIGH"),
        ((*SHORT, *MASS, "--worlds", "4", "--speeds", "12,14"), "take maneuver.speed=A,B,C as a key"),
        ((*SHORT, *MASS, "--worlds", "4", "--search", "ground.friction=0.5..1"), "cannot be given beside --vary"),
        (("drive", "m113", *MASS, "--worlds", "4"), "has tracks; studies are for vehicles on wheels"),
        (("drive", "sedan", *MASS, "--worlds", "4"), "needs a --maneuver"),
        (("drive", "sedan", "--maneuver", "iso-9", *MASS, "--worlds", "4"), "simwarp: maneuver 'iso-9' is not known"),
        (SEARCH, "needs one goal, --maximise FIGURE or --minimise FIGURE"),
        ((*SEARCH, "--maximise", "pass_speed"), "needs --speeds A:B:STEP"),
        ((*SEARCH, "--maximise", "margin", "--speeds", "12,14"), "--speeds: is of --maximise pass_speed"),
        ((*SEARCH, "--maximise", "pass_speed", "--speeds", "14,12"), "--speeds: must rise"),
        ((*SEARCH, "--maximise", "margin", "--subject-to", "peak_roll"), "must be \"FIGURE<=X\""),
        ((*SEARCH, "--maximise", "margin", "--trials", "0"), "--trials must be from 1 to"),
        ((*SEARCH, "--maximise", "margin", "--worlds", "8"), "--worlds: is of --vary"),
        ((*SEARCH, "--maximise", "margin", "--csv", "a.csv"), "--csv: is of --vary"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_line(command, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    code, out, err = command(*arguments)
    assert (code, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--worst", "1", "--worst-by", "peak_rol"), "--worst-by: 'peak_rol' is no figure of iso-3888-2; did you mean"),
        (("--worst", "1", "--worst-by", "peak_roll:most"), "--worst-by: must be FIGURE or FIGURE:least"),
    ],
    ids=["figure", "word"],
)
def test_a_figure_that_is_not_there_is_told_before_worlds_are_driven(command, tmp_path, monkeypatch, more, said):
    monkeypatch.chdir(tmp_path)
    code, _, err = command(*SHORT, *MASS, "--worlds", "4", *more)
    assert code == 2
    assert said in err


def test_the_worst_of_a_manoeuvre_without_rules_need_a_figure(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ("drive", "sedan", "--maneuver", "step-input", "--duration", "0.3", "--dt", "0.002", "--device", "cpu")
    code, _, err = command(*arguments, *MASS, "--worlds", "4", "--worst", "1")
    assert code == 2
    assert "step-input has no rules to tell what is worst; give --worst-by with one of " in err


def test_a_search_without_optuna_says_how_to_get_it(command, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    monkeypatch.chdir(tmp_path)
    code, _, err = command(*SEARCH, "--maximise", "margin")
    assert (code, err) == (2, "simwarp: --search needs the package optuna: pip install 'simwarp[sweep]'\n")
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
def test_a_study_writes_table_rows_picture_and_the_worst(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = command(
        *SHORT, *MASS, "--vary", "ground.friction=0.7+-0.05", "--worlds", "5", "--csv", "rows.csv", "--plot", "a.png",
        "--json", "a.json", "--worst", "2", "--worst-by", "peak_roll", "--worst-film", "png", "--out", "worst",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert "rank correlation" in out
    content = json.loads((tmp_path / "a.json").read_text())
    assert (content["worlds"], content["done"], content["broken"]) == (5, 5, 0)
    assert set(content["quantiles"]["peak_roll"]) == {"5", "50", "95"}
    rolls = [row["figures"]["peak_roll"] for row in content["rows"]]
    assert [each["figures"]["peak_roll"] for each in content["worst"]] == sorted(rolls)[:-3:-1]
    with (tmp_path / "rows.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [float(row["peak_roll"]) for row in table] == pytest.approx(rolls)
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert sorted(os.listdir(tmp_path / "worst")) == [
        f"worst_{n}.{kind}" for n in (1, 2) for kind in ("csv", "json", "png")
    ]  # fmt: skip
    # the vehicle of the worst world, driven by itself on its friction, is that world
    worst = content["worst"][0]
    code, _, _ = command(
        *SHORT[:1], "worst/worst_1.json", *SHORT[2:], "--friction", str(worst["values"]["ground.friction"]), "--csv",
        "again.csv",
    )  # fmt: skip
    assert code == 0
    assert (tmp_path / "again.csv").read_text() == (tmp_path / "worst" / "worst_1.csv").read_text()


@pytest.mark.slow
def test_an_interruption_keeps_the_rows_of_whole_batches(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    real = StudyBar.advance

    def advance(self, done, beside=""):
        real(self, done, beside)
        if done > 4.5:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(StudyBar, "advance", advance)
    code, out, _ = command(
        *SHORT, *MASS, "--worlds", "6", "--batch", "2", "--csv", "rows.csv", "--json", "a.json"
    )  # fmt: skip
    assert code == 130
    assert "interrupted: 4 of 6 worlds are done and kept" in out
    content = json.loads((tmp_path / "a.json").read_text())
    assert (content["interrupted"], content["done"]) == (True, 4)
    assert len((tmp_path / "rows.csv").read_text().splitlines()) == 5


def designs(path):
    content = json.loads(path.read_text())
    return content, [(each["values"], each["goal"], each["figures"]) for each in content["designs"]]


@pytest.mark.slow
def test_a_search_that_is_stopped_goes_on_as_if_it_had_not_been(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asked = (*SEARCH, "--maximise", "pass_speed", "--speeds", "12,14", "--subject-to", "peak_roll<=1.5",
             "--trials", "5", "--at-once", "2")  # fmt: skip
    code, _, err = command(*asked, "--out", "whole", "--json", "whole.json")
    assert code in (0, 1), err
    real = StudyBar.advance

    def advance(self, done, beside=""):
        real(self, done, beside)
        if done > 2.5:
            os.kill(os.getpid(), signal.SIGINT)

    with monkeypatch.context() as patched:
        patched.setattr(StudyBar, "advance", advance)
        assert command(*asked, "--out", "parts", "--json", "parts.json")[0] == 130
    assert len(designs(tmp_path / "parts.json")[1]) == 2
    assert command(*asked, "--out", "parts", "--json", "parts.json")[0] == code
    _, expected = designs(tmp_path / "whole.json")
    parts, found = designs(tmp_path / "parts.json")
    assert len(found) == 5
    assert found == expected
    assert parts["built"]["values"] == {"chassis.components[0].mass": 1550.0}
    assert {"search.log", "trials.csv", "search.png"} <= set(os.listdir(tmp_path / "whole"))
    code, _, err = command(*asked[:-4], "--at-once", "2", "--seed", "3", "--out", "whole")
    assert code == 2
    assert "whole holds a search with seed 0, not 3; give another folder" in err


@pytest.mark.slow
def test_a_goal_with_bounds_finds_the_end_of_its_range(command, tmp_path, monkeypatch):
    """A heavier sedan leans more: the least roll with a bound of the mass from below is at the lightest that it allows.

    The figure is monotone in the key, so that the best of all designs that were tried is the lightest one.
    """
    monkeypatch.chdir(tmp_path)
    code, _, err = command(
        *SEARCH, "--speed", "14", "--minimise", "peak_roll", "--subject-to", "entry_speed>=10", "--trials", "6",
        "--at-once", "3", "--out", "found", "--json", "a.json",
    )  # fmt: skip
    assert (code, err) == (0, "")
    content, tried = designs(tmp_path / "a.json")
    assert content["best"]["goal"] == min(goal for _, goal, _ in tried)
    best = json.loads((tmp_path / "found" / "best.json").read_text())
    patch = json.loads((tmp_path / "found" / "patch.json").read_text())
    mass = content["best"]["values"]["chassis.components[0].mass"]
    assert best["chassis"]["components"][0]["mass"] == mass
    assert patch["chassis"]["components"][0]["mass"] == mass
