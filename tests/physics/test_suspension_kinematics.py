"""Toe, camber and steering angles over wheel travel against the loop equations solved in NumPy.

Required are 0.02 degrees; both solutions are exact up to the float32 coordinate that the steering is set by, so the
tests ask for 1e-4 degrees.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from simwarp.vehicle.spec.vehicle_spec import RotaryArm, SpecError, SteeringMount, VehicleSpec
from simwarp.vehicle.suspensions.kinematics import TravelTable, travel_table
from tests.physics.sample_vehicles import samples, shipped
from tests.reference.suspension_kinematics import Wheel, axle_wheels

ANGLE = 1.0e-4
"""Largest difference of an angle [degrees]."""
PLACE = 1.0e-6
"""Largest difference of a wheel's centre [m]."""


def reference(spec: VehicleSpec, axle: int, travels: tuple[float, float], steering: float) -> tuple[Wheel, Wheel]:
    part: Any = spec.axles[axle]
    mount = None
    if part.steering is not None:
        held: Any = spec.steerings[part.steering]
        mount = (vars(held.steering), held.location, held.rotation)
    return axle_wheels(
        vars(part.suspension), part.location, travels, steering, wheel_offset=part.wheel.offset, mount=mount
    )


def compare(spec: VehicleSpec, axle: int, table: TravelTable, lefts: np.ndarray, rights: np.ndarray) -> None:
    for row, (left, right, steering) in enumerate(zip(lefts, rights, table.steering, strict=True)):
        wheels = reference(spec, axle, (float(left), float(right)), float(steering))
        for column, wheel in enumerate(wheels):
            state = f"travel {left} {right}, steering {steering}, wheel {column}"
            assert np.degrees(table.steer[row, column] - wheel.steer) == pytest.approx(0.0, abs=ANGLE), state
            assert np.degrees(table.camber[row, column] - wheel.camber) == pytest.approx(0.0, abs=ANGLE), state
            assert table.center[row, column] == pytest.approx(wheel.center, abs=PLACE), state


def grid(travel: float, steering: float) -> tuple[np.ndarray, np.ndarray]:
    """Nine travels straight ahead, five at four more steerings."""
    heights = [np.linspace(-travel, travel, 9), np.tile(np.linspace(-travel, travel, 5), 4 if steering else 0)]
    inputs = [np.zeros(9), np.repeat([-1.0, -0.5, 0.5, 1.0], 5) * steering if steering else np.zeros(0)]
    return np.concatenate(heights), np.concatenate(inputs)


CASES: dict[str, tuple[VehicleSpec, int, float, float]] = {
    "hmmwv front: pitman arm": (shipped("hmmwv"), 0, 0.08, 1.0),
    "hmmwv rear": (shipped("hmmwv"), 1, 0.08, 0.0),
    "hmmwv-reduced front: rack": (shipped("hmmwv-reduced"), 0, 0.08, 1.0),
    "hmmwv-reduced rear": (shipped("hmmwv-reduced"), 1, 0.08, 0.0),
    "gator front: rack": (shipped("gator"), 0, 0.08, 0.8),
    "artcar front: pitman arm": (shipped("artcar"), 0, 0.02, 1.0),
    "artcar rear": (shipped("artcar"), 1, 0.02, 0.0),
    "sedan front: rack": (shipped("sedan"), 0, 0.08, 1.0),
    "MacPherson strut": (samples()["macpherson-strut"], 0, 0.08, 1.0),
    "multi-link, steered": (samples()["multi-link"], 0, 0.08, 1.0),
    "multi-link, rear": (samples()["multi-link"], 1, 0.08, 0.0),
    "solid axle: drag link": (samples()["solid-axle"], 0, 0.08, 0.5),
    "trailing arm": (samples()["trailing-arm"], 1, 0.08, 0.0),
}


@pytest.mark.quick(
    "hmmwv rear", "multi-link, rear", "trailing arm", "gator front: rack", "artcar front: pitman arm", "artcar rear"
)
@pytest.mark.parametrize("case", CASES)
def test_both_wheels_up_and_down(case):
    spec, axle, travel, steering = CASES[case]
    heights, inputs = grid(travel, steering)
    table = travel_table(spec, axle, heights, inputs)
    assert table.reached.all()
    assert table.travel == pytest.approx(np.stack([heights, heights], axis=1), abs=1e-9)
    compare(spec, axle, table, heights, heights)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.sweep
