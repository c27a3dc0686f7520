"""`simwarp drive`: manoeuvres with verdicts, of all shipped vehicles, and many speeds or steerings in one batch."""

import json

import pytest

from simwarp.cli.drive.drive_road import with_patches
from simwarp.vehicle.driving.maneuvers import MANEUVERS, maneuver
from simwarp.vehicle.results.runs import set_up
from simwarp.vehicle.spec.vehicle_files import load_vehicle, vehicle_names

STANDARD = tuple(MANEUVERS)[tuple(MANEUVERS).index("iso-3888-1") :]
"""Manoeuvres with verdicts or of standards; the earlier ones have tests of their own."""
JUDGED = ("double-lane-change", "iso-3888-1", "iso-3888-2", "sine-with-dwell", "fishhook", "braking", "split-braking",
          "hill-start")  # fmt: skip


@pytest.mark.parametrize("vehicle", vehicle_names())
@pytest.mark.parametrize("name", STANDARD)
def test_every_manoeuvre_can_be_set_up_for_every_vehicle(vehicle, name):
    spec = load_vehicle(vehicle)
    what = maneuver(name, spec)
    setup = set_up(spec, what, device="cpu", dt=1e-3)
    assert what.duration > 0.0
    assert setup.simulation.model.world_count == 1


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", vehicle_names())
@pytest.mark.parametrize("name", STANDARD)
def test_every_vehicle_drives_every_manoeuvre(command, tmp_path, monkeypatch, vehicle, name):
    """To its end, with a page of plots, results of its own and verdicts where there are rules."""
    monkeypatch.chdir(tmp_path)
    step = "0.001" if vehicle == "artcar" else "0.002"
    code, out, err = command(
        "drive", vehicle, "--maneuver", name, "--dt", step, "--device", "cpu", "--plot", "a.png", "--json", "a.json"
    )
    assert (code, err) == (0, "")
    content = json.loads((tmp_path / "a.json").read_text())
    end = maneuver(name, load_vehicle(vehicle)).duration
    assert content["final"]["t_s"] == pytest.approx(end, abs=0.011)
    assert len(content["results"]) > 4
    assert (content["passed"] is None) == (name not in JUDGED)
    assert bool(content["verdicts"]) == (name in JUDGED)
    assert ("limit" in out) == (name in JUDGED)
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.slow
def test_verdicts_are_printed_and_written(command, tmp_path, monkeypatch):
    """A hill start of the Gator that ends before it has climbed: two rules are kept, one is not."""
    monkeypatch.chdir(tmp_path)
    code, out, _ = command(
        "drive", "gator", "--maneuver", "hill-start", "--slope", "0.1", "--duration", "3.2", "--json", "a.json"
    )
    assert code == 0
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["passed"] is False
    assert [set(row) for row in content["verdicts"]] == [{"rule", "limit", "value", "passed", "unit", "where"}] * 3
    assert [row["passed"] for row in content["verdicts"]] == [True, True, False]
    assert "start: climbed" in out
    assert out.count("FAIL") == 1


@pytest.mark.slow
def test_a_batch_of_speeds_has_a_table_and_the_highest_speed_passed(command, tmp_path, monkeypatch):
    """The sedan passes slowly and fails fast, each row as its run alone."""
    monkeypatch.chdir(tmp_path)
    common = ["drive", "sedan", "--maneuver", "iso-3888-2", "--dt", "0.002", "--device", "cpu"]
    code, out, err = command(*common, "--speeds", "8:20:6", "--plot", "a.png", "--json", "a.json")
    assert (code, err) == (0, "")
    content = json.loads((tmp_path / "a.json").read_text())
    assert [row["speed"] for row in content["rows"]] == [8.0, 14.0, 20.0]
    assert content["rows"][0]["passed"] is True
    assert content["rows"][2]["passed"] is False
    best = max(row["speed"] for row in content["rows"] if row["passed"])
    assert content["highest_passed"] == best
    assert f"highest speed passed: {best:g} m/s" in out
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    code, _, _ = command(*common, "--speed", "14", "--json", "b.json")
    alone = json.loads((tmp_path / "b.json").read_text())
    assert alone["passed"] == content["rows"][1]["passed"]
    values = [[row["value"] for row in each["verdicts"]] for each in (alone, content["rows"][1])]
    assert values[0] == pytest.approx(values[1], abs=1e-12)


