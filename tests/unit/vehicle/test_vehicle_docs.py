"""The tables of docs/vehicles.md are those of the code."""

import dataclasses
import inspect
import math
import re
import subprocess
import sys
import typing
from pathlib import Path
from typing import Any

import pytest

import simwarp as sw
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.drivers import SCRIPT_COLUMNS, TIMES
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.driving.maneuvers import MANEUVERS, maneuver, maneuver_options
from simwarp.vehicle.results.channels import COLUMNS, PULLS, SINKAGES, Recorder
from simwarp.vehicle.spec import vehicle_spec as specs
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import Spec
from simwarp.vehicle.tires import tire_parameters
from simwarp.vehicle.tires.parameter_vector import MODELS
from simwarp.vehicle.tracks.tracked_files import all_vehicle_names
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "vehicles.md").read_text(encoding="utf-8")


def table_rows(first: str) -> list[list[str]]:
    """Rows of all tables whose head begins with a cell."""
    found, inside = [], False
    for line in PAGE.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            inside = False
        elif cells[0] == first:
            inside = True
        elif inside and not line.startswith("|--"):
            found.append(cells)
    return found


def keys_of(cls: type[Spec], without: frozenset[str] = frozenset()) -> dict[str, bool]:
    """Field -> whether it has a default."""
    plain = dataclasses.MISSING
    return {
        field.name: field.default is not plain or field.default_factory is not plain
        for field in dataclasses.fields(cls)
        if field.name not in {"template", *without}
    }


def listed_keys(cell: str) -> dict[str, bool]:
    return {name: mark == "?" for name, mark in re.findall(r"`(\w+)`(\??)", cell)}


UNIONS = (specs.Suspension, specs.Steering, specs.Driveline, specs.Engine, specs.Transmission)
TEMPLATES = [(union, cls) for union in UNIONS for cls in typing.get_args(typing.get_args(union)[0])]


def name_of(cls: type[Spec]) -> str:
    return str(next(field.default for field in dataclasses.fields(cls) if field.name == "template"))


@pytest.mark.parametrize(("union", "cls"), TEMPLATES, ids=[cls.__name__ for _, cls in TEMPLATES])
def test_the_keys_of_a_template_are_listed(union, cls):
    rows = [row for row in table_rows("template") if f"`{name_of(cls)}`" in row[0] and row[1][:1] == "`"]
    if len(rows) > 1:  # `simple` is a driveline and an engine
        kind = "driveline" if union is specs.Driveline else "engine"
        rows = [row for row in rows if kind in row[0]]
    common = frozenset({"spindle", "axle_inertia"}) if union is specs.Suspension else frozenset()
    assert len(rows) == 1
    assert listed_keys(rows[0][1]) == keys_of(cls, common)


PARTS = {
    "vehicle": specs.VehicleSpec, "`chassis`": specs.Chassis, "rigid part": specs.RigidPart, "`axles`": specs.Axle,
    "`wheel`": specs.Wheel, "`brake`": specs.Brake, "`antiroll_bar`": specs.AntirollBar,
    "`steerings`": specs.SteeringMount, "`springs`": specs.ForceLine, "`trailers`": specs.Trailer,
    "`hitch`": specs.Hitch,
}  # fmt: skip


def test_the_keys_of_the_parts_are_listed():
    rows = {row[0]: row[1] for row in table_rows("part")}
    assert rows.keys() == PARTS.keys()
    for name, cls in PARTS.items():
        assert listed_keys(rows[name]) == keys_of(cls), name


def test_tires_and_their_parameters_are_listed():
    models = {row[0].strip("`"): row[1] for row in table_rows("template") if "Parameters`" in row[1]}
    assert models.keys() == MODELS.keys()
    for name, model in MODELS.items():
        assert re.findall(r"`(\w+)`", models[name]) == [part.__name__ for part in model.parts]
    classes = {row[0].strip("`"): row[1] for row in table_rows("class")}
    parts = {part for model in MODELS.values() for part in model.parts} | {tire_parameters.CommonParameters}
    assert classes.keys() == {part.__name__ for part in parts}
    for part in parts:
        assert list(listed_keys(classes[part.__name__])) == [field.name for field in dataclasses.fields(part)]


def test_the_manoeuvres_are_listed_with_their_options():
    rows = {row[0].strip("`"): row for row in table_rows("manoeuvre")}
    assert {name for name in rows if name in MANEUVERS} == set(MANEUVERS)
    smaller = [load_vehicle(name) for name in ("gator", "artcar")]
    hmmwv = load_vehicle("hmmwv")
    for name in MANEUVERS:
        options, end = rows[name][2], rows[name][3]
        assert re.findall(r"`(\w+)`", options) == maneuver_options(name)
        assert (options == "none") == (maneuver_options(name) == [])
        default = {key: parameter.default for key, parameter in inspect.signature(MANEUVERS[name]).parameters.items()}
        for key, number in re.findall(r"`(\w+)` ([\d.]+)", options):
            if default[key] is not None:
                assert default[key] == float(number), (name, key)
        for key, *numbers in re.findall(r"`speed` ([\d.]+) \(([\d.]+), ([\d.]+)\)", options):
            for spec, number in zip((hmmwv, *smaller), (key, *numbers), strict=True):
                assert held_speed(maneuver(name, spec)) == pytest.approx(float(number), abs=0.005)
        if end != "`duration`":
            told = [float(number) for number in re.findall(r"[\d.]+", end)]
            ends = [maneuver(name, spec).duration for spec in (hmmwv, *smaller)]
            assert told == pytest.approx(ends if len(told) > 1 else ends[:1], abs=0.5 if len(told) > 1 else 1e-9)


