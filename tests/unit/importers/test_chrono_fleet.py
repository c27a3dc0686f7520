"""Chrono's wheeled vehicles, all of them: which load, what they weigh, and one line for those that do not."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scripts.chrono_fleet import BLOCK, FIGURES, FIGURES_PAGE, PAGE, loaded, row, vehicle_files
from simwarp.importers.chrono_json import Node
from simwarp.importers.chrono_suspensions import force_line
from simwarp.importers.chrono_vehicle import load_chrono_vehicle
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.vehicle_spec import BeamAxle, RotaryArm, SpecError

CHRONO = Path(__file__).parents[4] / "shared/reference/chrono/vehicles"
ONCE = ("Axle Tube", "Tube", "Triangular Link", "Bellcrank", "Bell Crank", "Draglink", "Panhard Rod", "Trackbar",
        "Axle Housing", "Transverse Beam")  # fmt: skip
"""Parts of a suspension that it has one of; of all others there is one on each side."""
WALKED = (
    "truck/json/truck_Vehicle.json",
    "gclass/vehicle/G500_Vehicle.json",
    "generic/vehicle/Vehicle_SolidAxles.json",
    "MAN_Kat1/vehicle/MAN_10t_Vehicle_8WD.json",
    "Polaris/Polaris.json",
    "hmmwv/vehicle/HMMWV_Vehicle_replica.json",
    "generic/vehicle_multisteer/Vehicle_DualFront_Shared.json",
    "generic/vehicle/Vehicle_HendricksonPRIMAXX.json",
    "articulated_chassis/ACV_Vehicle.json",
    "mtv/vehicle/MTV_Vehicle_WalkingBeam.json",
)
MASSLESS_TIERODS = ("DoubleWishbone", "MultiLink", "MacPhersonStrut")

pytestmark = pytest.mark.skipif(not CHRONO.exists(), reason="the files of the other simulator are not here")


def read(file: str) -> Any:
    return Node.of_file(CHRONO / file).value


def suspension_mass(file: str) -> float:
    """Of both sides [kg]: every "Mass" of the file, as often as there is such a part."""
    value, total = read(file), 0.0
    template = value["Template"]
    for name, part in value.items():
        if isinstance(part, list):  # bodies of the generic suspension
            total += sum(2.0 * body.get("Mass", 0.0) for body in part if isinstance(body, dict))
        if not isinstance(part, dict) or "Mass" not in part:
            continue
        across = name == "Tierod" and template != "SolidBellcrankThreeLinkAxle"
        if name == "Tierod" and template in MASSLESS_TIERODS:
            continue
        total += (1.0 if name in ONCE or across else 2.0) * part["Mass"]
    return total


def steering_mass(file: str) -> float:
    return sum(part["Mass"] for part in read(file).values() if isinstance(part, dict) and "Mass" in part)


def file_mass(vehicle: str, tire: float) -> float:
    """All that a vehicle's files weigh [kg]."""
    value = read(vehicle)
    total = sum(part["Mass"] for part in read(value["Chassis"]["Input File"])["Components"])
    total += sum(steering_mass(mount["Input File"]) for mount in value.get("Steering Subsystems", ()))
    for rear in value.get("Rear Chassis", ()):
        total += sum(part["Mass"] for part in read(rear["Input File"])["Components"])
    total += sum(2.0 * read(beam["Input File"])["Beam"]["Mass"] for beam in value.get("Subchassis", ()))
    for axle in value["Axles"]:
        total += suspension_mass(axle["Suspension Input File"])
        total += 2.0 * read(axle["Left Wheel Input File"])["Mass"] + 2.0 * tire
        if "Antirollbar Input File" in axle:
            total += 2.0 * read(axle["Antirollbar Input File"])["Arm"]["Mass"]
    return float(total)


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_the_list_on_the_page_is_that_of_the_files():
    """All but its last column, which is that of the slow test that drives them; nine in ten drive plausibly."""
    block = BLOCK.search(PAGE.read_text(encoding="utf-8"))
    assert block is not None
    lines = [cells(line) for line in block[0].splitlines()[3:-1]]
    assert [tuple(line[:3]) for line in lines] == [row(CHRONO, vehicle) for vehicle in vehicle_files(CHRONO)]
    assert sum(line[3].startswith("yes") for line in lines) >= 0.9 * len(lines)


