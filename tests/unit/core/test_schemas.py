"""The shipped JSON Schemas are those of the types, take all shipped files and refuse what the loader refuses."""

import copy
import importlib.util
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from scripts.schemas import DATA, schemas
from simwarp.core.types import ModelError
from simwarp.sensors.presets import load_config
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.spec.vehicle_files import load_vehicle, to_json
from simwarp.vehicle.tracks.tracked_files import load_tracked_vehicle
from tests.reference.json_schema import fits

ROOT = DATA.parent
VEHICLES = sorted((ROOT / "vehicle" / "data").glob("*.json"))
TIRES = sorted((ROOT / "vehicle" / "data").glob("*/tires/**/*.json"))
DRIVELINES = sorted((ROOT / "vehicle" / "data").glob("*/drivelines/*.json"))
SENSORS = sorted((ROOT / "sensors" / "data").glob("*.json"))


def schema(name: str) -> dict[str, Any]:
    return json.loads((DATA / f"{name}.schema.json").read_text(encoding="utf-8"))


VEHICLE, TRACKED, SENSOR = schema("vehicle"), schema("tracked_vehicle"), schema("sensor")


def valid(value: Any, whole: dict[str, Any], part: dict[str, Any] | None = None) -> bool:
    """What our own validator says, and that of the package `jsonschema` where it is installed."""
    wanted = whole if part is None else part
    found = fits(value, wanted, whole)
    if importlib.util.find_spec("jsonschema"):
        import jsonschema  # type: ignore[import-not-found, import-untyped, unused-ignore]

        assert found == jsonschema.Draft202012Validator({**wanted, "$defs": whole["$defs"]}).is_valid(value)
    return found


def read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


PINNED = next(
    line.partition("==")[2].split()[0]
    for line in (Path(__file__).parents[3] / "constraints.txt").read_text(encoding="utf-8").splitlines()
    if line.startswith("pydantic==")
)


@pytest.mark.skipif(version("pydantic") != PINNED, reason="other versions of pydantic describe dataclasses otherwise")
def test_they_are_made_of_the_types():
    for path, text in schemas().items():
        assert path.read_text(encoding="utf-8") == text, "run: python -m scripts.schemas"


def test_inherited_fields_are_described_as_where_they_stand():
    """Units of their own too, where a key's usual one is another: a spring at a pin turns."""
    told = {kind: TRACKED["$defs"][kind]["properties"] for kind in ("ShoeTrack", "BeltTrack", "DoublePinSprocket")}
    for kind in ("ShoeTrack", "BeltTrack"):
        assert told[kind]["pin_stiffness"]["description"].endswith("[N·m/rad].")
    assert told["DoublePinSprocket"]["separation"]["description"] == "Distance of the two discs [m]."


@pytest.mark.parametrize("path", VEHICLES, ids=lambda path: path.stem)
def test_every_shipped_vehicle_fits(path):
    assert valid(read(path), VEHICLE)


def test_the_shipped_tracked_vehicle_fits_and_mistakes_do_not(tmp_path):
    folder = ROOT / "vehicle" / "data" / "tracked"
    right = read(folder / "m113.json")
    assert valid(right, TRACKED)
    assert not valid(right, VEHICLE)
    driveline = TRACKED["$defs"]["TrackedVehicleSpec"]["properties"]["driveline"]
    assert all(valid(read(path), TRACKED, driveline) for path in folder.glob("*/drivelines/*.json"))
    assert valid({**right, "$schema": "tracked_vehicle.schema.json", "left": {"file": "left.json"}}, TRACKED)
    for keys, new in (
        ("left.shoes", 2), ("left.sprocket.teeth", 2.5), ("right.idler.tensioner.stiffness", -1.0),
        ("track_ofset", 1.0), ("left.shoe.template", "track-rubber"), ("driveline", {"template": "simple"}),
    ):  # fmt: skip
        wrong = changed(right, keys, new)
        assert not valid(wrong, TRACKED), keys
        (tmp_path / "wrong.json").write_text(json.dumps(wrong))
        with pytest.raises(SpecError):
            load_tracked_vehicle(tmp_path / "wrong.json")


