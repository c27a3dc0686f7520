"""Chrono's vehicle files, as they are: the same vehicles as ours, units converted, mistakes named.

`chrono_vehicle_files.json` holds values of Project Chrono's data/vehicle (commit 7689fbc, BSD-3-Clause): path -> file.
"""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from simwarp.importers.chrono_drivetrain import BRAKES, DRIVELINES, ENGINES, STEERINGS, TRANSMISSIONS
from simwarp.importers.chrono_suspensions import SUSPENSIONS, antiroll_bar
from simwarp.importers.chrono_tires import TIRES
from simwarp.importers.chrono_vehicle import Files, load_chrono_vehicle
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import DATA, load_vehicle
from simwarp.vehicle.spec.vehicle_spec import BUMP_STOP, Spec, SpecError, Wheel
from simwarp.vehicle.tires.parameter_vector import tire_vector

VALUES = json.loads((Path(__file__).parent / "chrono_vehicle_files.json").read_text(encoding="utf-8"))
RPM = math.pi / 30.0
PRINTED = 5.5e-4
"""Points of the HMMWV are printed to the millimetre."""

HMMWV = {
    "engine": "hmmwv/powertrain/HMMWV_EngineShafts.json",
    "transmission": "hmmwv/powertrain/HMMWV_AutomaticTransmissionShafts.json",
    "tire": "hmmwv/tire/HMMWV_TMeasyTire.json",
}
SEDAN = {
    "engine": "sedan/powertrain/Sedan_EngineSimpleMap.json",
    "transmission": "sedan/powertrain/Sedan_AutomaticTransmissionSimpleMap.json",
    "tire": "sedan/tire/Sedan_TMeasyTire.json",
}


