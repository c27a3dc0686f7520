"""`simwarp rig`: tables, files and JSON of all rigs, interruptions, one clear line for each mistake."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from simwarp.vehicle import vehicle_names
from simwarp.vehicle.rigs import tire_rig
from simwarp.vehicle.spec.vehicle_files import DATA, save_vehicle
from tests.physics.sample_vehicles import shipped


@pytest.fixture
def rig(command, tmp_path, monkeypatch):
    """Run the command in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: command("rig", *arguments)


def columns(path: str) -> dict[str, list[str]]:
    with Path(path).open() as file:
        rows = list(csv.reader(file))
    return {name: [row[k] for row in rows[1:]] for k, name in enumerate(rows[0])}


@pytest.mark.slow
def test_tires_over_each_other_with_all_files(rig):
    arguments = ("--tires", "fiala", "tmeasy", "--loads", "3000", "6000", "--points", "11")
    code, out, err = rig("tire", "hmmwv", *arguments, "--csv", "a.csv", "--plot", "a.png", "--json", "a.json")
    assert (code, err) == (0, "")
    assert "cornering_stiffness_N_per_rad" in out
    content = json.loads(Path("a.json").read_text())
    assert [entry["tire"] for entry in content["parameters"]] == ["fiala", "fiala", "tmeasy", "tmeasy"]
    assert content["parameters"][0]["cornering_stiffness_N_per_rad"] == pytest.approx(50000.0, rel=2e-3)
    found = columns("a.csv")
    # two tires and loads: a sweep of the slip angle, and one of the slip ratio without and at two slip angles
    assert len(found["Fx_N"]) == content["rows"] == len(content["curves"]["Fx_N"]) == 2 * 2 * 11 * 4
    assert set(found["status"]) == {"done"}
    assert {"slip_ratio", "slip_angle_deg", "inclination_deg", "speed_mps", "Fz_N", "Fy_N", "Mx_Nm"} <= found.keys()
    assert Path("a.png").read_bytes()[:4] == b"\x89PNG"


def test_a_file_of_a_tire_needs_loads(rig):
    name = str(DATA / "hmmwv" / "tires" / "fiala.json")
    code, _, err = rig("tire", name)
    assert (code, err.count("\n")) == (2, 1)
    assert "--loads must be given with the file of a tire" in err
    code, out, _ = rig("tire", name, "--loads", "4000", "--points", "5")
    assert code == 0
    assert "fiala" in out


@pytest.mark.slow
def test_a_suspension_with_all_files(rig):
    code, out, err = rig(
        "suspension", "artcar", "--points", "5", "--csv", "a.csv", "--plot", "a.png", "--json", "a.json"
    )
    assert (code, err) == (0, "")
    assert "double-wishbone" in out
    content = json.loads(Path("a.json").read_text())
    assert content["parameters"]["caster_deg"] == pytest.approx(-2.585, abs=0.01)
    assert content["rows"] == 15
    found = columns("a.csv")
    assert found["motion"] == ["parallel"] * 5 + ["opposite"] * 5 + ["steering"] * 5
    assert found["wheel_rate_L_N_per_mm"][-1] == "nan"  # of no travel
    assert content["curves"]["wheel_rate_L_N_per_mm"][-1] is None


@pytest.mark.slow
def test_forces_on_a_linkage_without_bushings(rig):
    code, out, _ = rig("suspension", "artcar", "--points", "3", "--force", "10", "--json", "a.json")
    assert code == 0
    assert "brake_steer_deg_per_kN" in out
    compliance = json.loads(Path("a.json").read_text())["compliance"]
    assert list(compliance) == ["side", "brake", "drive"]
    assert compliance["side"]["force_N"] == [-10.0, -5.0, 0.0, 5.0, 10.0]


@pytest.mark.slow
def test_a_vehicle_of_a_file_steers(rig):
    save_vehicle(shipped("sedan"), "mine.json")
    code, _, err = rig(
        "steering", "mine.json", "--points", "5", "--json", "a.json", "--plot", "a.svg", "--csv", "a.csv"
    )
    assert (code, err) == (0, "")
    parameters = json.loads(Path("a.json").read_text())["parameters"]
    assert parameters["inner_at_left_lock_deg"] == pytest.approx(35.03, abs=0.01)
    assert float(columns("a.csv")["handwheel_deg"][-1]) == pytest.approx(math.degrees(0.2705260341))


@pytest.mark.slow
def test_a_vehicle_on_a_tilt_table_and_on_posts(rig):
    code, _, _ = rig("full-car", "skid-steer", "--test", "tilt", "--points", "9", "--json", "a.json", "--plot", "a.png")
    assert code == 0
    content = json.loads(Path("a.json").read_text())
    found = content["parameters"]
    assert found["tangent_of_lift_angle"] == pytest.approx(found["static_stability_factor"], rel=0.05)
    assert 0 < content["tipped"] < 9  # those beyond the angle tipped over, which is no failure
    assert content["diverged"] == 0
    reasons = [text for text in content["curves"]["reason"] if text]
    assert len(reasons) == content["tipped"]
    assert all("tipped over: the chassis rolls by" in text for text in reasons)
    code, _, _ = rig(
        "full-car", "artcar", "--test", "road", "--roads", "A", "--duration", "1", "--json", "b.json", "--plot", "b.png"
    )
    assert code == 0
    assert json.loads(Path("b.json").read_text())["parameters"][0]["acceleration_rms_mps2"] > 0.0
    code, _, _ = rig("full-car", "artcar", "--low", "4", "--points", "3", "--json", "c.json", "--plot", "c.png")
    assert code == 0
    assert json.loads(Path("c.json").read_text())["parameters"]["heave_peak"] > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", vehicle_names())