def test_patches_of_the_command_line_are_on_the_road_with_the_friction_that_is_given():
    spec = load_vehicle("gator")
    what = with_patches(maneuver("split-braking", spec), [(1.0, 5.0, -2.0, 0.0, 0.09)], 0.9, spec)
    own, laid = what.patches
    assert own == maneuver("split-braking", spec).patches[0]
    assert (laid.x, laid.y, laid.factor) == ((1.0, 5.0), (-2.0, 0.0), pytest.approx(0.1))


@pytest.mark.slow
def test_a_patch_of_ice_lengthens_a_stop_and_stands_in_title_and_files(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    common = ["drive", "gator", "--maneuver", "braking", "--speed", "6", "--dt", "0.002", "--device", "cpu"]
    ice = [*PATCH, "10", "30", "-5", "5", "0.05"]
    distances = []
    for patch in ([], ice):
        code, out, err = command(*common, *patch, "--json", "a.json")
        assert (code, err) == (0, "")
        assert ("friction 0.05 on a patch" in out.splitlines()[1]) == bool(patch)
        assert "at 6 m/s" in " ".join(out.split())
        content = json.loads((tmp_path / "a.json").read_text())
        assert len(content["friction_patches"]) == bool(patch)
        distances.append(content["final"]["x_m"])
    assert distances[1] > distances[0] + 2.0


@pytest.mark.slow
def test_a_batch_of_steerings_is_a_row_each(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = command(
        "drive", "gator", "--maneuver", "fishhook", "--steerings", "0.2,0.4", "--duration", "1", "--dt", "0.002",
        "--device", "cpu", "--json", "a.json",
    )  # fmt: skip
    assert code == 0
    content = json.loads((tmp_path / "a.json").read_text())
    assert [row["steering"] for row in content["rows"]] == [0.2, 0.4]
    assert content["highest_passed"] is None
    assert "highest speed" not in out


def test_an_interruption_of_a_batch_keeps_what_was_recorded(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def stopped(self, t):
        if t > 0.1:
            raise KeyboardInterrupt

    monkeypatch.setattr("simwarp.cli.drive.drive_progress.ManeuverBar.advance", stopped)
    code, out, _ = command(
        "drive", "gator", "--maneuver", "iso-3888-1", "--speeds", "5,6", "--dt", "0.005", "--device", "cpu",
        "--json", "a.json",
    )  # fmt: skip
    assert code == 130
    assert "interrupted: the last rows are missing" in out
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["interrupted"] is True
    assert [row["passed"] for row in content["rows"]] == [False, False]


LANES = ["--maneuver", "iso-3888-1"]
PATCH = ["--friction-patch"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["gator", *LANES, "--speeds", "x"], "--speeds: must be first:last:step, such as 10:25:1"),
        (["gator", *LANES, "--speeds", "9:5:1"], "--speeds: must rise from first to last"),
        (["gator", *LANES, "--speeds", "1:9:0.001"], "--speeds: must be at most 1000 values, got 8001"),
        (["gator", *LANES, "--speeds", "0,5"], "speed: must be in [0.01, 1000], got 0.0"),
        (["gator", *LANES, "--speeds", "5", "--speed", "4"], "--speed: cannot be given beside --speeds"),
        (["gator", *LANES, "--speeds", "5", "--steerings", "0.1"], "--steerings: cannot be given beside --speeds"),
        (["gator", *LANES, "--speeds", "5", "--csv", "a.csv"], "--csv: is of one run, not of many speeds"),
        (["gator", *LANES, "--speeds", "5", "--channels", "Fx_*"], "--channels: is of one run, not of many speeds"),
        (["gator", *LANES, "--speeds", "5", "--view"], "--view shows one run"),
        (["gator", *LANES, "--speeds", "5", "--worlds", "3"], "--worlds: follows from the values"),
        (["gator", *LANES, "--speeds", "5", "--tire", "soil-rigid"], "must be driven on a road, got tires on soil"),
        (["gator", *LANES, "--speeds", "5:900:1", "--dt", "1e-9"], "steps of 1e-09 s"),
        (["gator", "--speeds", "5"], "--speeds: needs a --maneuver that has a speed, such as iso-3888-1"),
        (["gator", "--maneuver", "acceleration", "--speeds", "5"], "speed: no option of the maneuver acceleration"),
        (["gator", "--maneuver", "step-steer", "--speeds", "5,6"], "must have a driver on a path, got a script"),
        (["gator", "--maneuver", "bump", "--speeds", "3,4"], "must have the bump of the first one"),
        (["gator", "--maneuver", "braking", "--speeds", "5", "--plot", "a.png"], "--plot: braking has no lanes"),
        (["gator", "--maneuver", "fishhook", "--steerings", "0.1,2"], "steering: must be in [-1, 1], got 2.0"),
        (["m113", "--maneuver", "accelerate", "--speeds", "5"], "--speeds: 'M113' has tracks"),
        (["gator", "--maneuver", "fishhook", "--dwell", "-1"], "dwell: must be in [0, 10], got -1.0"),
        (["gator", "--maneuver", "split-braking", "--left", "0"], "left: must be in [0.01, 1], got 0.0"),
        (["gator", "--maneuver", "braking", "--brakes", "2"], "brakes: must be in [0, 1], got 2.0"),
        (["gator", "--maneuver", "bump", "--length", "0"], "length: must be in [0.01, 100], got 0.0"),
        (["gator", "--maneuver", "bump", "--length", "0.01", "--speed", "20"], "length: must be at least"),
        (["gator", "--maneuver", "bump", "--height", "x"], "--height must be a number [m], got 'x'"),
        (["gator", "--maneuver", "sine-with-dwell", "--duration", "2"], "duration: must be above 3.68 s"),
        (["gator", "--maneuver", "iso-3888-1", "--left", "0.3"], "left: no option of the maneuver iso-3888-1"),
        (["gator", "--maneuver", "bump", "--tire", "soil-rigid"], "must be driven on tires that are force laws"),
        (["gator", "--maneuver", "slow-steer", "--brakes", "1"], "--brakes: no option of the maneuver slow-steer"),
        (["gator", *LANES, "--speeds", "0,5"], "--speed: must be in [0.01, 1000], got 0.0"),
        (["gator", "--dt", "0"], "--dt must be a positive number"),
        (["gator", "--worlds", "0"], "--worlds must be at least 1"),
        (["run.csv"], "vehicle 'run.csv': must be a shipped one or a JSON file, got a .csv file; drive its inputs by"),
        (["gator", *PATCH, "5", "0", "-2", "2", "0.1"], "X0 and X1 must rise [m], got 5 and 0"),
        (["gator", *PATCH, "0", "5", "2", "2", "0.1"], "Y0 and Y1 must rise [m], got 2 and 2"),
        (["gator", *PATCH, "0", "5", "-2", "2", "0"], "MU must be from 0.0001 to 10, got 0"),
        (["gator", *PATCH, "0", "5", "-2", "2"], "--friction-patch'. Expected 5 values"),
        (["gator", *PATCH, "0", "5", "-2", "2", "x"], "--friction-patch must be a number [X0 X1 Y0 Y1 MU], got 'x'"),
        (["gator", *PATCH, "0", "1e4", "0", "1e3", "0.1"], "all patches must lie within 250000 m²"),
        (
            ["gator", "--tire", "rigid", *PATCH, "0", "5", "0", "2", "0.1"],
            "must be driven on tires that are force laws",
        ),
        (["m113", *PATCH, "0", "5", "0", "2", "0.1"], "--friction-patch: 'M113' has tracks"),
    ],
)
def test_wrong_input_is_one_line(command, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    code, out, err = command("drive", *arguments)
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert err.startswith("simwarp: ")
    assert words in err