class Folder:
    """Chrono's data/vehicle in a temporary folder."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.values: dict[str, Any] = json.loads(json.dumps(VALUES))
        self.write()

    def write(self) -> None:
        for path, value in self.values.items():
            file = self.root / path
            file.parent.mkdir(parents=True, exist_ok=True)
            # Chrono's files have comments
            file.write_text("// a comment\n" + json.dumps(value, indent=2).replace("{", "{ /* more */", 1))
        for name in ("HMMWV", "Sedan"):
            tir = self.root / name.lower() / "tire" / f"{name}_Pac02Tire.tir"
            tir.write_text((DATA / "sedan" / "tires" / "pacejka2002.tir").read_text())

    def hmmwv(self, **options: Any) -> Any:
        self.write()
        path = self.root / "hmmwv/vehicle/HMMWV_Vehicle_4WD.json"
        return load_chrono_vehicle(path, **(HMMWV | options))

    def part(self, kind: str, path: str, *more: Any) -> Any:
        self.write()
        readers: Any = {
            "Suspension": SUSPENSIONS, "Steering": STEERINGS, "Brake": BRAKES, "Engine": ENGINES, "Tire": TIRES,
            "Transmission": TRANSMISSIONS, "Driveline": DRIVELINES, "Antirollbar": {"AntirollBarRSD": antiroll_bar},
        }  # fmt: skip
        return Files(self.root).part(kind, readers[kind], path, *more)

    def error(self, **options: Any) -> str:
        with pytest.raises(SpecError) as caught:
            self.hmmwv(**options)
        assert "\n" not in str(caught.value)
        return str(caught.value)


@pytest.fixture
def chrono(tmp_path):
    return Folder(tmp_path)


def differences(a: Any, b: Any, tolerance: float, place: str = "") -> list[str]:
    """Where two values differ by more than a tolerance, or a millionth of them."""
    pairs: list[tuple[str, Any, Any]] = []
    if isinstance(a, Spec) and type(a) is type(b):
        pairs = [(f".{field.name}", getattr(a, field.name), getattr(b, field.name)) for field in dataclasses.fields(a)]
    elif isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        pairs = [(f"[{index}]", x, y) for index, (x, y) in enumerate(zip(a, b, strict=True))]
    elif isinstance(a, (int, float)) and isinstance(b, (int, float)):
        return [] if abs(a - b) <= tolerance + 1e-6 * abs(a) else [f"{place}: {a} and {b}"]
    elif a != b:
        return [f"{place}: {a} and {b}"]
    return [line for step, x, y in pairs for line in differences(x, y, tolerance, place + step)]


# ---- the same vehicles -----------------------------------------------------------------------------------------------


def test_the_hmmwv_is_ours_within_the_printed_rounding(chrono):
    """Ours follows Chrono's C++ model: another shock, the tire's load instead of its index, a box in pictures."""
    ours: Any = load_vehicle("hmmwv")
    theirs = chrono.hmmwv()
    assert [axle.suspension.springs[1].damping for axle in theirs.axles] == [19015.57, 36725.22]
    axles = []
    for mine, other in zip(ours.axles, theirs.axles, strict=True):
        shock = dataclasses.replace(
            other.suspension.springs[1],
            damping=0.0,
            damper_curve=mine.suspension.springs[1].damper_curve,
            damper_map=mine.suspension.springs[1].damper_map,
        )
        springs = (other.suspension.springs[0], shock)
        suspension = dataclasses.replace(other.suspension, springs=springs)
        axles.append(dataclasses.replace(other, suspension=suspension, tire=mine.tire))
    sizes = {"size": ours.chassis.size, "size_center": ours.chassis.size_center}
    chassis = dataclasses.replace(theirs.chassis, **sizes)
    theirs = dataclasses.replace(
        theirs, name="hmmwv", axles=tuple(axles), chassis=chassis, maneuver_defaults=ours.maneuver_defaults
    )
    assert differences(ours, theirs, PRINTED) == []


def test_the_sedan_is_ours_but_for_its_trim_and_the_balance_of_its_shafts(chrono):
    """Ours has longer springs, with which it stands as designed, and shafts that do not push the chassis aside."""
    theirs: Any = load_chrono_vehicle(chrono.root / "sedan/vehicle/Sedan_Vehicle.json", **SEDAN)
    ours: Any = load_vehicle("sedan")
    axles = []
    for mine, other in zip(ours.axles, theirs.axles, strict=True):
        spring, damper = other.suspension.springs
        assert spring.rest_length == 0.51
        spring = dataclasses.replace(spring, rest_length=mine.suspension.springs[0].rest_length)
        suspension = dataclasses.replace(other.suspension, springs=(spring, damper))
        tire = dataclasses.replace(other.tire, parameters=mine.tire.parameters)
        axles.append(dataclasses.replace(other, tire=tire, suspension=suspension))
    assert theirs.driveline.reaction == -1.0
    for mine, other in zip(ours.axles, theirs.axles, strict=True):
        assert mine.tire.parameters == {**other.tire.parameters, "damping_ratio": 0.5}
    theirs = dataclasses.replace(
        theirs, name="sedan", axles=tuple(axles), start_height=ours.start_height,
        maneuver_defaults=ours.maneuver_defaults,
        driveline=dataclasses.replace(theirs.driveline, axle=-1, reaction=0.0),
        chassis=dataclasses.replace(theirs.chassis, size=ours.chassis.size, size_center=ours.chassis.size_center),
    )  # fmt: skip
    assert differences(ours, theirs, 1e-8) == []


def test_the_gator_declares_the_wheelbase_of_another(chrono):
    path = chrono.root / "gator/json/Gator_Vehicle.json"
    tires = [f"gator/json/Gator_TMeasyTire{end}.json" for end in ("Front", "Rear")]
    with pytest.warns(UserWarning, match=r"^Gator_Vehicle.json: Wheelbase: 2.776 m is not that of the axles, 1.94 m"):
        theirs: Any = load_chrono_vehicle(path, tire=tires, root=chrono.root)
    ours: Any = load_vehicle("gator")
    assert theirs.wheelbase is None
    assert theirs.engine is None
    assert [axle.tire.radius for axle in theirs.axles] == [0.28575, 0.3175]
    assert theirs.steerings[0].steering.max_angle == pytest.approx(math.radians(55.0))
    # the arm's inertia is another in the C++ model, which ours follows
    front = dataclasses.replace(theirs.axles[0].suspension, arm=ours.axles[0].suspension.arm)
    assert differences(ours.axles[0].suspension, front, 1e-9) == []
    assert differences(ours.axles[1].suspension, theirs.axles[1].suspension, 1e-9) == []


def test_powertrains_are_ours(chrono):
    for name, engine, transmission in (
        ("simplemap", "EngineSimpleMap", "AutomaticTransmissionSimpleMap"),
        ("simple", "EngineSimple", "AutomaticTransmissionSimpleMap"),
        ("cvt", "EngineSimpleMap", "AutomaticTransmissionSimpleCVT"),
    ):
        ours = with_options(load_vehicle("hmmwv"), powertrain=name)
        theirs = [
            chrono.part("Engine", f"hmmwv/powertrain/HMMWV_{engine}.json"),
            chrono.part("Transmission", f"hmmwv/powertrain/HMMWV_{transmission}.json"),
        ]
        assert differences((ours.engine, ours.transmission), tuple(theirs), 1e-7) == []
    ours = with_options(load_vehicle("sedan"), powertrain="shafts")
    assert differences(ours.engine, chrono.part("Engine", "sedan/powertrain/Sedan_EngineShafts.json"), 1e-7) == []
    manual = chrono.part("Transmission", "sedan/powertrain/Sedan_ManualTransmissionShafts.json")
    assert differences(ours.transmission, manual, 1e-9) == []


def test_drivelines_are_ours(chrono):
    for name, file, axles in (("4wd", "Driveline4WD", (0, 1)), ("simple", "DrivelineSimple", (0, 1))):
        ours = with_options(load_vehicle("hmmwv"), driveline=name).driveline
        assert ours == chrono.part("Driveline", f"hmmwv/driveline/HMMWV_{file}.json", axles)
    ours = with_options(load_vehicle("hmmwv"), driveline="fwd").driveline
    assert ours == chrono.part("Driveline", "hmmwv/driveline/HMMWV_Driveline2WD.json", (0,))


# ---- single parts ----------------------------------------------------------------------------------------------------


def test_springs_with_limits_have_bump_stops(chrono):
    spring, shock = chrono.part("Suspension", "hmmwv/suspension/HMMWV_DoubleWishboneRear.json").springs
    assert (spring.min_length, spring.max_length, spring.bump_curve) == (0.15, 0.35, BUMP_STOP)
    assert spring.rest_length == 0.382
    assert spring.spring_curve[0] == (-0.2, -711719.3)
    assert (shock.rest_length, shock.bump_curve) == (None, None)


def test_a_shock_with_a_map(chrono):
    shock = chrono.part("Suspension", "hmmwv/suspension/HMMWV_DoubleWishboneFront_mapShock.json").springs[1]
    lengths, rates, forces = shock.damper_map
    assert (len(lengths), rates) == (15, (-0.666667, -0.333333, 0.0, 0.333333, 0.666667))
    assert forces[4][5:7] == (14973.3, 14973.3)
    # the C++ shock in the middle of its stroke, 128.25 lbf s/in in rebound
    ours: Any = load_vehicle("hmmwv")
    curve = np.array(ours.axles[0].suspension.springs[1].damper_curve).T
    assert np.interp(0.666667, *curve) == pytest.approx(14973.3, rel=1e-4)
    assert np.interp(-0.666667, *curve) == pytest.approx(-8347.71, rel=1e-4)


def test_old_and_degressive_dampers(chrono):
    values = chrono.values["sedan/suspension/Sedan_DoubleWishbone.json"]
    values["Shock"]["Curve Data"] = [[-1, -10], [1, 20]]
    del values["Shock"]["Damping Coefficient"]
    values["Spring"]["Curve Data"] = [[-1, -100], [1, 100]]
    values["Spring"]["Preload"] = 7
    spring, shock = chrono.part("Suspension", "sedan/suspension/Sedan_DoubleWishbone.json").springs
    assert shock.damper_curve == ((-1.0, -10.0), (1.0, 20.0))
    assert (spring.spring_curve, spring.preload) == (((-1.0, -100.0), (1.0, 100.0)), 7.0)
    del values["Shock"]["Curve Data"]
    values["Shock"] |= {"Damping Coefficient": 1000, "Degressivity Compression": 3, "Degressivity Expansion": 1}
    curve = np.array(chrono.part("Suspension", "sedan/suspension/Sedan_DoubleWishbone.json").springs[1].damper_curve).T
    assert np.interp([-1.0, 1.0], *curve) == pytest.approx([-1000 / 4, 1000 / 2])


def test_bushings(chrono):
    path = "hmmwv/suspension/HMMWV_DoubleWishboneFront_bushings.json"
    found = chrono.part("Suspension", path)
    assert found.upper_arm_bushing == found.lower_arm_bushing
    assert found.upper_arm_bushing.stiffness_linear == 7e7
    assert found.upper_arm_bushing.damping_rotational == 500.0
    chrono.values[path]["Upper Control Arm"]["Bushing Data"]["DOF"]["Stiffness Linear"] = 2
    with pytest.raises(SpecError, match=r"Upper Control Arm.Bushing Data.DOF.Stiffness Linear: must be 0.*, got 2$"):
        chrono.part("Suspension", path)


def test_other_suspensions(chrono):
    reduced = chrono.part("Suspension", "hmmwv/suspension/HMMWV_DoubleWishboneReducedFront.json")
    assert (reduced.springs[0].stiffness, reduced.springs[0].damping) == (167062.0, 60068.0)
    strut = chrono.part("Suspension", "generic/suspension/MacPhersonStrut.json")
    assert strut.strut.com == pytest.approx((-0.094512535, 0.81914575, 0.4137268))
    assert strut.lower_arm.mass == 5.091
    links = chrono.part("Suspension", "sedan/suspension/Sedan_MultiLink.json")
    assert links.trailing_link_chassis == (0.723, 0.449, -0.072)
    assert links.lateral.inertia == (0.0543, 0.0541, 0.000279)
    rigid = chrono.part("Suspension", "generic/suspension/RigidSuspension.json")
    assert rigid.spindle.com == (0.0, 1.1, 0.0)


def test_axles_that_the_data_lack(chrono):
    rigid = chrono.values["generic/suspension/RigidSuspension.json"]
    tube = {"Mass": 10, "COM": [0, 0, 0], "Inertia": [6, 3, 6], "Radius": 0.05, "Pin Location": [0, 0, 0.15]}
    chrono.values["pinned.json"] = rigid | {"Template": "RigidPinnedAxle", "Tube": tube}
    pinned = chrono.part("Suspension", "pinned.json")
    assert (pinned.pin, pinned.axle_tube.mass) == ((0.0, 0.0, 0.15), 10.0)
    spring = {"Location Chassis": [0.3, 0.8, 0.4], "Location Arm": [0.3, 0.8, 0.0]}
    chrono.values["trailing.json"] = rigid | {
        "Template": "SemiTrailingArm",
        "Trailing Arm": {
            "Mass": 2, "COM": [0.3, 0.8, 0], "Inertia": [1, 1, 1], "Location Spindle": [0, 0.9, 0],
            "Location Chassis Outer": [0.5, 0.9, 0], "Location Chassis Inner": [0.5, 0.6, 0],
        },
        "Spring": spring | {"Spring Coefficient": 350000, "Free Length": 0.356},
        "Shock": spring | {"Damping Coefficient": 20000},
        "Toe Angle (deg)": 1.0,
    }  # fmt: skip
    arm = chrono.part("Suspension", "trailing.json")
    assert arm.pivot == pytest.approx((0.5, 0.75, 0.0))
    assert arm.pivot_axis == pytest.approx((0.0, 1.0, 0.0))
    assert arm.toe == pytest.approx(math.radians(1.0))
    assert arm.arm.inertia == pytest.approx((1.0, 1.0, 1.0))
    # axes of the file: x along the pivots, which is y of the vehicle, z down
    chrono.values["trailing.json"]["Trailing Arm"]["Inertia"] = [1, 2, 2.5]
    assert chrono.part("Suspension", "trailing.json").arm.inertia == pytest.approx((2.0, 1.0, 2.5))


def test_a_tie_rod_with_a_mass_is_warned_of(chrono):
    path = "sedan/suspension/Sedan_DoubleWishbone.json"
    chrono.values[path]["Tierod"] |= {"Mass": 6.0, "Inertia": [1, 1, 1], "Radius": 0.02}
    with pytest.warns(UserWarning, match=r"^Sedan_DoubleWishbone.json: Tierod.Mass: left out"):
        chrono.part("Suspension", path)


def test_contact_shapes_of_a_chassis_are_warned_of(chrono):
    path = next(path for path in chrono.values if path.endswith("HMMWV_Chassis.json"))
    plain = chrono.hmmwv().chassis
    chrono.values[path]["Contact"] = {"Materials": [], "Shapes": []}
    with pytest.warns(UserWarning, match=r"^HMMWV_Chassis.json: Contact: left out; add_chassis_box adds a box"):
        assert chrono.hmmwv().chassis == plain


def test_steerings(chrono):
    rack = chrono.part("Steering", "hmmwv/steering/HMMWV_RackPinion.json")
    ours: Any = load_vehicle("hmmwv-reduced")
    # the file turns by 50 degrees, the class of the recorded runs, which ours follows, by 30
    assert rack.max_angle == pytest.approx(math.radians(50.0))
    ours = dataclasses.replace(ours.steerings[0].steering, max_angle=rack.max_angle)
    assert differences(ours, rack, 1e-9) == []
    chrono.values["rotary.json"] = {
        "Type": "Steering", "Template": "RotaryArm",
        "Pitman Arm": {
            "Mass": 1, "Inertia": [1, 1, 1], "Inertia Products": [0, 0, 0.1], "Point of Rotation": [0, 0, 0],
            "Point to Draglink": [0.2, 0, 0], "Axis of Rotation": [0, 2, 0], "Maximum Angle (deg)": 30,
        },
    }  # fmt: skip
    arm = chrono.part("Steering", "rotary.json")
    assert (arm.arm.com, arm.arm_axis) == ((0.1, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert arm.max_angle == pytest.approx(math.pi / 6)


def test_brakes_and_bars(chrono):
    assert chrono.part("Brake", "hmmwv/brake/HMMWV_BrakeShafts_Front.json").max_torque == 4000.0
    bar = chrono.part("Antirollbar", "generic/antirollbar/AntirollBarRSD.json", (1.3, 0.0, -0.1))
    assert (bar.location, bar.arm_length, bar.droplink_height, bar.stiffness) == ((1.3, 0.0, -0.1), 0.7, -0.04, 10000.0)
    axle = chrono.values["hmmwv/vehicle/HMMWV_Vehicle_4WD.json"]["Axles"][0]
    file = "generic/antirollbar/AntirollBarRSD.json"
    axle |= {"Antirollbar Input File": file, "Antirollbar Location": [1.3, 0, -0.1]}
    assert chrono.hmmwv().axles[0].antiroll_bar == bar


@pytest.mark.parametrize("name", [path for path, value in VALUES.items() if value["Type"] == "Tire"])
def test_tires_are_known_to_the_tire_models(name, chrono):
    if "generic" in name:  # with a curve for a change
        chrono.values[name]["Fiala Parameters"]["Vertical Curve Data"] = [[0, 0], [0.1, 31000]]
    if "Pac02" in name:
        (chrono.root / "hmmwv/tire/HMMWV_Pac02Tire.tir").touch()
    tire = chrono.part("Tire", name, chrono.root)
    if tire.template == "rigid":
        assert tire.parameters == {"friction": 0.9, "restitution": 0.1}
    else:
        assert tire_vector(tire).values[0] == tire.radius


def test_units_of_a_property_file_are_refused_by_file_and_line(chrono, monkeypatch):
    monkeypatch.setattr(chrono, "write", lambda: None)  # the file stays as it is changed here
    file = chrono.root / "hmmwv/tire/HMMWV_Pac02Tire.tir"
    lines = ["LENGTH = 'mile'" if line.startswith("LENGTH") else line for line in file.read_text().splitlines()]
    file.write_text("\n".join(lines))
    number = 1 + lines.index("LENGTH = 'mile'")
    with pytest.raises(SpecError, match=rf"^HMMWV_Pac02Tire\.tir: line {number}: LENGTH: must be one of 'meter'"):
        chrono.part("Tire", "hmmwv/tire/HMMWV_Pac02Tire.json", chrono.root)


def test_tires_are_ours(chrono):
    """The C++ tires differ from those of the files: Fiala's table and damping, the load of TMeasy."""
    theirs = chrono.part("Tire", "hmmwv/tire/HMMWV_Pac89Tire.json", chrono.root).parameters
    ours: Any = with_options(load_vehicle("hmmwv"), tire="pacejka89").axles[0].tire.parameters
    for key in ("lateral", "longitudinal", "aligning", "vertical_curve"):
        np.testing.assert_allclose(ours[key], theirs[key], rtol=1e-6)
    tmeasy = chrono.part("Tire", "hmmwv/tire/HMMWV_TMeasyTire.json", chrono.root).parameters
    assert (tmeasy["pattern"], tmeasy["load_index"], "load" in tmeasy) == ("truck", 108, False)
    gator = chrono.part("Tire", "gator/json/Gator_TMeasyTireFront.json", chrono.root).parameters
    assert (gator["load"], gator["design_pressure"], gator["use_pressure"]) == (1800.0, 1.0, 1.0)


