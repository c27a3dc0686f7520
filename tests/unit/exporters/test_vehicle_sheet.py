"""Data sheets of vehicles: their numbers are those of the models that are built of them."""

import dataclasses

import pytest

import simwarp as sw
from simwarp.exporters.vehicle_sheet import vehicle_sheet
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.vehicle_files import load_vehicle, vehicle_names
from simwarp.vehicle.tracks.tracked_files import all_vehicle_names, load_any_vehicle


def facts(spec, title):
    section = next(each for each in vehicle_sheet(spec) if each.title == title)
    return {fact.label: fact.value for fact in section.facts}


@pytest.mark.parametrize("name", all_vehicle_names())
def test_every_vehicle_has_a_sheet(name):
    found = vehicle_sheet(load_any_vehicle(name))
    assert found[0].title == "Vehicle"
    assert float(facts(load_any_vehicle(name), "Vehicle")["mass"]) > 1.0
    for section in found:
        assert section.facts
        assert all(fact.label and fact.value for fact in section.facts)


@pytest.mark.parametrize("name", vehicle_names())
def test_axle_loads_carry_the_mass(name):
    whole = facts(load_vehicle(name), "Vehicle")
    loads = [float(value) for label, value in whole.items() if label.startswith("load on") and "axle" in label]
    assert len(loads) == len(load_vehicle(name).all_axles)
    # five digits of either
    assert sum(loads) == pytest.approx(9.81 * float(whole["mass"]), rel=2e-4)
    builder = sw.ModelBuilder()
    add_vehicle(builder, load_vehicle(name))
    assert float(whole["mass"]) == pytest.approx(sum(body.mass for body in builder.bodies), rel=1e-4)


def test_a_load_ahead_weighs_on_the_first_axle():
    spec = load_vehicle("sedan")
    part = spec.chassis.components[0]
    moved = dataclasses.replace(part, com=(part.com[0] + 0.1, *part.com[1:]))
    ahead = dataclasses.replace(spec, chassis=dataclasses.replace(spec.chassis, components=(moved,)))
    first = [float(facts(each, "Vehicle")["load on the first axle at rest"]) for each in (spec, ahead)]
    # the moved mass times its way over the wheelbase
    assert first[1] - first[0] == pytest.approx(9.81 * part.mass * 0.1 / 2.776, rel=0.01)


def test_springs_tires_and_ratios_are_told():
    axle, gears = facts(load_vehicle("sedan"), "Axle 0"), facts(load_vehicle("sedan"), "Transmission")
    assert (axle["spring 0: stiffness"], axle["damper 1: damping"], axle["tire"]) == ("5e+05", "10000", "tmeasy")
    assert gears["forward ratios"].startswith("0.265, 0.489")
