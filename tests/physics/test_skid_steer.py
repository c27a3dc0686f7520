"""A vehicle with a motor on each side: straight, on the spot, its motors' limits, on slopes, power, worlds apart."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.path_tracking import full_speed, full_yaw_rate
from simwarp.vehicle.spec.mirroring import mirrored
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_spec import DifferentialDrive, VehicleSpec
from simwarp.vehicle.tires.tires import ground
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from tests.physics.sample_vehicles import shipped
from tests.physics.vehicle_energy import Ledger, drag_work, sample, tire_work
from tests.reference.skid_steer import LugreFriction, coulomb, yaw_rate

SPEC: Any = shipped("skid-steer")
LINE: DifferentialDrive = SPEC.driveline
LENGTH, TRACK, RADIUS = 0.512, 0.5708, SPEC.axles[0].tire.radius
IDLE, AHEAD, SPOT = (0.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)


class Robot:
    """One in every world, on a plane or a slope, or floating without weight."""

    def __init__(
        self, *inputs: tuple[float, ...], spec: VehicleSpec = SPEC, dt: float = 1.0e-3, slope: float = 0.0,
        floating: bool = False, speed: float = 0.0, friction: float = 0.9,
    ) -> None:  # fmt: skip
        lean = -math.atan(slope)
        rotation = np.array([0.0, math.sin(0.5 * lean), 0.0, math.cos(0.5 * lean)])
        self.builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0)) if floating else sw.ModelBuilder()
        up = 100.0 if floating else spec.start_height - 0.003
        start = sw.pose((-up * math.sin(-lean), 0.0, up * math.cos(lean)), rotation)
        self.parts = add_vehicle(self.builder, spec, at=start, speed=speed)
        if any(side.meets_shapes for side in self.parts.sides):
            self.builder.add_shape_plane(material=sw.Material(friction=friction), pose=sw.pose(rotation=rotation))
        model = self.builder.finalize(len(inputs), "cpu", per_world=per_world())
        self.vehicle = Vehicle(self.parts, model, ground=ground("cpu", rotation=rotation), randomised=True)
        self.vehicle.tires.ground_friction.fill_(friction)
        self.vehicle.input.assign(np.array(inputs, np.float32))
        self.sim = sw.Simulation(model, dt, elements=[self.vehicle], solver=VEHICLE_SOLVER)
        self.motors = [model.joint_dof_start[motor] for motor in self.parts.driveline.motors]

    def after(self, seconds: float) -> "Robot":
        self.sim.step(round(seconds / self.sim.dt))
        assert self.sim.problems() == []
        return self

    @property
    def speeds(self) -> np.ndarray:
        """(W, 2) of the motors, left and right [rad/s]."""
        return self.sim.state.joint_qd.numpy()[:, self.motors].astype(float)

    @property
    def voltage_torques(self) -> np.ndarray:
        """(W, 2) that the voltages gave in the last step [N·m]: the model has no other bounded efforts."""
        return self.sim.state.box_impulse.numpy().astype(float) / self.sim.dt

    @property
    def yaw(self) -> np.ndarray:
        return self.vehicle.omega_b.numpy()[:, 2]

    @property
    def place(self) -> np.ndarray:
        return self.vehicle.position.numpy()


def without_rolling_resistance(spec: Any = SPEC) -> Any:
    parameters = {**spec.axles[0].tire.parameters, "rolling_resistance": 0.0}
    axles = tuple(
        dataclasses.replace(axle, tire=dataclasses.replace(axle.tire, parameters=parameters)) for axle in spec.axles
    )
    return dataclasses.replace(spec, axles=axles)


# ---- what it is ------------------------------------------------------------------------------------------------------


def test_it_has_the_size_of_its_pattern():
    robot = Robot(IDLE)
    assert sum(body.mass for body in robot.builder.bodies) == pytest.approx(50.0)
    places = np.array([robot.builder.bodies[side.spindle].pose.position for side in robot.parts.sides])
    assert np.ptp(places[:, 0]) == pytest.approx(LENGTH)
    assert np.ptp(places[:, 1]) == pytest.approx(TRACK)
    assert robot.after(1.0).vehicle.tires.load.numpy().sum() == pytest.approx(50.0 * 9.81, rel=1e-4)


# ---- inputs ----------------------------------------------------------------------------------------------------------

SHARES = {
    (0.0, 0.5, 0.0, 1): (0.5, 0.5),
    (0.0, 0.5, 0.0, -1): (-0.5, -0.5),
    (0.0, 0.5, 0.0, 0): (0.0, 0.0),
    (0.25, 0.5, 0.0, 1): (0.25, 0.75),
    (0.25, 0.5, 0.0, -1): (-0.75, -0.25),  # the yaw rate keeps its sense
    (1.0, 0.0, 0.0, 1): (-1.0, 1.0),
    (-0.4, 0.0, 0.0, 0): (0.4, -0.4),
    (1.0, 1.0, 0.0, 1): (0.0, 1.0),  # both ask for too much: slower on the same curve
    (0.5, 1.0, 0.0, 1): (1.0 / 3.0, 1.0),
    (0.25, 0.5, 0.5, 1): (0.125, 0.375),
    (0.25, 0.5, 1.0, 1): (0.0, 0.0),
    (3.0, 7.0, -1.0, 5): (0.0, 1.0),  # beyond their ends
}


def test_inputs_are_the_speeds_of_the_sides():
    robot = Robot(*[(steering, throttle, braking, 0.0) for steering, throttle, braking, _ in SHARES])
    robot.vehicle.gear.assign(np.array([gear for *_, gear in SHARES], np.int32))
    robot.sim.step()
    asked = robot.sim.control.joint_target_qd.numpy()[:, robot.motors]
    assert asked == pytest.approx(LINE.max_speed * np.array(list(SHARES.values())), rel=1e-6, abs=1e-4)


@pytest.mark.parametrize("gear", [1, -1])
def test_it_drives_straight_and_alike_on_both_sides(gear):
    robot = Robot(AHEAD, (0.0, 0.3, 0.0, 0.0))
    robot.vehicle.gear.fill_(gear)
    robot.after(3.0)
    # the loaded radius is 3 mm less than the unloaded one
    assert robot.vehicle.velocity_b.numpy()[:, 0] == pytest.approx(
        gear * full_speed(SPEC) * np.array([1.0, 0.3]), rel=0.03
    )
    # what one side rounds, the other rounds as well
    assert np.abs(robot.place[:, 1]).max() < 1.0e-6
    assert np.abs(robot.yaw).max() < 1.0e-6
    load = robot.vehicle.tires.load.numpy()
    assert load[:, 0::2] == pytest.approx(load[:, 1::2], rel=1e-5)


def test_a_mirror_image_turns_the_other_way():
    inputs = [(0.6, 0.4, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)]
    run = Robot(*inputs).after(2.0)
    other = Robot(*[(-steering, *rest) for steering, *rest in inputs], spec=mirrored(SPEC)).after(2.0)
    flip = np.array([1.0, -1.0, 1.0])
    # of runs of two seconds, in single precision
    assert other.place == pytest.approx(flip * run.place, abs=1e-5)
    assert other.yaw == pytest.approx(-run.yaw, abs=1e-5)
    assert abs(run.yaw).min() > 0.5


# ---- on the spot -----------------------------------------------------------------------------------------------------


def test_coulomb_friction_widens_the_track_by_its_closed_form():
    """The reference itself: every wheel slides, and what its push turns is what its scrubbing resists."""
    wheels = np.array([(x, y) for x in (0.256, -0.256) for y in (0.2854, -0.2854)])
    assert 2.0 / (TRACK * yaw_rate(1.0, wheels, coulomb)) == pytest.approx(1.0 + (LENGTH / TRACK) ** 2, rel=1e-9)


@pytest.mark.parametrize("friction", [0.4, 0.9])
def test_turning_on_the_spot_slips_as_the_tires_balance(friction):
    commands = (0.3, 1.0, -0.6)
    robot = Robot(*[(steering, 0.0, 0.0, 0.0) for steering in commands], friction=friction, dt=2.0e-3).after(3.0)
    tire = SPEC.axles[0].tire
    values = tire.parameters
    sunk = robot.vehicle.tires.deflection.numpy()[0].mean()
    law = LugreFriction(
        values["bristle_rate"], values["kinetic_friction"], values["static_friction"], values["stribeck_speed"], 1.2,
        2.0 * math.sqrt(RADIUS * sunk), friction / 0.8,
    )  # fmt: skip
    discs = [0.4 * tire.width * share for share in (-1.0, 0.0, 1.0)]
    points = np.array([(x, y + d) for x in (0.256, -0.256) for y in (0.2854, -0.2854) for d in discs])
    for world, steering in enumerate(commands):
        tread = abs(steering) * LINE.max_speed * LINE.gear_ratio * (RADIUS - sunk)
        found = robot.yaw[world] * math.copysign(1.0, steering)
        # the reference leaves out that wheels behind bear 1 % more than those in front: an effect of second order
        assert found == pytest.approx(yaw_rate(tread, points, law), rel=2e-3)
        # measured on robots of this kind: a track of 1.5 to 2 times the true one
        assert 1.5 < 2.0 * tread / TRACK / found < 2.0
        assert found == pytest.approx(abs(steering) * full_yaw_rate(SPEC), rel=0.05)
    assert np.abs(robot.place[:, :2]).max() < 2.0e-3
    assert robot.speeds[:, 0] == pytest.approx(-robot.speeds[:, 1], rel=1e-4)


def test_rigid_tires_turn_between_the_bounds_of_coulomb_friction():
    """Cylinders in contact touch along lines; which of its ends bears the load decides how wide the track is."""
    robot = Robot((0.5, 0.0, 0.0, 0.0), spec=with_options(SPEC, tire="rigid")).after(2.0)
    tread = 0.5 * LINE.max_speed * LINE.gear_ratio * RADIUS
    bounds = []
    for end in (0.5, -0.5):
        side = 0.5 * TRACK + end * SPEC.axles[0].tire.width
        places = np.array([(x, y) for x in (0.256, -0.256) for y in (side, -side)])
        bounds.append(yaw_rate(tread, places, coulomb))
    # a thousandth for what the load is more behind than in front
    assert 0.999 * bounds[0] < robot.yaw[0] < 1.001 * bounds[1]


@pytest.mark.parametrize("gain", [None, 0.5, 1.0e6])
def test_long_steps_and_stiff_controllers_give_the_same_motion(gain):
    spec = dataclasses.replace(SPEC, driveline=dataclasses.replace(LINE, gain=gain))
    inputs = (AHEAD, SPOT, (0.5, 0.7, 0.0, 0.0))
    fine, coarse = (Robot(*inputs, spec=spec, dt=dt).after(3.0) for dt in (1.0e-3, 1.0e-2))
    # steady: nothing depends on the step but the bristles' damping, which long steps reduce
    assert coarse.yaw == pytest.approx(fine.yaw, rel=1e-3, abs=1e-5)
    assert coarse.vehicle.velocity_b.numpy()[:, 0] == pytest.approx(
        fine.vehicle.velocity_b.numpy()[:, 0], rel=1e-3, abs=1e-4
    )
    assert coarse.speeds == pytest.approx(fine.speeds, rel=2e-3)


# ---- motors ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gain", [None, 5.0])
def test_a_free_motor_runs_up_its_straight_line(gain):
    """Off the ground the two sides turn against each other, so that the chassis stays: I w' = T0 (1 - w / w0)."""
    line = dataclasses.replace(LINE, gain=gain)
    robot = Robot(SPOT, spec=dataclasses.replace(SPEC, driveline=line), floating=True, dt=1.0e-4)
    wheels = sum(
        float(robot.builder.bodies[side.spindle].inertia[1, 1]) for side in robot.parts.sides if side.side > 0.0
    )
    inertia = line.motor_inertia + wheels * line.gear_ratio**2
    time = inertia * line.no_load_speed / line.stall_torque
    end = -time * math.log(1.0 - line.max_speed / line.no_load_speed)
    for share in (0.3, 0.6, 0.9):
        robot.after(share * end - float(robot.sim.time.numpy()[0]))
        now = float(robot.sim.time.numpy()[0])
        expected = line.no_load_speed * (1.0 - math.exp(-now / time))
        # backward Euler lags by a half of a step in the time constant of 20 ms at most
        assert robot.speeds[0] == pytest.approx([-expected, expected], rel=5e-3)
    robot.after(end)
    assert robot.speeds[0, 1] == pytest.approx(line.max_speed, rel=1e-3)