def test_a_tmeasy_tire_with_all_its_values(chrono):
    values = chrono.values["hmmwv/tire/HMMWV_TMeasyTire.json"]
    axis = {
        "Initial Slopes dF{0}/ds{0} [N]": [1e5, 2e5], "Maximum F{0} Load [N]": [3e4, 5e4],
        "Sliding F{0} Load [N]": [2e4, 4e4], "Slip s{0} at Maximum F{0}": [0.1, 0.12],
        "Slip s{0} where sliding begins": [0.6, 0.7],
    }  # fmt: skip
    values["Parameters"] = {
        "Vertical": {
            "Nominal Vertical Force [N]": 9000,
            "Vertical Tire Stiffness [N/m]": 4e5,
            "Tire Vertical Damping [Ns/m]": 3000,
            "Tire Bottoming Radius [m]": 0.22,
        },
        "Longitudinal": {key.format("x"): pair for key, pair in axis.items()},
        "Lateral": {key.format("y"): pair for key, pair in axis.items()},
        "Aligning": {
            "Normalized Trail at Zero Slip sy": [0.18, 0.19],
            "Slip sy where Trail Changes Sign": [0.36, 0.37],
            "Slip sy where Trail Tends to Zero": [1.0, 1.1],
        },
    }
    chrono.values["tire.json"] = values
    for key in ("Vehicle Type", "Load Index", "Maximum Bearing Capacity [N]"):
        del values[key]
    tire = chrono.part("Tire", "tire.json", chrono.root)
    assert tire.parameters["slide_slip_y"] == (0.6, 0.7)
    assert tire.parameters["load_limit"] == 31500.0
    assert tire.parameters["bottom_deflection"] == pytest.approx(0.4699 - 0.22)
    assert len(tire_vector(tire).values) > 0


