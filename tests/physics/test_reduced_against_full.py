"""Reduced vehicles beside the full ones that they were measured on, in the manoeuvres of `simwarp drive`."""

import numpy as np
import pytest

from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.reduced.reduction import reduce_vehicle
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.vehicle_files import load_vehicle, reduced_vehicle_names

SHARE = 0.05
"""Deviations of speed, yaw rate and wheel loads over the full vehicle's largest value."""
MOMENTS = 0.03
"""Share of the rows in which yaw rates and loads may be off by more: wheels that spin as a vehicle starts, and gear
changes, come some milliseconds apart, for it has settled on its tires' bristles otherwise.
"""
STRAIGHT = 0.05
"""Yaw rates below are those of a vehicle that drives straight on [rad/s]."""
MANOEUVRES = (
    "reference-accel", "reference-steer", "reference-brake", "step-steer", "sine-sweep", "double-lane-change",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", reduced_vehicle_names())
@pytest.mark.parametrize("course", MANOEUVRES)
def test_a_reduced_vehicle_moves_as_the_full_one(name, course):
    runs = []
    for spec in (load_vehicle(load_vehicle(name).full_name), load_vehicle(name)):
        setup = set_up(spec, maneuver(course, spec), wheel_bodies=False)
        runs.append(Drive(setup).run().columns)
    full, reduced = runs
    moving = np.asarray(full["t_s"]) >= 0.0  # both have settled, on springs that are alike
    columns = ["speed_mps", "yawrate_radps", *(f"Fz_{wheel}_N" for wheel in ("FL", "FR", "RL", "RR"))]
    for column in columns:
        expected, found = (np.asarray(run[column])[moving] for run in (full, reduced))
        largest = np.abs(expected).max()
        if column == "yawrate_radps":
            largest = max(largest, STRAIGHT)
        off = np.abs(found - expected) / largest
        assert np.sqrt(np.mean(off**2)) < SHARE, column
        assert np.mean(off > SHARE) <= (0.0 if column == "speed_mps" else MOMENTS), (column, off.max())


@pytest.mark.slow
@pytest.mark.parametrize("name", reduced_vehicle_names())
def test_the_shipped_file_is_what_the_command_makes_of_the_full_vehicle(name):
    shipped = load_vehicle(name)
    made = reduce_vehicle(load_vehicle(shipped.full_name))
    assert made.name == name
    for axle, other in zip(made.axles, shipped.axles, strict=True):
        for side in ("left", "right"):
            table, kept = (getattr(each.suspension, side) for each in (axle, other))
            for field in ("ahead", "aside", "axis_x", "axis_z", "windup", "spring_load", "damper_load"):
                # linkages are closed to single precision, rates are differences over 2 mm
                largest = np.abs(getattr(kept, field)).max()
                assert np.array(getattr(table, field)) == pytest.approx(
                    np.array(getattr(kept, field)), abs=2e-4 * largest + 1e-5
                )
    assert made.chassis.components[0].mass == pytest.approx(shipped.chassis.components[0].mass)