def test_every_shipped_part_and_sensor_fits():
    assert len(TIRES) > 10
    assert all(valid(read(path), VEHICLE, {"$ref": "#/$defs/Tire"}) for path in TIRES)
    driveline = VEHICLE["$defs"]["VehicleSpec"]["properties"]["driveline"]
    assert all(valid(read(path), VEHICLE, driveline) for path in DRIVELINES)
    assert len(SENSORS) > 15
    assert [path.stem for path in SENSORS if not valid(read(path), SENSOR)] == []


def changed(value: Any, keys: str, new: Any) -> Any:
    made = copy.deepcopy(value)
    *path, last = [int(key) if key.isdigit() else key for key in keys.split(".")]
    inner = made
    for key in path:
        inner = inner[key]
    inner[last] = new
    return made


@pytest.mark.parametrize(
    ("keys", "new"),
    [
        ("nam", "x"), ("wheelbase", "long"), ("axles", []), ("axles.0.wheel.mass", -1.0), ("axles.0.wheel.mass", True),
        ("axles.0.suspension.camber", 5.0), ("axles.0.suspension.template", "wishbone"),
        ("axles.0.suspension.upper_arm_front", [0.0, 1.0]), ("chassis.components.0.inertia", [1.0, 0.0, 1.0]),
        ("axles.0.suspension.spindel", {}), ("axles.0.wheel", {"file": 3}),
    ],
)  # fmt: skip
def test_what_the_loader_refuses_a_vehicle_the_schema_refuses(keys, new, tmp_path):
    right = json.loads(to_json(load_vehicle("hmmwv")))
    assert valid(right, VEHICLE)
    wrong = changed(right, keys, new)
    assert not valid(wrong, VEHICLE)
    (tmp_path / "wrong.json").write_text(json.dumps(wrong))
    with pytest.raises(SpecError, match=keys.rpartition(".")[0].replace(".0", r"\[0\]") or keys):
        load_vehicle(tmp_path / "wrong.json")


@pytest.mark.parametrize(
    ("keys", "new"),
    [
        ("sensor", "lidra"), ("schedule.rate", 0), ("schedule.rat", 1), ("beams.rows", 1.5), ("mode", "loudest"),
        ("noise.dropout", 2), ("outputs", ["points", "points"]), ("far", None),
    ],
)  # fmt: skip
def test_what_the_loader_refuses_a_sensor_the_schema_refuses(keys, new, tmp_path):
    right = {
        "sensor": "lidar", "schedule": {"rate": 20.0}, "noise": {"range": 0.1},
        "beams": {"columns": 4, "rows": 2, "elevation": [0.1, -0.1]},
    }  # fmt: skip
    assert valid(right, SENSOR)
    wrong = changed(right, keys, new)
    assert not valid(wrong, SENSOR)
    (tmp_path / "wrong.json").write_text(json.dumps(wrong))
    with pytest.raises(ModelError):
        load_config(tmp_path / "wrong.json")


def test_files_may_name_their_schema(tmp_path):
    """Editors complete by it; other files of a vehicle may, too."""
    vehicle = {"$schema": "vehicle.schema.json", **json.loads(to_json(load_vehicle("hmmwv")))}
    brake = {"$schema": "x", "max_torque": 4000.0}
    (tmp_path / "brake.json").write_text(json.dumps(brake))
    vehicle = changed(vehicle, "axles.0.brake", {"file": "brake.json"})
    assert valid(vehicle, VEHICLE)
    (tmp_path / "mine.json").write_text(json.dumps(vehicle))
    assert load_vehicle(tmp_path / "mine.json").axles[0].brake == load_vehicle("hmmwv").axles[0].brake
    sensor = {"$schema": "sensor.schema.json", **read(ROOT / "sensors" / "data" / "generic-imu.json")}
    assert valid(sensor, SENSOR)
    (tmp_path / "imu.json").write_text(json.dumps(sensor))
    assert load_config(tmp_path / "imu.json") == load_config("generic-imu")