# ---- units and frames ------------------------------------------------------------------------------------------------


def test_units_are_converted(chrono):
    spec = chrono.hmmwv()
    assert spec.steerings[0].steering.max_angle == pytest.approx(math.radians(30.0))
    assert spec.steerings[0].rotation == pytest.approx((0.0, 0.1607426, 0.0, 0.9869964), abs=1e-7)
    assert spec.engine.torque[1] == pytest.approx((800.0 * RPM, 382.0))
    assert spec.transmission.upshift_speed == pytest.approx(2500.0 * RPM)
    assert (spec.axles[0].steering, spec.axles[1].steering) == (0, None)
    assert spec.axles[0].wheel == Wheel(mass=18.8, inertia=(0.4634, 0.6243, 0.4634))


def test_a_turned_component(chrono):
    """Turned by 90 degrees about z: x and y change places, Ixz becomes Iyz."""
    component = chrono.values["hmmwv/chassis/HMMWV_Chassis.json"]["Components"][0]
    component["Centroidal Frame"]["Orientation"] = [math.sqrt(0.5), 0, 0, math.sqrt(0.5)]
    component["Products of Inertia"] = [0, 10, 0]
    part = chrono.hmmwv().chassis.components[0]
    assert part.inertia == pytest.approx((2955.66, 1078.52, 3570.2))
    assert part.products == pytest.approx((0.0, 0.0, 10.0), abs=1e-9)


