"""Torques that a driveline gives to its wheels and that hold the steering, against balances of power and momentum."""

import math

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.core.types import JointType
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.results.channels import Recorder
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

DT = 1.0e-3
WHEELS = ("FL", "FR", "RL", "RR")


class Probe:
    """A vehicle that rolls, with its torques recorded after every step."""

    def __init__(self, name: str, speed: float, inputs: tuple[float, float, float], **options: str) -> None:
        builder = sw.ModelBuilder()
        parts = add_vehicle(builder, with_options(load_vehicle(name), **options), speed=speed)
        model = builder.finalize(1, "cpu", per_world=per_world())
        self.car = Vehicle(parts, model)
        self.car.input.assign(np.array([[*inputs, 0.0]], np.float32))
        self.sim = sw.Simulation(model, DT, elements=[self.car], solver=VEHICLE_SOLVER, joint_reactions=True)
        channels = ["torque_*", "engine_Nm", "drive_Nm", "steeringwheel_*", "reaction:*"]
        channels = [each for each in channels if parts.steerings or not each.startswith("steering")]
        self.recorder = Recorder(self.sim, self.car, channels=channels)
        self.recorder.sample()

    def step(self, steps: int) -> None:
        for _ in range(steps):
            self.sim.step()
            self.recorder.sample()

    def column(self, name: str) -> np.ndarray:
        return self.recorder.column(name)[:, 0]

    def rate(self, joint: int) -> float:
        return float(self.sim.state.joint_qd.numpy()[0, self.sim.model.joint_dof_start[joint]])

    @property
    def driven(self) -> list[str]:
        return [wheel for wheel in WHEELS if f"torque_{wheel}_Nm" in self.recorder.names]

    def shaft_energy(self) -> float:
        """Of all turning shafts [J]."""
        joints = self.sim.model.builder.joints
        return sum(
            0.5 * spec.inertia * self.rate(joint) ** 2
            for joint, spec in enumerate(joints) if spec.type is JointType.SHAFT
        )  # fmt: skip


def middles(values: np.ndarray) -> np.ndarray:
    return 0.5 * (values[1:] + values[:-1])


@pytest.mark.parametrize(
    ("name", "speed", "driven"), [("gator", 3.0, "RL RR"), ("sedan", 12.0, ""), ("artcar", 1.5, "FL FR RL RR")]
)
def test_wheels_get_what_the_engine_gives(name, speed, driven):
    """These transmissions lose nothing: the engine's work is that on the wheels and what shafts gain in speed."""
    probe = Probe(name, speed, (0.0, 0.4, 0.0))
    probe.step(100)  # the drop onto the ground is over in the driveline
    begin, before = len(probe.recorder.rows), probe.shaft_energy()
    probe.step(300)
    stored = probe.shaft_energy() - before
    if driven:
        assert probe.driven == driven.split()
    engine = float(np.sum(probe.column("engine_Nm")[begin:] * probe.column("engine_radps")[begin:])) * DT
    wheels = 0.0
    for wheel in probe.driven:
        rates = middles(probe.column(f"omega_{wheel}_radps"))[begin - 1 :]
        wheels += float(np.sum(probe.column(f"torque_{wheel}_Nm")[begin:] * rates)) * DT
    assert engine > 0.0
    # the engine's speed is that of a step's start, half a step of acceleration early: 1e-4 of it
    assert wheels + stored == pytest.approx(engine, rel=2e-3)


