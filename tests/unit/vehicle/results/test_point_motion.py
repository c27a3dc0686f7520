"""What a vehicle tells about itself: motion of a point, in arrays that a controller reads."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.results.chassis_motion import matrices
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

POINT = (1.2, 0.3, 0.8)
DT = 1e-3


@pytest.fixture(scope="module")
def turning():
    """A reduced HMMWV that turns and brakes, and the two last states of the point."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle("hmmwv-reduced"), speed=8.0)
    vehicle = Vehicle(parts, builder.finalize(2, "cpu", per_world=per_world()), point=POINT)
    sim = sw.Simulation(vehicle.model, DT, elements=[vehicle], solver=VEHICLE_SOLVER)
    vehicle.input[:, 0] = 0.4
    vehicle.input[:, 2] = 0.2
    for _ in range(700):
        sim.step()
    states = []
    for _ in range(2):
        body = parts.chassis
        rotation = matrices(sim.state.body_rot.numpy()[:, body])
        arm = rotation @ (parts.reference + np.array(POINT))
        omega = sim.state.body_omega.numpy()[:, body].astype(float)
        velocity = sim.state.body_v.numpy()[:, body] + np.cross(omega, arm)
        states.append((rotation, sim.state.body_x.numpy()[:, body] + arm, velocity, omega))
        sim.step()
    return vehicle, sim, states, parts


def now(sim, parts):
    rotation = matrices(sim.state.body_rot.numpy()[:, parts.chassis])
    arm = rotation @ (parts.reference + np.array(POINT))
    omega = sim.state.body_omega.numpy()[:, parts.chassis].astype(float)
    return rotation, sim.state.body_x.numpy()[:, parts.chassis] + arm, (
        sim.state.body_v.numpy()[:, parts.chassis] + np.cross(omega, arm)
    ), omega  # fmt: skip


def test_place_and_velocity_are_those_of_the_point(turning):
    vehicle, sim, _, parts = turning
    rotation, place, velocity, omega = now(sim, parts)
    # the point's place on the chassis is float32: 1e-7 of a metre
    assert vehicle.position.numpy() == pytest.approx(place, abs=2e-7)
    # float32 products of some 10 m/s
    assert vehicle.velocity_b.numpy() == pytest.approx(np.einsum("wji,wj->wi", rotation, velocity), abs=5e-6)
    assert vehicle.omega_b.numpy() == pytest.approx(np.einsum("wji,wj->wi", rotation, omega), abs=1e-6)
    assert vehicle.omega_b.numpy()[0, 2] > 0.1  # positive input turns to the left


def test_angles_are_roll_pitch_and_yaw(turning):
    vehicle, sim, _, parts = turning
    rotation = now(sim, parts)[0][0]
    roll, pitch, yaw = vehicle.angles.numpy()[0].astype(float)
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    about_z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    assert about_z @ about_y @ about_x == pytest.approx(rotation, abs=1e-6)


def test_the_acceleration_is_the_change_of_the_point_s_velocity(turning):
    vehicle, sim, states, parts = turning
    rotation, _, velocity, _ = now(sim, parts)
    change = (velocity - states[-1][2]) / DT
    # float32 velocities of 8 m/s over 1 ms: 5e-7 / 1e-3 each
    assert vehicle.acceleration_b.numpy() == pytest.approx(np.einsum("wji,wj->wi", rotation, change), abs=3e-3)
    assert vehicle.acceleration_b.numpy()[0, 0] < -0.5  # it brakes


def test_arrays_stay_where_they_are(turning):
    vehicle, sim, _, _ = turning
    before = vehicle.position.ptr, vehicle.velocity_b.ptr
    sim.step()
    assert (vehicle.position.ptr, vehicle.velocity_b.ptr) == before


def test_a_point_that_is_none_is_refused():
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, load_vehicle("hmmwv-reduced"))
    model = builder.finalize(1, "cpu", per_world=per_world())
    with pytest.raises(sw.ModelError, match="Vehicle: point must be 3"):
        Vehicle(parts, model, point=(1.0, 2.0))