def test_voids_are_taken_out(chrono):
    """A cube of 8 kg without an eighth: what is left lies on the other side."""
    components = chrono.values["hmmwv/chassis/HMMWV_Chassis.json"]["Components"]
    frame = {"Location": [0, 0, 0], "Orientation": [1, 0, 0, 0]}
    solid = {"Centroidal Frame": frame, "Mass": 8, "Moments of Inertia": [4 / 3] * 3, "Products of Inertia": [0, 0, 0]}
    corner = json.loads(json.dumps(solid)) | {"Mass": 1, "Moments of Inertia": [1 / 24] * 3, "Void": True}
    corner["Centroidal Frame"]["Location"] = [0.25, 0.25, 0.25]
    solid["Moments of Inertia"] = [8 / 6] * 3
    corner["Moments of Inertia"] = [0.25 / 6] * 3
    components[:] = [solid, corner]
    (part,) = chrono.hmmwv().chassis.components
    assert part.mass == pytest.approx(7.0)
    assert part.com == pytest.approx((-0.25 / 7,) * 3)
    # about the origin: 8/6 - (1/24 + 2/16); then to the centre of mass
    expected = 8 / 6 - 0.25 / 6 - 2 * 0.0625 - 7 * 2 * (0.25 / 7) ** 2
    assert part.inertia == pytest.approx((expected,) * 3)
    components[1]["Mass"] = 9
    assert chrono.error().startswith("HMMWV_Chassis.json: Components: must weigh more than their voids, got -1.0 kg")


