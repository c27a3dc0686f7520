"""All shipped vehicles through all that lists vehicles: the names are those of their files, whichever there are."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

import simwarp
from simwarp import cli
from simwarp.cli.view.vehicle_subject import vehicle_subject
from simwarp.cli.view.view_target import find_target
from simwarp.tasks import make
from simwarp.tasks.driving import DRIVEN_VEHICLES
from simwarp.vehicle import Drive, Vehicle, load_vehicle, maneuver, option_names, set_up, vehicle_names, with_options
from simwarp.vehicle.driving.maneuvers import MANEUVERS
from simwarp.vehicle.driving.track_maneuvers import TRACK_MANEUVERS
from simwarp.vehicle.results.road import TURN_REACH, check_own_ground, road_window
from simwarp.vehicle.roads import random_road
from simwarp.vehicle.roads.random_roads import MOST_NODES, SPACING
from simwarp.vehicle.spec.catalogue import catalogue
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.tracked_vehicle_spec import TrackedVehicleSpec
from simwarp.vehicle.spec.vehicle_files import DATA, REDUCED, TRACKED, plain, reduced_vehicle_names
from simwarp.vehicle.tracks.tracked_files import ON_BELTS, all_vehicle_names, load_any_vehicle
from tests.reference.json_schema import fits

NAMES = all_vehicle_names()
FILES = {path.stem for folder in (DATA, REDUCED, TRACKED) for path in folder.glob("*.json")}
ROAD = "iso8608:C:2"
PARSED = {
    "drive": ("--dt", "0", "dt must be a positive number, got 0"),
    "view": ("--seconds", "0", "seconds must be positive"),
    "export-fmu": ("--dt", "0", "--dt must be above 0"),
    "ros2": ("--wait-for", "/cmd_vel", "--wait-for"),
    "trim": ("--output", "a.txt", "output"),
    "reduce": ("--output", "a.txt", "--output must end in .json"),
    "rig full-car": ("--plot", "a.txt", "the name must end in .png"),
    "rig suspension": ("--plot", "a.txt", "the name must end in .png"),
    "rig steering": ("--plot", "a.txt", "the name must end in .png"),
    "rig tire": ("--plot", "a.txt", "the name must end in .png"),
}
"""Command -> a wrong option that is answered after the vehicle's name was read, and the answer."""
ON_WHEELS = ("trim", "reduce", "rig full-car", "rig suspension", "rig steering", "rig tire")


def tracked(name):
    return isinstance(load_any_vehicle(name), TrackedVehicleSpec)


def maneuvers_of(spec):
    return TRACK_MANEUVERS if isinstance(spec, TrackedVehicleSpec) else MANEUVERS


def on_level_ground(name, spec):
    """A manoeuvre, or None and why it is none of level ground."""
    try:
        what = maneuver(name, spec)
        check_own_ground(what)
    except SpecError as error:
        return None, str(error)
    return what, ""


def one_line(err):
    return len(err.strip().splitlines()) == 1 and "Traceback" not in err


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_catalogue_has_every_file(command):
    assert len(set(NAMES)) == len(NAMES)
    assert set(NAMES) >= FILES
    assert {name.removesuffix(ON_BELTS) for name in NAMES} == FILES
    code, out, _ = command("list", "--json", "-")
    assert code == 0
    listed = {each["name"]: each["summary"] for each in json.loads(out)["vehicles"]}
    assert listed == catalogue()
    assert list(listed) == NAMES
    assert all("chassis" in line and "\n" not in line for line in listed.values())
    for name, trailers in (("truck-semitrailer", 1), ("sedan-trailer", 1), ("sedan", 0)):
        assert listed[name].count("trailer") == trailers
    words = json.loads((Path(simwarp.__file__).parent / "data" / "completions.json").read_text(encoding="utf-8"))
    assert words["words"]["vehicles"] == sorted(NAMES)


