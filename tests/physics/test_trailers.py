"""Laws of trains: statics, turns without slip, sway, forces in the hitch, brakes."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any, NamedTuple

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.construction import VehicleParts, add_vehicle
from simwarp.vehicle.driving.drivers import ScriptedDriver, ScriptSpec
from simwarp.vehicle.rigs.standing_loads import standing_loads
from simwarp.vehicle.rigs.tire_rig import static_deflection, tire_forces
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import RigidPart, VehicleSpec
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world
from tests.reference.trailers import (
    SingleTrack,
    articulation,
    equivalent_wheelbase,
    tractrix,
    trailer_radius,
)

GRAVITY = 9.81
TRAINS = ("sedan-trailer", "truck-semitrailer")


class Train(NamedTuple):
    """A vehicle with trailers on flat ground."""

    spec: VehicleSpec
    builder: ModelBuilder
    parts: VehicleParts
    vehicle: Vehicle
    sim: sw.Simulation

    def places(self) -> np.ndarray:
        return np.asarray(self.sim.state.body_x.numpy()[0], np.float64)

    def axle_middles(self) -> np.ndarray:
        """(axles, 3) between the wheels' centres [m]."""
        places = self.places()
        return np.array([places[side.spindle] for side in self.parts.sides]).reshape(-1, 2, 3).mean(axis=1)

    def hitch_place(self, unit: int = 1) -> np.ndarray:
        """(3,) of the hitch of a unit [m]."""
        joint = self.builder.joints[self.parts.units[unit].hitch]
        turn = matrix_of(self.sim.state.body_rot.numpy()[0, joint.child])
        return np.asarray(self.places()[joint.child] + turn @ joint.frame1.position)

    def heading(self, unit: int) -> float:
        turn = matrix_of(self.sim.state.body_rot.numpy()[0, self.parts.units[unit].chassis])
        return float(np.arctan2(turn[1, 0], turn[0, 0]))


def start(
    spec: VehicleSpec, script: ScriptSpec, *, speed: float = 0.0, dt: float = 2.0e-3, reactions: bool = False
) -> Train:
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec, speed=speed)
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    sim = sw.Simulation(
        model, dt, elements=[ScriptedDriver(vehicle, script), vehicle], solver=VEHICLE_SOLVER, joint_reactions=reactions
    )
    return Train(spec, builder, parts, vehicle, sim)


STANDS = ScriptSpec()
"""Without brakes, which would keep along the road what the way down left them."""


# ---- statics ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TRAINS)
def test_loads_of_axles_and_hitch_are_those_of_statics(name):
    """Each unit is in balance, in forces and in moments about its hitch, with the hitch load that statics finds."""
    train = start(load_vehicle(name), STANDS, reactions=True)
    train.sim.step(5000)
    loads = train.vehicle.tires.load.numpy()[0].astype(float).reshape(-1, 2).sum(axis=1)
    force = train.sim.diagnostics.joint_reaction_force.numpy()[0].astype(float)
    places, middles = train.places(), train.axle_middles()
    masses = np.array([body.mass for body in train.builder.bodies])
    towing, trailer = train.parts.units
    own, pulled = (GRAVITY * masses[list(unit.bodies)] for unit in (towing, trailer))
    own_x, pulled_x = (places[list(unit.bodies), 0] for unit in (towing, trailer))
    hitch = train.hitch_place()[0]
    behind = slice(trailer.axles.start, trailer.axles.stop)
    # of the trailer about its axles' force, which acts where their loads say
    center = float(loads[behind] @ middles[behind, 0] / loads[behind].sum())
    total, com = float(pulled.sum()), float(pulled @ pulled_x / pulled.sum())
    on_hitch = total * (com - center) / (hitch - center)
    assert force[trailer.hitch, 2] == pytest.approx(on_hitch, rel=1e-3)
    assert loads[behind].sum() == pytest.approx(total - on_hitch, rel=1e-3)
    # of the towing vehicle on its two axles, loaded by the hitch
    front, rear = middles[towing.axles.start, 0], middles[towing.axles.stop - 1, 0]
    down, at = np.append(own, on_hitch), np.append(own_x, hitch)
    on_front = float(down @ (at - rear)) / (front - rear)
    assert loads[0] == pytest.approx(on_front, rel=1e-3)
    assert loads[1] == pytest.approx(float(down.sum()) - on_front, rel=1e-3)