# ---- mistakes --------------------------------------------------------------------------------------------------------

FRONT = "hmmwv/suspension/HMMWV_DoubleWishboneFront.json"
VEHICLE = "hmmwv/vehicle/HMMWV_Vehicle_4WD.json"


def test_unknown_keys(chrono):
    chrono.values[FRONT]["Spring"]["Sprng Coefficient"] = 3
    assert chrono.error().startswith(
        "HMMWV_DoubleWishboneFront.json: Spring.Sprng Coefficient: unknown key (did you mean 'Spring Coefficient'?)"
    )


def test_visual_keys_are_left_out(chrono):
    chrono.values[FRONT]["Visualization"] = {"Mesh Filename": "x.obj"}
    chrono.values[VEHICLE]["Name"] = "any"
    assert chrono.hmmwv().name == "any"


def test_missing_keys(chrono):
    del chrono.values[FRONT]["Upright"]["Mass"]
    assert chrono.error() == "HMMWV_DoubleWishboneFront.json: Upright.Mass: missing; give a number [kg]"
    chrono.values[FRONT]["Upright"]["Mass"] = 1
    del chrono.values[FRONT]["Shock"]["Damping Coefficient"]
    assert chrono.error().startswith("HMMWV_DoubleWishboneFront.json: Shock.Spring Coefficient: missing; give it, a da")