@pytest.mark.parametrize("name", vehicle_names())
def test_it_takes_its_options(name):
    spec = load_vehicle(name)
    for kind in ("tire", "powertrain", "driveline"):
        for option in option_names(name, kind):
            assert with_options(spec, **{kind: option}).name == name


def test_vehicles_of_tasks_are_shipped_ones():
    assert set(DRIVEN_VEHICLES) <= set(NAMES)
    assert {driven.full_name for driven in DRIVEN_VEHICLES.values()} <= set(vehicle_names())


@pytest.mark.parametrize("name", ["drive", "export-fmu"])
def test_overviews_have_every_vehicle(command, name):
    code, out, _ = command(name, "--help")
    assert code == 0
    listed = out.partition("vehicles: ")[2].partition(", or a JSON file")[0]
    assert listed.split(", ") == NAMES


@pytest.mark.parametrize("words", PARSED)
@pytest.mark.parametrize("name", NAMES)
def test_commands_take_the_name(command, here, name, words):
    option, value, message = PARSED[words]
    code, _, err = command(*words.split(), name, option, value)
    assert code == 2
    assert one_line(err)
    assert message in err or (words in ON_WHEELS and tracked(name) and "tracks" in err)


@pytest.mark.parametrize("name", NAMES)
def test_its_file_fits_the_schema(name):
    spec = load_any_vehicle(name)
    kind = "tracked_vehicle" if tracked(name) else "vehicle"
    schema = json.loads((Path(simwarp.__file__).parent / "data" / f"{kind}.schema.json").read_text(encoding="utf-8"))
    assert fits(json.loads(json.dumps(plain(spec))), schema, schema)


@pytest.mark.parametrize("name", NAMES)
def test_every_maneuver_is_made_for_it_or_refused_in_one_line(name):
    """Those of its kind; the ground of random roads holds the start of each."""
    spec = load_any_vehicle(name)
    for each in maneuvers_of(spec):
        what, reason = on_level_ground(each, spec)
        if what is None:
            assert one_line(reason)
            continue
        (left, right), (low, high) = road_window(what)
        assert left < -5.0
        assert right > 5.0
        assert low < -5.0
        assert high > 5.0


@pytest.mark.parametrize("name", NAMES)
def test_a_step_on_a_road_by_a_script_and_in_a_page(name):
    assert find_target(name).kind == "vehicle"
    spec = load_any_vehicle(name)
    road = random_road("C", seed=2, x=(-20.0, 20.0), y=(-20.0, 20.0))
    usual = "accelerate" if tracked(name) else "reference-accel"
    setup = set_up(spec, maneuver(usual, spec), device="cpu", road=road)
    subject = vehicle_subject(name, 1, "cpu", road=ROAD)
    for simulation in (setup.simulation, subject.simulation):
        simulation.step()
        places = simulation.state.body_x.numpy()
        assert np.isfinite(places).all()
        assert places[..., 2].max() > 0.1


@pytest.mark.parametrize("name", NAMES)
def test_a_task_takes_it_or_says_which(command, here, name):
    """`--task.vehicle`: those of `DRIVEN_VEHICLES` take a step, others are refused with their names."""
    if name in DRIVEN_VEHICLES:
        task = make("obstacle-avoidance", 1, obs="state", vehicle=name)
        task.step(torch.zeros((1, task.action_size)))
        assert np.isfinite(task.simulation.state.body_x.numpy()).all()
        return
    code, _, err = command("play", "obstacle-avoidance", "--task.vehicle", name)
    assert code == 2
    assert one_line(err)
    assert ", ".join(DRIVEN_VEHICLES) in err


