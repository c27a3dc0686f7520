"""`simwarp trim`: tables, files and JSON of a trim, and one clear line for each mistake."""

import json
import math

import pytest
from rich.console import Console

from simwarp.cli import trim_command
from simwarp.cli.trim_command import changed
from simwarp.vehicle import load_vehicle, stance, vehicle_names
from simwarp.vehicle.spec.vehicle_files import save_vehicle, to_json
from simwarp.vehicle.stances import AxleStance, LineStance, Stance


@pytest.fixture
def trimming(command, tmp_path, monkeypatch):
    """Run the command in a folder of its own: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: command("trim", *arguments)


@pytest.mark.slow
@pytest.mark.parametrize("name", vehicle_names())
def test_every_shipped_vehicle_is_shown(trimming, name, tmp_path):
    code, out, err = trimming(name, "--device", "cpu", "--json", "state.json")
    assert (code, err) == (0, "")
    for row in ("ride height [m]", "wheels over design [mm]", "stops", "toe [deg]", "rolling: force inwards [N]"):
        assert row in out
    content = json.loads((tmp_path / "state.json").read_text())
    assert (content["vehicle"], content["after"], content["file"], content["parameters"]) == (name, None, None, [])
    spec = load_vehicle(name)
    assert len(content["before"]) == len(spec.all_axles)
    for row in content["before"]:
        assert row["load"] > 0.0
        assert len(row["lines"]) == len(getattr(spec.all_axles[row["axle"]].suspension, "springs", ()))
        assert math.isfinite(row["rolling"]["side_force"])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gator", "artcar", "hmmwv-reduced"])
def test_a_vehicle_is_trimmed_and_written(trimming, name, tmp_path):
    code, out, err = trimming(name, "--ride-height", "design", "--toe", "-0.1", "-o", "mine.json", "--json", "-")
    assert code == 0
    content = json.loads(out)
    assert content["file"] == "mine.json"
    assert "before" in err
    assert "wrote mine.json" in err
    trimmed = load_vehicle(tmp_path / "mine.json")
    assert trimmed.name == name
    for index, found in enumerate(stance(trimmed).axles):
        row = content["after"][index]
        assert row["ride_height"] == pytest.approx(found.ride_height, abs=1e-5)
        if found.tierod is not None:
            assert abs(found.travel) < 5e-4
            assert math.degrees(found.toe) == pytest.approx(-0.1, abs=0.01)
    rows = changed(load_vehicle(name), trimmed)
    assert content["parameters"] == rows
    assert {"tie rod", "free length of spring 0", "toe as built"} <= {row["name"] for row in rows}


@pytest.mark.slow
def test_a_file_of_ones_own_is_trimmed_again_to_the_same(trimming, tmp_path):
    save_vehicle(load_vehicle("gator"), tmp_path / "own.json")
    assert trimming("own.json", "--toe", "0.2,keep", "--output", "one.json")[0] == 0
    code, out, _ = trimming("one.json", "--toe=0.2,keep", "--output", "two.json")
    assert code == 0
    assert "it stands as asked for: nothing is changed" in out
    assert (tmp_path / "one.json").read_text() == (tmp_path / "two.json").read_text()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "which vehicle? usage: simwarp trim VEHICLE [options]; vehicles: artcar, gator,"),
        (["sedna"], "vehicle 'sedna': not shipped (did you mean 'sedan'?)"),
        (["m113"], "'M113' has tracks, and no toe or camber to trim"),
        (["none.json"], "none.json: cannot be read"),
        (["gator", "--toe", "0,0"], "toe: must be left out of axle 1 of 'gator', which has no tie rod"),
        (["skid-steer", "--ride-height", "0.2"], "ride_height: must be left out of 'skid-steer', every axle of which"),
        (["hmmwv", "--ride-height", "0.4,0.4,0.4"], "ride_height: must be one value, or one per axle"),
        (["hmmwv", "--ride-height", "high"], "--ride-height must be a height [m], 'design' or 'keep', got 'high'"),
        (["hmmwv", "--ride-height", "nan"], "--ride-height must be a height [m]"),
        (["hmmwv", "--toe", "design"], "--toe must be an angle [deg] or 'keep', got 'design'"),
        (["hmmwv", "--toe", "-45"], "--toe must be within 20 degrees, got -45"),
        (["hmmwv", "--camber", "keep"], "--camber must not be 'keep' alone, which changes nothing"),
        (["hmmwv", "--move-stops"], "--move-stops needs a height to move them for: give --ride-height"),
        (["hmmwv", "--move-stops", "--toe", "0"], "--move-stops needs a height to move them for"),
        (["hmmwv", "-o", "a.json"], "--output needs something to trim: give --ride-height, --toe or --camber"),
        (["hmmwv", "--toe", "0", "-o", "a.txt"], "--output must end in .json, got 'a.txt'"),
        (["hmmwv", "--toe", "0", "-o", "none/a.json"], "output"),
        (["hmmwv", "--toes", "0"], "unknown option --toes; did you mean --toe?"),
        (["hmmwv", "--toe", "0", "--toe", "1"], "--toe is given twice"),
    ],
)
def test_mistakes_are_one_line(trimming, arguments, says):
    code, out, err = trimming(*arguments)
    assert (code, out) == (2, "")
    assert says in err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_stops_are_moved_where_that_is_asked_for(trimming, tmp_path):
    """The HMMWV with stiffer rear springs, back to the height of the page; the stop stands among what was changed."""
    content = json.loads(to_json(load_vehicle("hmmwv")))
    line = content["axles"][1]["suspension"]["springs"][0]
    line["spring_curve"] = [[x, 1.3 * force] for x, force in line["spring_curve"]]
    (tmp_path / "stiff.json").write_text(json.dumps(content))
    height = ("stiff.json", "--ride-height", "keep,0.5919", "--output", "back.json")
    code, _, err = trimming(*height)
    assert code == 2
    assert "springs[0] is 0.3564 m long and stands on its rebound stop, max_length 0.35: move it by --move-stops" in err
    assert err.count("\n") == 1
    code, out, _ = trimming(*height, "--move-stops", "--json", "found.json")
    assert code == 0
    assert "max_length of spring 0" in out
    found = json.loads((tmp_path / "found.json").read_text())
    assert {"free length of spring 0", "max_length of spring 0"} == {row["name"] for row in found["parameters"]}
    assert found["after"][1]["ride_height"] == pytest.approx(0.5919, abs=5e-5)
    assert found["after"][1]["lines"][0]["stop"] == ""
    assert stance(load_vehicle(tmp_path / "back.json")).axles[1].ride_height == pytest.approx(0.5919, abs=5e-5)


@pytest.mark.parametrize("terminal", [False, True])
def test_tables_are_printed_whole(trimming, terminal, monkeypatch):
    """With two states of two axles on two stops each: in a pipe one line a row, on a narrow terminal on several."""
    lines = tuple(
        LineStance(length=0.3, free_length=0.4, force=1.0, stop=stop, into_stop=0.0123)
        for stop in ("rebound", "hydraulic rebound")
    )
    axle = AxleStance(
        ride_height=0.5, travel=0.01, toe=0.0, camber=0.0, track=1.0, load=5e3, side_force=0.0, tierod=None, lines=lines
    )
    state = Stance(height=0.5, pitch=0.0, wheelbase=2.0, com_height=0.6, axles=(axle, axle))
    spec = load_vehicle("artcar")
    monkeypatch.setattr(trim_command, "_states", lambda *_: (state, state))
    monkeypatch.setattr(trim_command, "trim", lambda *_, **__: spec)
    if terminal:
        console = Console(force_terminal=True, width=80, color_system=None)
        monkeypatch.setattr(trim_command.TrimOptions, "console", lambda _: console)
    code, out, _ = trimming("artcar", "--toe", "0")
    assert code == 0
    assert "\N{HORIZONTAL ELLIPSIS}" not in out
    assert out.count("12.3") == 8
    if not terminal:
        assert out.count("rebound 12.3 mm, hydraulic rebound 12.3 mm") == 4
    else:
        assert max(map(len, out.splitlines())) <= 80


def test_a_vehicle_is_not_written_over_its_own_file(trimming, tmp_path):
    save_vehicle(load_vehicle("gator"), tmp_path / "own.json")
    code, _, err = trimming("own.json", "--toe", "0", "-o", "own.json")
    assert code == 2
    assert "--output would overwrite 'own.json', which is an input too" in err


def test_help_names_the_options(trimming):
    code, out, _ = trimming("gator", "--help")
    assert code == 0
    for word in ("--ride-height", "--toe", "--camber", "--output", "--json"):
        assert word in out
    assert trimming("--help")[1].startswith("usage: simwarp trim VEHICLE")
