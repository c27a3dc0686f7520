"""Defaults of manoeuvres: a copy of a vehicle has those of the vehicle, others what their engine lets them hold."""

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle.driving.driver_choices import usual_speed
from simwarp.vehicle.driving.handling_maneuvers import handling_speed
from simwarp.vehicle.driving.maneuvers import MANEUVERS, maneuver
from simwarp.vehicle.driving.reachable_speeds import HELD_SHARE, held_gear, top_speed
from simwarp.vehicle.driving.steering_ratio import angle_per_steering
from simwarp.vehicle.rigs.steering_rig import run_steering_rig
from simwarp.vehicle.spec.maneuver_defaults import ManeuverDefaults
from simwarp.vehicle.spec.vehicle_files import load_vehicle, reduced_vehicle_names, save_vehicle, vehicle_names
from simwarp.vehicle.spec.vehicle_spec import SpecError


def numbers(what):
    """Of a manoeuvre, all that a default decides."""
    follow, test = what.follow, what.intervention
    path = None if follow is None else follow.paths[0].points.tolist()
    script = what.script
    return (
        what.duration, what.initial_speed, path, follow and follow.speed, test and test.amplitude, what.drawbar,
        script.speed, what.held_gear, what.bump,
    )  # fmt: skip


@pytest.mark.parametrize("vehicle", [*vehicle_names(), *reduced_vehicle_names()])
def test_a_copy_of_another_name_is_tested_as_the_vehicle(vehicle, tmp_path):
    spec = load_vehicle(vehicle)
    save_vehicle(dataclasses.replace(spec, name="mine"), tmp_path / "mine.json")
    copy = load_vehicle(tmp_path / "mine.json")
    for name in MANEUVERS:
        assert numbers(maneuver(name, copy)) == numbers(maneuver(name, spec)), name


@pytest.mark.parametrize("vehicle", vehicle_names())
def test_a_vehicle_without_conditions_holds_what_it_is_asked_for(vehicle):
    spec = dataclasses.replace(load_vehicle(vehicle), maneuver_defaults=ManeuverDefaults())
    for name in ("step-steer", "iso-3888-1", "slow-steer", "braking", "bump", "constant-radius", "steady-state-circle"):
        what = maneuver(name, spec)
        asked = max(value for _, value in what.script.speed) if what.follow is None else what.follow.speed
        assert 0.0 < asked <= HELD_SHARE * top_speed(spec) + 1e-9
    with pytest.raises(SpecError, match="slow-steer finds it"):
        maneuver("fishhook", spec)


def test_top_speeds_are_those_of_engine_and_gears():
    """The Gator by its engine's limit; the HMMWV where torque less losses is zero; the robot by its motors' limit."""
    found: list[Any] = [load_vehicle(name) for name in ("gator", "hmmwv", "skid-steer")]
    gator, hmmwv, robot = found
    gear = gator.transmission.forward_ratios[0]
    rear = gator.axles[1].tire.radius * gator.driveline.rear_gear_ratio
    assert top_speed(gator) == pytest.approx(gator.engine.max_speed * gear * rear)
    rate = top_speed(hmmwv) / hmmwv.axles[0].tire.radius / (0.2 * 0.8)
    torque = np.interp(rate, *np.transpose(hmmwv.engine.torque)) + np.interp(rate, *np.transpose(hmmwv.engine.losses))
    assert torque == pytest.approx(0.0, abs=1e-6)
    assert top_speed(robot) == pytest.approx(robot.driveline.max_speed * robot.driveline.gear_ratio * 0.1651)
    assert handling_speed(load_vehicle("sedan")) == pytest.approx(80.0 / 3.6)
    assert usual_speed(hmmwv) == 12.0


def test_gears_suit_the_speed_and_motors_have_none():
    assert [held_gear(load_vehicle("hmmwv"), speed) for speed in (1.0, 5.0, 14.0)] == [1, 2, 3]
    assert held_gear(load_vehicle("skid-steer"), 0.5) is None


@pytest.mark.parametrize("vehicle", ["hmmwv", "sedan", "gator", "artcar"])
def test_the_steering_ratio_is_that_of_the_rig(vehicle):
    """Lock over the ratio on centre, by differences over 1 and 3 % of the lock: alike within the curve between them."""
    spec = load_vehicle(vehicle)
    rig = run_steering_rig(spec).parameters()
    lock = spec.steerings[0].steering.max_angle
    assert angle_per_steering(spec) == pytest.approx(lock / rig["ratio_on_centre"], rel=2e-3)
    name = f"{vehicle}-14dof"
    if name in reduced_vehicle_names():  # tables of 5 or more columns are straight between them
        assert angle_per_steering(load_vehicle(name)) == pytest.approx(angle_per_steering(spec), rel=0.01)


def test_conditions_are_checked(tmp_path):
    save_vehicle(load_vehicle("hmmwv"), tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    content["maneuver_defaults"]["speed_of_handling"] = -1.0
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(SpecError, match="speed_of_handling"):
        load_vehicle(tmp_path / "a.json")
