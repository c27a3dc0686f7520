"""Vehicles as data: the shipped ones weigh what Chrono's do, files are read and written exactly, mistakes are named.

Reference masses, centres of mass and inertias are those that PyChrono 10 reports for its C++ models.
"""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle.spec.variants import KINDS, option_names, with_options
from simwarp.vehicle.spec.vehicle_files import DATA, load_vehicle, read_spec, save_vehicle, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import (
    Axle,
    Brake,
    Chassis,
    DoubleWishbone,
    ForceLine,
    RigidPart,
    RigidSuspension,
    SpecError,
    Tire,
    VehicleSpec,
    Wheel,
)
from tests.unit.vehicle.vehicle_bodies import bodies, total

# mass [kg], centre of mass [m], principal diagonal of the inertia [kg·m²]
CHRONO = {
    "hmmwv": (2573.1380, (0.04793, 0.00016, 0.16889), (1437.580, 4339.482, 5236.409)),
    "hmmwv-reduced": (2493.5570, (0.05210, 0.0, 0.17854), (1446.286, 4128.538, 5026.116)),
    "gator": (906.2, (-0.14861, -0.00003, 0.31589), (156.206, 473.836, 600.366)),
    "artcar": (6.8444, (-0.12013, -0.00103, -0.04492), (0.100, 0.357, 0.435)),
}
# of one body: mass, diagonal of the inertia, place as built in the vehicle's frame
CHRONO_BODIES: dict[str, dict[str, Any]] = {
    "hmmwv": {
        "steering.link": (3.681, None, (1.36731, 0.0, 0.06041)),
        "steering.arm": (1.605, None, (1.30567, 0.249, 0.08104)),
        "0.spindle": (71.105, (4.3446, 7.3878, 4.3446), (1.64859, 0.90966, -0.0265)),
        "0.upright": (19.45, (0.1656, 0.1934, 0.04367), (1.64859, 0.75097, -0.02648)),
        "0.upper_arm": (5.813, None, (1.58345, 0.58866, 0.21772)),
        "0.lower_arm.right": (23.965, None, (1.68896, -0.54678, -0.05915)),
        "1.spindle": (71.105, (4.3446, 7.3878, 4.3446), (-1.65341, 0.90964, -0.02658)),
        "1.upper_arm": (5.813, None, (-1.56463, 0.58884, 0.22068)),
    },
    "hmmwv-reduced": {
        "steering.link": (9.072, (1.0, 1.0, 1.0), (1.44107, 0.0, 0.0806)),
        "0.spindle": (72.276, (5.3034, 8.3143, 5.3034), (1.65099, 0.90971, 0.00014)),
        "0.upright": (27.216, (5.0, 5.0, 5.0), (1.651, 0.80799, 0.00014)),
        "1.upright.right": (27.216, (5.0, 5.0, 5.0), (-1.651, -0.80796, 0.00005)),
    },
    "gator": {
        "steering.link": (2.0, (0.138, 0.05, 0.138), (0.92, 0.0, 0.08)),
        "0.spindle": (23.3, (0.499, 0.8378, 0.499), (0.97, 0.56, -0.02)),
        "0.arm": (4.0, (0.0151, 0.0207, 0.0355), (0.97, 0.21, -0.01)),
        "1.spindle.right": (23.3, (0.49848, 0.8365, 0.49848), (-0.97, -0.62, 0.0)),
    },
    "artcar": {
        "chassis": (4.96867, (0.053894, 0.24739, 0.28436), (-0.1336, -0.0014, -0.048)),
        "0.spindle": (0.28375, (0.00087184, 0.0011363, 0.00087184), (0.1426, 0.16599, -0.03725)),
        "1.upright": (0.071372, (1.507e-5, 1.253e-5, 1.141e-5), (-0.32264, 0.162, -0.03725)),
        "1.lower_arm": (0.086226, None, (-0.32206, 0.07774, -0.04044)),
    },
}


