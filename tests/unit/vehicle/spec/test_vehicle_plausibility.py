"""Numbers of a vehicle that are right by themselves and wrong beside the others: one error that names the key."""

import dataclasses
import json
from typing import Any

import pytest

import simwarp as sw
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle, plain, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import Chassis, ForceLine, RigidPart, SpecError
from simwarp.vehicle.vehicle import Vehicle, per_world

SUSPENSION = "axles.0.suspension"
SPRING = f"{SUSPENSION}.springs.0"


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        ("chassis.components", [], "chassis.components: must be one or more, got []"),
        ("chassis.size", [-1, 1, 1], "chassis.size[0]: must be positive, got -1"),
        ("chassis.size", [4000, 2000, 500], "chassis.size: must be within 16.89 m"),
        ("driveline.axles", [0, 5], "driveline.axles[1]: must be the index of an axle, 0 to 1, got 5"),
        ("driveline.axles", [-1, 0], "driveline.axles[0]: must be the index of an axle, 0 to 1, got -1"),
        ("driveline.axles", [1, 1], "driveline.axles: must be two different axles, got (1, 1)"),
        ("start_height", -2, "must be from 0.2612 to 2.846 m, where the wheels are near the ground, got -2"),
        ("start_height", 20, "they touch it at 0.4962"),
        ("start_height", 500, "start_height: must be from"),
        ("steerings.0.steering.max_angle", 30, "got 30; if these are degrees, they are 0.5236 rad"),
        (f"{SUSPENSION}.camber", 5.0, "axles[0].suspension.camber: must be within ±0.7854 rad (45°), got 5.0;"),
        (f"{SUSPENSION}.toe", -2.0, "axles[0].suspension.toe: must be within"),
        (f"{SPRING}.rest_length", 339, "within 6.756 m (2 wheelbases of 3.378 m), got 339.0; give metres"),
        (f"{SPRING}.rest_length", -0.3, "springs[0].rest_length: must be positive"),
        (f"{SPRING}.stiffness", 1e5, "springs[0].spring_curve: must be left out beside stiffness 100000: one law"),
        (f"{SPRING}.spring_curve", [[-100, -1e4], [0, 0]], "springs[0].spring_curve: must be within 6.756 m"),
        (f"{SUSPENSION}.springs.1.damping", 5.0, "springs[1].damper_curve: must be left out beside damping 5"),
        (f"{SUSPENSION}.upper_arm_front", [-65, 480, 245], "suspension.upper_arm_front: must be within 6.756 m"),
        (f"{SUSPENSION}.spindle.com", [0, 910, 0], "axles[0].suspension.spindle.com: must be within 6.756 m"),
        ("axles.1.location", [-1688.965, 0, 0], "must be 0.05 to 50 m along x from axles[0].location, got 1690.65 m"),
        ("axles.1.location", [1.688965, 0, 0], "axles[1].location: must be 0.05 to 50 m"),
        ("axles.0.wheel.offset", 20, "axles[0].wheel.offset: must be within"),
        ("axles.0.tire.radius", 469.9, "axles[0].tire.radius: must be within"),
        ("steerings.0.location", [1244.98, 0, 101], "steerings[0].location: must be within"),
        ("chassis.components.0.com", [56, 0, 213], "chassis.components[0].com: must be within"),
        ("axles.0.steering", None, 'steerings[0]: must be the steering of an axle: no axle names it; give'),
        ("steerings", [], "axles[0].steering: must be left out, for the vehicle has no steerings, got 0"),
        ("axles.0.steering", -1, "axles[0].steering: must be the index of a steering, 0, got -1"),
        ("chassis.components.0.inertia", [10, 10, 3000], "components[0].inertia: must be the inertia of a body"),
        (f"{SUSPENSION}.upright.products", [5, 0, 0], "suspension.upright.products: must be small beside the moments"),
        ("transmission", None, "engine: must be given together with a transmission; add one, or leave out engine"),
        ("engine", None, "transmission: must be given together with an engine; add one, or leave out transmission"),
        ("axles.1.tire.parameters.max_x", [-1, 2], "axles[1].tire.parameters.max_x[0]: must be positive, got -1"),
        ("axles.0.tire.template", "tmesy", "axles[0].tire.template: must be one of tmeasy, tmsimple, fiala,"),
        ("axles.0.tire.template", "rigid", "axles[0].tire.parameters.pattern: unknown key; known: friction,"),
        ("axles.0.tire.radius", 1e30, "axles[0].tire.radius: must be below 1e+15, got 1e+30"),
        ("driveline.rear_gear_ratio", 1e30, "driveline.rear_gear_ratio: must be below 1e+15"),
        ("transmission.forward_ratios", [], "transmission.forward_ratios: must be one or more numbers, got []"),
        (f"{SPRING}.spring_curve", [[0, 1], [0.1, 2], [0.05, 3]], "got x = 0.05 in [2] after 0.1; sort them by x"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(changed, keys, value, words):
    message = changed(keys, value)
    assert message.startswith("v.json: ")
    assert words in message


def test_a_driven_axle_that_is_none(changed, shipped):
    rear = plain(with_options(load_vehicle("hmmwv"), driveline="rwd").driveline)
    for axle in (7, -2):
        words = f"driveline.axle: must be the index of an axle, 0 to 1, or -1 for the last, got {axle}"
        assert words in changed("driveline", rear | {"axle": axle})
    simple = plain(load_vehicle("gator").driveline)
    assert simple["template"] == "simple"
    assert "driveline.axles[1]: must be the index" in changed("driveline", simple | {"axles": [0, 9]})


def test_what_does_not_fit_a_differential_drive_is_named(tmp_path):
    """One line each: what drives or steers beside it, motors that cannot reach their speed, wheels that differ."""
    robot, gator, sedan = (plain(load_vehicle(name)) for name in ("skid-steer", "gator", "sedan"))
    line, axles = robot["driveline"], robot["axles"]
    small = [axles[0], axles[1] | {"tire": axles[1]["tire"] | {"radius": 0.15}}]
    steered = {"steerings": sedan["steerings"], "axles": [axles[0] | {"steering": 0}, axles[1]]}
    beside = "must be left out beside the driveline 'differential-drive', whose motors drive and steer; leave it out,"
    for changes, words in (
        ({"engine": gator["engine"], "transmission": gator["transmission"]}, f"engine: {beside}"),
        (steered, f"steerings: {beside}"),
        ({"axles": small}, "axles: must be given tires of one radius within 2 % beside 'differential-drive'"),
        ({"driveline": line | {"max_speed": 701.0}}, "driveline.max_speed: must be at most no_load_speed, 700 rad/s"),
        ({"driveline": line | {"stall_torque": 0.0}}, "driveline.stall_torque: must be positive, got 0"),
        ({"driveline": line | {"gear_ratio": -0.1}}, "driveline.gear_ratio: must be positive, got -0.1"),
        ({"driveline": line | {"gain": 0}}, "driveline.gain: must be positive, got 0"),
        ({"driveline": line | {"torque": 1.0}}, "driveline.torque: unknown key"),
        ({"driveline": line | {"template": "differential-drives"}}, "did you mean 'differential-drive'"),
    ):
        (tmp_path / "v.json").write_text(json.dumps(robot | changes))
        with pytest.raises(SpecError) as error:
            load_vehicle(tmp_path / "v.json")
        message = str(error.value)
        assert message.startswith("v.json: ")
        assert words in message
        assert "\n" not in message


def test_an_option_that_does_not_fit_names_its_file(tmp_path):
    rear = plain(with_options(load_vehicle("hmmwv"), driveline="rwd").driveline)
    (tmp_path / "mine.json").write_text(json.dumps(rear | {"axle": 7}))
    with pytest.raises(SpecError, match=r"^mine.json: driveline.axle: must be the index of an axle"):
        with_options(load_vehicle("hmmwv"), driveline=str(tmp_path / "mine.json"))


def test_tires_of_a_file_name_it(tmp_path):
    tire = plain(load_vehicle("hmmwv").axles[0].tire)
    tire["parameters"]["max_x"] = [-1.0, 2.0]
    (tmp_path / "mine.json").write_text(json.dumps(tire))
    with pytest.raises(SpecError, match=r"^mine.json: parameters.max_x\[0\]: must be positive"):
        with_options(load_vehicle("hmmwv"), tire=str(tmp_path / "mine.json"))
    with pytest.raises(SpecError, match=r"^x.tir: a property file is no whole tire; give a .json file with template"):
        with_options(load_vehicle("hmmwv"), tire="x.tir")


def test_tires_in_python_name_vehicle_and_axle():
    spec = load_vehicle("gator")
    tire = dataclasses.replace(spec.axles[1].tire, parameters={"grip": 1.0})
    axles = (spec.axles[0], dataclasses.replace(spec.axles[1], tire=tire))
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, dataclasses.replace(spec, axles=axles))
    with pytest.raises(SpecError, match=r"^gator: axles\[1\].tire.parameters.grip: unknown key"):
        Vehicle(parts, builder.finalize(1, "cpu", per_world=per_world()))