def test_axles_of_a_bogie_bear_what_their_springs_and_tires_do():
    """A second computation: the three axles of the semitrailer as springs in a row below a rigid body on its hitch."""
    spec = load_vehicle("truck-semitrailer")
    train = start(spec, STANDS)
    train.sim.step(5000)
    loads = train.vehicle.tires.load.numpy()[0].astype(float).reshape(-1, 2).sum(axis=1)[2:]
    chassis = train.parts.units[1].chassis
    turn, places = matrix_of(train.sim.state.body_rot.numpy()[0, chassis]), train.places()
    origin = places[chassis] + turn @ train.parts.units[1].reference
    for axle, load in zip(spec.trailers[0].axles, loads, strict=True):
        suspension: Any = axle.suspension
        line = suspension.springs[0]
        # the height of the spring's seat over the ground, from which one equation has the axle's own height
        seat = (origin + turn @ np.add(axle.location, line.chassis_point))[2]
        unsprung = suspension.axle_tube.mass + 2.0 * (suspension.spindle.mass + axle.wheel.mass + axle.tire.mass)
        low, high = 0.4, axle.tire.radius
        for _ in range(60):
            height = 0.5 * (low + high)
            spring = 2.0 * line.stiffness * (line.rest_length - (seat - height - line.arm_point[2]))
            borne = 0.5 * (spring + GRAVITY * unsprung)
            sinks = axle.tire.radius - float(static_deflection(axle.tire, borne))
            low, high = (height, high) if sinks > height else (low, height)
        # the tube leans with the chassis, by a thousandth
        assert load == pytest.approx(2.0 * borne, rel=1e-3)


def test_the_lever_rule_of_the_rigs_knows_trailers():
    """Loads as built, which rigs take, are within 2 % of those that settle: the frames lean by some hundredths of a
    radian, and springs share a bogie's load unequally.
    """
    for name in TRAINS:
        train = start(load_vehicle(name), STANDS)
        train.sim.step(3000)
        loads = train.vehicle.tires.load.numpy()[0].astype(float).reshape(-1, 2).mean(axis=1)
        found = standing_loads(train.spec)
        np.testing.assert_allclose(found.wheel_load, loads, rtol=0.03)
        assert 2.0 * found.wheel_load.sum() == pytest.approx(
            GRAVITY * sum(body.mass for body in train.builder.bodies), rel=1e-9
        )


# ---- turns without slip ----------------------------------------------------------------------------------------------


class Turn(NamedTuple):
    """A steady turn."""

    center: np.ndarray
    """(2,) world [m]."""
    radius: float
    """On which that point of the towing vehicle's middle line goes which moves along it [m]."""
    ahead: float
    """Of that point from the rear axle [m]."""
    behind: float
    """From that point backwards to the hitch [m]."""
    rate: float
    """[rad/s], positive to the left."""


def turning(train: Train) -> Turn:
    """The present turn, from the velocities of the towing vehicle alone."""
    chassis = train.parts.chassis
    v = train.sim.state.body_v.numpy()[0, chassis].astype(float)
    rate = float(train.sim.state.body_omega.numpy()[0, chassis, 2])
    center = train.places()[chassis, :2] + np.array([-v[1], v[0]]) / rate
    heading = train.heading(0)
    along, across = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    ahead = float((center - train.axle_middles()[len(train.spec.axles) - 1, :2]) @ along)
    behind = float((center - train.hitch_place()[:2]) @ along)
    return Turn(center, abs(float((center - train.places()[chassis, :2]) @ across)), ahead, behind, rate)