@pytest.mark.parametrize("driveline", [None, "simple"])
def test_a_wheel_gains_spin_by_the_torques_on_it(driveline):
    """Euler's law about the axle: driveline, tire and brake are all that turns a wheel."""
    options = {} if driveline is None else {"driveline": driveline}
    probe = Probe("hmmwv", 8.0, (0.0, 0.8, 0.0), **options)
    probe.step(200)
    sim, car = probe.sim, probe.car
    for wheel in probe.driven:
        side = car.parts.sides[WHEELS.index(wheel)]
        start = matrix_of(sim.state.body_rot.numpy()[0, side.spindle])[:, 1]
        before = float(sim.state.body_omega.numpy()[0, side.spindle] @ start)
        sim.step()
        probe.recorder.sample()
        gained = float(sim.state.body_omega.numpy()[0, side.spindle] @ start) - before
        tire = float(car.tires.torque_w.numpy()[0, WHEELS.index(wheel)] @ start)
        inertia = float(sim.model.builder.bodies[side.spindle].inertia[1, 1])
        torque = float(probe.column(f"torque_{wheel}_Nm")[-1])
        assert torque > 50.0
        # float32 rates of 17 rad/s: half a unit, 1e-6 rad/s, times inertia over the step; and gyroscopic torques
        assert inertia * gained / DT == pytest.approx(torque + tire, abs=3.0 * inertia * 1e-6 / DT + 1e-3 * torque)


def test_brakes_are_no_torque_of_the_driveline():
    probe = Probe("gator", 4.0, (0.0, 0.0, 0.6))
    probe.step(200)
    for wheel in probe.driven:
        assert abs(probe.column(f"torque_{wheel}_Nm")[-1]) < 1.0
    assert probe.column("speed_mps")[-1] < 3.8


@pytest.mark.parametrize(("name", "speed"), [("sedan", 4.0), ("artcar", 1.0)])
def test_a_drive_shaft_reports_the_torque_of_its_transmission(name, speed):
    probe = Probe(name, speed, (0.0, 0.5, 0.0))
    probe.step(30)
    shaft, drive = (probe.column(name)[-1] for name in ("reaction:driveline.shaft.Mx_Nm", "drive_Nm"))
    assert drive > 0.0
    # the shaft's change of speed is one of float32 rates of 100 rad/s: 1e-5 rad/s over the step
    inertia = next(j.inertia for j in probe.sim.model.builder.joints if j.name == "driveline.shaft")
    assert shaft == pytest.approx(drive, abs=2e-2 * inertia + 1e-4 * drive)


@pytest.mark.parametrize(("name", "part"), [("gator", "slide.F"), ("hmmwv", "arm.hinge.M")])
def test_the_steering_wheel_is_held_against_the_tires(name, part):
    """In a left turn tires turn their wheels back. What holds them is the force on the rack, or the torque on the arm,
    over the ratio of their travel to the turn of the steering wheel."""
    probe = Probe(name, 4.0, (0.3, 0.0, 0.0))
    probe.step(1000)
    assert probe.column("steeringwheel_rad")[-1] == pytest.approx(math.radians(0.3 * 540.0), rel=1e-5)
    held = probe.column("steeringwheel_Nm")[-1]
    unit = "N" if part.endswith("F") else "Nm"
    wrench = np.array([probe.column(f"reaction:steering0.{part}{axis}_{unit}")[-1] for axis in "xyz"])
    joint = probe.sim.model.builder.joints[probe.car.parts.steerings[0].joint]
    body = matrix_of(probe.sim.state.body_rot.numpy()[0, joint.parent])
    axis = body @ (matrix_of(np.asarray(joint.frame0.rotation))[:, 2])
    assert held == pytest.approx(wrench @ axis * probe.car.parts.steerings[0].travel / math.radians(540.0), rel=1e-3)
    assert held > 0.0
    other = Probe(name, 4.0, (-0.3, 0.0, 0.0))
    other.step(1000)
    assert other.column("steeringwheel_Nm")[-1] == pytest.approx(-held, rel=0.1)


def test_a_robot_without_steering_has_no_steering_wheel():
    probe = Probe("skid-steer", 0.5, (0.0, 0.5, 0.0))
    assert probe.driven == list(WHEELS)
    assert not any(name.startswith("steeringwheel") for name in probe.recorder.names)
