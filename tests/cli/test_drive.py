"""`simwarp drive`: files, results and JSON of a manoeuvre, interruptions, one clear line for each mistake."""

import csv
import json
import subprocess
import sys
import time

import numpy as np
import pytest
import warp as wp
from PIL import Image

from simwarp import cli
from simwarp.vehicle.results import runs
from simwarp.vehicle.results.channels import COLUMNS, Run
from simwarp.vehicle.spec.vehicle_files import load_vehicle, save_vehicle


@pytest.fixture
def drive(capfd, tmp_path, monkeypatch):
    """Run the command in a folder of its own: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        capfd.readouterr()
        code = cli.main(["drive", *arguments])
        out, err = capfd.readouterr()
        return code, out, err

    return run


def test_a_reference_run_with_all_files(drive, tmp_path):
    code, out, err = drive(
        "gator", "--maneuver", "reference-accel", "--csv", "a.csv", "--plot", "a.png", "--json", "a.json"
    )
    assert (code, err) == (0, "")
    assert "time to 5 m/s" in out
    with (tmp_path / "a.csv").open() as file:
        rows = list(csv.reader(file))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == 1 + 2101
    assert (float(rows[1][0]), float(rows[-1][0])) == (-1.0, 20.0)
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["final"]["speed_mps"] == pytest.approx(float(rows[-1][COLUMNS.index("speed_mps")]))
    # the recorded reference: 5 m/s after 0.961 s, 7.94 m/s at most
    assert content["results"]["time_to_5"] == pytest.approx(0.961, abs=0.05)
    assert content["results"]["top_speed"] == pytest.approx(7.94, rel=0.015)
    assert (content["vehicle"], content["maneuver"], content["interrupted"]) == ("gator", "reference-accel", False)
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


def test_pictures_of_a_drive_show_its_ruts(drive, tmp_path):
    (tmp_path / "go.csv").write_text("t_s,throttle\n0,0.7\n1.5,0.7\n")
    pictures = {}
    for soil in ("soft", "hard"):
        arguments = (
            "--tire",
            "soil-rigid",
            "--soil",
            soil,
            "--maneuver",
            "go.csv",
            "--dt",
            "0.002",
            "--spacing",
            "0.1",
        )
        code, out, _ = drive("gator", *arguments, "--video", f"{soil}.png")
        assert code == 0
        assert f"wrote {soil}.png" in out
        pictures[soil] = np.asarray(Image.open(tmp_path / f"{soil}.png"), np.float64).mean(axis=2)
    assert pictures["soft"].shape == (540, 960)
    # deep ruts are darker than shallow ones: on a hundredth of the picture at least
    assert (pictures["soft"] < pictures["hard"] - 15.0).mean() > 0.01


def test_every_vehicle_drives_on_soil_by_the_plain_command(drive, tmp_path):
    """Also the smallest, whose wheels are narrower than twice the nodes' distance below a car."""
    (tmp_path / "go.csv").write_text("t_s,throttle\n0,0.7\n0.1,0.7\n")
    code, out, err = drive("artcar", "--tire", "soil-rigid", "--maneuver", "go.csv", "--dt", "0.002")
    assert code == 0, out + err


@pytest.mark.slow
def test_options_change_the_run(drive):
    def final(*arguments):
        code, out, _ = drive(
            "hmmwv-reduced", "--duration", "4", "--maneuver", "double-lane-change", "--json", "-", *arguments
        )
        assert code == 0
        return json.loads(out)

    usual = final()
    assert usual["friction"] == 0.9
    assert usual["dt"] == 1e-3
    slippery = final("--friction", "0.2")
    assert slippery["results"]["top_speed"] < 0.9 * usual["results"]["top_speed"]
    other = final("--tire", "pacejka89", "--dt", "0.002")
    assert (other["tire"], other["dt"]) == ("pacejka89", 0.002)
    assert 0.0 < abs(other["final"]["speed_mps"] - usual["final"]["speed_mps"]) < 1.0
    assert final("--powertrain", "simplemap")["final"] != usual["final"]
    assert final("--driveline", "rwd")["final"] != usual["final"]
    many = final("--worlds", "3")
    assert many["final"] == usual["final"]
    assert many["worlds"] == 3


def test_the_heading_tells_what_was_chosen(drive):
    arguments = ["--maneuver", "double-lane-change", "--speed", "4", "--duration", "0.2", "--friction", "0.5"]
    code, out, _ = drive("gator", *arguments, "--json", "a.json", "--plot", "a.svg")
    assert code == 0
    assert out.startswith("gator, double-lane-change, speed 4 m/s, duration 0.2 s, friction 0.5\n")
    code, out, _ = drive("gator", "--maneuver", "slope-hold", "--slope", "0.1", "--duration", "0.1", "--json", "-")
    assert json.loads(out)["options"] == {"slope": 0.1, "duration": 0.1}


def test_a_file_drives_like_the_shipped_vehicle(drive, tmp_path):
    save_vehicle(load_vehicle("gator"), tmp_path / "mine.json")
    found = []
    for name in ("mine.json", "gator"):
        code, out, _ = drive(name, "--maneuver", "double-lane-change", "--duration", "2", "--json", "-")
        assert code == 0
        found.append(json.loads(out)["final"])
    assert found[0] == found[1]