@pytest.mark.parametrize(
    ("name", "steering"), [("sedan-trailer", 0.5), ("truck-semitrailer", 0.3), ("truck-semitrailer", -0.3)]
)
def test_a_slow_turn_is_that_of_axles_that_do_not_slip(name, steering):
    """Articulation and off-tracking on a circle at 1 m/s are those of the closed form.

    The circle is that of the point of the towing vehicle which moves along it; its tires drift, and put that point
    some centimetres off the rear axle. A trailer's axle drifts by v² / (g R) over its tires' normalised stiffness of 7
    and more, 1e-3 rad at most. A bogie of three axles scrubs by 0.08 rad, where its tires make a fifth less than a
    linear law; the equivalent wheelbase, 2 % longer than the distance of the bogie's middle, is right to some of that.
    """
    script = ScriptSpec(steering=((0.0, 0.0), (3.0, steering)), speed=((0.0, 1.0),))
    train = start(load_vehicle(name), script, speed=1.0)
    train.sim.step(50000)
    turn = turning(train)
    unit = train.spec.units[1]
    assert unit.hitch is not None
    assert abs(turn.ahead) < 0.01 * turn.radius
    distances = [unit.hitch.trailer_point[0] - axle.location[0] for axle in unit.axles]
    wheelbase = equivalent_wheelbase(distances)
    found = float(train.vehicle.articulation.numpy()[0, 0])
    assert np.sign(found) == -np.sign(turn.rate)
    close = 1e-3 if len(unit.axles) == 1 else 5e-3
    assert abs(found) == pytest.approx(articulation(turn.radius, turn.behind, wheelbase), abs=close), turn
    # the point of the trailer's middle line at that distance behind the hitch is where an equivalent axle rolls
    heading = train.heading(1)
    at = train.hitch_place()[:2] - wheelbase * np.array([np.cos(heading), np.sin(heading)])
    rolls = float(np.linalg.norm(at - turn.center))
    assert rolls == pytest.approx(trailer_radius(turn.radius, turn.behind, wheelbase), abs=close * wheelbase)
    assert turn.radius - rolls > 0.1  # it cuts the corner


def test_a_slow_trailer_goes_along_the_tractrix_of_its_hitch():
    """Steered to and fro at 2 m/s: the trailer's heading is that of the rule for an axle that does not slip, along the
    path that its hitch went, to 3 mrad: what its tires drift at these side forces (see above).
    """
    steering = ((0.0, 0.0), (1.0, 0.6), (6.0, 0.6), (8.0, -0.8), (14.0, -0.8), (16.0, 0.0), (20.0, 0.0))
    train = start(load_vehicle("sedan-trailer"), ScriptSpec(steering=steering, speed=((0.0, 2.0),)), speed=2.0)
    path: list[Any] = [train.hitch_place()[:2]]
    headings = [train.heading(1)]
    for _ in range(1000):
        train.sim.step(10)
        path.append(train.hitch_place()[:2])
        headings.append(train.heading(1))
    times = np.linspace(0.0, 20.0, len(path))
    expected = tractrix(times, np.array(path, np.float64), 0.0, 3.9)
    turned = np.unwrap(headings)
    assert np.ptp(turned) > 0.7
    np.testing.assert_allclose(turned, expected, atol=3e-3)


# ---- sway ------------------------------------------------------------------------------------------------------------


def loaded_behind(spec: VehicleSpec, shift: float) -> VehicleSpec:
    """The trailer with its load moved backwards; the car with an open differential, for a locked one damps yaw, which
    the single-track model does not know.
    """
    (trailer,) = spec.trailers
    (part,) = trailer.chassis.components
    x, y, z = part.com
    moved = RigidPart(mass=part.mass, com=(x - shift, y, z), inertia=part.inertia)
    chassis = dataclasses.replace(trailer.chassis, components=(moved,))
    line: Any = spec.driveline
    return dataclasses.replace(
        spec, trailers=(dataclasses.replace(trailer, chassis=chassis),),
        driveline=dataclasses.replace(line, locking_limit=0.0),
    )  # fmt: skip