def shipped(name: str) -> Any:
    """A shipped vehicle, of which the tests know what is in it."""
    return load_vehicle(name)


@pytest.mark.parametrize("name", CHRONO)
def test_totals_are_those_of_chrono(name):
    """Chrono reports them after some steps, in which suspensions move by some tenths of a millimetre."""
    mass, com, inertia = CHRONO[name]
    found = total(bodies(load_vehicle(name)))
    assert found.mass == pytest.approx(mass, rel=1e-5)
    np.testing.assert_allclose(found.com, com, atol=6e-5)
    np.testing.assert_allclose(np.diag(found.inertia), inertia, rtol=2e-4, atol=5e-4)


@pytest.mark.parametrize("name", CHRONO_BODIES)
def test_bodies_are_those_of_chrono(name):
    found = {body.name: body for body in bodies(load_vehicle(name))}
    for key, (mass, inertia, place) in CHRONO_BODIES[name].items():
        assert found[key].mass == pytest.approx(mass, rel=2e-5), key
        np.testing.assert_allclose(found[key].com, place, atol=4e-4, err_msg=key)
        if inertia is not None:
            # the arm's own axes are tilted a little
            tilt = 2e-3 if key.endswith("arm") else 5e-5
            np.testing.assert_allclose(np.diag(found[key].inertia), inertia, rtol=tilt, err_msg=key)


def test_the_front_spring_of_the_hmmwv_as_built():
    """At 0.24646 m it is compressed by 92.5 mm: 0.627 of the way from -31.84 kN (80 mm) to -52.79 kN (100 mm)."""
    spring = shipped("hmmwv").axles[0].suspension.springs[0]
    length = np.linalg.norm(np.subtract(spring.chassis_point, spring.arm_point))
    deformation, force = np.array(spring.spring_curve).T
    assert length == pytest.approx(0.24646, abs=1e-5)
    assert np.interp(length - spring.rest_length, deformation, force) == pytest.approx(-44.98e3, rel=1e-3)


def test_the_damper_map_and_its_curve_agree_in_the_middle_of_the_stroke():
    for axle in shipped("hmmwv").axles:
        shock = axle.suspension.springs[1]
        lengths, rates, forces = shock.damper_map
        length = np.linalg.norm(np.subtract(shock.chassis_point, shock.arm_point))
        assert lengths[1] < length < lengths[2]
        for rate, row in zip(rates, forces, strict=True):
            at_rate = np.interp(length, lengths, row)
            assert at_rate == pytest.approx(np.interp(rate, *np.array(shock.damper_curve).T))


