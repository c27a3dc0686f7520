"""`simwarp drive m113`: records, plots, files and options of vehicles on tracks; one clear line for each mistake."""

import csv
import json

import numpy as np
import pytest
from PIL import Image

from simwarp import cli
from simwarp.cli.listing import catalogue
from simwarp.cli.view.view_target import find_target
from simwarp.vehicle import load_tracked_vehicle, save_tracked_vehicle
from simwarp.vehicle.driving.track_maneuvers import TRACK_MANEUVERS
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.track_readings import track_columns

GO = "t_s,throttle,steering\n0,0,0\n0.02,0.7,0\n{end},0.7,0.3\n"


@pytest.fixture
def drive(capfd, tmp_path, monkeypatch):
    """Run the command in a folder of its own: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "go.csv").write_text(GO.format(end=0.2))
    (tmp_path / "short.csv").write_text(GO.format(end=0.04))

    def run(*arguments):
        capfd.readouterr()
        code = cli.main(["drive", *arguments])
        out, err = capfd.readouterr()
        return code, out, err

    return run


def test_a_short_run_with_all_files(drive, tmp_path):
    files = ("--csv", "a.csv", "--chains", "c.svg", "--export-scene", "a.glb")
    code, out, err = drive("m113", "--maneuver", "go.csv", *files, "--json", "a.json")
    assert (code, err) == (0, "")
    assert "gain of energy" in out
    with (tmp_path / "a.csv").open() as file:
        rows = list(csv.reader(file))
    assert tuple(rows[0]) == track_columns((5, 5))
    assert len(rows) == 1 + 21
    run, content = Run.read(tmp_path / "a.csv"), json.loads((tmp_path / "a.json").read_text())
    assert all(np.isfinite(values).all() for values in run.columns.values())
    assert content["final"]["speed_mps"] == pytest.approx(run["speed_mps"][-1])
    assert (content["vehicle"], content["maneuver"], content["tire"]) == ("M113", "go.csv", None)
    # the inputs of the file, linear between its rows
    assert run["throttle"][1:3] == pytest.approx([0.35, 0.7], abs=1e-6)
    assert run["steer"][-1] == pytest.approx(0.3, abs=0.01)
    # pins bear what the tensioners leave to each run, and no pin less than that of the loosest half
    late = run["t_s"] > 0.1
    for side in ("L", "R"):
        assert (run[f"pin_max_{side}_N"] >= run[f"pin_mean_{side}_N"]).all()
        assert run[f"pin_mean_{side}_N"][late].mean() == pytest.approx(run[f"tension_{side}_N"][late].mean(), rel=0.15)
        assert (run[f"idler_{side}_m"][late] < -3.95).all()  # pushed to the rear until the chain is taut
    for name in ("c.svg", "a.glb"):
        assert (tmp_path / name).stat().st_size > 10_000, name


def test_a_file_drives_like_the_shipped_vehicle_and_a_record_again(drive, tmp_path):
    save_tracked_vehicle(load_tracked_vehicle("m113"), tmp_path / "mine.json")
    found = []
    for name, maneuver, kept in (("mine.json", "short.csv", "first.csv"), ("m113", "first.csv", "again.csv")):
        code, out, _ = drive(name, "--maneuver", maneuver, "--csv", kept, "--json", "-")
        assert code == 0
        found.append(json.loads(out)["final"])
    # inputs have nine digits in a file, and contacts of shoes magnify what is left out
    assert found[0]["x_m"] == pytest.approx(found[1]["x_m"], abs=1e-4)


def test_options_of_the_driveline(drive):
    code, out, _ = drive("m113", "--driveline", "simple", "--maneuver", "short.csv", "--worlds", "2", "--json", "-")
    assert code == 0
    content = json.loads(out)
    assert (content["driveline"], content["worlds"]) == ("simple", 2)


def test_it_is_listed_viewed_and_told_of_in_help(drive):
    assert "tracks of 63 and 64 shoes" in catalogue("simwarp.vehicle.spec.catalogue")["m113"]
    assert find_target("m113").kind == "vehicle"
    code, out, _ = drive("--help")
    assert code == 0
    assert "m113" in out
    assert all(name in out for name in TRACK_MANEUVERS)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["m114"], "did you mean 'm113'"),
        (["m113", "--maneuver", "step-steer"], "'step-steer' is for vehicles on wheels, got 'M113' on tracks"),
        (["gator", "--maneuver", "pivot"], "'pivot' is for vehicles on tracks, got 'gator' on wheels"),
        (["m113", "--maneuver", "acelerate"], "did you mean accelerate"),
        (["m113", "--tire", "tmeasy"], "--tire: 'M113' has tracks, which drive on rigid ground; leave it out"),
        (["m113", "--soil", "soft"], "--soil: 'M113' has tracks"),
        (["m113", "--spacing", "0.1"], "--spacing: 'M113' has tracks"),
        (["m113", "--soil-normal", "surface"], "--soil-normal: 'M113' has tracks"),
        (["m113", "--driveline", "4wd"], "unknown driveline '4wd'; known: simple"),
        (["m113", "--powertrain", "x"], "unknown powertrain 'x'"),
        (["m113", "--speed", "3"], "speed: no option of the maneuver accelerate; it has duration"),
        (["m113", "--maneuver", "steady-turn", "--duration", "5"], "above 7 s, where the turn begins"),
        (["m113", "--maneuver", "slope", "--duration", "2"], "above 6 s, where the brakes hold"),
        (["m113", "--maneuver", "obstacle", "--radius", "-1"], "radius: must be above 0 m"),
        (["m113", "--maneuver", "trench", "--width", "0"], "width: must be"),
        (["m113", "--maneuver", "trench", "--width", "x"], "--width must be a number [m], got 'x'"),
        (["gator", "--chains", "a.png"], "--chains: 'gator' has wheels and no chains; take --plot"),
        (["m113", "--chains", "a.txt"], "must end in .png"),
        (["half.json"], "half.json: left.track: missing; give one of shoes, belt"),
        (["chrono.json"], "chrono.json"),
    ],
)
def test_wrong_input_is_one_line_and_code_two(drive, tmp_path, arguments, words):
    (tmp_path / "half.json").write_text('{"left": {}, "right": {}}')
    (tmp_path / "chrono.json").write_text('{"Type": "Vehicle", "Template": "TrackedVehicle"}')
    code, out, err = drive(*arguments)
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert err.startswith("simwarp: ")
    assert words in err


@pytest.mark.slow
def test_a_picture_shows_the_hull(drive, tmp_path):
    """Behind the vehicle: olive in the middle, where the ground of asphalt is grey."""
    assert drive("m113", "--maneuver", "short.csv", "--video", "a.png", "--plot", "a.svg")[0] == 0
    picture = np.asarray(Image.open(tmp_path / "a.png"), np.float64)
    assert picture.shape == (540, 960, 3)
    olive = picture[..., 1] > picture[..., 2] + 15.0
    assert 0.02 < olive.mean() < 0.5
    assert (tmp_path / "a.svg").stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(TRACK_MANEUVERS))
def test_whole_manoeuvres(drive, name):
    code, out, _ = drive("m113", "--maneuver", name, "--csv", "a.csv", "--json", "-")
    assert code == 0
    content = json.loads(out)
    found = content["results"]
    assert not content["broken"]
    # friction and damping take energy, and nothing but the engine gives any: 1 % of its work for samples 10 ms apart
    assert found["losses"] > -0.01 * abs(found["engine_work"])
    assert abs(content["final"]["roll_rad"]) < 0.1
    if name == "accelerate":
        # recorded with this driveline: 2 m/s after 1.2 s, 6.0 m/s at most; dry teeth take half of the torque at speed
        assert 1.2 < found["time_to_2"] < 2.0
        assert 3.0 < found["top_speed"] < 6.0
    if name in ("obstacle", "trench"):
        assert found["crossed_after"] < 9.0
        assert found["nose_up"] + found["nose_down"] > 2.0  # degrees, as a level road never shows
    if name == "brake":
        # at rest within the friction of the shoes, 0.8, and no faster
        assert found["stopping_distance"] > 0.9 * found["braking_from"] ** 2 / (2.0 * 0.8 * 9.81)
        assert found["stopping_distance"] < 8.0
    if name == "slope":
        assert found["climbed"] > 1.0
        assert abs(found["held"]) < 100.0
    if name == "drawbar":
        # below what the shoes' friction of 0.8 takes of the weight, 111 kN
        assert 5e3 < found["greatest_pull"] < 0.8 * 111e3
