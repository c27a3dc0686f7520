"""Whatever lists vehicles has all that are shipped: the catalogue, the targets of commands, options, tasks."""

import json
from pathlib import Path
from typing import Any

import pytest

from simwarp.cli.view.vehicle_subject import vehicle_subject
from simwarp.cli.view.view_target import find_target
from simwarp.tasks.driving import DRIVEN_VEHICLES
from simwarp.vehicle import Vehicle, all_vehicle_names, load_any_vehicle, option_names, vehicle_names, with_options
from simwarp.vehicle.spec.catalogue import catalogue


def test_the_list_has_every_vehicle_in_a_line(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = command("list", "--json", "list.json")
    assert code == 0
    listed = {row["name"]: row["summary"] for row in json.loads(Path("list.json").read_text())["vehicles"]}
    assert listed == catalogue()
    assert list(listed) == all_vehicle_names()
    assert all("chassis" in line and "\n" not in line for line in listed.values())
    assert all(f"  {name} " in out for name in listed)
    for name, trailers in (("truck-semitrailer", 1), ("sedan-trailer", 1), ("sedan", 0)):
        assert listed[name].count("trailer") == trailers


@pytest.mark.parametrize("name", all_vehicle_names())
def test_every_vehicle_is_a_target(name):
    assert find_target(name).kind == "vehicle"


@pytest.mark.parametrize("name", vehicle_names())
def test_every_vehicle_takes_its_options(name):
    spec: Any = load_any_vehicle(name)
    for kind in ("tire", "powertrain", "driveline"):
        for option in option_names(name, kind):
            assert with_options(spec, **{kind: option}).name == name


@pytest.mark.parametrize("name", DRIVEN_VEHICLES)
def test_vehicles_of_tasks_are_shipped_ones(name):
    assert name in all_vehicle_names()
    assert DRIVEN_VEHICLES[name].full_name in vehicle_names()


@pytest.mark.slow
@pytest.mark.parametrize("name", vehicle_names())
def test_every_vehicle_is_viewed(name):
    """At rest on asphalt: each body that is drawn is there, and nothing breaks in half a second."""
    subject = vehicle_subject(name, 1, "cpu")
    assert subject.advance is not None
    for _ in range(25):
        subject.advance()
    vehicle = subject.elements["vehicle"]
    assert isinstance(vehicle, Vehicle)
    drawn = set(subject.scene.body.tolist())
    assert {unit.chassis for unit in vehicle.parts.units} <= drawn
    assert {side.spindle for side in vehicle.parts.sides} <= drawn
    assert subject.simulation.problems() == []