def test_there_are_figures_of_all_that_load():
    list_block = BLOCK.search(PAGE.read_text(encoding="utf-8"))
    block = FIGURES.search(FIGURES_PAGE.read_text(encoding="utf-8"))
    assert block is not None
    assert list_block is not None
    listed = [cells(line) for line in list_block[0].splitlines()[3:-1]]
    assert [cells(line)[0] for line in block[0].splitlines()[3:-1]] == [line[0] for line in listed if line[1] == "yes"]


@pytest.mark.parametrize("name", WALKED)
def test_a_vehicle_weighs_what_its_files_do(name):
    """Links are massless here, and what they weigh is on their ends: nothing is lost, nothing counted twice."""
    spec = loaded(CHRONO, CHRONO / name)
    builder = ModelBuilder()
    add_vehicle(builder, spec)
    expected = file_mass(name, spec.axles[0].tire.mass)
    assert sum(body.mass for body in builder.bodies) == pytest.approx(expected, rel=1e-9)


def test_masses_of_links_stay_where_they_are():
    """The rear axle of a truck, front to rear: its links' centres of mass are in the middle between their ends."""
    name = "truck/json/truck_Vehicle.json"
    spec, value = loaded(CHRONO, CHRONO / name), read("truck/json/truck_Vehicle.json")
    chassis = read(value["Chassis"]["Input File"])["Components"]
    total = sum(part["Mass"] for part in chassis)
    moment = sum(part["Mass"] * np.array(part["Centroidal Frame"]["Location"]) for part in chassis)
    for axle in value["Axles"]:
        suspension, place = read(axle["Suspension Input File"]), np.array(axle["Suspension Location"])
        for key, sides in (("Triangular Link", 1.0), ("Longitudinal Link", 2.0)):
            link = suspension[key]
            total += 0.5 * sides * link["Mass"]
            moment = moment + 0.5 * sides * link["Mass"] * (place + link["Location Chassis"]) * (1.0, 0.0, 1.0)
        if "Draglink" in suspension:
            link = suspension["Draglink"]
            total += 0.5 * link["Mass"]
            moment = moment + 0.5 * link["Mass"] * (place + link["Location Steering"])
    found = spec.chassis.components
    assert sum(part.mass for part in found) == pytest.approx(total)
    centre = sum(part.mass * np.array(part.com) for part in found) / total
    np.testing.assert_allclose(centre, moment / total, rtol=1e-9, atol=1e-12)


def test_a_bell_crank_steers_both_knuckles():
    front = loaded(CHRONO, CHRONO / "MAN_Kat1/vehicle/MAN_10t_Vehicle_8WD.json").axles[0].suspension
    assert isinstance(front, BeamAxle)
    assert front.bell_crank is not None
    assert (front.crossed_tierods, front.guide, len(front.rods)) == (True, "links", 1)
    assert front.arm is not None
    assert front.arm.chassis_point[1] == 0.0


def test_anti_roll_bars_of_panhard_axles_are_stiffness_in_roll():
    """Arms 0.4 m long, 0.7 m apart: a roll of 1 rad twists the bar by 0.7 / 0.4, whose energy is the same both ways."""
    axle = loaded(CHRONO, CHRONO / "gclass/vehicle/G500_Vehicle.json").axles[0].suspension
    assert isinstance(axle, BeamAxle)
    assert axle.roll_stiffness == pytest.approx(1000.0 * (0.7 / 0.4) ** 2)
    assert axle.roll_damping == pytest.approx(10.0 * (0.7 / 0.4) ** 2)
    assert [rod.mirrored for rod in axle.rods] == [False]


