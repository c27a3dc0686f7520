"""`simwarp drive --road`: a level road is a plane, its map of friction is friction, soils lie where they are drawn, and
wrong roads are refused in one line."""

import json

import numpy as np
import pytest

from simwarp import cli
from simwarp.vehicle import load_vehicle, save_vehicle, with_options

STRAIGHT = "t_s,steering,throttle,braking\n0,0,0,1\n0.5,0,0,1\n0.5,0,1,0\n1.5,0,1,0\n1.5,0,0,1\n2.5,0,0,1\n"


@pytest.fixture
def drive(capfd, tmp_path, monkeypatch):
    """Run the command in a folder of its own with a script and the bitmaps of a level road."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "inputs.csv").write_text(STRAIGHT)
    np.save("level.npy", np.zeros((3, 9)))
    np.save("slippery.npy", np.full((2, 2), 0.3))
    np.save("soil.npy", np.array([[0, 1]]))

    def run(*arguments):
        capfd.readouterr()
        code = cli.main(["drive", *arguments])
        out, err = capfd.readouterr()
        return code, out, err

    return run


def write_road(name, **further):
    content = {"origin": [-20.0, -10.0], "size": [80.0, 20.0], "height": {"pixels": "level.npy"}, **further}
    with open(name, "w") as file:
        json.dump(content, file)
    return name


def remarks(err):
    """Lines of standard error, but for those that a first run compiles."""
    return [line for line in err.splitlines() if "compiling kernels" not in line]


def final(drive, *arguments):
    code, _, err = drive("hmmwv-reduced", "--maneuver", "inputs.csv", "--json", "a.json", *arguments)
    assert (code, remarks(err)) == (0, [])
    with open("a.json") as file:
        return json.load(file)["final"]


def test_a_level_road_is_a_plane(drive):
    plane = final(drive)
    road = final(drive, "--road", write_road("road.json"))
    assert plane["x_m"] > 1.0
    # other kernels ask for the ground, in float32: microns a step, of which springs and brakes make no more
    for name in ("x_m", "z_m", "speed_mps", "Fz_FL_N"):
        assert road[name] == pytest.approx(plane[name], rel=1e-3, abs=1e-3), name


def test_a_map_of_friction_is_friction(drive):
    plane = final(drive, "--friction", "0.3")
    road = final(drive, "--road", write_road("road.json", friction={"pixels": "slippery.npy"}))
    grips = final(drive, "--road", write_road("grips.json"))
    assert road["x_m"] == pytest.approx(plane["x_m"], abs=2e-3)
    assert abs(road["x_m"] - grips["x_m"]) > 0.05


def test_a_random_road_lifts_the_vehicle(drive):
    level, rough = final(drive), final(drive, "--road", "iso8608:D:3")
    # class D: 3 cm between crests and troughs of a few metres
    assert 1e-3 < abs(rough["z_m"] - level["z_m"]) < 0.3
    assert rough["pitch_rad"] != pytest.approx(level["pitch_rad"], abs=1e-4)


@pytest.mark.slow
def test_soils_of_a_road_sink_as_they_do_alone(drive):
    """Standing on the first soil's half of the map."""
    road = write_road("road.json", soil="soil.npy", soils=["mid", "hard"], origin=[-6.0, -10.0], size=[80.0, 20.0])
    options = ("hmmwv", "--maneuver", "inputs.csv", "--duration", "0.5", "--tire", "soil-rigid", "--json", "a.json")
    found = []
    for arguments in (("--road", road), ("--soil", "mid")):
        code, _, err = drive(*options, *arguments)
        assert (code, remarks(err)) == (0, [])
        with open("a.json") as file:
            found.append(json.load(file)["final"]["sink_FL_m"])
    assert found[0] > 0.005
    assert found[0] == pytest.approx(found[1], rel=1e-3)


