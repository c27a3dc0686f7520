"""Beam axles: what leads the tube, how it rolls, what its knuckles do, and mistakes in their descriptions."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from simwarp.model.builder import ModelBuilder
from simwarp.scenery.suspension_visuals import BarKind, suspension_bars
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.reachable_speeds import shaft_speed
from simwarp.vehicle.reduced.reduction import reduce_vehicle
from simwarp.vehicle.rigs.standing_loads import driven_axles
from simwarp.vehicle.spec.drivetrain_parts import MultiAxleDriveline
from simwarp.vehicle.spec.mirroring import mirrored
from simwarp.vehicle.spec.variants import with_options
from simwarp.vehicle.spec.vehicle_files import load_vehicle
from simwarp.vehicle.spec.vehicle_spec import (
    AxleRod,
    BeamAxle,
    BellCrank,
    ForceLine,
    RackPinion,
    RigidPart,
    RotaryArm,
    SpecError,
    SteeringMount,
    TriangularArm,
    VehicleSpec,
)
from simwarp.vehicle.suspensions.kinematics import travel_table
from simwarp.vehicle.vehicle import VEHICLE_SOLVER, Vehicle, per_world

RATE, ASIDE = 60000.0, 0.5
SPINDLE = RigidPart(mass=10.0, com=(0.0, 0.8, 0.0), inertia=(0.1, 0.2, 0.1))
TUBE = RigidPart(mass=150.0, inertia=(20.0, 1.0, 20.0))
SPRINGS = (
    ForceLine(chassis_point=(0.0, ASIDE, 0.4), arm_point=(0.0, ASIDE, 0.0), stiffness=RATE, rest_length=0.5),
    ForceLine(chassis_point=(0.1, ASIDE, 0.4), arm_point=(0.1, ASIDE, 0.0), damping=6000.0),
)
COMMON: dict[str, Any] = {"spindle": SPINDLE, "axle_tube": TUBE, "springs": SPRINGS, "axle_inertia": 0.4}
KNUCKLE: dict[str, Any] = {
    "knuckle": RigidPart(mass=10.0, com=(0.0, 0.7, 0.0), inertia=(0.1, 0.1, 0.1)),
    "knuckle_lower": (0.0, 0.7, -0.1), "knuckle_upper": (0.0, 0.68, 0.1), "tierod_knuckle": (-0.2, 0.63, 0.1),
    "draglink_chassis": (0.6, 0.5, 0.2),
}  # fmt: skip
STRAIGHT = {"draglink_knuckle": (0.0, 0.5, 0.2)}
CRANK = BellCrank(
    part=RigidPart(mass=3.0, com=(0.0, 0.0, 0.2), inertia=(0.05, 0.05, 0.05)), pivot=(0.0, 0.0, 0.2),
    draglink=(0.0, 0.3, 0.2), tierod=(-0.25, 0.05, 0.15),
)  # fmt: skip
ROD = AxleRod(chassis_point=(0.9, 0.4, 0.0), axle_point=(0.0, 0.4, -0.1))
ARM = TriangularArm(chassis_point=(0.8, 0.0, 0.25), axle_point=(0.0, 0.0, 0.25))


def leaves(**more: Any) -> BeamAxle:
    return BeamAxle(guide="leaf-springs", **COMMON, **more)


def linked(**more: Any) -> BeamAxle:
    return BeamAxle(rods=(ROD,), arm=ARM, **COMMON, **more)


def truck(front: BeamAxle, *rear: BeamAxle) -> VehicleSpec:
    """A vehicle on such axles, with the HMMWV's chassis, wheels and tires; an arm steers the first one."""
    own: Any = with_options(load_vehicle("hmmwv"), tire="tmeasy")
    places = [2.0, *(-1.2 - 1.3 * index for index in range(len(rear)))]
    axles = tuple(
        dataclasses.replace(
            own.axles[0], suspension=suspension, location=(x, 0.0, 0.0), steering=0 if x > 0.0 else None,
            antiroll_bar=None,
        )
        for x, suspension in zip(places, (front, *rear), strict=True)
    )  # fmt: skip
    # positive steering turns the arm clockwise: its ball moves to where the left wheel's front goes out
    side = 0.3 if front.bell_crank is None else 0.7
    arm = RotaryArm(
        max_angle=0.5,
        arm=RigidPart(mass=2.0, com=(0.6, 0.5 * (side + 0.5), 0.2), inertia=(0.05, 0.05, 0.05)),
        arm_chassis=(0.6, side, 0.2),
    )
    mount = SteeringMount(steering=arm, location=(2.0, 0.0, 0.0))
    line = MultiAxleDriveline(axles=tuple(range(1, len(axles))))
    chassis = dataclasses.replace(own.chassis, components=(RigidPart(mass=2400.0, com=(0.0, 0.0, 0.6),
                                  inertia=(900.0, 3000.0, 3200.0)),))  # fmt: skip
    return dataclasses.replace(
        own, name="truck", axles=axles, steerings=(mount,), driveline=line, engine=None, transmission=None,
        wheelbase=None, chassis=chassis,
    )  # fmt: skip