def test_a_generic_double_wishbone_is_the_one_that_it_copies():
    """Points are those of the HMMWV's file, to the millimetre that both are printed with."""
    copy, own = (
        loaded(CHRONO, CHRONO / f"hmmwv/vehicle/HMMWV_Vehicle{end}.json").axles[0].suspension
        for end in ("_replica", "")
    )
    assert copy.template == own.template == "double-wishbone"
    for name in ("upper_arm_upright", "lower_arm_upright", "tierod_chassis", "tierod_upright"):
        np.testing.assert_allclose(getattr(copy, name), getattr(own, name), atol=6e-4)
    for arm in ("upper_arm", "lower_arm"):  # one hinge axis: its direction within the rounding of the quaternion
        axes = [np.subtract(getattr(each, f"{arm}_front"), getattr(each, f"{arm}_back")) for each in (copy, own)]
        first, second = (axis / np.linalg.norm(axis) for axis in axes)
        assert first @ second == pytest.approx(1.0, abs=1e-4)
        assert getattr(copy, arm).mass == getattr(own, arm).mass


def test_a_file_that_names_a_vehicle_is_that_vehicle():
    path = CHRONO / "sedan/Sedan.json"
    with pytest.warns(UserWarning, match=r"^Sedan.json: Powertrain: left out; give engine= and transmission="):
        found = load_chrono_vehicle(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        own = load_chrono_vehicle(CHRONO / "sedan/vehicle/Sedan_Vehicle.json", tire="sedan/tire/Sedan_TMeasyTire.json")
    assert (found.name, found.axles, found.chassis) == ("Sedan", own.axles, own.chassis)


def edited(folder: Path, changes: dict[str, Any], file: str) -> Path:
    """A folder that has all files of Chrono's, one of them changed: links to the others."""
    for path in CHRONO.rglob("*.json"):
        target = folder / path.relative_to(CHRONO)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.symlink_to(path)
    value = read(file)
    for key, change in changes.items():
        if change is None:
            del value[key]
        else:
            value[key] = change
    (folder / file).unlink()
    (folder / file).write_text(json.dumps(value))
    return folder


FRONT = "truck/json/truck_FrontSolidThreeLinkAxle.json"
TRUCK = "truck/json/truck_Vehicle.json"
SPRING = {"Location Chassis": [0.0, 0.529, 0.26], "Location Axle": [0.0, 0.529, 0.06], "Spring Coefficient": 420000.0}


@pytest.mark.parametrize(
    ("file", "changes", "message"),
    [
        (FRONT, {"Bellcrank": None}, r"truck_FrontSolidThreeLinkAxle.json: Bellcrank: missing.*; give an object"),
        (FRONT, {"Camber": 3}, r"truck_FrontSolidThreeLinkAxle.json: Camber: unknown key"),
        (FRONT, {"Template": "LeafspringAxle", "Spring": SPRING}, r"Spring.Free Length: missing; give a number \[m\]"),
        (FRONT, {"Template": "SAELeafspringAxle"}, r"Template: must be one of .*got 'SAELeafspringAxle'"),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(tmp_path, file, changes, message):
    root = edited(tmp_path, changes, file)
    with pytest.raises(SpecError, match=message) as caught:
        loaded(root, root / TRUCK)
    assert "\n" not in str(caught.value)


ACV = "articulated_chassis/ACV_Vehicle.json"
AXLE = {
    "Chassis Index": 0, "Suspension Location": [-0.5, 0, 0],
    "Suspension Input File": "articulated_chassis/ACV_RigidSuspension.json",
    "Left Wheel Input File": "articulated_chassis/ACV_Wheel.json",
    "Right Wheel Input File": "articulated_chassis/ACV_Wheel.json",
}  # fmt: skip
SPRUNG = AXLE | {"Suspension Input File": "generic/suspension/SemiTrailingArm.json"}


@pytest.mark.parametrize(
    ("file", "changes", "message"),
    [
        (ACV, {"Axles": [AXLE | {"Chassis Index": -1}, AXLE | {"Chassis Index": 1}]},
         r"ACV_Vehicle.json: Axles\[1\].Chassis Index: must be -1, .*, of which the vehicle has 1, got 1"),
        (ACV, {"Axles": [AXLE | {"Chassis Index": -1}, SPRUNG]},
         r"ACV_Vehicle.json: Axles\[1\].Suspension Input File: must be rigid on .*, got trailing-arm; only axles"),
        (ACV, {"Axles": [AXLE | {"Chassis Index": -1}]}, r"steerings\[0\]: must be the steering of an axle"),
        ("articulated_chassis/ACV_RearChassis.json", {"Front Connector Location": None},
         r"ACV_RearChassis.json: Front Connector Location: missing; give a list of 3 numbers \[m\]"),
        ("articulated_chassis/ACV_FrontChassis.json", {"Rear Connector Location": None},
         r"ACV_FrontChassis.json: Rear Connector Location: missing"),
        ("articulated_chassis/ACV_Connector.json", {"Template": "ChassisConnectorHitch"},
         r"Connector Input File: must be that of a ChassisConnectorArticulated or a ChassisConnectorTorsion, .*; desc"),
        ("articulated_chassis/ACV_Connector.json", {"Maximum Steering Angle (deg)": None},
         r"ACV_Connector.json: Maximum Steering Angle \(deg\): missing"),
    ],
)  # fmt: skip
def test_mistakes_of_articulated_vehicles_are_one_line(tmp_path, file, changes, message):
    root = edited(tmp_path, changes, file)
    with pytest.raises(SpecError, match=message) as caught:
        loaded(root, root / ACV)
    assert "\n" not in str(caught.value)


def test_an_articulated_vehicle_hinges_where_its_connectors_meet():
    """Front and rear connectors are 1 m from their chassis, whose axle is half a metre behind or ahead."""
    spec = loaded(CHRONO, CHRONO / ACV)
    (mount,) = spec.steerings
    assert isinstance(mount.steering, RotaryArm)
    assert mount.location == (-1.0, 0.0, 0.1)
    assert mount.steering.max_angle == pytest.approx(math.radians(30.0))
    assert mount.steering.arm.com == pytest.approx((-1.0, 0.0, 0.3))
    assert [axle.location for axle in spec.axles] == [(0.5, 0.0, 0.0), (-2.5, 0.0, 0.0)]
    assert [axle.steering for axle in spec.axles] == [None, 0]


def test_parts_of_a_rear_chassis_are_where_it_is(tmp_path):
    """A truck's rear half, held 2 m behind where its own frame would be: its axles and its steering are there too."""
    value = read("mtv/vehicle/MTV_Vehicle_WalkingBeam.json")
    mounts = [mount | {"Chassis Index": -1} for mount in value["Steering Subsystems"]]
    root = edited(tmp_path, {"Steering Subsystems": mounts}, "mtv/vehicle/MTV_Vehicle_WalkingBeam.json")
    file = root / "mtv/chassis/MTV_RearChassis.json"
    rear = read("mtv/chassis/MTV_RearChassis.json")
    file.unlink()
    file.write_text(json.dumps(rear | {"Front Connector Location": [0.15, 0.0, 0.45]}))
    own = loaded(CHRONO, CHRONO / "mtv/vehicle/MTV_Vehicle_WalkingBeam.json")
    moved = loaded(root, root / "mtv/vehicle/MTV_Vehicle_WalkingBeam.json")
    assert moved.steerings == own.steerings
    shift = [np.subtract(b.location, a.location).tolist() for a, b in zip(own.axles, moved.axles, strict=True)]
    np.testing.assert_allclose(shift, [[0.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [-2.0, 0.0, 0.0]], atol=1e-12)
    weight = rear["Components"][0]["Mass"]
    before, after = (part.com[0] for spec in (own, moved) for part in spec.chassis.components if part.mass == weight)
    assert before - after == pytest.approx(2.0)


def test_what_a_frame_in_parts_leaves_out_is_named():
    path, tire = CHRONO / "mtv/vehicle/MTV_Vehicle_WalkingBeam.json", "mtv/tire/FMTV_TMeasyTire.json"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load_chrono_vehicle(path, tire=tire)
    found = {str(each.message) for each in caught}
    assert "MTV_ChassisConnector.json: Torsional Stiffness: left out; the rear chassis does not twist" in found
    assert "MTV_Balancer.json: Beam: does not walk here; axles spring on the chassis" in found
    text = "MTV_SolidThreeLinkAxleF.json: Spindle.Inertia: a moment of 0 is no body's; it is raised to 0.5175 kg·m²"
    assert text in found


DE_DION, TOE_BAR = "generic/suspension/DeDionAxle.json", "generic/suspension/ToeBarDeDionAxle.json"
ROD: dict[str, Any] = {
    "Mass": 10.0, "Inertia": [1.0, 0.1, 1.0], "Radius": 0.02, "Location Connector Chassis": [-0.2, -0.44, 0.1],
    "Location Connector Axle": [-0.2, 0.44, 0.1],
}  # fmt: skip


@pytest.mark.parametrize("template", ["DeDionAxle", "PushPipeAxle"])
def test_axles_on_a_ball_weigh_what_their_files_do(tmp_path, template):
    """A front axle with knuckles and a rear one; no file of push pipes is here: those of De Dion axles are changed."""
    value = read("generic/vehicle/Vehicle_SolidAxles.json")
    root = edited(tmp_path, {"Axles": [axle | {"Suspension Input File": file} for axle, file in
                                       zip(value["Axles"], (TOE_BAR, DE_DION), strict=True)]},
                  "generic/vehicle/Vehicle_SolidAxles.json")  # fmt: skip
    expected = file_mass("generic/vehicle/Vehicle_SolidAxles.json", 0.0)
    expected -= sum(suspension_mass(axle["Suspension Input File"]) for axle in value["Axles"])
    for file in (TOE_BAR, DE_DION):
        suspension = read(file)
        watt = suspension["Watt Mechanism"]
        if template == "PushPipeAxle":
            suspension["Template"] = suspension["Template"].replace("DeDion", "PushPipe")
            suspension["Panhard Rod"] = ROD
            del suspension["Watt Mechanism"], suspension["Axle Tube"]["Location Stabilizer"]
            expected += ROD["Mass"]
            (root / file).unlink()
            (root / file).write_text(json.dumps(suspension))
        else:
            expected += watt["Center Link Mass"] + 2.0 * watt["Side Link Mass"]
        once = ("Axle Tube", "Tierod", "Draglink")
        parts = {name: part for name, part in suspension.items() if isinstance(part, dict) and "Mass" in part}
        expected += sum((1.0 if name in once else 2.0) * part["Mass"] for name, part in parts.items() if part != ROD)
    spec = loaded(root, root / "generic/vehicle/Vehicle_SolidAxles.json")
    builder = ModelBuilder()
    add_vehicle(builder, spec)
    tires = 4.0 * spec.axles[0].tire.mass
    assert sum(body.mass for body in builder.bodies) == pytest.approx(expected + tires, rel=1e-9)


def test_stops_the_wrong_way_round_are_turned():
    root = CHRONO / "generic/suspension"
    with pytest.warns(UserWarning, match=r"DeDionAxle.json: Spring.Minimum Length: 0.28 m is above Maximum"):
        line = force_line(Node.of_file(root / "DeDionAxle.json").child("Spring"), "Location Axle")
    assert (line.min_length, line.max_length) == (0.12, 0.28)


def test_an_axle_without_steering_may_say_so(tmp_path):
    """-1, as in the files of the other simulator; twin wheels are refused in one line."""
    value = read(TRUCK)["Axles"]
    root = edited(tmp_path / "a", {"Axles": [value[0], value[1] | {"Steering Index": -1}, value[2]]}, TRUCK)
    assert loaded(root, root / TRUCK).axles[1].steering is None
    root = edited(tmp_path / "b", {"Axles": [value[0], value[1] | {"Wheel Separation": 0.3}, value[2]]}, TRUCK)
    with pytest.raises(SpecError, match=r"Axles\[1\].Wheel Separation: must be 0 or left out: .*; give one wheel"):
        loaded(root, root / TRUCK)


def test_a_hendrickson_axle_has_a_rod_to_each_knuckle():
    axle = loaded(CHRONO, CHRONO / "generic/vehicle/Vehicle_HendricksonPRIMAXX.json").axles[0].suspension
    assert isinstance(axle, BeamAxle)
    assert (axle.guide, axle.draglink_chassis, axle.tierod_chassis) == ("leaf-springs", None, (-0.091, 0.4, -0.079))
    assert [line.stiffness for line in axle.springs] == [0.0, 267062.0]
