"""Vehicles by twists and Ackermann commands: the steering that an angle takes, rates, and circles that are driven."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.ros2.command_topics import CommandError, CommandTopic
from simwarp.ros2.vehicle_commands import SteeringMap, VehicleCommands, towards
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.path_tracking import full_speed, wheelbase
from simwarp.vehicle.driving.steering_ratio import angle_per_steering
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.tires.tires import ground
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from tests.unit.ros2.ros_graph import TYPES, encoded

REDUCED = load_vehicle("gator-14dof")
ROBOT = load_vehicle("skid-steer")
CONTROL = 0.02


class Driven:
    """A vehicle that is commanded."""

    def __init__(self, spec: VehicleSpec, *, stamped: bool = False) -> None:
        builder = sw.ModelBuilder()
        parts = add_vehicle(builder, spec)
        model = builder.finalize(1, "cpu", per_world=per_world())
        self.vehicle = Vehicle(parts, model, ground=ground(model.device))
        self.commands = VehicleCommands(self.vehicle, spec, stamped=stamped)
        self.topics = {each.topic: each for each in self.commands.topics()}
        self.inputs = self.commands.driver.command

    def simulated(self) -> sw.Simulation:
        elements = [self.commands.driver, self.vehicle]
        return sw.Simulation(self.vehicle.model, 1e-3, elements=elements, solver=VEHICLE_SOLVER, threads=1)

    def send(self, topic: str, values: dict[str, Any]) -> None:
        found: CommandTopic = self.topics[topic]
        found.read(TYPES.read(found.kind, encoded(found.kind, values)))()

    def wanted(self) -> list[float]:
        """Speed, and steering or yaw rate, that the driver holds after a control step."""
        self.commands.advance(CONTROL)
        return [float(value) for value in self.inputs.numpy()[0]]


def test_an_angle_becomes_the_input_that_turns_the_wheels_so() -> None:
    made = SteeringMap(REDUCED)
    rate = angle_per_steering(REDUCED)
    assert made.input_for(0.0) == pytest.approx(0.0, abs=1e-3)
    assert made.input_for(0.01) - made.input_for(0.0) == pytest.approx(0.01 / rate, rel=0.02)
    assert made.least < -0.2
    assert made.most > 0.2
    inputs = [made.input_for(angle) for angle in np.linspace(made.least, made.most, 11)]
    assert np.all(np.diff(inputs) > 0.0)
    assert (inputs[0], inputs[-1]) == (-1.0, 1.0)
    assert (made.input_for(2.0), made.input_for(-2.0)) == (1.0, -1.0)


def test_wheels_behind_turn_the_other_way() -> None:
    ahead = SteeringMap(REDUCED)
    front, rear = REDUCED.axles
    places = front.location, rear.location
    axles = (dataclasses.replace(rear, location=places[0]), dataclasses.replace(front, location=places[1]))
    behind = SteeringMap(dataclasses.replace(REDUCED, axles=axles))
    for angle in (-0.2, 0.05, 0.2):
        assert behind.input_for(angle) == pytest.approx(ahead.input_for(-angle), abs=1e-9)


@pytest.mark.parametrize(("speed", "turn"), [(2.0, 0.3), (2.0, -0.3), (-2.0, 0.3), (0.5, 0.0)])
def test_a_twist_becomes_the_angle_that_rolls_without_slip(speed: float, turn: float) -> None:
    made = SteeringMap(REDUCED)
    angle = made.angle_for(speed, turn)
    assert speed * math.tan(angle) / wheelbase(REDUCED) == pytest.approx(turn)
    assert made.angle_for(0.0, turn) == 0.0  # a car does not turn at rest


def test_a_steered_vehicle_takes_twists_and_ackermann_commands() -> None:
    driven = Driven(REDUCED)
    assert [*driven.topics] == ["/cmd_vel", "/ackermann_cmd"]
    made = driven.commands.map
    assert made is not None
    driven.send("/cmd_vel", {"linear": {"x": 2.0}, "angular": {"z": 0.3}})
    angle = math.atan(wheelbase(REDUCED) * 0.3 / 2.0)
    assert driven.wanted() == pytest.approx([2.0, made.input_for(angle)], rel=1e-6)
    driven.send("/ackermann_cmd", {"drive": {"speed": -1.0, "steering_angle": -0.1}})
    assert driven.wanted() == pytest.approx([-1.0, made.input_for(float(np.float32(-0.1)))], rel=1e-6)
    rests = {topic: each.rest for topic, each in driven.topics.items()}
    assert rests["/cmd_vel"] is not None
    assert rests["/ackermann_cmd"] is not None
    rests["/cmd_vel"]()  # which does not drive any more
    assert driven.wanted()[0] == -1.0
    rests["/ackermann_cmd"]()
    assert driven.wanted() == pytest.approx([0.0, made.input_for(0.0)], abs=1e-6)


def test_rates_of_an_ackermann_command_are_kept() -> None:
    driven = Driven(REDUCED)
    made = driven.commands.map
    assert made is not None
    drive = {"speed": 1.0, "steering_angle": 0.2, "acceleration": 2.0, "steering_angle_velocity": 0.5}
    driven.send("/ackermann_cmd", {"drive": drive})
    for step in range(1, 30):
        speed, steering = driven.wanted()
        assert speed == pytest.approx(min(2.0 * CONTROL * step, 1.0), rel=1e-6)
        assert steering == pytest.approx(made.input_for(min(0.5 * CONTROL * step, 0.2)), rel=1e-5, abs=1e-6)
    driven.commands.rest()
    assert driven.wanted() == pytest.approx([0.0, made.input_for(0.0)], abs=1e-6)


def test_towards() -> None:
    assert [towards(0.0, 1.0, 0.0), towards(0.0, 1.0, 0.25), towards(0.9, 1.0, 0.25)] == [1.0, 0.25, 1.0]
    assert [towards(0.0, -1.0, 0.25), towards(1.0, -1.0, 0.0)] == [-0.25, -1.0]


def test_a_robot_with_two_motors_takes_a_yaw_rate() -> None:
    driven = Driven(ROBOT, stamped=True)
    assert [(each.topic, each.kind) for each in driven.topics.values()] == [
        ("/cmd_vel", "geometry_msgs/msg/TwistStamped")
    ]
    driven.send("/cmd_vel", {"twist": {"linear": {"x": 0.5}, "angular": {"z": -0.75}}})
    assert driven.wanted() == pytest.approx([0.5, -0.75])
    assert driven.commands.driver.gains.speed_feedforward == pytest.approx(1.0 / full_speed(ROBOT))


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        ({"speed": math.nan}, "drive.speed must be finite, got nan"),
        ({"steering_angle": math.inf}, "drive.steering_angle must be finite, got inf"),
        ({"acceleration": -1.0}, "drive.acceleration must be >= 0, got -1; 0 means at once"),
        ({"steering_angle_velocity": -0.5}, "drive.steering_angle_velocity must be >= 0, got -0.5; 0 means at once"),
    ],
)
def test_wrong_ackermann_commands_are_one_line(drive: dict[str, float], words: str) -> None:
    driven = Driven(REDUCED)
    with pytest.raises(CommandError, match=f"^/ackermann_cmd: {words}"):
        driven.send("/ackermann_cmd", {"drive": drive})
    assert not driven.inputs.numpy().any()


def test_a_vehicle_without_a_driveline_is_refused() -> None:
    spec = dataclasses.replace(REDUCED, driveline=None, engine=None, transmission=None)
    with pytest.raises(sw.ModelError, match="vehicle 'gator-14dof': has no driveline that could move it; add one"):
        Driven(spec)


@pytest.mark.parametrize(
    ("topic", "values"),
    [
        ("/cmd_vel", {"linear": {"x": 1.0}, "angular": {"z": 0.06}}),
        ("/ackermann_cmd", {"drive": {"speed": 1.0, "steering_angle": math.atan(0.06 * 2.776)}}),
    ],
)
def test_a_commanded_circle_is_driven(topic: str, values: dict[str, Any]) -> None:
    """0.06 rad/s at 1 m/s: a circle of 17 m, at 0.006 g, where tires hardly slip and the linkage decides."""
    spec = load_vehicle("sedan-14dof")
    driven = Driven(spec)
    assert wheelbase(spec) == pytest.approx(2.776)
    sim = driven.simulated()
    driven.send(topic, values)
    rates, speeds = [], []
    for step in range(400):
        driven.commands.advance(CONTROL)
        sim.step(20)
        if step >= 300:
            speeds.append(float(driven.vehicle.velocity_b.numpy()[0, 0]))
            rates.append(float(driven.vehicle.omega_b.numpy()[0, 2]))
    # the integral of the speed's controller has come to rest; the mean angle of both wheels stands for the middle one's
    assert np.mean(speeds) == pytest.approx(1.0, rel=0.01)
    assert np.mean(rates) / np.mean(speeds) == pytest.approx(0.06, rel=0.02)