def test_torques_stay_within_what_the_motors_give():
    """Full reversals on the ground, and a stall against too little torque."""
    weak = dataclasses.replace(SPEC, driveline=dataclasses.replace(LINE, stall_torque=0.2))
    for spec in (SPEC, weak):
        robot = Robot(AHEAD, SPOT, (1.0, 1.0, 0.0, 0.0), spec=spec, dt=2.0e-3)
        line: Any = spec.driveline
        reached = 0.0
        for step in range(450):
            if step in (150, 300):
                robot.vehicle.gear.fill_(-1 if step == 150 else 1)
                robot.vehicle.input[:, 0].assign(-robot.vehicle.input.numpy()[:, 0])
            robot.sim.step()
            given, speeds = robot.voltage_torques, robot.speeds
            assert np.abs(given).max() <= line.stall_torque * (1.0 + 1.0e-5)
            reached = max(reached, float(np.abs(given).max()))
            # along the motor's turning: up to its line; against it: the line of the other voltage
            torque = np.sign(speeds) * given - line.stall_torque * np.abs(speeds) / line.no_load_speed
            assert (torque <= line.stall_torque * (1.0 - np.abs(speeds) / line.no_load_speed) + 1.0e-5).all()
            assert (torque >= -line.stall_torque * (1.0 + np.abs(speeds) / line.no_load_speed) - 1.0e-5).all()
        assert reached == pytest.approx(line.stall_torque, rel=1e-4)