def test_every_shipped_vehicle_runs(rig, name):
    spec = shipped(name)
    assert rig("tire", name, "--points", "5")[0] == 0
    assert rig("steering", name, "--points", "5")[0] == (0 if spec.steerings else 2)
    for axle, part in enumerate(spec.axles):
        rigid = part.suspension.template == "rigid-suspension"
        assert rig("suspension", name, "--axle", str(axle), "--points", "5")[0] == (2 if rigid else 0)
    assert rig("full-car", name, "--low", "5", "--points", "2", "--modes", "heave", "pitch", "roll")[0] == 0


def test_an_interruption_keeps_what_is_done(rig, monkeypatch):
    """The second tire is interrupted: the first one is written."""
    whole = tire_rig.run_tire_rig
    asked = []

    def interrupted(tire, sweep, **options):
        asked.append(tire)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return whole(tire, sweep, **options)

    monkeypatch.setattr("simwarp.cli.rig.tire_command.run_tire_rig", interrupted)
    code, out, _ = rig("tire", "hmmwv", "--tires", "fiala", "tmeasy", "--points", "5", "--csv", "a.csv")
    assert code == 130
    assert "interrupted; the rows that are done are kept" in out
    assert set(columns("a.csv")["tire"]) == {"fiala"}


@pytest.mark.slow
def test_a_world_that_diverges_is_marked_and_not_fatal(rig):
    code, out, _ = rig("suspension", "artcar", "--travel", "0.2", "--points", "21", "--csv", "a.csv")
    assert code == 1  # some fell short
    assert "rows diverged: see the columns status and reason" in out
    found = columns("a.csv")
    status = np.array(found["status"])
    assert {"done", "diverged"} == set(status)
    # each says which joint stays open, and at which travel that was asked
    for ended, reason, travel in zip(status, found["reason"], found["travel_L_mm"], strict=True):
        assert ("the linkage does not close: joint 'axle." in reason) == (ended == "diverged")
        assert math.isfinite(float(travel))
    told = [line for line in out.splitlines() if "the linkage does not close" in line]
    assert [line.split(",")[0].strip() for line in told] == ["motion parallel", "motion opposite"]
    assert "likewise" in out


def test_a_load_beyond_the_tire_is_told_in_one_line_and_the_others_stay(rig):
    arguments = ("--loads", "4000", "4e6", "--points", "3", "--combined", "--csv", "a.csv", "--json", "a.json")
    code, out, _ = rig("tire", "hmmwv", *arguments)
    assert code == 1
    lines = [line for line in out.splitlines() if "the tire bears" in line]
    assert len(lines) == 1
    assert "Fz_N 4000000: the tire bears" in lines[0]
    assert "and 5 more, likewise" in out
    content = json.loads(Path("a.json").read_text())
    assert (content["rows"], content["diverged"]) == (12, 6)
    assert [bool(text) for text in content["curves"]["reason"]] == [
        ended == "diverged" for ended in columns("a.csv")["status"]
    ]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "which rig? usage: simwarp rig tire|suspension|steering|full-car"),
        (("wheel", "sedan"), "unknown rig 'wheel'"),
        (("tire",), "which vehicle? usage: simwarp rig tire"),
        (("steering", "m113"), "'M113' has tracks; a rig holds vehicles on wheels"),
        (("suspension", "gator", "--axle", "1"), "must have a suspension that travels, got 'rigid-suspension'"),
        (("suspension", "sedan", "--axle", "2"), "axle: must be from 0 (front) to 1 of 'sedan', got 2"),
        (("suspension", "sedan", "--travel", "0"), "travel: must be > 0 m, got 0: the range would be empty"),
        (("steering", "skid-steer"), "'skid-steer' has no steered axle"),
        (("tire", "no.json"), "no.json: cannot be read"),
        (("tire", "sedan", "--tires", "rigid"), "got 'rigid'; take another tire"),
        (("tire", "sedan", "--slip", "0"), "slip: must be > 0"),
        (("tire", "sedan", "--plot", "a.jpg"), "the name must end in .png, .pdf, .svg"),
        (("full-car", "sedan", "--low", "5", "--high", "2"), "frequencies: must be 0 < low < high"),
        (("full-car", "sedan", "--tire", "rigid"), "got 'rigid'; take another tire"),
        (("full-car", "sedan", "--angle", "90"), "--angle must be above 0 and below 80 deg"),
        (("full-car", "sedan", "--test", "tilt", "--angle", "20", "--points", "1"), "points: must be 3 or more angles"),
        (("full-car", "sedan", "--test", "road", "--duration", "0.001"), "duration: must be finite and at least 0.1 s"),
    ],
)
def test_what_cannot_work_is_one_line(rig, words, message):
    code, out, err = rig(*words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_help_names_the_rigs(rig):
    assert "full-car" in rig("--help")[1]
    assert "--inclinations" in rig("tire", "--help")[1]
