"""Vehicles that start at speed: everything that turns does so consistently, and nothing jolts."""

import dataclasses
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import rotate
from simwarp.core.types import JointType
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.initial_velocity import start_of
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from tests.physics.sample_vehicles import shipped

CASES = {
    "hmmwv": {},
    "hmmwv-reduced": {},
    "hmmwv-rwd": {"driveline": "rwd", "powertrain": "cvt"},
    "hmmwv-simple": {"driveline": "simple", "powertrain": "simplemap"},
    "gator": {},
    "artcar": {},
    "sedan": {},
    "sedan-shafts": {"powertrain": "shafts"},
}
SPEEDS = {"gator": 6.0, "artcar": 1.5}


def described(case: str) -> Any:
    name = case if case in ("hmmwv-reduced",) else case.partition("-")[0]
    return with_options(shipped(name), **CASES[case])


def start(spec, speed, dt=1.0e-3, **options):
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec, speed=speed, **options)
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    return builder, parts, vehicle, sw.Simulation(model, dt, elements=[vehicle], solver=VEHICLE_SOLVER)


def coupling_slip(builder, model, joint_qd, gear):
    """Sum of coefficient x rate of every coupling that holds in the gear."""
    rows = {"gears": 0.0} if gear == 0 else {}
    return [
        sum(value * joint_qd[dof] for dof, value in coupling.terms)
        for coupling in builder.couplings
        if coupling.name not in rows
    ]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("direction", [1.0, -0.15])
@pytest.mark.sweep
def test_the_first_step_finds_nothing_to_correct(case, direction):
    speed = direction * SPEEDS.get(case.partition("-")[0], 15.0)
    builder, parts, _, sim = start(described(case), speed)
    state = sim.state
    # float32 of rates up to 300 rad/s
    slips = coupling_slip(builder, sim.model, state.joint_qd.numpy()[0], parts.start.gear)
    assert np.abs(slips or [0.0]).max() < 1e-4
    for joint, spec in enumerate(builder.joints):
        # every coordinate of the mechanism stands, but for spins and turns of wheels
        if spec.type not in (JointType.SHAFT, JointType.RELATIVE_ROTATION) and joint not in {
            side.spin for side in parts.sides
        }:
            first, last = sim.model.joint_dof_start[joint : joint + 2]
            assert np.abs(state.joint_qd.numpy()[0, first:last]).max(initial=0.0) < 2e-6, spec.name
    before = state.body_v.numpy()[0].copy()
    rates = state.joint_qd.numpy()[0].copy()
    sim.step()
    # in the air: gravity, springs (50 kN on a wheel of 50 kg: 1 m/s in 1 ms at most) and no jerk along x
    change = state.body_v.numpy()[0] - before
    assert np.abs(change[parts.chassis, :2]).max() < 2e-3
    assert sim.diagnostics.row_residual.numpy()[0] < 1e-4
    shafts = [sim.model.joint_dof_start[j] for j, spec in enumerate(builder.joints) if spec.type == JointType.SHAFT]
    # engine brake and converter act at once: 60 N·m on the sedan's engine and clutch of 0.1 kg·m²; a shaft that was
    # left behind would jump by tens of rad/s
    assert np.abs(state.joint_qd.numpy()[0, shafts] - rates[shafts]).max(initial=0.0) < 1.0


@pytest.mark.parametrize("case", CASES)
@pytest.mark.sweep
def test_it_rolls_on(case):
    """A second without pedals: the wheels take the ground's speed, and the vehicle keeps most of its own."""
    spec = described(case)
    speed = SPEEDS.get(case.partition("-")[0], 15.0)
    _, parts, vehicle, sim = start(spec, speed)
    gear = int(vehicle.gear.numpy()[0])
    slips, jerks, before = [], [], sim.state.body_v.numpy()[0, parts.chassis, 0]
    for _ in range(1000):
        sim.step()
        slips.append(np.abs(vehicle.tires.slip_ratio.numpy()[0]).max())
        after = sim.state.body_v.numpy()[0, parts.chassis, 0]
        jerks.append(abs(after - before) / sim.dt)
        before = after
    # wheels land on a smaller radius than the unloaded one: by deflection / radius, 10 % at most
    assert max(slips) < 0.2
    assert max(jerks) < 15.0
    # on that radius they turn faster, which may take the next gear
    assert vehicle.gear.numpy()[0] in (gear, gear + 1)
    # rolling resistance and engine brake: the model car's tires alone take 0.6 m/s²
    assert speed - 2.0 < sim.state.body_v.numpy()[0, parts.chassis, 0] < speed
    assert sim.problems() == []