def test_wrong_values(chrono):
    chrono.values[FRONT]["Upright"]["COM"] = [0, 1]
    assert chrono.error() == "HMMWV_DoubleWishboneFront.json: Upright.COM: must be a list of 3 numbers [m], got [0, 1]"
    chrono.values[FRONT]["Upright"]["COM"] = [0, 1, "x"]
    assert chrono.error() == "HMMWV_DoubleWishboneFront.json: Upright.COM[2]: must be a number, got 'x'"
    chrono.values[FRONT]["Upright"]["COM"] = [0, 1, 1]
    chrono.values[FRONT]["Upright"]["Mass"] = -1
    assert chrono.error() == "HMMWV_DoubleWishboneFront.json: Upright.mass: must be positive, got -1.0"


def test_negative_stiffness(chrono):
    spring = chrono.values["sedan/suspension/Sedan_DoubleWishbone.json"]["Spring"]
    spring["Spring Coefficient"] = -3.0
    with pytest.raises(
        SpecError, match=r"^Sedan_DoubleWishbone.json: Spring.stiffness: must be zero or positive, got -3"
    ):
        chrono.part("Suspension", "sedan/suspension/Sedan_DoubleWishbone.json")


def test_unknown_templates_list_those_known(chrono):
    chrono.values[FRONT]["Template"] = "DoubleWishbones"
    message = chrono.error()
    assert message.startswith(
        "HMMWV_DoubleWishboneFront.json: Template: must be one of DoubleWishbone, DoubleWishboneR"
    )
    assert message.endswith("got 'DoubleWishbones' (did you mean 'DoubleWishbone'?)")
    assert chrono.error(engine="hmmwv/wheel/HMMWV_Wheel.json").startswith("HMMWV_DoubleWishboneFront.json")
    chrono.values[FRONT]["Template"] = "DoubleWishbone"
    assert chrono.error(engine="hmmwv/wheel/HMMWV_Wheel.json") == (
        "HMMWV_Wheel.json: Type: must be one of Engine, got 'Wheel'"
    )