def test_one_wheel_up_the_other_down(case):
    spec, axle, travel, steering = CASES[case]
    lefts = np.array([-1.0, -0.5, 0.5, 1.0]) * 0.75 * travel
    table = travel_table(spec, axle, lefts, 0.5 * steering, right=-lefts)
    assert table.reached.all()
    compare(spec, axle, table, lefts, -lefts)


def test_a_rotary_arm():
    """Another steering for the sedan's front: the tie rods' inner balls go round the arm's hinge."""
    spec = shipped("sedan")
    arm = RotaryArm(max_angle=0.4, arm=spec.steerings[0].steering.link, arm_chassis=(0.15, 0.0, 0.0))
    spec = dataclasses.replace(spec, steerings=(SteeringMount(steering=arm, location=spec.steerings[0].location),))
    heights, inputs = grid(0.06, 0.5)
    compare(spec, 0, travel_table(spec, 0, heights, inputs), heights, heights)


def test_toe_and_camber_as_built():
    spec = shipped("hmmwv")
    set_up = dataclasses.replace(spec.axles[0].suspension, toe=0.01, camber=-0.02)
    spec = dataclasses.replace(spec, axles=(dataclasses.replace(spec.axles[0], suspension=set_up), spec.axles[1]))
    heights = np.linspace(-0.08, 0.08, 5)
    table = travel_table(spec, 0, heights)
    assert table.toe[2] == pytest.approx([0.01, 0.01], abs=1e-6)
    assert table.camber[2] == pytest.approx([-0.02, -0.02], abs=1e-6)
    compare(spec, 0, table, heights, heights)


def test_positive_steering_is_to_the_left_and_mirrored():
    for case, (spec, axle, _, steering) in CASES.items():
        if steering:
            table = travel_table(spec, axle, 0.0, [-0.5 * steering, 0.5 * steering])
            assert (table.steer[1] > 0.01).all(), case
            if "pitman" not in case and "solid" not in case:  # those are not symmetric themselves
                assert table.steer[1] == pytest.approx(-table.steer[0, ::-1], abs=1e-7), case


def test_states_out_of_reach_are_told():
    """Where the Gator's tie rods are too short, both say so."""
    spec = shipped("gator")
    heights, inputs = (v.ravel() for v in np.meshgrid([-0.08, -0.04, 0.0], [-1.0, -0.5, 0.5, 1.0]))
    table = travel_table(spec, 0, heights, inputs)
    assert 0 < table.reached.sum() < len(heights)
    for row, (height, value) in enumerate(zip(heights, inputs, strict=True)):
        if table.reached[row]:
            reference(spec, 0, (float(height), float(height)), float(value))
        else:
            assert np.isnan(table.camber[row]).all()
            with pytest.raises(ArithmeticError):
                reference(spec, 0, (float(height), float(height)), float(value))


def test_a_pinned_axle_rolls():
    """Its right wheel follows the left: both lie on one line through the tube."""
    spec: Any = samples()["pinned-axle"]
    table = travel_table(spec, 1, [-0.06, 0.0, 0.06])
    half = spec.axles[1].suspension.spindle.com[1] + spec.axles[1].wheel.offset
    drop = -spec.axles[1].suspension.pin[2]
    for row, height in enumerate([-0.06, 0.0, 0.06]):
        # height of the left wheel over the pin: drop cos r + half sin r
        angle = np.arcsin((drop + height) / np.hypot(half, drop)) - np.arctan2(drop, half)
        assert table.camber[row] == pytest.approx([-angle, angle], abs=1e-7)
        assert table.steer[row] == pytest.approx([0.0, 0.0], abs=1e-7)
        assert table.travel[row, 1] == pytest.approx(drop * np.cos(angle) - half * np.sin(angle) - drop, abs=1e-7)


def test_what_cannot_travel_is_refused():
    with pytest.raises(SpecError, match="travels: must be 0"):
        travel_table(shipped("gator"), 1, 0.01)
    assert travel_table(shipped("gator"), 1, 0.0).reached.all()
    with pytest.raises(SpecError, match="axle: must be in"):
        travel_table(shipped("gator"), 2, 0.0)