STEERED = {
    "leaf springs": leaves(**KNUCKLE, **STRAIGHT),
    "links": linked(**KNUCKLE, bell_crank=CRANK, crossed_tierods=True),
    "one tie rod to a bell crank": linked(**KNUCKLE, bell_crank=CRANK),
}


@pytest.mark.parametrize("name", STEERED)
def test_an_arm_steers_both_wheels_one_way(name):
    """Both wheels turn to the left for positive steering, more with more of it, by nearly the same angle."""
    table = travel_table(truck(STEERED[name], leaves()), 0, 0.0, [-0.5, -0.25, 0.0, 0.25, 0.5])
    assert table.reached.all(), table.reason
    assert (np.diff(table.steer, axis=0) > 0.0).all()
    np.testing.assert_allclose(table.steer[2], 0.0, atol=1e-5)
    # a trapezium turns the inner wheel further, by less than half of the angle
    assert (np.abs(table.steer[:, 0] - table.steer[:, 1])[[0, 1, 3, 4]] < 0.5 * np.abs(table.steer).max(axis=1)[
        [0, 1, 3, 4]]).all()  # fmt: skip


OWN_RODS = KNUCKLE | {"draglink_chassis": None, "tierod_chassis": (-0.2, 0.2, 0.1)}


def racked(front: BeamAxle) -> VehicleSpec:
    """A truck whose rack moves what hangs on it by 0.05 m to the right for full steering."""
    rack = RackPinion(max_angle=0.5, pinion_radius=0.1, link=RigidPart(mass=5.0, inertia=(0.1, 0.1, 0.1)))
    return dataclasses.replace(
        truck(front, leaves()), steerings=(SteeringMount(steering=rack, location=(1.8, 0.0, 0.1)),)
    )


def test_knuckles_with_a_rod_each_follow_the_rack():
    """Rods of 0.43 m lie across, levers of 0.2 m lie behind the kingpin: the wheels turn by the rack's travel over the
    lever, 0.025 m / 0.2 m, but for the angles of lever and kingpin.
    """
    table = travel_table(racked(leaves(**OWN_RODS)), 0, 0.0, [-0.5, 0.0, 0.5])
    assert table.reached.all(), table.reason
    np.testing.assert_allclose(table.steer[1], 0.0, atol=1e-5)
    np.testing.assert_allclose(table.steer[[0, 2]], [[-0.125] * 2, [0.125] * 2], rtol=0.1)
    # left and right mirror each other
    np.testing.assert_allclose(table.steer[0], -table.steer[2, ::-1], atol=1e-5)


def test_a_rod_to_each_knuckle_is_drawn():
    front = racked(leaves(**OWN_RODS)).axles[0]
    links = [bar for bar in suspension_bars(front) if bar.kind is BarKind.LINK]
    found = {tuple(np.sign([bar.start[1], bar.end[1]]).tolist()) for bar in links}
    assert found == {(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)}  # both rods, and the rack between their balls