def test_sides_must_be_alike(chrono):
    chrono.values["hmmwv/wheel/other.json"] = chrono.values["hmmwv/wheel/HMMWV_Wheel.json"] | {"Mass": 19}
    chrono.values[VEHICLE]["Axles"][1]["Right Wheel Input File"] = "hmmwv/wheel/other.json"
    assert chrono.error().startswith(
        "HMMWV_Vehicle_4WD.json: Axles[1].Right Wheel Input File: must be like the left one"
    )


def test_tires_are_asked_for(chrono):
    assert chrono.error(tire=None).startswith("HMMWV_Vehicle_4WD.json: tire: missing; Chrono's vehicles name none")
    assert chrono.error(tire=[HMMWV["tire"]] * 3).endswith("must be one file, or one for each of 2 axles, got 3")
    assert chrono.error(tire="none.json").startswith("none.json: cannot be read: no such file")


def test_drivelines_drive_as_many_axles_as_they_can(chrono):
    chrono.values[VEHICLE]["Driveline"]["Suspension Indexes"] = [1]
    message = "drives 2 axles, but the vehicle's Driveline.Suspension Indexes are (1,)"
    assert chrono.error() == f"HMMWV_Driveline4WD.json: {message}"
    chrono.values[VEHICLE]["Driveline"]["Suspension Indexes"] = [0, 2]
    assert chrono.error() == (
        "HMMWV_Vehicle_4WD.json: Driveline.Suspension Indexes: must be a list of axles below 2, got [0, 2]"
    )


def test_indices_are_whole(chrono):
    chrono.values[VEHICLE]["Axles"][0]["Steering Index"] = 0.5
    assert chrono.error() == "HMMWV_Vehicle_4WD.json: Axles[0].Steering Index: must be a whole number, got 0.5"


def test_an_engine_without_a_transmission(chrono):
    assert chrono.error(transmission=None).startswith("HMMWV_Vehicle_4WD.json: engine: must be given together with")


def test_comments_keep_lines_and_columns(chrono):
    (chrono.root / "car.json").write_text('{ // one "two"\n  /* three\n four */ "Type" 5 }')
    with pytest.raises(SpecError, match=r"^car.json: line 3 column 17: broken JSON: Expecting ':' delimiter$"):
        load_chrono_vehicle(chrono.root / "car.json")


def test_addresses_in_texts_are_no_comments(chrono):
    chrono.values[VEHICLE]["Name"] = "see http://example.org /* here */"
    assert chrono.hmmwv().name == "see http://example.org /* here */"


def test_the_root_is_found_or_asked_for(chrono, tmp_path_factory):
    away = tmp_path_factory.mktemp("away") / "car.json"
    away.write_text((chrono.root / VEHICLE).read_text())
    with pytest.raises(SpecError, match=r"^car.json: Chassis.Input File: 'hmmwv/chassis/HMMWV_Chassis.json' is in no"):
        load_chrono_vehicle(away, tire=HMMWV["tire"])
    assert load_chrono_vehicle(away, tire=HMMWV["tire"], root=chrono.root).name == "HMMWV_Vehicle_4WD"