def test_a_recorded_run_can_be_driven_again(drive, tmp_path):
    assert drive("gator", "--maneuver", "double-lane-change", "--duration", "3", "--csv", "first.csv")[0] == 0
    assert drive("gator", "--maneuver", "first.csv", "--csv", "again.csv")[0] == 0
    first, again = (Run.read(tmp_path / f"{name}.csv") for name in ("first", "again"))
    assert again["t_s"] == pytest.approx(first["t_s"] + 1.0)
    # inputs between the rows are interpolated
    assert again["speed_mps"] == pytest.approx(first["speed_mps"], abs=0.05)


def test_an_interruption_keeps_what_was_recorded(drive, tmp_path, monkeypatch):
    broken = runs.Drive.broken
    calls = []

    def interrupted(self):
        calls.append(self)
        if len(calls) == 150:
            raise KeyboardInterrupt
        return broken(self)

    monkeypatch.setattr(runs.Drive, "broken", interrupted)
    code, out, _ = drive("gator", "--csv", "a.csv", "--json", "a.json", "--plot", "a.svg")
    assert code == 130
    assert "interrupted at t = 0.50 s; what was recorded is kept" in out
    assert Run.read(tmp_path / "a.csv")["t_s"][-1] == 0.5
    assert json.loads((tmp_path / "a.json").read_text())["interrupted"] is True
    assert (tmp_path / "a.svg").exists()


@pytest.mark.slow
def test_a_signal_interrupts(tmp_path):
    code = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    code += "from simwarp.cli import main; sys.exit(main(sys.argv[1:]))"
    arguments = ["drive", "gator", "--maneuver", "slope-hold", "--duration", "100000", "--csv", "a.csv"]
    process = subprocess.Popen(
        [sys.executable, "-c", code, *arguments], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    # its first line of progress, after ten seconds at most of driving
    assert process.stdout is not None
    assert b"of 100000 s" in process.stdout.readline()
    process.send_signal(2)
    deadline = time.monotonic() + 60.0
    out, _ = process.communicate(timeout=deadline - time.monotonic())
    assert process.returncode == 130, out
    assert b"Traceback" not in out
    assert Run.read(tmp_path / "a.csv")["t_s"][-1] > 1.0


def test_a_vehicle_that_breaks_down_ends_with_one(drive, monkeypatch, tmp_path):
    set_up = runs.set_up

    def harmed(*arguments, **options):
        setup = set_up(*arguments, **options)
        setup.simulation.state.body_v.fill_(wp.vec3(wp.nan))
        return setup

    monkeypatch.setattr("simwarp.cli.drive.drive_command.set_up", harmed)
    code, out, _ = drive("gator", "--csv", "a.csv", "--json", "a.json")
    assert code == 1
    assert "broke down at t = -1.00 s" in out
    assert json.loads((tmp_path / "a.json").read_text())["broken"] is True


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "which vehicle"),
        (["gater"], "did you mean 'gator'"),
        (["gator", "--maneuver", "reference-acel"], "did you mean reference-accel"),
        (["gator", "--maneuver", "none.csv"], "cannot be read"),
        (["gator", "--tire", "fiala"], "unknown tire 'fiala'"),
        (["gator", "--powertrain", "x"], "unknown powertrain 'x'"),
        (["gator", "--driveline", "x.json"], "cannot be read"),
        (["gator", "--friction", "0"], "friction must be a positive number"),
        (["gator", "--friction", "x"], "friction"),
        (["gator", "--dt", "nan"], "--dt must be a finite number"),
        (["gator", "--dt", "1"], "dt must be at most"),
        (["gator", "--worlds", "0"], "worlds must be at least 1"),
        (["gator", "--device", "cuda:7"], "not available"),
        (["gator", "--csv", "/nowhere/a.csv"], "--csv: cannot write '/nowhere/a.csv': folder /nowhere does not exist"),
        (["gator", "--csv", "."], "--csv must name a file, '.' is a folder"),
        (["gator", "--plot", "a.txt"], ".png"),
        (["gator", "--video", "a.txt"], "must end in .mp4, .gif, .png"),
        (["gator", "--maneuver", "slope-hold", "--duration", "500", "--video", "a.mp4"], "at most 120 s"),
        (["gator", "--json", "/nowhere/a.json"], "does not exist"),
        (["gator", "--speed", "3"], "it has none"),
        (["gator", "--maneuver", "step-steer", "--steering", "2"], "steering: must be in [-1, 1], got 2.0"),
        (["gator", "--sped", "3"], "did you mean --speed"),
        (["gator", "--speed", "12 km/h"], "--speed must be a number [m/s], got '12 km/h'"),
        (["gator", "--worlds", "1.5"], "--worlds must be a whole number, got '1.5'"),
        (["gator", "--tire", "x.tir"], "x.tir: a property file is no whole tire; give a .json file"),
        (["gator", "--maneuver", "step-steer", "--duration", "5"], "above 15 s, where the step begins"),
        (["gator", "--maneuver", "short.csv"], "short.csv: line 3: must have 2 numbers"),
        (["gator", "--maneuver", "slope-hold", "--dt", "1e-9"], "61 s in steps of 1e-09 s are 6.1e+10 steps"),
        (["gator", "--maneuver", "slope-hold", "--duration", "1e12"], "are 1e+15 steps, at most 1e+09 are made"),
        (["gator", "--maneuver", "slope-hold", "--duration", "1e9", "--dt", "0.01"], "are 1e+11 steps"),
        (
            ["gator", "--maneuver", "slope-hold", "--duration", "1e-9"],
            "duration: must be at least 0.01, got 1e-09; give seconds",
        ),
        (["gator", "--maneuver", "sine-sweep", "--duration", "3601"], "at most 3600 s of a sweep"),
        (["gator", "--maneuver", "sine-sweep", "--speed", "1e9"], "speed: must be in [0.01, 1000]"),
        (["gator", "--maneuver", "constant-radius", "--radius", "1e14"], "radius: must be at most"),
        (["gator", "--maneuver", "slope-hold", "--friction", "1e30"], "friction: must be from 0.0001 to 10"),
        (["gator", "--maneuver", "slope-hold", "--worlds", "2000000000"], "take fewer worlds"),
        (["none.json"], "cannot be read"),
        (["bad.json"], "unknown key"),
        (["chrono.json"], "chrono.json"),
        (["chrono.json", "--powertrain", "engine.json"], "a comma"),
    ],
)
@pytest.mark.sweep
def test_wrong_input_is_one_line_and_code_two(drive, tmp_path, arguments, words):
    (tmp_path / "bad.json").write_text('{"mass": 3}')
    (tmp_path / "short.csv").write_text("t_s,steer\n0,0\n1\n")
    (tmp_path / "chrono.json").write_text('{"Type": "Vehicle", "Template": "WheeledVehicle"}')
    code, out, err = drive(*arguments)
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert err.startswith("simwarp: ")
    assert words in err


