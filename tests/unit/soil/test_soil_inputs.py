"""Bad inputs of soils: one line with parameter, value, rule and remedy, in Python and at the command line."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp import cli
from simwarp.soil import Soil, SoilBox, SoilSpec, SoilSphere, SoilWheel, soil_under
from simwarp.vehicle import Vehicle, add_vehicle, load_vehicle, per_world, with_options
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.tires.tires import ground
from tests.unit.soil.soil_wheels import RADIUS, WIDTH

GOOD = {"k_phi": 1e6}
NONSENSE: Any = {"body": None, "share": 0.5, "half": 0.1, "pose": (0, 0, 0)}
"""Of types that a checker would refuse."""


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"k_phi": 0.0}, "k_phi must be positive, got 0.0; give N/m^(n+2); a preset shows the order of magnitude"),
        ({"k_phi": -2e6}, "k_phi must be positive, got -2000000.0; give N/m^(n+2); a preset"),
        ({"exponent": 0.1}, "exponent must be in [0.2, 2], got 0.1; give 1 for a linear soil"),
        ({"exponent": 2.5}, "exponent must be in [0.2, 2], got 2.5; give 1 for a linear soil"),
        (
            {"friction_angle": 30.0},
            "friction_angle must be within ±1.047 rad (60°), got 30.0; if these are degrees, they are 0.5236 rad",
        ),
        ({"friction_angle": 1.1}, "friction_angle must be within ±1.047 rad (60°), got 1.1; if these are degrees"),
        ({"friction_angle": -0.1}, "friction_angle must be zero or positive, got -0.1; give radians"),
        ({"cohesion": -1.0}, "cohesion must be zero or positive, got -1.0; give 0 for none"),
        ({"elastic": 1e5}, "elastic must be at least k_phi n z^(n-1) = 1.026e+06 Pa/m at 0.5 m: unloading is stiffer"),
        ({"elastic": 1e5}, "got 100000.0; raise it, or lower k_phi"),
        ({"shear_length": 0.0}, "shear_length must be positive, got 0.0; give metres; a preset shows"),
        ({"damping": -1.0}, "damping must be zero or positive, got -1.0; give 0 for none"),
    ],
)
def test_values_of_a_soil(values, message):
    with pytest.raises(sw.ModelError) as found:
        SoilSpec(**{**GOOD, **values})
    assert message in str(found.value)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(SoilSpec)])
@pytest.mark.parametrize("value", [math.nan, math.inf, "1e6", None])
def test_no_value_of_a_soil_may_be_anything_but_a_finite_number(name, value):
    with pytest.raises(sw.ModelError, match=f"{name} must be a (finite )?number, got "):
        SoilSpec(**{**GOOD, name: value})


def model_of(worlds: int = 1) -> sw.Model:
    builder = sw.ModelBuilder()
    builder.add_body("b", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_height_field_asset(np.zeros((5, 5)), size=(8.0, 4.0))
    return builder.finalize(worlds, "cpu")


WHEELS = [SoilWheel(body=0, radius=RADIUS, width=WIDTH)]
FIELD: Any = {"kind": sw.ShapeType.HEIGHT_FIELD}
LEANING = (0.0, math.sin(math.radians(25.0)), 0.0, math.cos(math.radians(25.0)))
"""By 50 degrees."""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"spacing": 0.128},
            "spacing must be positive and at most half the narrowest shape's width, 0.127 m, got 0.128",
        ),
        ({"spacing": math.nan}, "spacing must be positive and at most half the narrowest shape's width"),
        ({"spacing": 0.0}, "got 0.0; 0.05 suits cars"),
        ({"pages": 7}, "pages must be an integer >= 8, got 7; so many of 0.4 m may lie below the shapes; raise it, or"),
        ({"spacing": 0.01, "pages": 50}, "pages must be an integer >= 65, got 50; so many of 0.08 m"),
        ({"pages": 2.5}, "pages must be an integer"),
        ({"ground": {"rotation": LEANING}}, "ground must lean by at most 45 degrees, got 50; turn it, or gravity"),
        ({"soil_map": [[0]], "map_cell": (0.0, 1.0)}, "map_cell must be two numbers, finite and > 0 m, got (0.0, 1.0)"),
        ({"soil_map": [[0]], "map_origin": (math.nan, 1.0)}, "map_origin must be two numbers, finite, got (nan, 1.0)"),
        (
            {"soil_map": [[0, 0]], "map_origin": (-4.0, -2.0), "map_cell": (4.0, 3.9), "ground": FIELD},
            "soil_map must cover the ground, x -4 to 4, y -2 to 2 m, got x -4 to 4, y -2 to 1.9; set map_origin and",
        ),
        ({"soil_map": [[0, 1]]}, "soil_map must hold indices below 1, got 1; name more soils"),
        ({"soil_map": [0, 1]}, "soil_map must be (rows, columns) or (1, rows, columns), got (2,)"),
        ({"soil": "mud"}, "preset must be soft, mid, hard, clay, snow, sand, got 'mud'; or give a SoilSpec"),
        ({"shear_memory": "vector"}, "shear_memory must be one of direction, scalar, got 'vector'"),
        ({"spacing": 1e-6}, "spacing must be so wide that at most 1048576 pages may lie below the shapes, got 1e-06"),
        ({"spacing": "0.05"}, "spacing must be positive and at most half the narrowest shape's width, 0.127 m, got"),
        ({"spacing": None}, "0.127 m, got None; 0.05 suits cars"),
        ({"spacing": 1e-320}, "0.127 m, got 1e-320; 0.05 suits cars"),
        ({"soil": []}, "soil must be a SoilSpec, the name of a preset, or a list of these, got []; presets are soft,"),
        ({"soil": ["mid", 3]}, "soil must be a SoilSpec, the name of a preset, or a list of these, got ['mid', 3]; "),
        ({"soil_map": [[0.5]]}, "soil_map must hold indices below 1, got 0.5; name more soils"),
        ({"soil_map": [[math.nan]]}, "soil_map must hold indices below 1, got nan; name more soils"),
        ({"soil_map": [[0, -1]]}, "soil_map must hold indices below 1, got -1; name more soils"),
        ({"soil_map": [[0, 0], [0]]}, "soil_map must be (rows, columns) or (1, rows, columns), got [[0, 0], [0]]; it"),
        ({"soil_map": [[0]], "map_cell": 1.0}, "map_cell must be two numbers, finite and > 0 m, got 1.0; it has one"),
        ({"soil_map": [[0]], "map_cell": (1.0, 1.0, 1.0)}, "map_cell must be two numbers, finite and > 0 m, got (1.0"),
        ({"ground": 5}, "ground must be of simwarp.vehicle.tires.ground, got 5; make it by that"),
        ({"weighted": "no"}, "weighted must be True or False, got 'no'; choose one"),
        ({"per_world": 2}, "per_world must be True or False, got 2; choose one"),
    ],
)
def test_options_of_a_soil(options, message):
    if isinstance(options.get("ground"), dict):
        options = {**options, "ground": ground("cpu", **options["ground"])}
    with pytest.raises(sw.ModelError) as found:
        Soil(model_of(), WHEELS, **options)
    assert message in str(found.value)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        (SoilSphere(body=0, radius=0.1), "shapes must be a list, got SoilSphere"),
        ("b", "shapes must be a list, got 'b'; write shapes=[...]"),
        (
            ["b"],
            "of SoilWheel, SoilBox, SoilSphere, SoilCapsule, SoilCylinder, SoilBlade, got 'b' among them; wrap it",
        ),
        ([], "shapes must be at least one, got none; name those that sink in"),
        (
            [SoilSphere(body=NONSENSE["body"], radius=0.1)],
            "SoilSphere: body must be an integer, the body's index, or its name, got None",
        ),
        (
            [SoilSphere(body=NONSENSE["share"], radius=0.1)],
            "SoilSphere: body must be an integer, the body's index, or its name, got 0.5",
        ),
        ([SoilSphere(body=sw.WORLD, radius=0.1)], "body must be an integer >= 0, got -1; name it, or give its index"),
        ([SoilSphere(body=0, radius=0.1, offset=(0.0, 1.0))], "SoilSphere: offset must be 3 finite numbers"),
        ([SoilBox(body=0, half=NONSENSE["half"])], "SoilBox: half must be 3 finite numbers"),
        ([SoilBox(body=0, half=(0.1, 0.1))], "SoilBox: half must be 3 finite numbers"),
        (
            [SoilBox(body=0, half=(0.1, 0.1, 0.1), pose=NONSENSE["pose"])],
            "SoilBox: pose must be a Pose, got (0, 0, 0)",
        ),
    ],
)
def test_shapes_of_a_soil(shapes, message):
    with pytest.raises(sw.ModelError) as found:
        Soil(model_of(), shapes)
    assert message in str(found.value)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("vehicles", [[], 3, [3], None])
def test_soil_lies_under_vehicles(vehicles):
    with pytest.raises(sw.ModelError, match="soil_under: vehicles must be at least one Vehicle or Vehicles, got"):
        soil_under(vehicles)


def test_vehicles_of_two_models_have_no_soil_in_common():
    message = "soil_under: vehicles must be of one model, got several; add them all to one ModelBuilder"
    with pytest.raises(sw.ModelError, match=message):
        soil_under([vehicle_of("soil-rigid", "soil-rigid"), vehicle_of("soil-rigid", "soil-rigid")])


def test_a_soil_acts_once_in_a_step():
    model = model_of()
    soil = Soil(model, WHEELS)
    with pytest.raises(sw.ModelError, match="Simulation: elements must stand there once each, got Soil twice; drop"):
        sw.Simulation(model, 0.002, elements=[soil, soil])


def test_heights_are_asked_for_at_numbers():
    with pytest.raises(sw.ModelError, match=r"soil: points must be \(N, 2\), .*, got 'here'; give x and y of each"):
        Soil(model_of(), WHEELS).height("here")


def test_ground_that_leans_a_little_and_maps_that_cover_it_will_do():
    lean = (0.0, math.sin(math.radians(22.0)), 0.0, math.cos(math.radians(22.0)))
    Soil(model_of(), WHEELS, ground=ground("cpu", rotation=lean), pages=8)
    cells: Any = {"soil_map": [[0, 0]], "map_origin": (-4.0, -2.0), "map_cell": (4.0, 4.0)}
    Soil(model_of(), WHEELS, ground=ground("cpu", **FIELD), **cells)
    with pytest.raises(SpecError, match="must turn about the vertical only"):
        ground("cpu", kind=sw.ShapeType.HEIGHT_FIELD, rotation=lean)


def vehicle_of(*tires: str) -> Vehicle:
    """A HMMWV with these tires on its axles."""
    builder = sw.ModelBuilder()
    spec = load_vehicle("hmmwv")
    axles = [
        dataclasses.replace(axle, tire=with_options(spec, tire=tire).axles[index].tire)
        for index, (axle, tire) in enumerate(zip(spec.axles, tires, strict=True))
    ]
    parts = add_vehicle(builder, dataclasses.replace(spec, axles=tuple(axles)))
    return Vehicle(parts, builder.finalize(1, "cpu", per_world=per_world()))


def test_tires_that_make_forces_of_their_own_do_not_deform_soil():
    message = "tires of vehicle 'hmmwv' must be soil-rigid, got tmeasy, which do not deform it; with_options"
    with pytest.raises(sw.ModelError, match=message):
        soil_under(vehicle_of("tmeasy", "tmeasy"))


def test_tires_of_both_kinds_are_refused():
    message = "axles: tires must be soil-rigid on all wheels or on none, got both; choose one kind"
    with pytest.raises(SpecError, match=message):
        vehicle_of("soil-rigid", "tmeasy")


def test_two_vehicles_of_one_prefix_are_refused():
    builder = sw.ModelBuilder()
    spec = with_options(load_vehicle("hmmwv"), tire="soil-rigid")
    add_vehicle(builder, spec, prefix="a.")
    with pytest.raises(SpecError) as found:
        add_vehicle(builder, spec, prefix="a.")
    assert "\n" not in str(found.value)
    assert "a." in str(found.value)


def test_soil_lies_on_the_vehicles_ground():
    """A vehicle that is parked on a slope leans with it: the soil does not stay level below it."""
    builder = sw.ModelBuilder()
    spec = with_options(load_vehicle("gator"), tire="soil-rigid")
    lean = (0.0, math.sin(-0.1), 0.0, math.cos(-0.1))
    parts = add_vehicle(builder, spec, at=sw.pose((0.0, 0.0, spec.start_height), lean))
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model, ground=ground("cpu", rotation=lean))
    soil = soil_under(vehicle, "hard")
    simulation = sw.Simulation(model, 1e-3, elements=[vehicle, soil], solver=sw.vehicle.VEHICLE_SOLVER, threads=1)
    simulation.step(500)
    forward = simulation.state.body_rot.numpy()[0, parts.chassis]
    pitch = 2.0 * math.asin(float(forward[1]))
    assert pitch == pytest.approx(-0.2, abs=0.03)
    assert float(soil.touched.numpy().min()) > 3


COMMANDS = [
    (["--soil", "mid"], "tires of vehicle 'hmmwv' must be soil-rigid, got tmeasy", "--tire soil-rigid"),
    (["--tire", "soil-rigid", "--soil", "mud"], "preset must be soft, mid, hard, clay, snow, sand, got", "SoilSpec"),
    (
        ["--tire", "soil-rigid", "--spacing", "0.2"],
        "at most half the narrowest shape's width, 0.127 m, got 0.2",
        "0.05",
    ),
    (["--tire", "soil-rigid", "--spacing", "nan"], "--spacing must be a finite number", "nan"),
    (["--tire", "soil-rigid", "--spacing", "0.001"], "pages must be an integer >= 16048, got 2048", "spacing"),
]


@pytest.mark.parametrize(("arguments", "rule", "remedy"), COMMANDS)
def test_the_command_line_says_it_in_one_line(arguments, rule, remedy, capsys):
    assert cli.main(["drive", "hmmwv", "--maneuver", "reference-soil", "--device", "cpu", *arguments]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    lines = told.err.strip().splitlines()
    assert len(lines) == 1
    assert rule in lines[0]
    assert remedy in lines[0]