def test_leaves_lead_straight_up():
    """Parallel travel moves the wheels along z alone, without toe or camber; opposite travel is a roll of the tube."""
    travels = np.array([-0.06, 0.0, 0.06])
    up = travel_table(truck(leaves(**KNUCKLE, **STRAIGHT), leaves()), 1, travels)
    np.testing.assert_allclose(up.center[:, :, :2] - up.center[1, :, :2], 0.0, atol=1e-6)
    np.testing.assert_allclose([up.toe, up.camber], 0.0, atol=1e-6)
    opposite = travel_table(truck(leaves(**KNUCKLE, **STRAIGHT), leaves()), 1, travels, right=-travels)
    roll = np.arcsin(travels / SPINDLE.com[1])
    np.testing.assert_allclose(opposite.camber[:, 0], -roll, atol=1e-6)
    np.testing.assert_allclose(opposite.toe, 0.0, atol=1e-6)


def test_links_lead_on_arcs():
    """The ball of the arm goes round its hinge: the middle of the axle moves back by the versine of its rise."""
    travels = np.array([-0.06, 0.0, 0.06])
    table = travel_table(truck(linked(**KNUCKLE, bell_crank=CRANK, crossed_tierods=True), linked()), 1, travels)
    assert table.reached.all(), table.reason
    # hinge and ball at one height, rods lower and longer: the tube pitches by a little, which the wheel's centre shares
    shift = table.center[:, 0, 0] - table.center[1, 0, 0]
    assert (shift[[0, 2]] != 0.0).all()
    assert (np.abs(shift) < travels.max()).all()
    np.testing.assert_allclose(table.center[:, 0, 0], table.center[:, 1, 0], atol=1e-6)
    np.testing.assert_allclose(table.center[:, 0, 1], -table.center[:, 1, 1], atol=1e-6)


BALL = (1.2, 0.0, 0.1)


@pytest.mark.parametrize("across", ["Watt linkage", "Panhard rod"])
def test_a_push_pipe_leads_round_its_ball(across):
    """Wheels' middle goes round the ball. A Watt linkage keeps its own middle across, a rod of 1 m lets it go aside by
    the versine.
    """
    rod = AxleRod(chassis_point=(-0.2, -0.5, 0.1), axle_point=(-0.2, 0.5, 0.1), mirrored=False)
    aside: dict[str, Any] = {"watt": (-0.2, 0.0, 0.1)} if across == "Watt linkage" else {"rods": (rod,)}
    spec = truck(leaves(**KNUCKLE, **STRAIGHT), BeamAxle(ball=BALL, **COMMON, **aside))
    travels = np.array([-0.06, 0.0, 0.06])
    table = travel_table(spec, 1, travels)
    assert table.reached.all(), table.reason
    middle = table.center.mean(axis=1) - spec.axles[1].location
    np.testing.assert_allclose(np.linalg.norm(middle - BALL, axis=1), np.linalg.norm(BALL), atol=1e-6)
    # at 0.2 m beside the rod's axle end the tube has risen by up to 7/6 of the wheels' travel
    most = 0.0 if across == "Watt linkage" else 1.0 - np.sqrt(1.0 - (7.0 / 6.0 * travels.max()) ** 2)
    assert (np.abs(middle[:, 1]) <= most + 1e-6).all()
    rolled = travel_table(spec, 1, travels, right=-travels)
    assert rolled.reached.all(), rolled.reason
    assert (np.diff(rolled.camber[:, 0]) < 0.0).all()


def standing(spec: VehicleSpec, *, steps: int = 4000) -> tuple[ModelBuilder, Vehicle, Simulation]:
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec)
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    simulation = Simulation(model, 1.0e-3, elements=[vehicle], solver=VEHICLE_SOLVER)
    inputs = vehicle.input.numpy()
    inputs[:, 2] = 1.0
    vehicle.input.assign(inputs)
    simulation.step(steps)
    return builder, vehicle, simulation


