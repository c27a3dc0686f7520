"""A driver by forward speed and yaw rate: its law, vehicles with motors and with an engine, and paths driven so."""

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.core.types import ModelError
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.maneuvers import maneuver
from simwarp.vehicle.driving.path_tracking import (
    PathTracker,
    PathTrackingSpec,
    PIDGains,
    Unicycle,
    full_speed,
    full_yaw_rate,
    unicycle_for,
)
from simwarp.vehicle.driving.paths import Path, circle
from simwarp.vehicle.driving.twist import TwistDriver, TwistGains, twist_gains_for
from simwarp.vehicle.results.runs import Drive, set_up
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, Vehicles, per_world

ROBOT, GATOR = load_vehicle("skid-steer"), load_vehicle("gator")
CRUISE = PIDGains(proportional=0.5, integral=2.0)


def build(spec: VehicleSpec, worlds: int, *, speed: float = 0.0) -> Vehicle:
    builder = sw.ModelBuilder()
    parts = add_vehicle(builder, spec, speed=speed)
    return Vehicle(parts, builder.finalize(worlds, "cpu", per_world=per_world()), randomised=True)


def simulated(vehicle: Any, driver: Any, dt: float = 2.0e-3) -> sw.Simulation:
    return sw.Simulation(vehicle.model, dt, elements=[driver, vehicle], solver=VEHICLE_SOLVER)


# ---- its law ---------------------------------------------------------------------------------------------------------


class Law:
    """One driver in float64."""

    def __init__(self, gains: TwistGains) -> None:
        self.gains = gains
        self.total = np.zeros(2)
        self.gear = 1

    def step(self, dt: float, command: np.ndarray, speed: float, yaw_rate: float) -> list[float]:
        """Steering, throttle, braking."""
        gains, (wanted, turn) = self.gains, command
        if wanted < 0.0 <= self.gear and speed < gains.standstill:
            self.gear, self.total[0] = -1, 0.0
        elif wanted > 0.0 >= self.gear and speed > -gains.standstill:
            self.gear, self.total[0] = 1, 0.0
        direction = -1.0 if self.gear < 0 else 1.0
        along = max(direction * wanted, 0.0)
        errors = np.array([along - direction * speed, turn - yaw_rate])
        outputs = np.array(
            [
                gains.speed_feedforward * along + gains.speed_proportional * errors[0]
                + gains.speed_integral * self.total[0],
                gains.yaw_feedforward * turn + gains.yaw_proportional * errors[1] + gains.yaw_integral * self.total[1],
            ]
        )  # fmt: skip
        for index in (0, 1):
            if abs(outputs[index]) < 1.0 or outputs[index] * errors[index] < 0.0:
                self.total[index] += dt * errors[index]
        pedal, steering = np.clip(outputs, -1.0, 1.0)
        throttle, braking = max(pedal, 0.0), min(max(-gains.brake_share * outputs[0], 0.0), 1.0)
        if along == 0.0:
            self.total[0] = throttle = 0.0
            if turn == 0.0:
                self.total[1] = steering = 0.0
                braking = 1.0 if abs(speed) < gains.standstill else braking
        return [steering, throttle, braking]


@pytest.mark.parametrize("gains", [TwistGains(), twist_gains_for(ROBOT)], ids=["engine", "motors"])
def test_the_driver_is_its_law_and_needs_three_arrays_of_a_vehicle(gains):
    """Motions that no vehicle makes, by a vehicle that is three arrays and a gear."""
    worlds, dt = 40, 0.01
    rng = np.random.default_rng(3)
    model = build(ROBOT, worlds).model
    names = {"velocity_b": wp.vec3, "omega_b": wp.vec3}
    stand_in: Any = SimpleNamespace(
        input_rows=wp.zeros((worlds, 1, 4), dtype=float, device="cpu"),
        gear=wp.array([1] * worlds, dtype=int, device="cpu"),
        **{name: wp.zeros(worlds, dtype=kind, device="cpu") for name, kind in names.items()},
    )
    driver = TwistDriver(stand_in, gains)
    sim = sw.Simulation(model, dt, elements=[driver])
    laws = [Law(gains) for _ in range(worlds)]
    command = np.zeros((worlds, 2))
    gears = set()
    for step in range(120):
        if step % 20 == 0:
            command = rng.uniform(-1.0, 1.0, (worlds, 2)) * (rng.random((worlds, 2)) < 0.7)
            driver.command.assign(command.astype(np.float32))
        motion = rng.uniform(-0.5, 0.5, (worlds, 2, 3)).astype(np.float32)
        stand_in.velocity_b.assign(motion[:, 0])
        stand_in.omega_b.assign(motion[:, 1])
        sim.step()
        truth = [
            law.step(dt, command[world].astype(np.float32).astype(float), motion[world, 0, 0], motion[world, 1, 2])
            for world, law in enumerate(laws)
        ]
        # single precision of a sum of 120
        assert stand_in.input_rows.numpy()[:, 0, :3] == pytest.approx(np.array(truth), abs=2e-5)
        assert stand_in.gear.numpy().tolist() == [law.gear for law in laws]
        gears |= {law.gear for law in laws}
    assert gears == {-1, 1}


