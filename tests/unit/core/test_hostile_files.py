"""Files of vehicles, tires, sensors and drivers that hold anything at all: a line that names the place, or they fit."""

import json
import os
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from simwarp.core.types import ModelError
from simwarp.importers.chrono_json import without_comments
from simwarp.importers.chrono_vehicle import load_chrono_vehicle
from simwarp.sensors.presets import load_config
from simwarp.sensors.shipped import DATA as SENSORS, sensor_names
from simwarp.vehicle.driving.drivers import read_script
from simwarp.vehicle.driving.paths import circle, read_path
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.spec.vehicle_files import DATA, MOST_FILES, load_vehicle, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import SpecError

REFUSED = (SpecError, ModelError)
LONGEST = 1500
"""Characters of an error."""

HOSTILE: tuple[Any, ...] = (
    None, True, 0, -1, 1.5, -1e-30, 1e14, 1e15, 3e38, 10**18, 2**31, float("nan"), float("inf"), "", "x", "é" * 300,
    "x" * 20_000, [], [1], [[]], ["a"], [None] * 3, [1e14] * 3, [0, 0, 0], [True] * 3, [float("nan")] * 3,
    [[1, 2], [1, 2]], [[0, 0], [1, 1]], {}, {"a": 1}, {"": {}}, {"x" * 20_000: 1}, {"template": {}}, {"template": []},
    {"template": None}, {"template": "x"}, {"kind": {}}, {"kind": "x"}, {"file": None}, {"file": ""}, {"file": "."},
    {"file": "none.json"}, {"file": "x" * 300 + ".json"}, {"file": "a\0b"}, {"file": "mine.json"},
    {"file": "/dev/zero"}, {"file": "pipe"}, {"file": "loop"}, json.loads("[" * 90 + "]" * 90),
)  # fmt: skip


