"""A tilt table against the rigid vehicle's track over twice its height, and what its tires take off that."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simwarp.vehicle.rigs import RowStatus, run_tilt_table
from simwarp.vehicle.rigs.tilt_table import first_lift
from simwarp.vehicle.spec.vehicle_spec import SpecError
from tests.physics.sample_vehicles import shipped


@pytest.mark.slow
def test_a_vehicle_without_springs_lifts_at_track_over_two_heights():
    """It leans on its tires alone: when one side has lifted, the other bears all, its tires twice as deep, and the
    centre of mass has moved aside by its height times that lean.
    """
    spec = shipped("skid-steer")
    table = run_tilt_table(spec, points=17)
    assert table.lifted_wheel in (0, 2)  # the left side is raised
    stiffness = 40000.0
    weight = float(np.nansum(table.load[0]))
    deflection = weight / (4.0 * stiffness)
    half = table.track / (2.0 * table.com_height)
    lean = 2.0 * deflection * math.cos(table.lift_angle) / table.track
    assert math.tan(table.lift_angle) == pytest.approx(half - lean, rel=0.01)
    assert table.lift_angle < table.rigid_angle
    done = table.status == RowStatus.DONE
    assert table.load[done].sum(axis=1) == pytest.approx(weight * np.cos(table.angle[done]), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hmmwv", "sedan"])
def test_springs_take_some_of_the_angle(name):
    table = run_tilt_table(shipped(name), points=13)
    assert 0.75 * table.rigid_angle < table.lift_angle < table.rigid_angle
    assert (table.status == RowStatus.TIPPED)[-1]  # and it is told
    assert np.isnan(table.load[-1]).all()


def test_the_lift_is_where_the_load_of_a_wheel_would_end():
    angle = np.linspace(0.0, 1.0, 11)
    load = np.stack([1000.0 - 1500.0 * angle, 1000.0 - 1250.0 * angle, 1000.0 + angle, 1000.0 + angle], axis=1)
    assert first_lift(angle, np.maximum(load, 0.0)) == (pytest.approx(2.0 / 3.0), 0)
    assert first_lift(angle, load[:, 2:])[1] == -1
    lost = np.where(angle[:, None] > 0.55, np.nan, load)  # tipped over before a load was seen to end
    assert first_lift(angle, lost) == (pytest.approx(2.0 / 3.0), 0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"points": 2}, "points: must be 3 or more angles"),
        ({"angles": [0.1, 0.2, 0.3]}, "angles: must be three or more, increasing from 0"),
        ({"angles": [0.0, np.nan, 0.3]}, "angles: must be three or more, increasing from 0"),
        ({"angles": [0.0, 0.5, 2.0]}, "angles: must be below a right angle, got 2 rad"),
        ({"dt": 0.0}, "dt: must be above 0"),
    ],
)
def test_an_empty_range_is_one_line(options, message):
    with pytest.raises(SpecError, match=message):
        run_tilt_table(shipped("skid-steer"), **options)