def test_a_vehicle_without_a_gear_only_goes_ahead():
    vehicle = build(ROBOT, 1)
    bare: Any = SimpleNamespace(
        input_rows=vehicle.input_rows, velocity_b=vehicle.velocity_b, omega_b=vehicle.omega_b
    )  # fmt: skip
    driver = TwistDriver(bare, twist_gains_for(ROBOT))
    sim = simulated(vehicle, driver)
    driver.command.assign(np.array([[-0.5, 0.0]], np.float32))
    sim.step(200)
    assert vehicle.gear.numpy()[0] == 1
    assert abs(vehicle.velocity_b.numpy()[0, 0]) < 1e-3


def test_one_vehicle_at_a_time():
    builder = sw.ModelBuilder()
    parts = [
        add_vehicle(builder, ROBOT, at=sw.pose((2.0 * k, 0.0, ROBOT.start_height)), prefix=f"r{k}_") for k in (0, 1)
    ]
    both: Any = Vehicles(parts, builder.finalize(2, "cpu", per_world=per_world()))
    with pytest.raises(ModelError, match=r"^TwistDriver: vehicle must be one, got 2; make a driver for each of them$"):
        TwistDriver(both)
    drivers = [TwistDriver(each, twist_gains_for(ROBOT)) for each in both]
    drivers[1].command.assign(np.array([[0.4, 0.0], [0.0, 0.5]], np.float32))
    sim = sw.Simulation(both.model, 2.0e-3, elements=[*drivers, both], solver=VEHICLE_SOLVER)
    sim.step(1500)
    assert np.abs(both.velocity_b.numpy()[:, 0]).max() < 1e-4
    assert both.velocity_b.numpy()[0, 1, 0] == pytest.approx(0.4, abs=0.01)
    assert both.omega_b.numpy()[1, 1, 2] == pytest.approx(0.5, abs=0.01)


# ---- vehicles --------------------------------------------------------------------------------------------------------


def test_a_robot_holds_every_twist_on_any_ground():
    """Also where friction differs, of which the feedforward knows nothing."""
    commands = np.array([(0.5, 0.5), (-0.5, 0.3), (0.0, 1.2), (0.3, -0.8), (-0.2, -0.6), (0.9, 0.0)], np.float32)
    vehicle = build(ROBOT, len(commands))
    vehicle.tires.ground_friction.assign(np.array([0.9, 0.3, 0.5, 0.8, 0.4, 0.9], np.float32))
    driver = TwistDriver(vehicle, twist_gains_for(ROBOT))
    sim = simulated(vehicle, driver)
    driver.command.assign(commands)
    sim.step(3000)
    # the integrals leave nothing; a turn on the spot drifts a little
    assert vehicle.velocity_b.numpy()[:, 0] == pytest.approx(commands[:, 0], abs=5e-3)
    assert vehicle.omega_b.numpy()[:, 2] == pytest.approx(commands[:, 1], abs=5e-3)
    driver.command.assign(-commands)
    sim.step(3000)
    assert vehicle.velocity_b.numpy()[:, 0] == pytest.approx(-commands[:, 0], abs=5e-3)
    assert vehicle.omega_b.numpy()[:, 2] == pytest.approx(-commands[:, 1], abs=5e-3)
    driver.command.fill_(0.0)
    sim.step(500)
    still = vehicle.position.numpy().copy()
    sim.step(500)
    assert np.abs(vehicle.position.numpy() - still).max() < 1e-4


def test_an_engine_holds_a_twist_by_pedals_and_steering():
    """A vehicle whose steering turns wheels: the same driver, with the gains for engines, forward and backward."""
    commands = np.array([(4.0, 0.3), (3.0, -0.2)], np.float32)
    vehicle = build(GATOR, 2)
    driver = TwistDriver(vehicle)
    sim = simulated(vehicle, driver)
    driver.command.assign(commands)
    sim.step(12000)
    assert vehicle.velocity_b.numpy()[:, 0] == pytest.approx(commands[:, 0], abs=0.1)
    assert vehicle.omega_b.numpy()[:, 2] == pytest.approx(commands[:, 1], abs=0.02)
    driver.command.fill_(0.0)
    sim.step(3000)
    assert np.abs(vehicle.velocity_b.numpy()[:, 0]).max() < 0.02
    driver.command.assign(np.array([(-1.0, 0.0), (-1.5, 0.0)], np.float32))
    sim.step(6000)
    assert vehicle.gear.numpy().tolist() == [-1, -1]
    assert (vehicle.velocity_b.numpy()[:, 0] < -0.5).all()


