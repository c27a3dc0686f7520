"""Clutches across differentials, and tires that are shapes in contact."""

import dataclasses
import warnings

import numpy as np
import pytest

import simwarp as sw
from simwarp.soil.vehicle_wheels import soil_under
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import ShaftsDriveline4WD, SpecError
from simwarp.vehicle.tires.contact_tires import ContactTires
from simwarp.vehicle.tires.tires import ground
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

DT = 1e-3


def split_road(**changes):
    """A reduced HMMWV at 2 m/s whose left wheels are on ice: friction 0.1 for y > 0, 0.9 for y < 0."""
    spec = load_vehicle("hmmwv-reduced")
    assert isinstance(spec.driveline, ShaftsDriveline4WD)
    spec = dataclasses.replace(spec, driveline=dataclasses.replace(spec.driveline, reaction=0.0, **changes))
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, spec, speed=2.0)
    model = builder.finalize(1, "cpu", per_world=per_world())
    road = ground(
        "cpu", friction_map=[[1.0], [1.0 / 9.0]], friction_origin=(-500.0, -500.0), friction_cell=(1000.0, 500.0)
    )
    vehicle = Vehicle(parts, model, ground=road)
    return vehicle, sw.Simulation(model, DT, elements=[vehicle], solver=VEHICLE_SOLVER)


def launch(vehicle, sim, time: float = 1.0) -> np.ndarray:
    """Full throttle; wheel speeds then [rad/s]."""
    vehicle.input[:, 1] = 1.0
    for _ in range(round(time / DT)):
        sim.step()
    turns = [sim.model.joint_dof_start[side.turn] for side in vehicle.parts.sides]
    return sim.state.joint_qd.numpy()[0, turns]


def test_a_locked_axle_turns_its_wheels_together_and_pulls_more():
    free, sim_free = split_road()
    open_speeds = launch(free, sim_free)
    locked, sim = split_road(lockable=True, axle_locking_limit=20000.0, central_locking_limit=20000.0)
    assert locked.lock.shape == (1, 3)
    locked.lock[:, :] = 1.0
    speeds = launch(locked, sim)
    assert open_speeds[0] > open_speeds[1] + 10.0  # the wheel on ice runs away
    # 1500 N·m on the slip's 0.016 kg·m2 are 90 rad/s a step, of which float32 keeps 1e-5
    assert speeds == pytest.approx(np.full(4, speeds[0]), abs=1e-4)
    assert locked.velocity_b.numpy()[0, 0] > free.velocity_b.numpy()[0, 0] + 0.5


def test_a_limited_slip_differential_holds_its_torque_and_no_more():
    differences = []
    for torque in (0.0, 400.0):
        vehicle, sim = split_road(axle_slip_torque=torque)
        speeds = launch(vehicle, sim, 0.5)
        differences.append(speeds[0] - speeds[1])
    assert 0.0 < differences[1] < differences[0]


def test_an_open_lockable_differential_is_open():
    speeds = []
    for lockable in (False, True):
        vehicle, sim = split_road(lockable=lockable)
        speeds.append(launch(vehicle, sim, 0.3))
    # the clutch's slip has 1/500 of the wheels' inertia
    assert speeds[1] == pytest.approx(speeds[0], rel=2e-3)


def rigid(worlds: int = 2, friction: float = 0.9):
    spec = with_options(load_vehicle("hmmwv-reduced"), tire="rigid")
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, spec)
    builder.add_shape_plane(material=sw.Material(friction=friction))
    model = builder.finalize(worlds, "cpu", per_world=per_world(["shape_friction"]))
    vehicle = Vehicle(parts, model)
    return vehicle, sw.Simulation(model, DT, elements=[vehicle], solver=VEHICLE_SOLVER)


def test_rigid_tires_carry_the_vehicle_and_drive_it():
    vehicle, sim = rigid()
    assert isinstance(vehicle.tires, ContactTires)
    vehicle.input[:, 2] = 1.0
    for _ in range(1500):
        sim.step()
    weight = float(sim.model.body_mass.numpy()[0].sum()) * 9.81
    # springs still settle by some 0.1 m/s2
    assert vehicle.tires.load.numpy().sum(axis=1) == pytest.approx(np.full(2, weight), rel=0.02)
    vehicle.input[:, 2] = 0.0
    vehicle.input[:, 1] = 0.5
    for _ in range(1000):
        sim.step()
    speed = vehicle.velocity_b.numpy()[:, 0]
    turns = [sim.model.joint_dof_start[side.turn] for side in vehicle.parts.sides]
    rolling = sim.state.joint_qd.numpy()[:, turns] * 0.467
    assert (speed > 0.5).all()
    assert rolling == pytest.approx(np.repeat(speed[:, None], 4, axis=1), abs=0.02)
    assert sim.problems() == []


def test_rigid_tires_take_the_smaller_friction():
    vehicle, sim = rigid()
    vehicle.tires.ground_friction.assign(np.array([0.9, 0.05], np.float32))
    vehicle.input[:, 1] = 1.0
    for _ in range(1000):
        sim.step()
    speed = vehicle.velocity_b.numpy()[:, 0]
    assert speed[1] < 0.05 * 9.81 + 0.05 < speed[0]


def test_mixed_tires_and_unknown_parameters_are_refused():
    spec = load_vehicle("hmmwv-reduced")
    other = with_options(spec, tire="rigid")
    mixed = dataclasses.replace(spec, axles=(spec.axles[0], other.axles[1]))
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, mixed)
    model = builder.finalize(1, "cpu", per_world=per_world())
    with pytest.raises(SpecError, match="rigid on all wheels or on none"):
        Vehicle(parts, model)
    tire = dataclasses.replace(other.axles[0].tire, parameters={"grip": 1.0})
    wrong = dataclasses.replace(other, axles=tuple(dataclasses.replace(axle, tire=tire) for axle in other.axles))
    with pytest.raises(SpecError, match=r"axles\[0\]\.tire\.parameters\.grip: unknown key"):
        add_vehicle(sw.ModelBuilder(), wrong)


@pytest.mark.parametrize("tire", ["rigid", "soil-rigid", "tmeasy"])
@pytest.mark.parametrize("grounded", [False, True])
def test_tires_that_have_nothing_to_stand_on_are_told(tire, grounded):
    """Fails where such a vehicle falls for ever without a word. Tires with a law of their own have a plane."""
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, with_options(load_vehicle("hmmwv-reduced"), tire=tire))
    if grounded and tire == "rigid":
        builder.add_shape_plane()
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    soil = [soil_under(vehicle)] if grounded and tire == "soil-rigid" else []
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sw.Simulation(model, DT, elements=[vehicle, *soil], solver=VEHICLE_SOLVER)
    found = [str(each.message) for each in told if "stand on" in str(each.message)]
    if grounded or tire == "tmeasy":
        assert found == []
    else:
        assert len(set(found)) == 1
        assert found[0].startswith(f"vehicle 'hmmwv-reduced': its {tire} tires have nothing to stand on: the ")
