"""Chrono's wheeled vehicles, all of them: which load, what they weigh, and one line for those that do not."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scripts.chrono_fleet import BLOCK, PAGE, loaded, table
from simwarp.importers.chrono_json import Node
from simwarp.importers.chrono_vehicle import load_chrono_vehicle
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.vehicle_spec import BeamAxle, SpecError

CHRONO = Path(__file__).parents[4] / "shared/reference/chrono/vehicles"
ONCE = ("Axle Tube", "Tube", "Triangular Link", "Bellcrank", "Bell Crank", "Draglink", "Panhard Rod", "Trackbar")
"""Parts of a suspension that it has one of; of all others there is one on each side."""
WALKED = (
    "truck/json/truck_Vehicle.json",
    "gclass/vehicle/G500_Vehicle.json",
    "generic/vehicle/Vehicle_SolidAxles.json",
    "MAN_Kat1/vehicle/MAN_10t_Vehicle_8WD.json",
    "Polaris/Polaris.json",
    "hmmwv/vehicle/HMMWV_Vehicle_replica.json",
    "generic/vehicle_multisteer/Vehicle_DualFront_Shared.json",
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
    total += sum(steering_mass(mount["Input File"]) for mount in value["Steering Subsystems"])
    for axle in value["Axles"]:
        total += suspension_mass(axle["Suspension Input File"])
        total += 2.0 * read(axle["Left Wheel Input File"])["Mass"] + 2.0 * tire
        if "Antirollbar Input File" in axle:
            total += 2.0 * read(axle["Antirollbar Input File"])["Arm"]["Mass"]
    return float(total)


def test_the_list_on_the_page_is_that_of_the_files():
    block = BLOCK.search(PAGE.read_text(encoding="utf-8"))
    assert block is not None
    made = table(CHRONO)
    assert block[0].partition("\n")[2].removesuffix("<!-- end of files -->") == made
    lines = [line.split("|")[2].strip() for line in made.splitlines()[2:]]
    assert lines.count("yes") >= 0.9 * len(lines)


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
        (TRUCK, {"Rear Chassis": []}, r"truck_Vehicle.json: Rear Chassis: must be absent, .*; use a file without it"),
        (FRONT, {"Template": "LeafspringAxle", "Spring": SPRING}, r"Spring.Free Length: missing; give a number \[m\]"),
        (FRONT, {"Template": "DeDionAxle"}, r"Template: must be one of .*got 'DeDionAxle'"),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(tmp_path, file, changes, message):
    root = edited(tmp_path, changes, file)
    with pytest.raises(SpecError, match=message) as caught:
        loaded(root, root / TRUCK)
    assert "\n" not in str(caught.value)