def test_it_starts_along_its_own_axis_in_the_pose_given():
    half = np.pi / 8.0
    pose = sw.pose((3.0, -2.0, 0.6), (0.0, 0.0, np.sin(half), np.cos(half)))
    builder = ModelBuilder()
    parts = add_vehicle(builder, shipped("hmmwv"), at=pose, speed=10.0)
    forward = rotate(pose.rotation, np.array([1.0, 0.0, 0.0]))
    for body in builder.bodies:
        assert body.velocity == pytest.approx(10.0 * forward)
    for side in parts.sides:
        left = rotate(builder.bodies[side.spindle].pose.rotation, np.array([0.0, 1.0, 0.0]))
        radius = parts.spec.axles[side.axle].tire.radius
        assert builder.bodies[side.spindle].omega == pytest.approx(10.0 / radius * left)


def test_gear_and_engine_fit_the_speed():
    expected = {0.0: 1, 4.0: 1, 8.0: 2, 12.0: 3, 25.0: 3, -2.0: -1}
    for speed, gear in expected.items():
        _, parts, vehicle, _ = start(shipped("hmmwv"), speed)
        assert vehicle.gear.numpy()[0] == gear
        # 1/0.4673 rad/s of the wheel per m/s, 0.2 in the axles
        ratio = {-1: -0.1, 1: 0.2, 2: 0.4, 3: 0.8}[gear]
        radius = parts.spec.axles[0].tire.radius
        assert parts.start.motor_speed == pytest.approx(speed / radius / 0.2 / ratio)
        assert vehicle.engine_speed.numpy()[0] == pytest.approx(abs(parts.start.motor_speed), rel=1e-6)


def test_a_manual_box_starts_in_a_gear_or_in_neutral_where_it_is_asked_for():
    spec = described("sedan-shafts")
    _, parts, vehicle, sim = start(spec, 15.0)
    gear, motor = vehicle.gear.numpy()[0], parts.start.motor_speed
    # the lowest gear below 300 rad/s: neither the next lower one nor a crawling engine
    assert gear > 1
    assert 150.0 < motor < 300.0
    for _ in range(200):
        sim.step()
    # the closed clutch keeps engine and wheels together
    assert vehicle.engine_speed.numpy()[0] == pytest.approx(motor, rel=0.1)
    _, parts, vehicle, _ = start(spec, 15.0, gear=0)
    assert vehicle.gear.numpy()[0] == 0
    assert parts.start.motor_speed == 0.0
    _, higher, vehicle, _ = start(spec, 15.0, gear=gear + 1)
    assert vehicle.gear.numpy()[0] == gear + 1
    assert 0.0 < higher.start.motor_speed < motor


def test_a_reset_brings_the_start_back():
    _, _, _, sim = start(shipped("hmmwv"), 15.0)
    first = sim.state.body_v.numpy().copy()
    for _ in range(50):
        sim.step()
    run = sim.state.body_x.numpy().copy()
    sim.reset()
    assert (sim.state.body_v.numpy() == first).all()
    for _ in range(50):
        sim.step()
    assert (sim.state.body_x.numpy() == run).all()


def test_wrong_starts_are_named():
    gear: Any
    for gear in (4, "2"):
        with pytest.raises(SpecError, match="gear: must be a whole number from -1"):
            add_vehicle(ModelBuilder(), shipped("hmmwv"), gear=gear)
    wrong: Any
    for wrong in (float("nan"), "10", True):
        with pytest.raises(SpecError, match="speed: must be a finite number"):
            add_vehicle(ModelBuilder(), shipped("hmmwv"), speed=wrong)
    bare: Any = dataclasses.replace(shipped("gator"), engine=None, transmission=None)
    assert start_of(bare.transmission, 5.0, 20.0, None).motor_speed == 0.0
