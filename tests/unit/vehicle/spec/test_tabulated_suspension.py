"""Descriptions of reduced vehicles: what tables have to be, and what a reduced vehicle cannot do."""

import dataclasses
import json

import numpy as np
import pytest

import simwarp as sw
from simwarp.vehicle import reduce_vehicle, reduced_vehicle_names, save_vehicle, stance, with_options
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.reduced.reduced_construction import chassis_parts, drive_row, lock_rows, shaft_inertia
from simwarp.vehicle.results.runs import set_up
from simwarp.vehicle.spec.parts import SpecError, merged
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import ShaftsDriveline4WD, VehicleSpec
from simwarp.vehicle.suspensions.kinematics import travel_table
from simwarp.vehicle.tracks.tracked_files import all_vehicle_names, load_any_vehicle
from simwarp.vehicle.vehicle import Vehicle, per_world


def test_the_shipped_ones_are_named_after_the_full_ones():
    names = reduced_vehicle_names()
    assert names == ["gator-14dof", "hmmwv-14dof", "sedan-14dof"]
    assert set(names) <= set(all_vehicle_names())
    for name in names:
        spec = load_any_vehicle(name)
        assert isinstance(spec, VehicleSpec)
        assert spec.name == name
        assert spec.is_reduced
        assert not load_vehicle(spec.full_name).is_reduced


@pytest.mark.parametrize("name", ["hmmwv-14dof", "sedan-14dof", "gator-14dof"])
def test_it_weighs_as_much_as_the_full_vehicle(name):
    spec = load_vehicle(name)
    mass, _, _ = merged(chassis_parts(spec))
    builder = sw.ModelBuilder()
    add_vehicle(builder, load_vehicle(spec.full_name))
    assert mass == pytest.approx(sum(body.mass for body in builder.bodies), rel=1e-9)


@pytest.mark.parametrize(
    ("field", "change", "message"),
    [
        (
            "travel",
            lambda s: (s.travel[0], s.travel[2], *s.travel[2:]),
            "travel: must be increasing and equally spaced",
        ),
        ("steering", lambda s: s.steering[:-1], "left.ahead: must be 25 rows of 20 numbers"),
        ("rate", lambda s: s.rate[::2], "left.damper_load: must be 25 rows of 9 numbers"),
        (
            "right",
            lambda s: dataclasses.replace(s.right, bar_twist=s.right.bar_twist[1:]),
            "right.bar_twist: must be 25 numbers",
        ),
    ],
)
def test_tables_have_an_entry_for_each_place(field, change, message):
    suspension = load_vehicle("hmmwv-14dof").axles[0].suspension
    with pytest.raises(SpecError, match=message):
        dataclasses.replace(suspension, **{field: change(suspension)})


def test_a_file_with_a_short_table_names_the_key(tmp_path):
    save_vehicle(load_vehicle("sedan-14dof"), tmp_path / "short.json")
    described = json.loads((tmp_path / "short.json").read_text())
    described["axles"][1]["suspension"]["left"]["windup"].pop()
    (tmp_path / "short.json").write_text(json.dumps(described))
    with pytest.raises(SpecError, match=r"short\.json.*windup"):
        load_vehicle(tmp_path / "short.json")


def test_tables_and_linkages_do_not_mix():
    full, reduced = load_vehicle("sedan"), load_vehicle("sedan-14dof")
    with pytest.raises(SpecError, match="axles: must be two of tables or none"):
        dataclasses.replace(reduced, axles=(reduced.axles[0], full.axles[1]))


@pytest.mark.parametrize(
    ("vehicle", "message"),
    [
        ("hmmwv-14dof", "reduced already"), ("skid-steer", "engine or none"),
    ],
)  # fmt: skip
def test_what_cannot_be_reduced_is_refused(vehicle, message):
    with pytest.raises(SpecError, match=message):
        reduce_vehicle(load_vehicle(vehicle))


def test_a_tire_that_is_a_shape_is_refused():
    with pytest.raises(SpecError, match="must be a force law to be reduced"):
        reduce_vehicle(with_options(load_vehicle("sedan"), tire="rigid"))
    with pytest.raises(SpecError, match="must be a force law on tables"):
        add_vehicle(sw.ModelBuilder(), with_options(load_vehicle("sedan-14dof"), tire="rigid"))


@pytest.mark.parametrize(
    "asks",
    [
        lambda spec: stance(spec),
        lambda spec: travel_table(spec, 0, [0.0, 0.01]),
        lambda spec: set_up(spec, maneuver("drawbar", spec)),
    ],
)
def test_what_needs_a_linkage_says_so_in_one_line(asks):
    with pytest.raises(SpecError, match=r"'sedan-14dof' is reduced to tables, and .* needs linkages"):
        asks(load_vehicle("sedan-14dof"))


def test_obstacles_need_the_bodies_of_the_wheels():
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle("sedan-14dof"), wheel_bodies=False)
    builder.add_shape_box(sw.WORLD, half=(1.0, 1.0, 0.1), name="kerb")
    model = builder.finalize(1, "cpu", per_world=per_world())
    with pytest.raises(SpecError, match="obstacles: must be left out with wheel_bodies=False"):
        Vehicle(parts, model, obstacles="all")


def test_the_driveline_s_numbers_are_those_of_its_gears():
    spec = load_vehicle("hmmwv-14dof")
    assert isinstance(spec.driveline, ShaftsDriveline4WD)
    # all wheels at 1 rad/s: gears of 0.2 turn every shaft at 5 rad/s
    assert drive_row(spec).sum() == pytest.approx(5.0)
    energy = np.ones(4) @ shaft_inertia(spec.driveline) @ np.ones(4)
    assert energy == pytest.approx(25.0 * (0.5 + 2.0 * (0.5 + 0.6 * 0.2**2)))
    assert isinstance(spec.driveline, ShaftsDriveline4WD)
    assert lock_rows(spec.driveline) == []
    locked = dataclasses.replace(spec.driveline, lockable=True)
    rows = lock_rows(locked)
    assert [row.sum() for row, _, _ in rows] == pytest.approx([0.0, 0.0, 0.0])
    assert [torque for _, _, torque in rows] == [100.0, 100.0, 100.0]