def test_a_reset_clears_the_command_and_the_integrals():
    vehicle = build(ROBOT, 2)
    driver = TwistDriver(vehicle, twist_gains_for(ROBOT))
    sim = simulated(vehicle, driver)
    driver.command.assign(np.array([[0.5, 0.2], [0.5, 0.2]], np.float32))
    sim.step(300)
    assert (np.abs(driver.memory["error_sum"].numpy()) > 0.0).all()
    sim.reset(np.array([True, False]))
    assert driver.command.numpy()[0].tolist() == [0.0, 0.0]
    assert driver.command.numpy()[1].tolist() == pytest.approx([0.5, 0.2])
    assert driver.memory["error_sum"].numpy()[0].tolist() == [0.0, 0.0]


# ---- paths -----------------------------------------------------------------------------------------------------------


def follow(path: Path, speed: float, seconds: float, friction: tuple[float, ...] = (0.9,), **changes: Any) -> Any:
    """Distances from a path (samples, W) [m], every tenth of a second, and the vehicle at the end."""
    vehicle = build(ROBOT, len(friction))
    vehicle.tires.ground_friction.assign(np.array(friction, np.float32))
    steering = dataclasses.replace(unicycle_for(ROBOT), **changes)
    spec = PathTrackingSpec(paths=(path,), speed=speed, steering=steering, speed_gains=CRUISE)
    driver = PathTracker(vehicle, spec)
    sim = simulated(vehicle, driver)
    found = []
    for _ in range(round(10.0 * seconds)):
        sim.step(50)
        found.append(driver.distance.numpy().copy())
    return np.array(found), vehicle


def wave() -> Path:
    """Half a metre to either side in every four metres: curves of 0.8 m radius at its crests."""
    x = np.linspace(0.0, 16.0, 641)
    return Path(np.stack([x, 0.5 * np.sin(0.5 * math.pi * x)], axis=1))


def test_it_follows_a_sinusoidal_path():
    """At 0.5 m/s; it starts 38 degrees off the path. Found: 15 mm and 37 mm at most later on, on firm and on
    slippery ground.
    """
    distance, vehicle = follow(wave(), 0.5, 24.0, (0.9, 0.4))
    assert vehicle.position.numpy()[:, 0].min() > 8.0
    assert np.abs(distance).max() < 0.13
    settled = np.abs(distance[60:]).max(axis=0)
    assert settled[0] < 0.025
    assert settled[1] < 0.045


def test_it_comes_back_to_a_line_as_a_critically_damped_system():
    """d'' + 4/L d' + 4/L² d = 0 over the way s: d = d0 (1 + 2 s / L) exp(-2 s / L)."""
    line = Path(np.array([(-5.0, -0.2), (20.0, -0.2)]))
    distance, vehicle = follow(line, 0.2, 20.0, approach=2.0, soft_speed=1e-3)
    way = vehicle.position.numpy()[0, 0] + 0.2 * 0.1 * np.arange(1 - len(distance), 1)
    expected = 0.2 * (1.0 + way) * np.exp(-way)
    # it starts from rest, and yaw lags by some tenths of a second: 4 cm of way
    late = slice(40, None)
    assert distance[late, 0] == pytest.approx(expected[late], abs=0.012)
    assert abs(distance[-1, 0]) < 0.01 + expected[-1]


def test_it_turns_on_the_spot_where_the_path_leads_back():
    back = Path(np.array([(5.0, 0.0), (-10.0, 0.0)]))
    distance, vehicle = follow(back, 0.5, 16.0)
    assert np.abs(distance).max() < 0.25
    assert abs(distance[-1, 0]) < 0.02
    assert vehicle.position.numpy()[0, 0] < -2.0


@pytest.mark.parametrize("radius", [1.0, -0.6])
def test_it_keeps_on_tight_circles(radius):
    """It heads a degree beside the way that it takes, as wheels that scrub do, which the law takes for an error."""
    distance, _ = follow(circle(radius), 0.3, 20.0)
    assert np.abs(distance[100:]).max() < unicycle_for(ROBOT).approach * math.tan(math.radians(1.5))


def test_manoeuvres_along_paths_take_its_own_steering():
    what = maneuver("constant-radius", ROBOT, duration=14.0)
    assert what.follow is not None
    assert isinstance(what.follow.steering, Unicycle)
    run = Drive(set_up(ROBOT, what, device="cpu", dt=5e-3)).run()
    off = np.abs(np.hypot(run["x_m"], run["y_m"] - 2.0) - 2.0)
    assert off.max() < 0.03
    assert run["speed_mps"][-1] == pytest.approx(0.5, abs=0.01)


def test_speeds_of_other_drivelines_are_refused():
    for ask in (full_speed, full_yaw_rate, unicycle_for, twist_gains_for):
        with pytest.raises(SpecError, match=r"^driveline: must be 'differential-drive', got 'simple'$"):
            ask(GATOR)
    with pytest.raises(SpecError, match=r"got None$"):
        full_speed(dataclasses.replace(GATOR, engine=None, transmission=None, driveline=None))
    with pytest.raises(SpecError, match="yaw_integral"):
        TwistGains(yaw_integral=-1.0)
    with pytest.raises(SpecError, match="full_yaw_rate"):
        Unicycle(full_yaw_rate=0.0)