def linear_model(spec: VehicleSpec) -> SingleTrack:
    """The single-track model of a car with a one-axle trailer: masses as built, tires measured at their loads."""
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec)
    loads = standing_loads(spec)
    found = {}
    for number, unit in enumerate(parts.units):
        bodies = [builder.bodies[body] for body in unit.bodies]
        mass = np.array([body.mass for body in bodies])
        place = np.array([body.pose.position for body in bodies])
        com = mass @ place / mass.sum()
        away = place - com
        inertia: Any = sum(
            (matrix_of(body.pose.rotation) @ body.inertia @ matrix_of(body.pose.rotation).T)[2, 2]
            + body.mass * (d[0] ** 2 + d[1] ** 2)
            for body, d in zip(bodies, away, strict=True)
        )
        found[number] = (float(mass.sum()), float(com[0]), float(inertia))
    hitch = spec.trailers[0].hitch.towing_point[0]
    small = 5e-3
    stiffness, trail = [], []
    for axle, load in zip(spec.all_axles, loads.wheel_load, strict=True):
        forces = tire_forces(axle.tire, load=load, slip_angle=small)
        side, moment = abs(float(forces.fy)), abs(float(forces.mz))
        stiffness.append(2.0 * side / small)
        trail.append(moment / side)
    x = loads.axle_x
    (own_mass, own_com, own_inertia), (trailer_mass, trailer_com, trailer_inertia) = found[0], found[1]
    return SingleTrack(
        mass=own_mass, inertia=own_inertia, front=x[0] - own_com, rear=own_com - x[1], hitch=own_com - hitch,
        trailer_mass=trailer_mass, trailer_inertia=trailer_inertia, trailer_com=hitch - trailer_com,
        trailer_axle=hitch - x[2],
        stiffness=(stiffness[0], stiffness[1], stiffness[2]), trail=(trail[0], trail[1], trail[2]),
    )  # fmt: skip


def sway(spec: VehicleSpec, speed: float, seconds: float = 9.0) -> np.ndarray:
    """(n,) articulation every 0.02 s after a short pull at the steering on a straight road [rad]."""
    steering = ((0.0, 0.0), (2.0, 0.0), (2.1, 0.008), (2.3, 0.008), (2.4, 0.0))
    train = start(spec, ScriptSpec(steering=steering, speed=((0.0, speed),)), speed=speed)
    train.sim.step(1200)
    found = []
    for _ in range(round(seconds / 0.02)):
        train.sim.step(10)
        found.append(float(train.vehicle.articulation.numpy()[0, 0]))
    return np.array(found)


def swing(angles: np.ndarray) -> tuple[float, float]:
    """Growth of an oscillation from extreme to extreme [1/s], negative where it dies away, and its frequency [rad/s].

    Of the swings between 2e-5 rad and the first of 0.08 rad, from where on tires are no longer linear.
    """
    turns = [k for k in range(1, len(angles) - 1) if (angles[k] - angles[k - 1]) * (angles[k + 1] - angles[k]) < 0.0]
    sizes = np.abs([angles[k] - angles[j] for j, k in itertools.pairwise(turns)])
    kept = list(itertools.takewhile(lambda index: 2e-5 < sizes[index] < 0.08, range(1, len(sizes))))
    first, last = kept[0], kept[-1]
    elapsed = 0.02 * (turns[last] - turns[first])
    return float(np.log(sizes[last] / sizes[first]) / elapsed), np.pi * (last - first) / elapsed


