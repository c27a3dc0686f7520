"""Laws of trains: statics, turns without slip, sway, forces in the hitch, brakes."""

from __future__ import annotations

import dataclasses
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


STANDS = ScriptSpec(braking=((0.0, 1.0),))


# ---- statics ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TRAINS)
def test_loads_of_axles_and_hitch_are_those_of_statics(name):
    """Each unit is in balance, in forces and in moments about its hitch, with the load of the hitch that statics finds.

    The hitch carries along x what braked wheels that stand push and pull: a few newtons, at a lever of a metre.
    """
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


def turning(train: Train) -> tuple[np.ndarray, float, float]:
    """Centre (2,) of the present turn [m], the rear axle's radius [m], the yaw rate [rad/s]."""
    chassis = train.parts.chassis
    v = train.sim.state.body_v.numpy()[0, chassis].astype(float)
    rate = float(train.sim.state.body_omega.numpy()[0, chassis, 2])
    center = train.places()[chassis, :2] + np.array([-v[1], v[0]]) / rate
    rear = train.axle_middles()[len(train.spec.axles) - 1, :2]
    return center, float(np.linalg.norm(rear - center)), rate


@pytest.mark.parametrize(
    ("name", "steering"), [("sedan-trailer", 0.5), ("truck-semitrailer", 0.35), ("truck-semitrailer", -0.35)]
)
def test_a_slow_turn_is_that_of_axles_that_do_not_slip(name, steering):
    """Articulation and off-tracking on a circle at 1 m/s are those of the closed form.

    At that speed a trailer's axle drifts by 2 v² / (g R) over its tires' normalised stiffness of 7 and more: 1.5e-3 rad
    at most. The plate's friction of 4 kN·m turns the semitrailer's bogie of 1.5 MN/rad by 4e-4 rad; its inner and outer
    wheels, which slip by 0.05 to 0.1 rad against each other, are no longer linear by some percent of that.
    """
    script = ScriptSpec(steering=((0.0, 0.0), (3.0, steering)), speed=((0.0, 1.0),))
    train = start(load_vehicle(name), script, speed=1.0)
    train.sim.step(35000)
    center, radius, rate = turning(train)
    unit = train.spec.units[1]
    assert unit.hitch is not None
    distances = [unit.hitch.trailer_point[0] - axle.location[0] for axle in unit.axles]
    wheelbase = equivalent_wheelbase(distances)
    behind = train.spec.axles[-1].location[0] - unit.hitch.towing_point[0]
    found = float(train.vehicle.articulation.numpy()[0, 0])
    assert np.sign(found) == -np.sign(rate)
    v, chassis = train.sim.state.body_v.numpy()[0].astype(float), train.parts.chassis
    arm = train.hitch_place() - train.places()[chassis]
    hitch_v = v[chassis] + np.cross(train.sim.state.body_omega.numpy()[0, chassis].astype(float), arm)
    away = np.arctan2(hitch_v[1], hitch_v[0]) - train.heading(1)
    print("TRAILER", np.sin(away)*np.linalg.norm(train.hitch_place()[:2]-center), wheelbase, radius, np.rad2deg(found))
    assert abs(found) == pytest.approx(articulation(radius, behind, wheelbase), abs=4e-3)
    # the point of the trailer's middle line at that distance behind the hitch is where an equivalent axle rolls
    heading = train.heading(1)
    at = train.hitch_place()[:2] - wheelbase * np.array([np.cos(heading), np.sin(heading)])
    rolls = float(np.linalg.norm(at - center))
    assert rolls == pytest.approx(trailer_radius(radius, behind, wheelbase), abs=4e-3 * wheelbase)
    assert radius - rolls > 0.1  # it cuts the corner


def test_a_slow_trailer_goes_along_the_tractrix_of_its_hitch():
    """Steered to and fro at 2 m/s: the trailer's heading is that of the rule for an axle that does not slip, along the
    path that its hitch went, to 3 mrad: what its tires drift at these side forces (see above).
    """
    steering = ((0.0, 0.0), (1.0, 0.6), (6.0, 0.6), (8.0, -0.8), (14.0, -0.8), (16.0, 0.0), (20.0, 0.0))
    train = start(load_vehicle("sedan-trailer"), ScriptSpec(steering=steering, speed=((0.0, 2.0),)), speed=2.0)
    path, headings = [train.hitch_place()[:2]], [train.heading(1)]
    for _ in range(1000):
        train.sim.step(10)
        path.append(train.hitch_place()[:2])
        headings.append(train.heading(1))
    times = 0.02 * np.arange(len(path))
    expected = tractrix(times, np.array(path), 0.0, 3.9)
    turned = np.unwrap(headings)
    assert np.ptp(turned) > 0.7
    np.testing.assert_allclose(turned, expected, atol=3e-3)


# ---- sway ------------------------------------------------------------------------------------------------------------


def loaded_behind(spec: VehicleSpec, shift: float) -> VehicleSpec:
    """The trailer with its load moved backwards, and without the hitch's bounds."""
    (trailer,) = spec.trailers
    (part,) = trailer.chassis.components
    x, y, z = part.com
    moved = RigidPart(mass=part.mass, com=(x - shift, y, z), inertia=part.inertia)
    chassis = dataclasses.replace(trailer.chassis, components=(moved,))
    return dataclasses.replace(spec, trailers=(dataclasses.replace(trailer, chassis=chassis),))


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
        inertia = sum(
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
    (mass, com, inertia), (trailer_mass, trailer_com, trailer_inertia) = found[0], found[1]
    return SingleTrack(
        mass=mass, inertia=inertia, front=x[0] - com, rear=com - x[1], hitch=com - hitch, trailer_mass=trailer_mass,
        trailer_inertia=trailer_inertia, trailer_com=hitch - trailer_com, trailer_axle=hitch - x[2],
        stiffness=(stiffness[0], stiffness[1], stiffness[2]), trail=(trail[0], trail[1], trail[2]),
    )  # fmt: skip


def sway(spec: VehicleSpec, speed: float, seconds: float = 9.0) -> np.ndarray:
    """(n,) articulation every 0.02 s after a short pull at the steering on a straight road [rad]."""
    steering = ((0.0, 0.0), (2.0, 0.0), (2.1, 0.06), (2.3, 0.06), (2.4, 0.0))
    train = start(spec, ScriptSpec(steering=steering, speed=((0.0, speed),)), speed=speed)
    train.sim.step(1200)
    found = []
    for _ in range(round(seconds / 0.02)):
        train.sim.step(10)
        found.append(float(train.vehicle.articulation.numpy()[0, 0]))
    return np.array(found)


def growth(angles: np.ndarray) -> float:
    """Rate of an oscillation's growth from its first to its last extremes [1/s]; negative: it dies away."""
    turns = [k for k in range(1, len(angles) - 1) if (angles[k] - angles[k - 1]) * (angles[k + 1] - angles[k]) < 0.0]
    sizes = np.abs([angles[k] - angles[j] for j, k in zip(turns, turns[1:], strict=False)])
    kept = [index for index, size in enumerate(sizes) if size > 2e-5]
    first, last = kept[1], kept[-1]
    return float(np.log(sizes[last] / sizes[first]) / (0.02 * (turns[last] - turns[first])))
