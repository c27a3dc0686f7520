"""``simwarp reduce``: the file that it writes, and what it refuses."""

import json

import pytest

from simwarp.vehicle.spec.vehicle_files import load_vehicle


@pytest.mark.slow
def test_it_writes_a_vehicle_that_is_read_back(command, tmp_path):
    file, report = tmp_path / "small.json", tmp_path / "report.json"
    options = ("--rows", "3", "--columns", "3", "--output", str(file), "--json", str(report), "--device", "cpu")
    code, out, err = command("reduce", "sedan", *options)
    assert code == 0, err
    assert "wheel rate [N/mm]" in out
    spec, content = load_vehicle(file), json.loads(report.read_text())
    assert spec.is_reduced
    assert content["file"] == str(file)
    assert content["reduced"] == spec.name == "sedan-14dof"
    assert content["parameters"][0]["wheel rate [N/mm]"] > 0.0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("m113",), "has tracks"),
        (("sedan-14dof",), "reduced already"),
        (("skid-steer",), "motors per side"),
        (("sedan", "--columns", "4"), "odd number of columns"),
        (("sedan", "--output", "sedan.txt"), "--output must end in .json"),
        (("sedam",), "sedan"),
    ],
)
def test_what_cannot_be_reduced_is_refused_in_one_line(command, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    code, _, err = command("reduce", *arguments)
    assert code == 2
    assert said in err
    assert len(err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