def test_one_axle_has_no_wheelbase(shipped, tmp_path):
    data = json.loads(json.dumps(shipped["sedan"]))
    data["axles"].pop()
    data["driveline"]["axle"] = 0
    (tmp_path / "v.json").write_text(json.dumps(data))
    with pytest.raises(SpecError, match=r"^v.json: wheelbase: must be left out of a vehicle with one axle, got 2.776$"):
        load_vehicle(tmp_path / "v.json")


@pytest.mark.parametrize("name", vehicle_names())
def test_lengths_in_millimetres_are_found_in_vehicles_of_any_size(changed, shipped, name):
    """One suspension as a drawing in millimetres tells it."""

    def scaled(value, key=""):
        if isinstance(value, dict):
            return {k: v if k in ("mass", "inertia", "products") else scaled(v, k) for k, v in value.items()}
        if isinstance(value, list) and len(value) == 3 and isinstance(value[0], float) and "axis" not in key:
            return [1e3 * v for v in value]
        return [scaled(v) for v in value] if isinstance(value, list) else value

    message = changed("axles.0.suspension", scaled(shipped[name]["axles"][0]["suspension"]), name)
    assert message.startswith("v.json: axles[0].suspension.")
    assert message.endswith("give metres, not millimetres")


def test_rules_hold_in_python_too():
    ends: Any = {"chassis_point": (0.0, 0.0, 0.0), "arm_point": (0.0, 0.0, 1.0)}
    with pytest.raises(SpecError, match="spring_curve: must be left out beside stiffness"):
        ForceLine(**ends, stiffness=1.0, spring_curve=((0.0, 0.0), (1.0, 1.0)))
    with pytest.raises(SpecError, match="components: must be one or more"):
        Chassis(components=())
    bar = RigidPart(mass=1.0, inertia=(1.0, 1.0, 3.0))
    with pytest.raises(SpecError, match=r"components\[0\].inertia: must be the inertia of a body"):
        Chassis(components=(bar,))
    with pytest.raises(SpecError, match="start_height"):
        dataclasses.replace(load_vehicle("gator"), start_height=9.0)
