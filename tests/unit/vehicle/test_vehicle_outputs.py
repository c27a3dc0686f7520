"""What a vehicle tells of its motion where nothing has stepped yet: outputs follow a state that somebody set."""

from __future__ import annotations

import numpy as np
import pytest

import simwarp as sw
from simwarp.scenery import yaw_pose
from simwarp.vehicle import VEHICLE_SOLVER, Vehicle, add_vehicle, load_vehicle, per_world

WORLDS = 3
DISTURBED = np.array([False, True, False])
OUTPUTS = ("position", "angles", "velocity_b", "omega_b", "acceleration_b")


@pytest.fixture
def driven() -> tuple[sw.Simulation, Vehicle]:
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle("gator"), at=yaw_pose(2.0, 1.0, 0.5, 0.3))
    model = builder.finalize(WORLDS, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    simulation = sw.Simulation(model, 0.001, elements=[vehicle], solver=VEHICLE_SOLVER)
    return simulation, vehicle


def outputs(vehicle: Vehicle) -> dict[str, np.ndarray]:
    return {name: getattr(vehicle, name).numpy().copy() for name in OUTPUTS}


def test_outputs_are_there_before_the_first_step(driven) -> None:
    _, vehicle = driven
    assert vehicle.position.numpy()[0][:2] == pytest.approx([2.0, 1.0], abs=1e-6)
    assert vehicle.angles.numpy()[0][2] == pytest.approx(0.3, abs=1e-6)


def test_outputs_follow_a_reset_of_some_worlds(driven) -> None:
    simulation, vehicle = driven
    start = outputs(vehicle)
    vehicle.input.assign(np.tile([0.5, 1.0, 0.0, 0.0], (WORLDS, 1)).astype(np.float32))
    simulation.step(200)
    before = outputs(vehicle)
    assert np.abs(before["acceleration_b"]).max() > 0.1
    simulation.reset(DISTURBED)
    after = outputs(vehicle)
    for name in OUTPUTS:
        np.testing.assert_array_equal(after[name][DISTURBED], start[name][DISTURBED], err_msg=name)
        np.testing.assert_array_equal(after[name][~DISTURBED], before[name][~DISTURBED], err_msg=name)


def test_outputs_follow_what_was_written_and_measured(driven) -> None:
    simulation, vehicle = driven
    simulation.step(20)
    still = outputs(vehicle)
    moved = simulation.state.body_x.numpy()
    moved[1] += (3.0, -2.0, 0.0)
    simulation.state.body_x.assign(moved)
    simulation.measure(DISTURBED)
    told = outputs(vehicle)
    np.testing.assert_allclose(told["position"][1] - still["position"][1], (3.0, -2.0, 0.0), atol=1e-12)
    assert (told["acceleration_b"][1] == 0.0).all()
    for name in OUTPUTS:
        np.testing.assert_array_equal(told[name][~DISTURBED], still[name][~DISTURBED], err_msg=name)


def test_a_restored_snapshot_is_told(driven) -> None:
    simulation, vehicle = driven
    kept, told = simulation.snapshot(), outputs(vehicle)
    simulation.step(100)
    simulation.restore(kept)
    for name in OUTPUTS[:4]:
        np.testing.assert_array_equal(outputs(vehicle)[name], told[name], err_msg=name)