@pytest.mark.parametrize("vehicle", ["hmmwv-reduced", "m113-belt"])
def test_a_run_ends_where_its_road_does(drive, vehicle):
    road = write_road("short.json", origin=[-6.0, -6.0], size=[14.0, 12.0])
    (code, out, err) = drive(vehicle, "--maneuver", "inputs.csv", "--duration", "20", "--road", road, "--csv", "a.csv")
    assert (code, remarks(err)) == (0, [])  # it stops before
    with open("go.csv", "w") as file:
        file.write("t_s,throttle\n0,1\n9,1\n")
    code, out, err = drive(vehicle, "--maneuver", "go.csv", "--road", road, "--json", "a.json")
    assert (code, remarks(err)) == (1, [])
    with open("a.json") as file:
        content = json.load(file)
    assert content["left_road_s"] == pytest.approx(content["final"]["t_s"], abs=1e-6)
    assert f"the vehicle left the road at t = {content['left_road_s']:.2f} s, where the run ends" in out
    # the first wheel's centre is at the border, which is 8 m ahead; it has not begun to fall
    assert 5.0 < content["final"]["x_m"] < 9.0
    assert abs(content["final"]["pitch_rad"]) < 0.1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("drive", "m113-belt"), "road: must be of one friction below tracks, got a map of friction; leave it out"),
        (("view", "m113-belt", "--no-open"), "road: must be of one friction below tracks, got a map of friction"),
        (("view", "stiff.json", "--no-open"), "a map of friction must be below tires that are force laws, got rigid"),
        (("drive", "stiff.json"), "must be driven on tires that are force laws, got rigid; leave out --tire"),
    ],
)
def test_maps_that_a_vehicle_does_not_read_are_refused(drive, capfd, arguments, message):
    save_vehicle(with_options(load_vehicle("hmmwv"), tire="rigid"), "stiff.json")
    road = write_road("road.json", friction={"pixels": "slippery.npy"})
    assert cli.main([*arguments, "--road", road, "--device", "cpu"]) == 2
    _, err = capfd.readouterr()
    assert message in err
    assert len(remarks(err)) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("drive", "m113"), "road: must be rigid below tracks, got soils mid, hard; leave them out"),
        (("view", "m113-belt", "--no-open"), "road: must be rigid below tracks, got soils mid, hard"),
        (("view", "gator", "--no-open"), "road: must be rigid here, got soils mid, hard; simwarp drive --tire"),
        (("drive", "gator"), "soil: tires of vehicle 'gator' must be soil-rigid, got tmeasy"),
    ],
)
def test_soils_that_a_vehicle_does_not_sink_into_are_refused(drive, capfd, arguments, message):
    road = write_road("road.json", soil="soil.npy", soils=["mid", "hard"])
    assert cli.main([*arguments, "--road", road, "--device", "cpu"]) == 2
    _, err = capfd.readouterr()
    assert message in err
    assert len(remarks(err)) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--roads", "K"), ("--roads", "K")),
        (("--roads", "C", "--seed", "-1"), ("--seed must be a whole number from 0", "got '-1'")),
    ],
)
def test_roads_of_rigs_that_are_none_are_one_line(capfd, arguments, words):
    assert cli.main(["rig", "full-car", "artcar", "--test", "road", *arguments]) == 2
    _, err = capfd.readouterr()
    assert len(remarks(err)) == 1
    for word in words:
        assert word in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--road", "iso8608:K"), "--road: must be of a class from A to H, got 'K'"),
        (("--road", "iso8608:C:x"), "--road: must be of a seed"),
        (("--road", "iso8608:C:-1"), "--road: must be of a seed that is a whole number, 0 or more, got '-1'"),
        (("--road", "mud.json", "--tire", "soil-rigid"), "preset must be soft, mid, hard, clay, snow, sand, got 'mud'"),
        (("--road", "gravel"), "--road: must be iso8608:CLASS"),
        (("--road", "none.json"), "--road: none.json: cannot be read"),
        (("--road", "iso8608:C", "--maneuver", "slope-hold"), "level ground, got slope-hold with a slope"),
        (("--road", "iso8608:C", "--speeds", "5,6", "--maneuver", "iso-3888-1"), "--road: is of one run"),
        (("--road", "empty.json"), "height: "),
        (("--road", "short.json"), "at least 5 m to all sides of the origin"),
        (("--road", "soils.json", "--soil", "mid", "--tire", "soil-rigid"), "--soil: the road 'soils.json' has soils"),
    ],
)
def test_wrong_roads_are_refused_in_one_line(drive, arguments, message):
    with open("empty.json", "w") as file:
        json.dump({"origin": [0.0, 0.0], "size": [1.0, 1.0]}, file)
    write_road("short.json", origin=[-1.0, -1.0])
    write_road("soils.json", soils=["mid"])
    write_road("mud.json", soils=["mud"])
    code, _, err = drive("hmmwv", *arguments)
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1