def test_a_soft_controller_gives_way_by_its_gain():
    """On a slope the motors hold the weight's torque m g sin r / 2 each by a speed that is wrong by torque / gain."""
    soft = dataclasses.replace(SPEC, driveline=dataclasses.replace(LINE, gain=0.5))
    robot = Robot(IDLE, spec=soft, slope=0.2).after(3.0)
    weight = 50.0 * 9.81 * 0.2 / math.sqrt(1.04)
    deflection = robot.vehicle.tires.deflection.numpy()[0].mean()
    torque = 0.5 * weight * (RADIUS - deflection) * LINE.gear_ratio
    speed = -torque / (0.5 + LINE.stall_torque / LINE.no_load_speed)
    # rolling resistance acts from 0.125 m/s on, which this does not reach; the tires' own slip is a percent
    assert robot.speeds[0] == pytest.approx([speed, speed], rel=0.02)


# ---- standstill ------------------------------------------------------------------------------------------------------


def way(robot: Robot, seconds: float, since: float = 2.0) -> float:
    """From a time on, by when the tires' springs have come to rest [m]."""
    start = robot.after(since).place[0].copy()
    return float(np.linalg.norm(robot.after(seconds - since).place[0] - start))


@pytest.mark.parametrize("tire", ["lugre", "rigid"])
def test_motors_hold_it_on_a_slope_up_to_friction(tire):
    """Friction of 0.9 (0.81 while it slides, of LuGre's tires) holds on 0.5 and not on 1.2."""
    spec = with_options(SPEC, tire=tire)
    assert way(Robot(IDLE, spec=spec, slope=0.5, dt=2.0e-3), 10.0) < 1.0e-4
    steep = Robot(IDLE, spec=spec, slope=1.2, dt=2.0e-3)
    assert way(steep, 3.0) > 1.0
    # it slides with its wheels held
    assert np.abs(steep.speeds).max() < 1.0