def driven_on(name, folder, *options):
    """Exit code and content of half a second of a drive."""
    script = "t_s,throttle,braking\n0,0,1\n0.5,0,1\n0.5,0.6,0\n2,0.6,0\n"
    (folder / "inputs.csv").write_text(script)
    code = cli.main(["drive", name, "--maneuver", "inputs.csv", "--json", "a.json", "--device", "cpu", *options])
    return code, json.loads((folder / "a.json").read_text())


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_it_is_driven_on_a_plane_and_on_a_road(here, name):
    code, plane = driven_on(name, here, "--csv", "a.csv", "--plot", "a.png")
    assert code == 0
    code, road = driven_on(name, here, "--road", ROAD, "--video", "b.png")
    assert code == 0
    for content in (plane, road):
        assert not content["broken"]
        assert content["left_road_s"] is None
        assert content["final"]["x_m"] > 0.05
    # class C: centimetres
    assert road["final"]["z_m"] != pytest.approx(plane["final"]["z_m"], abs=1e-4)
    assert abs(road["final"]["z_m"] - plane["final"]["z_m"]) < 0.5
    assert (here / "b.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.slow
@pytest.mark.parametrize("name", vehicle_names())
def test_it_stands_in_a_page_with_all_of_its_units(name):
    """At rest on asphalt: each body that is drawn is there, and nothing breaks in half a second."""
    subject = vehicle_subject(name, 1, "cpu")
    assert subject.advance is not None
    for _ in range(25):
        subject.advance()
    vehicle = subject.elements["vehicle"]
    assert isinstance(vehicle, Vehicle)
    drawn = set(subject.scene.body.tolist())
    assert {unit.chassis for unit in vehicle.parts.units} <= drawn
    assert {side.spindle for side in vehicle.parts.sides} <= drawn
    assert subject.simulation.problems() == []


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_it_is_viewed_and_driven_by_hand_on_a_road(command, here, name):
    common = ("view", name, "--road", ROAD, "--no-open", "--device", "cpu")
    code, out, _ = command(*common, "--seconds", "0.5", "--record", "a.html")
    assert code == 0
    assert "wrote a.html" in out
    code, out, _ = command(*common, "--seconds", "2", "--drive")
    assert code == 0
    assert "view  http://127.0.0.1:" in out


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_all_other_commands_run_or_say_why_not(command, here, name):
    assert command("export-fmu", name, "--output", "a.fmu")[0] == 0
    runs = {
        "trim": (), "reduce": ("--rows", "3", "--columns", "3"), "rig tire": ("--points", "5", "--loads", "3000"),
        "rig steering": ("--points", "5"), "rig suspension": ("--points", "5"),
        "rig full-car": ("--test", "road", "--roads", "C", "--duration", "0.5"),
    }  # fmt: skip
    refused = []
    for words, options in runs.items():
        code, _, err = command(*words.split(), name, *options)
        if code == 2:
            refused.append(words)
            assert one_line(err), (words, err)
        else:
            assert code == 0, (words, err)
    if tracked(name):
        assert refused == list(runs)
    elif name in reduced_vehicle_names():  # there are no linkages
        assert refused == [words for words in runs if words != "rig tire"]
    else:
        assert "rig tire" not in refused
        assert "rig full-car" not in refused


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_maneuvers_stay_on_the_road_that_is_made_for_them(name):
    """Without the manoeuvres' own ground, none ends where there is no ground, but on roads as large as they can be."""
    spec = load_any_vehicle(name)
    driven = []
    for each in maneuvers_of(spec):
        what, _ = on_level_ground(each, spec)
        if what is None or what.drawbar is not None:
            continue
        if isinstance(spec, TrackedVehicleSpec) and not spec.on_belts and what.duration > 6.0:
            continue  # soil alone; and chains take a minute for twenty seconds
        window = road_window(what)
        drive = Drive(set_up(spec, what, device="cpu", dt=0.002, road=random_road("A", x=window[0], y=window[1])))
        run = drive.run()
        nodes = np.prod(np.diff(window, axis=1)[:, 0] / SPACING)
        if drive.left_road is None:
            assert run["t_s"][-1] == pytest.approx(what.duration, abs=0.02), each
        else:  # in a wide circle, say, or rolled over
            assert nodes > 0.95 * MOST_NODES or window[1][1] >= TURN_REACH, (each, window, run.final())
            assert run["t_s"][-1] == pytest.approx(drive.left_road, abs=0.02), each
        driven.append(each)
    assert driven