@pytest.mark.slow
@pytest.mark.parametrize("name", STEERED)
def test_a_truck_of_three_axles_stands(name):
    """Forces and moments of the wheels balance its weight: about y, and about x, whatever the springs share."""
    rear = leaves() if name == "leaf springs" else linked()
    builder, vehicle, simulation = standing(truck(STEERED[name], rear, rear))
    masses = np.array([body.mass for body in builder.bodies])
    places = np.asarray(simulation.state.body_x.numpy()[0], np.float64)
    weight, com = masses.sum() * 9.81, masses @ places / masses.sum()
    loads = np.asarray(vehicle.tires.load.numpy()[0], np.float64)
    wheels = places[[side.spindle for side in vehicle.parts.sides]]
    assert (loads > 0.0).all()
    # what is left of its bounce after four seconds, and single precision of forces of 10 kN
    assert loads.sum() == pytest.approx(weight, rel=1e-3)
    assert loads @ wheels[:, :2] == pytest.approx(weight * com[:2], abs=1e-3 * weight)


@pytest.mark.slow
@pytest.mark.parametrize("bar", [0.0, 20000.0])
def test_springs_and_a_bar_hold_it_in_roll(bar):
    """A chassis whose centre of mass is beside the middle: Σ (2 k a² + bar) roll = W times its arm about the tubes."""
    spec = truck(leaves(**KNUCKLE, **STRAIGHT, roll_stiffness=bar), leaves(roll_stiffness=bar))
    part = spec.chassis.components[0]
    aside = dataclasses.replace(spec.chassis, components=(dataclasses.replace(part, com=(0.0, 0.05, 0.6)),))
    builder, vehicle, simulation = standing(dataclasses.replace(spec, chassis=aside))
    tubes = [index for index, body in enumerate(builder.bodies) if body.name.endswith("tube")]
    chassis = vehicle.parts.chassis
    torque = sum((2.0 * RATE * ASIDE**2 + bar) * (_up(simulation, tube) - _up(simulation, chassis)) for tube in tubes)
    places = np.asarray(simulation.state.body_x.numpy()[0], np.float64)
    arm = places[chassis, 1] - places[tubes, 1].mean()
    assert arm > 0.05  # it leans to where it is heavy
    # springs go round with the chassis, by the square of a roll of 0.05 rad; the steering's arm weighs 20 N
    assert torque == pytest.approx(part.mass * 9.81 * arm, rel=0.02)


def _up(simulation: Simulation, body: int) -> float:
    """Roll of a body, small [rad]."""
    x, _, _, w = simulation.state.body_rot.numpy()[0, body]
    return float(2.0 * np.arctan2(x, w))


def test_mirror_images_have_their_drag_link_on_the_other_side():
    own = truck(leaves(**KNUCKLE, **STRAIGHT), leaves())
    axle: Any = mirrored(own).axles[0].suspension
    assert axle.draglink_knuckle == (0.0, -0.5, 0.2)
    assert mirrored(mirrored(own)) == own
    with pytest.raises(SpecError, match=r"axles\[0\].suspension.bell_crank: must be absent to mirror"):
        mirrored(truck(linked(**KNUCKLE, bell_crank=CRANK), leaves()))


