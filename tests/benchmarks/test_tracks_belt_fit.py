"""The M113 on belts beside the M113 shoe by shoe: figures that fit within a tenth stay so."""

import json

import pytest

from benchmarks import tracks_belt_fit
from benchmarks.tracks_belt_fit import APART, CASES, RESULTS, compared

FILED = json.loads(RESULTS.read_text(encoding="utf-8"))["cases"]


def filed(name):
    """Figures of the run shoe by shoe that the file has."""
    return {figure: row["shoes"] for figure, row in FILED[name].items()}


def check(name, belt):
    """Every figure but those that are known to be apart."""
    figures = {figure: row for figure, row in compared(belt, filed(name)).items() if (name, figure) not in APART}
    assert figures
    for figure, row in figures.items():
        assert row["ratio"] == pytest.approx(1.0, abs=0.1), (name, figure, row)


def test_the_file_has_all_cases():
    assert FILED.keys() == CASES.keys()
    assert {(name, figure) for name, figures in FILED.items() for figure in figures} >= APART


@pytest.mark.parametrize("name", ["start", "hold 2 m/s, teeth"])
def test_belts_start_and_lose_as_shoes_do(name):
    check(name, CASES[name].run(on_belts=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_belts_do_what_shoes_do(name):
    check(name, CASES[name].run(on_belts=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["start", "turn, full steering", "half round", "towed, clay"])
def test_shoes_do_what_the_file_says(name):
    """On another processor sums of float32 differ: what a run of some seconds makes of that stays below 3 %."""
    found = CASES[name].run(on_belts=False)
    for figure, value in filed(name).items():
        assert found[figure] == pytest.approx(value, rel=0.03, abs=2e-3), figure


def test_named_cases_are_written_and_the_others_kept(tmp_path, monkeypatch, capsys):
    file = tmp_path / "rows.json"
    file.write_text(json.dumps({"cases": {"coast": FILED["coast"], "start": FILED["start"]}}), encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["tracks_belt_fit.py", "--belt", "start", "--json", str(file)])
    tracks_belt_fit.main()
    cases = json.loads(file.read_text(encoding="utf-8"))["cases"]
    assert cases["coast"] == FILED["coast"]
    assert {figure: row["shoes"] for figure, row in cases["start"].items()} == filed("start")
    assert "speed at 3 s [m/s]" in capsys.readouterr().out


def test_an_unknown_case_is_refused_by_name(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["tracks_belt_fit.py", "swim"])
    with pytest.raises(SystemExit):
        tracks_belt_fit.main()
    assert "got 'swim'" in capsys.readouterr().err