def keys_of(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a value, of lists the first item alone."""
    yield at
    items = value.items() if isinstance(value, dict) else enumerate(value[:1]) if isinstance(value, list) else ()
    for key, item in items:
        yield from keys_of(item, (*at, key))


def changed(value: Any, at: tuple[Any, ...], new: Any) -> Any:
    """The value with another one at a place."""
    if not at:
        return new
    copy: Any = dict(value) if isinstance(value, dict) else list(value)
    copy[at[0]] = changed(copy[at[0]], at[1:], new)
    return copy


def inlined(value: Any, folder: Path) -> Any:
    """A vehicle's file with the files that it names."""
    if isinstance(value, dict) and set(value) == {"file"}:
        path = folder / value["file"]
        return inlined(json.loads(path.read_text()), path.parent) if path.suffix == ".json" else {"file": str(path)}
    if isinstance(value, dict):
        return {key: inlined(item, folder) for key, item in value.items()}
    return [inlined(item, folder) for item in value] if isinstance(value, list) else value


@pytest.fixture
def folder(tmp_path):
    """A folder in which hostile files lie."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    return tmp_path


def attack(base: Any, file: Path, read: Any, share: float, seed: int) -> tuple[int, int]:
    """Put hostile values in every place: how many were refused, and taken. Anything else raises."""
    draws = random.Random(seed)
    refused = taken = 0
    for at in keys_of(base):
        for value in HOSTILE:
            if draws.random() >= share:
                continue
            file.write_text(json.dumps(changed(base, at, value)))
            told = error_of(read, file)
            assert "\n" not in told, (at, value)
            assert len(told) < LONGEST, (at, value)
            refused, taken = refused + bool(told), taken + (not told)
    return refused, taken


def error_of(read: Any, file: Path) -> str:
    """What is said about a file; nothing where it is read."""
    try:
        read(file)
    except REFUSED as error:
        return str(error)
    return ""


def attack_vehicle(name: str, folder: Path, share: float) -> None:
    refused, taken = attack(
        inlined(json.loads((DATA / f"{name}.json").read_text()), DATA), folder / "mine.json", load_vehicle, share, 7
    )
    assert refused > 5 * taken > 0


def attack_sensor(name: str, folder: Path, share: float) -> None:
    refused, taken = attack(
        json.loads((SENSORS / f"{name}.json").read_text()), folder / "mine.json", load_config, share, 11
    )
    assert refused > 2 * taken


@pytest.mark.parametrize("name", ["gator", "sedan"])
def test_hostile_values_in_a_vehicle_are_named_or_taken(name, folder):
    attack_vehicle(name, folder, share=0.03)


@pytest.mark.parametrize("name", ["generic-camera", "generic-imu", "vlp-16"])
def test_hostile_values_in_a_sensor_are_named_or_taken(name, folder):
    attack_sensor(name, folder, share=0.3)


def test_a_file_of_a_name_that_no_file_system_takes(tmp_path):
    (tmp_path / "bad.json").write_text('{"name": "x", "engine": {"file": "\\ud800"}}')
    with pytest.raises(ValueError, match=r"bad\.json: engine\.file: must be a file beside bad\.json"):
        load_vehicle(tmp_path / "bad.json")


@pytest.mark.slow
@pytest.mark.parametrize("name", vehicle_names())
def test_hostile_values_in_all_vehicles(name, folder):
    attack_vehicle(name, folder, share=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", sensor_names())
def test_hostile_values_in_all_sensors(name, folder):
    attack_sensor(name, folder, share=1.0)


@pytest.mark.parametrize("read", [load_vehicle, load_config, load_chrono_vehicle])
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "broken JSON"),
        (b"{", "broken JSON"),
        (b"\xff\xfe{}", "not UTF-8"),
        (b"null", "must be an object"),
        (b"[" * 100_000 + b"]" * 100_000, "nested too deep"),
        (b'{"a":' * 500 + b"1" + b"}" * 500, "nested too deep"),
        (b'{"mass": ' + b"9" * 400 + b"}", "beyond 64 bits"),
        (b'{"mass": ' + b"9" * 5000 + b"}", "beyond 64 bits"),
        (b'{"mass": 1e308}', "beyond float32"),
        (b'{"a": 1, "b": 2, "a": 3}', "a: given twice in one object"),
        (b"\xef\xbb\xbf{}", "missing"),
        ("folder", "it is a folder"),
        ("pipe", "no regular file"),
        ("/dev/zero", "no regular file"),
        ("loop", "symbolic link"),
        ("x" * 300, "name too long"),
        ("a\0b", "must name a file"),
        ("none", "No such file"),
    ],
)
def test_what_is_no_file_of_json_is_one_line(folder, read, content, words):
    (folder / "folder").mkdir()
    if isinstance(content, bytes):
        (folder / "mine.json").write_bytes(content)
        content = "mine.json"
    with pytest.raises(REFUSED) as caught:
        read(folder / content)
    assert words.lower() in str(caught.value).lower()
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < LONGEST


def test_templates_of_wrong_types_are_named(folder):
    file = folder / "mine.json"
    gator = inlined(json.loads((DATA / "gator.json").read_text()), DATA)
    for value, words in (
        ({}, "got {}"),
        ([1], "got [1]"),
        (None, "got None"),
        (True, "got True"),
        ("ramp", "got 'ramp'"),
    ):
        file.write_text(json.dumps(changed(gator, ("engine", "template"), value)))
        with pytest.raises(SpecError, match=r"mine\.json: engine\.template: must be one of ") as caught:
            load_vehicle(file)
        assert words in str(caught.value)


def test_files_that_name_each_other_come_to_an_end(folder):
    gator = inlined(json.loads((DATA / "gator.json").read_text()), DATA)
    for index in range(3):
        (folder / f"{index}.json").write_text(json.dumps([{"file": f"{index + 1}.json"}] * 30))
    (folder / "3.json").write_text("1.0")
    parameters = ("axles", 0, "tire", "parameters")
    (folder / "mine.json").write_text(json.dumps(changed(gator, parameters, {"a": {"file": "0.json"}})))
    with pytest.raises(SpecError, match=f"more than {MOST_FILES} files in all"):
        load_vehicle(folder / "mine.json")
    (folder / "3.json").write_text(json.dumps([{"file": "0.json"}]))
    for index in range(3):
        (folder / f"{index}.json").write_text(json.dumps([{"file": f"{index + 1}.json"}]))
    with pytest.raises(SpecError, match="must not lead back"):
        load_vehicle(folder / "mine.json")


# ---- tires, Chrono's files -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("PDY1 = 1e308", "PDY1: must be below 1e+15"),
        ("PDY1 = 1e400", "PDY1: must be a finite number"),
        ("PDY1 = " + "9" * 5000, "PDY1: must be a finite number"),
        ("X" * 20_000 + " = x", "must be a number or quoted text"),
        ("x" * 20_000, "must be KEY = value"),
    ],
)
def test_lines_of_a_property_file_are_named_in_short(tmp_path, line, words):
    tire = json.loads((DATA / "sedan" / "tires" / "pacejka2002.json").read_text())
    text = (DATA / "sedan" / "tires" / "pacejka2002.tir").read_text()
    (tmp_path / "pacejka2002.tir").write_text(f"{text}\n{line}\n")
    sedan = inlined(json.loads((DATA / "sedan.json").read_text()), DATA)
    (tmp_path / "mine.json").write_text(json.dumps(changed(sedan, ("axles", 0, "tire"), tire)))
    with pytest.raises(SpecError) as caught:
        load_vehicle(tmp_path / "mine.json")
    assert words in str(caught.value)
    assert len(str(caught.value)) < LONGEST


@pytest.mark.parametrize("text", ["/*" * 50_000, '"' + '\\"' * 50_000, "//" * 50_000, '"/*"' * 20_000 + "/*"])
def test_comments_and_texts_without_an_end_are_read_once(text):
    # from every beginning to the end of the text these would take hours
    assert len(without_comments(text)) == len(text)


def test_comments_are_blanked_and_texts_are_kept():
    text = '{"a": "/* no */ // no", /* yes\n */ "b": 1 // yes\n}'
    assert json.loads(without_comments(text)) == {"a": "/* no */ // no", "b": 1}
    assert without_comments(text).count("\n") == text.count("\n")


def test_names_that_no_file_can_have_are_one_line(tmp_path):
    (tmp_path / "mine.json").write_text(
        json.dumps({"Type": "Vehicle", "Template": "WheeledVehicle", "Chassis": {"Input File": "x" * 300}})
    )
    with pytest.raises(SpecError, match="Chassis") as caught:
        load_chrono_vehicle(tmp_path / "mine.json")
    assert len(str(caught.value)) < LONGEST


# ---- drivers and paths -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t_s,steer\n0,0\n1,nan\n", "steer: must be from -1 to 1"),
        ("t_s,speed_target\n0,0\n1,1e300\n", "speed_target: must be a finite number"),
        ("t_s,speed_target\n0,0\n1e300,1\n", "t_s: must be a finite number"),
        ("t_s,speed_target\n0,0\n" + "9" * 5000 + ",1\n", "t_s: must be a finite number"),
        ("t_s,steer\n0,0\n1," + "x" * 20_000 + "\n", "got 'xxxx"),
        (",".join(["a"] * 50_000) + "\n1\n", "column 'a': given twice"),
        ("x" * 200_000 + "\n1\n", "field larger than"),
        ("", "must have rows"),
    ],
)
def test_scripts_that_cannot_be_driven_are_one_line(tmp_path, text, words):
    (tmp_path / "run.csv").write_text(text)
    with pytest.raises(SpecError) as caught:
        read_script(tmp_path / "run.csv")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < LONGEST


def test_a_run_is_no_device_and_no_folder(folder):
    for name, words in (("pipe", "no regular file"), ("/dev/zero", "no regular file"), (".", "it is a folder")):
        with pytest.raises(SpecError, match=words):
            Run.read(folder / name)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("9" * 5000 + " 3\n", "line 1 must be the number of points"),
        ("² 3\n", "line 1 must be the number of points"),
        ("2 3\n0 0 0\n1\n", "point 2 must be 3 numbers"),
        ("2 3\n0 0 0\nnan 0 0\n", "point 2 must be 3 numbers"),
        ("2 3\n0 0 0\n1e300 0 0\n", "point 2 must be 3 numbers"),
        ("2 3\n0 0 0\n1e8 0 0\n", "must have at most 1000000 points"),
        ("6000 3\n" + "0 0 0\n" * 6000, "at most 5000 points"),
    ],
)
def test_paths_that_cannot_be_followed_are_one_line(tmp_path, text, words):
    (tmp_path / "path.txt").write_text(text)
    with pytest.raises(SpecError) as caught:
        read_path(tmp_path / "path.txt")
    assert words in str(caught.value)
    assert len(str(caught.value)) < LONGEST


def test_a_circle_has_an_end():
    with pytest.raises(SpecError, match="radius: must be at most"):
        circle(1e30)