def test_a_trailer_that_is_loaded_behind_sways_above_the_critical_speed():
    """The sway dies away below the critical speed of the single-track model and grows above it, at its frequency.

    The full car rolls, and its suspensions steer: 15 % off the critical speed the sign is beyond that. With its load
    where it is shipped the same trailer is damped at both speeds, in the model and in full.
    """
    shipped = load_vehicle("sedan-trailer")
    spec = loaded_behind(shipped, 0.6)
    model, mild = linear_model(spec), linear_model(shipped)
    critical = model.critical_speed()
    assert 20.0 < critical < 28.0
    for share, sign in ((0.85, -1.0), (1.15, 1.0)):
        value = model.swaying(share * critical)
        rate, frequency = swing(sway(spec, share * critical))
        assert np.sign(value.real) == sign
        assert np.sign(rate) == sign
        # the full car damps more, as it rolls and its wheels travel: by 0.2 to 0.33 1/s, which are 8 % of the critical
        # speed; the frequency is that of tires and masses
        assert rate == pytest.approx(value.real, abs=0.4)
        assert frequency == pytest.approx(value.imag, rel=0.1)
        assert mild.swaying(share * critical).real < -0.5
    assert swing(sway(shipped, 1.15 * critical, 4.0))[0] < -0.5


# ---- the hitch -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TRAINS)
def test_a_hitch_does_no_work_but_its_friction(name):
    """What the joint gives the trailer it takes from the towing vehicle: in a swerve under brakes, the sum of both
    powers is that of the plate's dry friction, and nothing at a ball. Forces turn by kilowatts in either.
    """
    script = ScriptSpec(
        steering=((0.0, 0.0), (1.0, 0.25), (2.0, -0.25), (3.0, 0.0)), braking=((0.0, 0.0), (1.5, 0.0), (2.0, 0.3))
    )
    train = start(load_vehicle(name), script, speed=10.0, reactions=True)
    unit = train.parts.units[1]
    joint, hitch = train.builder.joints[unit.hitch], train.spec.trailers[0].hitch
    dof = train.sim.model.joint_dof_start[unit.hitch] + 1
    passed, balance, friction = [], [], []
    for _ in range(1500):
        before_x, before_turn = train.places(), train.sim.state.body_rot.numpy()[0].copy()
        train.sim.step()
        state, diagnostics = train.sim.state, train.sim.diagnostics
        force = diagnostics.joint_reaction_force.numpy()[0, unit.hitch].astype(float)
        torque = diagnostics.joint_reaction_torque.numpy()[0, unit.hitch].astype(float)
        anchors, speeds = [], []
        for body, frame in ((joint.parent, joint.frame0), (joint.child, joint.frame1)):
            arm = matrix_of(before_turn[body]) @ frame.position
            anchors.append(before_x[body] + arm)
            omega = state.body_omega.numpy()[0, body].astype(float)
            speeds.append((state.body_v.numpy()[0, body].astype(float) + np.cross(omega, arm), omega))
        on_trailer = float(force @ speeds[1][0] + torque @ speeds[1][1])
        on_vehicle = -float(force @ speeds[0][0] + torque @ speeds[0][1])
        passed.append(abs(on_trailer))
        balance.append(on_trailer + on_vehicle)
        friction.append(-hitch.yaw_friction * abs(float(state.joint_qd.numpy()[0, dof])))
    assert np.max(passed) > 1.0e4
    if hitch.kind == "ball":
        np.testing.assert_allclose(balance, 0.0, atol=1e-3 * np.max(passed))
        return
    # dry friction holds or brakes: it never drives, and where the plate turns it is all that the joint takes
    assert np.max(balance) < 1e-3 * np.max(passed)
    turning = np.abs(friction) > 100.0
    assert turning.sum() > 500
    close = np.isclose(np.array(balance)[turning], np.array(friction)[turning], atol=1e-3 * np.max(passed))
    # a step in which the sense of the turn changes has less of it
    assert close.mean() > 0.98


