"""The drawbar test: pull over slip of vehicles on soil, and what it holds constant."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest

from simwarp import cli
from simwarp.soil import soil_under
from simwarp.vehicle import load_vehicle, with_options
from simwarp.vehicle.driving.drawbar import DrawbarSpec
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.results.channels import PULLS, SINKAGES, Run
from simwarp.vehicle.results.results import pull_at, results
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.vehicle_spec import SpecError
from tests.reference import soil as reference
from tests.reference.soil_quadrature import rolling
from tests.reference.soil_shapes import Wheel

SLIPS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)


@functools.cache
def pulled(vehicle: str, soil: str) -> Run:
    spec = with_options(load_vehicle(vehicle), tire="soil-rigid")
    what = maneuver("drawbar", spec, duration=25.0)
    setup = set_up(spec, what, device="cpu", dt=2e-3, elements=lambda car: [soil_under(car, soil)])
    run = Drive(setup).run()
    return Run({name: values[run["t_s"] > 5.0] for name, values in run.columns.items()})


SOFT = pytest.param("soft", marks=pytest.mark.slow)


@pytest.mark.parametrize("soil", [SOFT, "mid", "hard"])
def test_pull_rises_with_slip_up_to_friction(soil):
    run = pulled("hmmwv", soil)
    pull = [pull_at(run, slip, 0.03) for slip in SLIPS]
    # at 0.3 and more a mean over 3 cm of slip may fall by its own noise of 0.5 %, where soil is sheared to the end
    assert (np.diff(pull) > -0.005).all()
    assert pull[0] < pull[1] < pull[2]
    if soil != "hard":
        assert max(pull) < math.tan(math.radians(30.0))
    assert np.abs(run["speed_mps"] - 1.0).max() < 0.1
    assert run["speed_mps"].mean() == pytest.approx(1.0, abs=0.01)
    weight = run["pull_N"] / run["pull_per_weight"]
    assert weight.mean() == pytest.approx(25_250.0, rel=0.02)


def test_two_axles_pull_as_single_wheels_by_quadrature_once_all_soil_is_sheared():
    """Above slip 0.3 pull is friction; below, the rear wheels pull more, in the firm ruts of the front ones."""
    run = pulled("hmmwv", "mid")
    parameters = dataclasses.replace(reference.PRESETS["mid"])
    wheel = Wheel(0.467, 0.254)
    for slip in (0.3, 0.4, 0.6):
        single = rolling(wheel, parameters, 6300.0, slip, reference.DIRECTION, 1.0).pull
        assert pull_at(run, slip, 0.03) == pytest.approx(single, abs=0.02)
    single = rolling(wheel, parameters, 6300.0, 0.1, reference.DIRECTION, 1.0).pull
    assert single < pull_at(run, 0.1, 0.02) < single + 0.15


def test_a_vehicle_that_drives_its_rear_axle_alone_pulls_less():
    run = pulled("gator", "mid")
    pull = [pull_at(run, slip, 0.03) for slip in SLIPS]
    assert (np.diff(pull) > -0.01).all()
    assert 0.05 < max(pull) < 0.45


def test_the_command_writes_pull_over_slip(tmp_path, capsys):
    table = tmp_path / "run.csv"
    command = ["drive", "hmmwv", "--tire", "soil-rigid", "--soil", "hard", "--maneuver", "drawbar", "--duration", "7"]
    assert cli.main([*command, "--dt", "0.002", "--device", "cpu", "--csv", str(table)]) == 0
    assert "pull / weight at slip 0.3" in capsys.readouterr().out
    run = Run.read(table)
    assert set(PULLS) | set(SINKAGES) < set(run.columns)
    assert run["slip"].max() > 0.5
    again = results(run, maneuver("drawbar", load_vehicle("hmmwv"), duration=7.0))
    assert {item.key for item in again} > {"pull_at_slip_0.1", "greatest_pull", "carriage_speed"}


def test_bad_values_are_one_line():
    with pytest.raises(SpecError, match="duration: must be above 5 s of a drawbar test, got 4"):
        maneuver("drawbar", load_vehicle("hmmwv"), duration=4.0)
    with pytest.raises(SpecError, match=r"slips\[1\]: must be in \(-1, 1\)"):
        DrawbarSpec(speed=1.0, start=1.0, ramp=1.0, sweep=1.0, slips=(0.0, 1.0))
    with pytest.raises(SpecError, match="speed: must be positive, got 0"):
        DrawbarSpec(speed=0.0, start=1.0, ramp=1.0, sweep=1.0)