def held_speed(what: Maneuver) -> float:
    if what.drawbar is not None:
        return what.drawbar.speed
    return max(speed for _, speed in what.script.speed) if what.follow is None else what.follow.speed


def test_the_columns_of_scripts_are_listed():
    names = {name for row in table_rows("column") for cell in row[:2] for name in re.findall(r"`(\w+)`", cell)}
    assert names == {*TIMES, *SCRIPT_COLUMNS}


def test_the_usual_columns_are_listed():
    names = [name for row in table_rows("usual column") for name in re.findall(r"`(\w+)`", row[0])]
    assert sorted(names) == sorted((*COLUMNS, "articulation1_rad", *SINKAGES, *PULLS))


def test_rigid_tires_are_listed():
    assert "`friction`" in next(row[1] for row in table_rows("template") if row[0] == "`rigid`")


BLOCKS = re.findall(r"```python\n(.*?)```\n\n(?:[^`]*\n\n)?```text\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.quick("0")
@pytest.mark.parametrize("index", range(PAGE.count("```python")))
def test_code_stands_alone_and_prints_what_is_shown(index, tmp_path):
    code, shown = BLOCKS[index]
    quiet = "from simwarp.core.warp_start import start_warp; start_warp()\n"
    done = subprocess.run(
        [sys.executable, "-c", quiet + code], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    number = r"-?\d+\.?\d*"
    assert re.sub(number, "#", done.stdout).split() == re.sub(number, "#", shown).split()
    printed, told = ([float(n) for n in re.findall(number, text)] for text in (done.stdout, shown))
    assert printed == pytest.approx(told, rel=0.02)


def test_the_shipped_vehicles_are_listed():
    assert sorted(row[0].strip("`") for row in table_rows("shipped")) == sorted(all_vehicle_names())


def test_the_outputs_that_are_listed_exist():
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle("gator"))
    vehicle = Vehicle(parts, builder.finalize(2, "cpu", per_world=per_world()))
    sim = sw.Simulation(vehicle.model, 1.0e-3, elements=[vehicle], solver=VEHICLE_SOLVER)
    owners = {"sim": sim, "vehicle": vehicle}
    listed = table_rows("array")
    assert len(listed) > 12
    sizes = {"W": 2, "B": sim.model.body_count, "4": 4, "wheels": 4, "dofs": sim.model.dof_count, "trailers": 0}
    for cells in listed:
        names = re.findall(r"`([\w.]+)`", cells[0])
        parent = names[0].rpartition(".")[0]
        wanted = tuple(sizes[name.strip()] for name in cells[1].partition(")")[0].strip("(").split(",") if name)
        for name in names:
            owner: Any = owners
            for step in (name if "." in name else f"{parent}.{name}").split("."):
                owner = owner[step] if isinstance(owner, dict) else getattr(owner, step)
            assert owner.shape == wanted, name


def test_the_recorder_is_where_the_page_says():
    assert f"{Recorder.__module__}.Recorder" in PAGE


def test_the_reduced_truck_stands_as_the_page_says():
    said = re.search(
        r"stands (\S+) m lower than `hmmwv`, and its front wheels lean inwards by (\S+)°, where .* outwards by (\S+)°",
        PAGE,
    )
    assert said is not None
    lower, inwards, outwards = map(float, said.groups())
    height, lean = {}, {}
    for name in ("hmmwv", "hmmwv-reduced"):
        builder = sw.ModelBuilder()
        parts = add_vehicle(builder, load_vehicle(name))
        vehicle = Vehicle(parts, builder.finalize(1, "cpu", per_world=per_world()))
        simulation = sw.Simulation(vehicle.model, 0.002, elements=[vehicle], solver=VEHICLE_SOLVER)
        vehicle.input[:, 2] = 1.0
        simulation.step(1500)  # at rest on its brakes
        height[name] = float(vehicle.position.numpy()[0, 2])
        # of the front left wheel: positive where its top leans to the right, which is inwards
        lean[name] = math.degrees(float(vehicle.tires.camber.numpy()[0, 0]))
    # the page rounds to a centimetre and a tenth of a degree
    assert height["hmmwv"] - height["hmmwv-reduced"] == pytest.approx(lower, abs=0.005)
    assert lean["hmmwv-reduced"] == pytest.approx(inwards, abs=0.05)
    assert lean["hmmwv"] == pytest.approx(-outwards, abs=0.05)