def test_a_train_far_above_the_ground_keeps_its_momentum():
    """Without weight, ground and brakes, thrown by a turn of the wheels at its hitch: linear and angular momentum stay,
    and energy only falls.
    """
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    spec = dataclasses.replace(load_vehicle("truck-semitrailer"), engine=None, transmission=None, driveline=None)
    parts = add_vehicle(builder, spec, at=sw.pose((0.0, 0.0, 100.0)))
    for body in parts.units[1].bodies:
        builder.bodies[body] = dataclasses.replace(builder.bodies[body], velocity=np.array([0.0, 2.0, 0.0]))
    model = builder.finalize(1, "cpu", per_world=per_world())
    sim = sw.Simulation(model, 2.0e-3, elements=[Vehicle(parts, model)], solver=VEHICLE_SOLVER)
    sim.step(5)
    first = momenta(builder, sim)
    sim.step(500)
    last = momenta(builder, sim)
    scale = 31000.0 * 2.0
    np.testing.assert_allclose(last[:3], first[:3], atol=1e-4 * scale)
    np.testing.assert_allclose(last[3:6], first[3:6], atol=1e-4 * scale * 8.0)
    assert last[6] < first[6]


def momenta(builder: ModelBuilder, sim: sw.Simulation) -> np.ndarray:
    """Linear momentum [N·s], angular momentum about the origin at the train's height [N·m·s], kinetic energy [J]."""
    state = sim.state
    x = np.asarray(state.body_x.numpy()[0], np.float64) - (0.0, 0.0, 100.0)
    v, omega = (each.numpy()[0].astype(np.float64) for each in (state.body_v, state.body_omega))
    linear, angular, energy = np.zeros(3), np.zeros(3), 0.0
    for index, body in enumerate(builder.bodies):
        turn = matrix_of(state.body_rot.numpy()[0, index])
        spin = turn @ body.inertia @ turn.T @ omega[index]
        linear += body.mass * v[index]
        angular += body.mass * np.cross(x[index], v[index]) + spin
        energy += 0.5 * (body.mass * v[index] @ v[index] + omega[index] @ spin)
    return np.array([*linear, *angular, energy])


# ---- brakes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "speed"), [("truck-semitrailer", 20.0), ("truck", 20.0), ("sedan-trailer", 25.0)])
def test_a_train_brakes_as_its_brakes_and_the_road_let_it(name, speed):
    """At half of the brakes no wheel locks: the mean deceleration is that of the brakes' torques over the tires'
    loaded radius, with rolling resistance and drag, on all masses and turning wheels. It stays on its line.
    """
    share = 0.5
    script = ScriptSpec(braking=((0.0, 0.0), (1.0, 0.0), (1.01, share)))
    train = start(load_vehicle(name), script, speed=speed)
    train.sim.step(700)
    begun, times = float(train.vehicle.velocity_b.numpy()[0, 0]), 500
    resistance = []
    for _ in range(times):
        train.sim.step()
        v = float(train.vehicle.velocity_b.numpy()[0, 0])
        drags = sum(unit.chassis.drag_factor for unit in train.spec.units) * v * v
        loads = train.vehicle.tires.load.numpy()[0].astype(float)
        rolling = sum(
            axle.tire.parameters["rolling_resistance"] * load
            for axle, load in zip(train.spec.all_axles, loads.reshape(-1, 2).sum(axis=1), strict=True)
        )
        resistance.append(drags + rolling)
    ended = float(train.vehicle.velocity_b.numpy()[0, 0])
    found = (begun - ended) / (times * train.sim.dt)
    slips = train.vehicle.tires.slip_ratio.numpy()[0]
    assert np.abs(slips).max() < 0.1
    standing = standing_loads(train.spec)
    force, mass = float(np.mean(resistance)), sum(body.mass for body in train.builder.bodies)
    for axle, radius in zip(train.spec.all_axles, standing.loaded_radius, strict=True):
        force += 0.0 if axle.brake is None else 2.0 * share * axle.brake.max_torque / radius
        parts: Any = axle
        spin = parts.suspension.spindle.inertia[1] + axle.wheel.inertia[1] + axle.tire.inertia[1]
        mass += 2.0 * (spin + parts.suspension.axle_inertia) / radius**2
    # the engine, which the automatic keeps geared, and the load's move to the front are left out
    assert found == pytest.approx(force / mass, rel=0.06)
    assert found < 0.8 * GRAVITY
    assert abs(train.places()[train.parts.chassis, 1]) < 0.2
    assert train.sim.problems() == []