@pytest.mark.parametrize("arguments", [["--duration", "1000"], ["--duration", "3", "--dt", "3e-5"]])
def test_a_record_that_no_memory_holds_is_refused_before_the_run(drive, monkeypatch, arguments):
    monkeypatch.setattr("simwarp.core.memory.free_memory", lambda device: 80 * 2**20)
    code, out, err = drive("gator", "--maneuver", "slope-hold", *arguments)
    assert (code, out) == (2, "")
    assert "the rows of the record need 95.4 MiB" in err
    assert "shorten --duration" in err


def test_help_lists_vehicles_and_manoeuvres(drive):
    code, out, _ = drive("--help")
    assert code == 0
    assert all(name in out for name in ("hmmwv", "artcar", "double-lane-change", "slope-hold"))
    code, out, _ = drive("hmmwv", "--help")
    assert code == 0
    assert "--friction" in out
    words = " ".join(out.replace("│", " ").split())
    assert "(default: 0.3 of step-steer, 0.1 of sine-sweep, 1 of steady-turn and pivot, 0.5 of slow-steer" in words
    assert "speed_target [m/s]" in words
    assert words.count("(default: None)") == 1  # of --json, which all commands have


def test_list_has_the_vehicles_with_their_options(capfd):
    assert cli.main(["list", "--json", "-"]) == 0
    entries = {entry["name"]: entry["summary"] for entry in json.loads(capfd.readouterr().out)["vehicles"]}
    assert {"hmmwv", "hmmwv-reduced", "gator", "artcar", "sedan", "skid-steer"} <= set(entries)
    assert "pacejka2002" in entries["hmmwv"]
    assert np.all([len(line) > 20 for line in entries.values()])


def test_a_manoeuvre_in_a_page_is_the_same_manoeuvre(drive, tmp_path):
    pytest.importorskip("viser")
    common = ["gator", "--maneuver", "constant-radius", "--duration", "0.5"]
    assert drive(*common, "--csv", "plain.csv")[0] == 0
    code, out, err = drive(*common, "--csv", "shown.csv", "--view", "--no-open", "--port", "0")
    assert (code, err) == (0, "")
    assert "view  http://127.0.0.1:" in out
    assert (tmp_path / "plain.csv").read_bytes() == (tmp_path / "shown.csv").read_bytes()


def test_a_manoeuvre_in_a_page_has_rows(drive):
    pytest.importorskip("viser")
    code, _, err = drive("gator", "--dt", "0.003", "--view", "--no-open")
    assert (code, err.count("\n")) == (2, 1)
    assert "--view shows a row every 10 ms, got --dt 0.003; take 0.001" in err


def test_channels_are_listed_and_an_unknown_one_is_refused(drive):
    code, out, _ = drive("gator", "--channels", "list", "--json", "-")
    names = [row["name"] for row in json.loads(out)["channels"]]
    assert code == 0
    assert {"sideslip_rad", "Fx_RR_N", "travel_FL_m"} <= set(names)
    code, _, err = drive("gator", "--channels", "Fx_QQ")
    assert (code, err.count("\n")) == (2, 1)
    assert "got 'Fx_QQ'; did you mean" in err