MISTAKES: dict[str, tuple[dict[str, Any], str]] = {
    "nothing leads it": (
        {}, "rods: must be 4 or more with the two of an arm and the three of a ball where guide is 'links', got 0; add",
    ),
    "leaves without springs": ({"guide": "leaf-springs", "springs": ()}, "springs: must be one or more where guide"),
    "a bar on links": ({"rods": (ROD,), "arm": ARM, "roll_stiffness": 1.0}, "roll_stiffness: must be 0 where guide"),
    "a tie rod without a knuckle": (
        {"guide": "plane", "tierod_knuckle": (0.0, 0.5, 0.0)}, "tierod_knuckle: must be left out without a knuckle",
    ),
    "a knuckle without a kingpin": (
        {"guide": "plane", **KNUCKLE, **STRAIGHT, "knuckle_upper": None}, "knuckle_upper: must be given beside a knuck",
    ),
    "a drag link to nothing": ({"guide": "plane", **KNUCKLE}, "draglink_knuckle: must be given either as"),
    "a drag link without length": (
        {"guide": "plane", **KNUCKLE, "draglink_knuckle": (0.6, 0.5, 0.2)}, "draglink_chassis: must be apart",
    ),
    "two ways to steer": (
        {"guide": "plane", **OWN_RODS, **STRAIGHT}, "draglink_knuckle: must be left out beside tierod_chassis",
    ),
    "a tie rod without length": (
        {"guide": "plane", **OWN_RODS, "tierod_chassis": (-0.2, 0.63, 0.1)}, "tierod_knuckle: must be apart from",
    ),
    "a rod of a knuckle that is not there": (
        {"guide": "plane", "tierod_chassis": (0.0, 0.3, 0.0)}, "tierod_chassis: must be left out without a knuckle",
    ),
    "crossed tie rods without a crank": (
        {"guide": "plane", **KNUCKLE, **STRAIGHT, "crossed_tierods": True}, "crossed_tierods: must be false",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_named(name):
    changes, message = MISTAKES[name]
    with pytest.raises(SpecError, match=message) as caught:
        BeamAxle(**(COMMON | changes))
    assert "\n" not in str(caught.value)


def test_arms_are_across_their_hinges():
    with pytest.raises(SpecError, match="axle_point: must be at the y of chassis_point, 0 m"):
        TriangularArm(chassis_point=(0.8, 0.0, 0.2), axle_point=(0.0, 0.1, 0.2))


def test_what_leads_and_steers_a_beam_is_drawn():
    """Two rods, an arm, a drag link and both arms of the bell crank, where they lie; as many of them as there are."""
    spec = truck(linked(**KNUCKLE, bell_crank=CRANK, crossed_tierods=True), leaves())
    front = spec.axles[0]
    drawn = {
        (tuple(bar.start.round(9).tolist()), tuple(bar.end.round(9).tolist()))
        for bar in suspension_bars(front)
        if bar.kind is BarKind.LINK
    }
    ends = [(ROD.chassis_point, ROD.axle_point), (ARM.chassis_point, ARM.axle_point),
            (KNUCKLE["draglink_chassis"], CRANK.draglink), (CRANK.pivot, CRANK.tierod)]  # fmt: skip
    for start, end in ends:
        assert tuple(tuple(np.add(front.location, point).round(9).tolist()) for point in (start, end)) in drawn
    assert len(drawn) == 2 + 1 + 1 + 2 + 1  # and the tie rod across


def test_the_drive_shaft_turns_with_all_driven_axles():
    """At the mean of the wheels behind it, over the ratio; reduced vehicles have no such driveline."""
    spec = truck(leaves(), leaves(), leaves())
    spec = dataclasses.replace(spec, driveline=MultiAxleDriveline(axles=(0, 1, 2), gear_ratio=0.25))
    assert shaft_speed(spec, 10.0) == pytest.approx(10.0 / spec.axles[0].tire.radius / 0.25)
    assert driven_axles(spec) == (0, 1, 2)
    two = dataclasses.replace(truck(leaves(), leaves()), driveline=MultiAxleDriveline(axles=(0, 1)))
    with pytest.raises(SpecError, match="driveline: must be a template for one or two axles to be reduced, got 'simp"):
        reduce_vehicle(two)


def test_an_axle_is_driven_once():
    with pytest.raises(SpecError, match=r"driveline.axles: must be different axles, got \(1, 2, 1\)"):
        dataclasses.replace(truck(leaves(), leaves(), leaves()), driveline=MultiAxleDriveline(axles=(1, 2, 1)))