def test_weak_motors_roll_back_where_their_stall_torque_ends():
    """2 T0 / (ratio r) carries m g sin: a slope of 0.21 with 0.1 N·m."""
    weak = dataclasses.replace(SPEC, driveline=dataclasses.replace(LINE, stall_torque=0.1))
    limit = 2.0 * 0.1 / (LINE.gear_ratio * 0.162) / (50.0 * 9.81)
    assert way(Robot(IDLE, spec=weak, slope=0.9 * limit), 3.0) < 1.0e-3
    assert way(Robot(IDLE, spec=weak, slope=1.2 * limit), 3.0) > 0.05


# ---- power -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("inputs", [AHEAD, SPOT, (0.7, 0.5, 0.0, 0.0)])
def test_what_the_motors_give_is_stored_or_dissipated(inputs):
    dt = 1.0e-3
    robot = Robot(inputs, dt=dt)
    ledger = Ledger(robot.builder)
    before = sample(robot.sim)
    first, given, lost = ledger.stored(before), 0.0, 0.0
    for _ in range(1500):
        robot.sim.step()
        after = sample(robot.sim)
        middle = 0.5 * (before.joint_qd + after.joint_qd)[robot.motors]
        given += dt * float(robot.voltage_torques[0] @ middle)
        lost -= dt * LINE.stall_torque / LINE.no_load_speed * float(after.joint_qd[robot.motors] @ middle)
        lost += tire_work(robot.vehicle, before, after, dt) + drag_work(robot.vehicle, before, after, dt)
        before = after
    assert given > 50.0
    assert lost < 0.0
    # found: 3e-8, which is single precision of what is summed here
    assert abs(ledger.stored(before) - first - given - lost) < 1.0e-5 * given