# ---- reading and writing ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", vehicle_names())
def test_round_trip(name, tmp_path):
    spec = load_vehicle(name)
    save_vehicle(spec, tmp_path / "copy.json")
    again = load_vehicle(tmp_path / "copy.json")
    assert again == spec
    save_vehicle(again, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_text() == (tmp_path / "copy.json").read_text()


def test_all_six_are_shipped():
    assert vehicle_names() == [
        "artcar", "gator", "hmmwv", "hmmwv-reduced", "sedan", "sedan-trailer", "skid-steer", "truck",
        "truck-semitrailer",
    ]  # fmt: skip
    assert all(load_vehicle(name).name == name for name in vehicle_names())


@pytest.mark.parametrize("name", vehicle_names())
@pytest.mark.parametrize("kind", KINDS)
def test_every_option_fits(name, kind):
    spec = load_vehicle(name)
    for option in option_names(name, kind):
        other = with_options(spec, **{kind: option})
        assert other.name == name
        if kind == "tire":
            assert [axle.tire.mass for axle in other.all_axles] == [axle.tire.mass for axle in spec.all_axles]


def test_options_change_what_they_name():
    spec = load_vehicle("hmmwv")
    other: Any = with_options(spec, tire="fiala", powertrain="simplemap", driveline="rwd")
    assert {axle.tire.template for axle in other.axles} == {"fiala"}
    assert (other.engine.template, other.transmission.template) == ("map", "automatic-map")
    assert other.driveline.template == "shafts-2wd"
    assert other.axles[0].suspension == spec.axles[0].suspension


def test_front_and_rear_tires_differ():
    front, rear = (axle.tire for axle in with_options(load_vehicle("gator"), tire="rigid").axles)
    assert (front.radius, rear.radius) == (0.28575, 0.3175)


def test_the_default_is_one_of_the_options():
    spec = load_vehicle("hmmwv")
    assert with_options(spec, tire="tmeasy", powertrain="shafts", driveline="4wd") == spec


def test_an_option_from_a_file(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text((DATA / "hmmwv" / "tires" / "fiala.json").read_text())
    assert with_options(load_vehicle("hmmwv"), tire=str(path)).axles[1].tire.template == "fiala"


def test_property_files_stand_for_their_keys():
    tir: Any = with_options(load_vehicle("sedan"), tire="pacejka2002").axles[0].tire.parameters["tir"]
    assert tir["PROPERTY_FILE_FORMAT"] == "PAC2002"
    assert tir["PEX4"] == -3.7604e-5
    assert tir["UNLOADED_RADIUS"] == 0.344


# ---- mistakes --------------------------------------------------------------------------------------------------------


@pytest.fixture
def hmmwv(tmp_path):
    """A copy of a shipped vehicle in one file, as a dictionary, and a function that loads it as changed."""
    save_vehicle(load_vehicle("hmmwv"), tmp_path / "hmmwv.json")
    data = json.loads((tmp_path / "hmmwv.json").read_text())

    def error() -> str:
        (tmp_path / "hmmwv.json").write_text(json.dumps(data))
        with pytest.raises(SpecError) as caught:
            load_vehicle(tmp_path / "hmmwv.json")
        message = str(caught.value)
        assert "\n" not in message
        return message

    return data, error


def suspension(data):
    return data["axles"][0]["suspension"]


def missing_point(data):
    del suspension(data)["upper_arm_front"]


def missing_mass(data):
    del data["chassis"]["components"][0]["mass"]


def missing_inertia(data):
    del data["axles"][1]["wheel"]["inertia"]


def missing_suspension(data):
    del data["axles"][1]["suspension"]


def negative_stiffness(data):
    suspension(data)["springs"][0]["stiffness"] = -5.0


def unknown_key(data):
    suspension(data)["upper_arm_frnt"] = [0, 0, 0]


def unknown_template(data):
    suspension(data)["template"] = "double-whishbone"


def no_template(data):
    del data["driveline"]["template"]


def no_object(data):
    data["engine"] = "shafts"


def short_point(data):
    suspension(data)["tierod_chassis"] = [1.0, 2.0]


def text_for_number(data):
    data["axles"][0]["brake"]["max_torque"] = "4000"


def truth_for_number(data):
    data["axles"][0]["brake"]["max_torque"] = True


def fraction_for_index(data):
    data["axles"][0]["steering"] = 0.5


def no_such_steering(data):
    data["axles"][0]["steering"] = 3


def wrong_wheelbase(data):
    data["wheelbase"] = 2.776


def infinite(data):
    data["start_height"] = float("inf")


def unordered_curve(data):
    suspension(data)["springs"][0]["spring_curve"] = [[0.1, 5.0], [0.0, 0.0]]


def unordered_stops(data):
    suspension(data)["springs"][0]["min_length"] = 0.5


def short_map(data):
    suspension(data)["springs"][1]["damper_map"][2].pop()


def bad_literal(data):
    suspension(data)["inertia_axes"] = "arms"


def no_axles(data):
    data["axles"] = []


def no_transmission(data):
    del data["transmission"]


def zero_mass(data):
    data["axles"][0]["tire"]["mass"] = 0.0


MISTAKES = {
    missing_point: "axles[0].suspension.upper_arm_front: missing; give a point (x, y, z) [m]",
    missing_mass: "chassis.components[0].mass: missing; give a number [kg]",
    missing_inertia: "axles[1].wheel.inertia: missing; give moments of inertia (Ixx, Iyy, Izz) [kg·m²]",
    missing_suspension: "axles[1].suspension: missing; give an object with a template: double-wishbone, double-",
    negative_stiffness: "axles[0].suspension.springs[0].stiffness: must be zero or positive, got -5.0",
    unknown_key: "axles[0].suspension.upper_arm_frnt: unknown key (did you mean 'upper_arm_front'?); known: template,",
    unknown_template: "axles[0].suspension.template: must be one of double-wishbone, double-wishbone-reduced,",
    no_template: "driveline.template: missing; give one of shafts-2wd, shafts-4wd, simple",
    no_object: "engine: must be an object with a template, got 'shafts'; templates: simple, map, shafts",
    short_point: "axles[0].suspension.tierod_chassis: must be a point (x, y, z) [m], got [1.0, 2.0]",
    text_for_number: "axles[0].brake.max_torque: must be a number [N·m], got '4000'",
    truth_for_number: "axles[0].brake.max_torque: must be a number [N·m], got True",
    fraction_for_index: "axles[0].steering: must be a whole number, got 0.5",
    no_such_steering: "axles[0].steering: must be the index of a steering, 0, got 3",
    wrong_wheelbase: "wheelbase: must be that of the axles within 2 %, 3.378 m (their frames) or 3.302 m",
    infinite: "start_height: must be a finite number, got inf",
    unordered_curve: "axles[0].suspension.springs[0].spring_curve: must be two or more (x, y) pairs with increasing x",
    unordered_stops: "axles[0].suspension.springs[0].min_length: must be less than max_length 0.3, got 0.5",
    short_map: "axles[0].suspension.springs[1].damper_map: forces: must be 3 rows (rates) of 4 (lengths), got (2, [4])",
    bad_literal: "axles[0].suspension.inertia_axes: must be one of 'arm', 'vehicle', got 'arms' (did you mean 'arm'?)",
    no_axles: "axles: must be one or more, got []",
    no_transmission: "engine: must be given together with a transmission; add one, or leave out engine",
    zero_mass: "axles[0].tire.mass: must be positive, got 0.0",
}


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.__name__)
def test_mistakes_are_named(mistake, hmmwv):
    data, error = hmmwv
    mistake(data)
    assert error().startswith(f"hmmwv.json: {MISTAKES[mistake]}")


def test_an_unknown_template_has_a_near_name(hmmwv):
    data, error = hmmwv
    unknown_template(data)
    assert error().endswith("got 'double-whishbone' (did you mean 'double-wishbone'?)")


def loading(path) -> str:
    with pytest.raises(SpecError) as caught:
        load_vehicle(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_broken_json_names_line_and_column(tmp_path):
    (tmp_path / "car.json").write_text('{\n  "name": "car",\n  "axles" 3\n}')
    assert loading(tmp_path / "car.json") == "car.json: line 3 column 11: broken JSON: Expecting ':' delimiter"


def test_a_key_given_twice(tmp_path):
    (tmp_path / "car.json").write_text('{"name": "a", "name": "b"}')
    assert loading(tmp_path / "car.json") == "car.json: name: given twice in one object; give it once"


def test_unreadable_files(tmp_path):
    assert "cannot be read: No such file" in loading(tmp_path / "none.json")
    (tmp_path / "latin.json").write_bytes(b'{"name": "\xe4"}')
    assert "not UTF-8" in loading(tmp_path / "latin.json")
    (tmp_path / "list.json").write_text("[1]")
    assert loading(tmp_path / "list.json").startswith(
        "list.json: must be an object with the keys of VehicleSpec, got [1]"
    )


def test_an_unknown_name_lists_those_known():
    assert loading("hmwv").startswith("vehicle 'hmwv': not shipped (did you mean 'hmmwv'?); known: artcar, gator,")


def test_files_in_files(tmp_path):
    """A subsystem in a file of its own, with mistakes under that file's name."""
    (tmp_path / "parts").mkdir()
    brake = tmp_path / "parts" / "brake.json"
    brake.write_text('{"max_torque": {"file": "torque.json"}}')
    (tmp_path / "parts" / "torque.json").write_text("400")
    (tmp_path / "one.json").write_text('{"file": "parts/brake.json"}')
    assert read_spec(Brake, tmp_path / "one.json") == Brake(max_torque=400.0)
    brake.write_text('{"max_torque": -1}')
    with pytest.raises(SpecError, match=r"^brake.json: max_torque: must be zero or positive, got -1$"):
        read_spec(Brake, tmp_path / "one.json")
    brake.write_text('{"file": "../one.json"}')
    with pytest.raises(SpecError, match=r"^brake.json: file: must not lead back to a file that led here"):
        read_spec(Brake, tmp_path / "one.json")
    brake.unlink()
    with pytest.raises(SpecError, match=r"^one.json: file: must be a file beside one.json, found none at 'parts/brake"):
        read_spec(Brake, tmp_path / "one.json")


def test_a_broken_property_file(tmp_path):
    (tmp_path / "bad.tir").write_text("[MODEL]\nFNOMIN = many\n")
    tire = {"template": "pacejka2002", "mass": 1, "inertia": [1, 1, 1], "radius": 1, "width": 1}
    (tmp_path / "tire.json").write_text(json.dumps(tire | {"parameters": {"tir": {"file": "bad.tir"}}}))
    with pytest.raises(SpecError, match=r"^bad.tir: line 2: FNOMIN: must be a number or quoted text, got 'many'$"):
        read_spec(Tire, tmp_path / "tire.json")


def test_unknown_options_list_those_there_are():
    with pytest.raises(
        SpecError,
        match=r"^gator: unknown tire 'tmesy' \(did you mean 'tmeasy'\?\); known: flexible, rigid, soil-rigid, tmeasy$",
    ):
        with_options(load_vehicle("gator"), tire="tmesy")
    spec = dataclasses.replace(load_vehicle("gator"), name="mine")
    with pytest.raises(
        SpecError, match=r"^mine: unknown driveline 'rwd'; known: none shipped; give the path of a .json"
    ):
        with_options(spec, driveline="rwd")


def test_rules_hold_in_python_too():
    part = RigidPart(mass=1.0, inertia=(1.0, 1.0, 1.0))
    with pytest.raises(SpecError, match="stiffness: must be zero or positive"):
        ForceLine(chassis_point=(0.0, 0.0, 0.0), arm_point=(0.0, 0.0, 1.0), stiffness=-1.0)
    with pytest.raises(SpecError, match="mass: must be positive"):
        RigidPart(mass=0.0, inertia=(1.0, 1.0, 1.0))
    axle = Axle(
        location=(0.0, 0.0, 0.0),
        suspension=RigidSuspension(spindle=part, axle_inertia=1.0),
        wheel=Wheel(mass=1.0, inertia=(1.0, 1.0, 1.0)),
        tire=Tire(template="rigid", mass=1.0, inertia=(1.0, 1.0, 1.0), radius=0.3, width=0.2),
    )
    engine = load_vehicle("gator")
    with pytest.raises(SpecError, match="driveline: must be given"):
        VehicleSpec(
            name="x",
            chassis=Chassis(components=(part,)),
            axles=(axle,),
            engine=engine.engine,
            transmission=engine.transmission,
        )
    assert isinstance(load_vehicle("hmmwv").axles[0].suspension, DoubleWishbone)