def test_a_train_that_jackknifes_goes_on():
    """Full lock and full brakes at 15 m/s on a slippery road: the trailer comes round as far as the hitch lets it."""
    script = ScriptSpec(steering=((0.0, 0.0), (0.5, 1.0)), braking=((0.0, 0.0), (0.5, 1.0)))
    train = start(load_vehicle("truck-semitrailer"), script, speed=15.0)
    train.vehicle.tires.ground_friction.fill_(0.25)
    angles = []
    for _ in range(60):
        train.sim.step(100)
        angles.append(float(train.vehicle.articulation.numpy()[0, 0]))
    limit = train.spec.trailers[0].hitch.yaw_limit
    assert limit is not None
    assert np.abs(angles).max() < limit + 0.05
    assert np.isfinite(train.places()).all()
    assert train.sim.problems() == []


# ---- worlds and worlds' trains ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TRAINS)
def test_trains_of_other_worlds_change_nothing(name):
    """A train between others that drive otherwise moves as it does alone, bit by bit, and so it does again."""

    def run(steering: list[float]) -> np.ndarray:
        builder = ModelBuilder()
        parts = add_vehicle(builder, load_vehicle(name), speed=8.0)
        model = builder.finalize(len(steering), "cpu", per_world=per_world())
        vehicle = Vehicle(parts, model)
        sim = sw.Simulation(model, 2.0e-3, elements=[vehicle], solver=VEHICLE_SOLVER)
        inputs = vehicle.input.numpy()
        inputs[:, 0] = steering
        inputs[:, 1] = 0.2
        vehicle.input.assign(inputs)
        sim.step(600)
        return np.concatenate(
            [sim.state.body_x.numpy().reshape(len(steering), -1), vehicle.articulation.numpy()], axis=1
        )

    alone, again, among = run([0.3]), run([0.3]), run([-0.2, 0.3, 0.0])
    np.testing.assert_array_equal(alone, again)
    np.testing.assert_array_equal(alone[0], among[1])
    assert np.abs(among[0, -1] - among[1, -1]) > 0.01


def test_a_train_of_two_trailers_articulates_twice():
    """A second trailer hangs on the first; both follow round a bend, each turned against the unit before it."""
    spec = load_vehicle("sedan-trailer")
    (trailer,) = spec.trailers
    second = dataclasses.replace(
        trailer, hitch=dataclasses.replace(trailer.hitch, towing_point=(-6.3, 0.0, 0.0), trailer_point=(0.0, 0.0, 0.0))
    )
    train = start(
        dataclasses.replace(spec, trailers=(trailer, second)),
        ScriptSpec(steering=((0.0, 0.0), (3.0, 0.3)), speed=((0.0, 2.0),)), speed=2.0,
    )  # fmt: skip
    train.sim.step(15000)
    first, behind = train.vehicle.articulation.numpy()[0].tolist()
    assert first < -0.1
    assert behind < -0.1
    turned = [train.heading(number) for number in range(3)]
    assert np.remainder(turned[1] - turned[0] - first + np.pi, 2.0 * np.pi) == pytest.approx(np.pi, abs=1e-3)
    assert np.remainder(turned[2] - turned[1] - behind + np.pi, 2.0 * np.pi) == pytest.approx(np.pi, abs=1e-3)
    assert train.vehicle.tires.load.numpy().shape == (1, 8)