def test_a_robot_that_rolls_freely_never_gains_energy():
    robot = Robot(IDLE, (0.0, 0.0, 1.0, 0.0), speed=1.0)
    ledger = Ledger(robot.builder)
    energy = [[ledger.stored(sample(robot.sim, world)) for world in (0, 1)]]
    for _ in range(500):
        robot.sim.step()
        energy.append([ledger.stored(sample(robot.sim, world)) for world in (0, 1)])
    # the motors brake: the tires' springs, which the ledger leaves out, hold 0.2 J each and give them back
    assert (np.diff(np.array(energy), axis=0) < 0.05).all()
    assert np.array(energy)[-1].max() < np.array(energy)[0].min() - 20.0


# ---- worlds ----------------------------------------------------------------------------------------------------------


def test_worlds_do_not_know_of_each_other():
    inputs = [(0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (-0.5, 0.8, 0.0, 0.0), (0.2, 0.2, 0.6, 0.0)]
    together = Robot(*inputs, dt=2.0e-3).after(1.5)
    for world, each in enumerate(inputs):
        alone = Robot(each, dt=2.0e-3).after(1.5)
        for name in together.sim.state.NAMES:
            ours, theirs = (getattr(robot.sim.state, name).numpy() for robot in (together, alone))
            assert ours[world].tobytes() == theirs[0].tobytes(), name


def test_a_reset_and_a_snapshot_bring_the_run_back():
    robot = Robot((0.4, 0.7, 0.0, 0.0), SPOT, dt=2.0e-3)
    robot.vehicle.gear.assign(np.array([-1, 1], np.int32))
    robot.sim.keep_as_initial()
    first = robot.after(0.5).place.copy()
    kept = robot.sim.snapshot()
    later = robot.after(0.5).place.copy()
    robot.sim.restore(kept)
    assert np.array_equal(robot.after(0.5).place, later)
    robot.sim.reset()
    assert np.array_equal(robot.after(0.5).place, first)


def test_a_start_at_speed_turns_motors_with_the_wheels():
    robot = Robot((0.0, 0.5 / full_speed(SPEC), 0.0, 0.0), spec=without_rolling_resistance(), speed=0.5)
    assert robot.speeds == pytest.approx(0.5 / RADIUS / LINE.gear_ratio)
    robot.sim.step()
    assert robot.speeds == pytest.approx(0.5 / RADIUS / LINE.gear_ratio, rel=1e-3)
    assert robot.vehicle.velocity_b.numpy()[0, 0] == pytest.approx(0.5, rel=1e-3)
