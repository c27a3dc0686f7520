"""A vehicle whose rear half is the arm of a steering: it bends in the middle."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import (
    RigidPart,
    RigidSuspension,
    RotaryArm,
    ShaftsDriveline2WD,
    SteeringMount,
    VehicleSpec,
)
from simwarp.vehicle.suspensions.kinematics import travel_table
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

AHEAD, BEHIND = 1.2, 1.6
"""Of the axles from the joint [m]."""
LARGEST = 0.4
"""Angle of the joint at full steering [rad]."""


def articulated() -> VehicleSpec:
    """Two bodies of a tonne, an axle on each; the joint is the origin."""
    own: Any = with_options(load_vehicle("hmmwv"), tire="tmeasy")
    spindle = RigidPart(mass=10.0, com=(0.0, 0.9, 0.0), inertia=(0.1, 0.2, 0.1))
    half = RigidPart(mass=1000.0, com=(-BEHIND, 0.0, 0.3), inertia=(200.0, 500.0, 600.0))
    axle = dataclasses.replace(
        own.axles[0], suspension=RigidSuspension(spindle=spindle, axle_inertia=0.4), location=(AHEAD, 0.0, 0.0),
        steering=None, antiroll_bar=None,
    )  # fmt: skip
    arm = RotaryArm(max_angle=LARGEST, arm=half, arm_chassis=(0.0, 0.0, 0.0))
    chassis = dataclasses.replace(own.chassis, components=(dataclasses.replace(half, com=(AHEAD, 0.0, 0.3)),))
    line = ShaftsDriveline2WD(axle=1, driveshaft_inertia=0.5, box_inertia=0.6, gear_ratio=0.25)
    return dataclasses.replace(
        own, name="articulated", chassis=chassis, engine=None, transmission=None, wheelbase=None, driveline=line,
        axles=(axle, dataclasses.replace(axle, location=(-BEHIND, 0.0, 0.0), steering=0)),
        steerings=(SteeringMount(steering=arm, location=(0.0, 0.0, 0.0)),), start_height=axle.tire.radius,
    )  # fmt: skip


def test_the_arm_turns_its_axle_as_a_whole():
    """To the left the rear wheels head to the right, by the joint's angle, on a circle about the joint."""
    table = travel_table(articulated(), 1, 0.0, [-1.0, 0.0, 0.5])
    assert table.reached.all(), table.reason
    angle = -LARGEST * np.array([-1.0, 0.0, 0.5])
    np.testing.assert_allclose(table.steer, np.column_stack([angle, angle]), atol=1e-6)
    middle = table.center.mean(axis=1)
    np.testing.assert_allclose(middle[:, 0], -BEHIND * np.cos(angle), atol=1e-6)
    np.testing.assert_allclose(middle[:, 1], -BEHIND * np.sin(angle), atol=1e-6)


def test_an_axle_that_no_steering_turns_stays():
    table = travel_table(articulated(), 0, 0.0, [-1.0, 1.0])
    np.testing.assert_allclose(table.steer, 0.0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("steering", [0.3, -0.3])
def test_it_goes_round_where_the_lines_of_its_axles_meet(steering):
    """Rolling slowly, the front axle's curvature is sin γ / (b + a cos γ) of lengths a ahead and b behind the joint."""
    builder = ModelBuilder()
    parts = add_vehicle(builder, articulated(), speed=2.0)
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model, point=(AHEAD, 0.0, 0.0))
    simulation = Simulation(model, 1.0e-3, elements=[vehicle], solver=VEHICLE_SOLVER)
    inputs = vehicle.input.numpy()
    inputs[:, 0] = steering
    vehicle.input.assign(inputs)
    simulation.step(3000)
    angle = LARGEST * steering
    expected = math.sin(angle) / (BEHIND + AHEAD * math.cos(angle))
    speed, rate = float(vehicle.velocity_b.numpy()[0, 0]), float(vehicle.omega_b.numpy()[0, 2])
    assert speed > 1.0
    # slip angles at 0.1 m/s² of side acceleration are below a thousandth, of wheels 0.12 rad apart
    assert rate / speed == pytest.approx(expected, rel=0.02)
