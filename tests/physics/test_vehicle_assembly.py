"""Laws of assembled vehicles: mirrored, as heavy as described, no redundant row, joints that hold, wheels where the
kinematics of the axle put them.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
import pytest

import simwarp as sw
from simwarp.model.builder import ModelBuilder
from simwarp.model.topology import build_tables
from simwarp.vehicle.construction import VehicleParts, add_vehicle
from simwarp.vehicle.driving.drivers import ScriptedDriver, ScriptSpec
from simwarp.vehicle.spec.vehicle_files import vehicle_names
from simwarp.vehicle.spec.vehicle_spec import (
    AntirollBar,
    Bushing,
    PitmanArm,
    RigidPart,
    RigidSuspension,
    SpecError,
    VehicleSpec,
)
from simwarp.vehicle.suspensions.kinematics import travel_table
from simwarp.vehicle.vehicle import Vehicle, per_world
from tests.physics.sample_vehicles import LINES_OF_A_SIDE, samples, shipped, with_antiroll_bars
from tests.reference.step_rows import Rows, matrices

VEHICLES: dict[str, VehicleSpec] = {name: shipped(name) for name in vehicle_names()} | samples()


class Run(NamedTuple):
    """A vehicle on flat ground."""

    builder: ModelBuilder
    parts: VehicleParts
    sim: sw.Simulation
    vehicle: Vehicle


def start(spec: VehicleSpec, script: ScriptSpec | None = None, dt: float = 1.0e-3) -> Run:
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec)
    model = builder.finalize(1, "cpu", per_world=per_world())
    vehicle = Vehicle(parts, model)
    driver = ScriptedDriver(vehicle, script or ScriptSpec())
    return Run(builder, parts, sw.Simulation(model, dt, elements=[driver, vehicle]), vehicle)


def run(run_: Run, seconds: float) -> float:
    """Steps; returns the largest joint error on the way [m or rad]."""
    worst = 0.0
    for _ in range(round(seconds / run_.sim.dt)):
        run_.sim.step()
        worst = max(worst, float(run_.sim.diagnostics.position_error.numpy()[0]))
    return worst


def built_rows(builder: ModelBuilder) -> Rows:
    rows = Rows(builder)
    positions = np.array([body.pose.position for body in builder.bodies])
    rows.evaluate(positions, matrices(np.array([body.pose.rotation for body in builder.bodies])))
    return rows


@pytest.mark.parametrize("name", VEHICLES)
def test_rows_hold_as_built_and_none_is_redundant(name):
    builder = ModelBuilder()
    add_vehicle(builder, VEHICLES[name])
    rows = built_rows(builder)
    assert np.abs(rows.value[: rows.bilateral]).max() < 1e-12
    strength = np.linalg.svd(rows.jacobian[: rows.bilateral], compute_uv=False)
    assert strength.min() > 1e-3


# freedoms of the bodies: the chassis' six, travel and spin of every wheel, the steering's one
MOBILITY = dict.fromkeys(VEHICLES, 6 + 8 + 1) | {
    "gator": 6 + 4 + 2 + 1,  # the rear wheels only spin
    "skid-steer": 6 + 4,  # all wheels do, two by two with shafts, which are no bodies
    "pinned-axle": 6 + 4 + 3 + 1,  # two spins and one roll
    "bushings": 6 + 8 + 1 + 8 * 5,  # five more of each arm
    "truck-semitrailer": 6
    + 8
    + 1
    + 2
    + 3 * 4,  # yaw and pitch on the fifth wheel; heave, roll and spins of three axles
    "sedan-trailer": 6 + 8 + 1 + 3 + 4,  # a ball
}


@pytest.mark.parametrize("name", VEHICLES)
def test_mobility(name):
    builder = ModelBuilder()
    add_vehicle(builder, VEHICLES[name])
    assert 6 * len(builder.bodies) - built_rows(builder).bilateral == MOBILITY[name]


@pytest.mark.parametrize("name", VEHICLES)
def test_the_right_side_mirrors_the_left(name):
    builder = ModelBuilder()
    add_vehicle(builder, VEHICLES[name])
    bodies = {body.name: body for body in builder.bodies}
    flip = np.diag([1.0, -1.0, 1.0])
    lefts = [key for key in bodies if "left" in key]
    # without suspensions there are the wheels alone, and a beam axle adds knuckles where it steers
    assert len(lefts) >= {"skid-steer": 2, "truck": 3}.get(name, 4)
    for key in lefts:
        left, right = bodies[key], bodies[key.replace("left", "right")]
        assert right.mass == left.mass
        assert right.pose.position == pytest.approx(flip @ left.pose.position, abs=1e-12)
        turn_left, turn_right = matrices(np.array([left.pose.rotation, right.pose.rotation]))
        in_world = turn_left @ left.inertia @ turn_left.T
        scale = np.abs(in_world).max()
        assert turn_right @ right.inertia @ turn_right.T == pytest.approx(flip @ in_world @ flip, abs=1e-12 * scale)


AXES = dict.fromkeys((sw.JointType.REVOLUTE, sw.JointType.PRISMATIC, sw.JointType.RELATIVE_ROTATION), (2,)) | {
    sw.JointType.CYLINDRICAL: (2,),
    sw.JointType.BUSHING: (2,),
    sw.JointType.REVOLUTE_SPHERICAL: (2,),
    sw.JointType.UNIVERSAL: (0, 1),
}


@pytest.mark.parametrize("name", VEHICLES)
def test_a_vehicle_is_the_same_anywhere(name):
    """Far off, turned about all axes: points and hinges of all joints are where they were in their bodies."""
    rotation = np.array([0.1, -0.2, 0.6, 0.7])
    here, there = ModelBuilder(), ModelBuilder()
    add_vehicle(here, VEHICLES[name], at=sw.pose((0.0, 0.0, 0.5)))
    add_vehicle(there, VEHICLES[name], at=sw.pose((200.0, -300.0, 7.0), rotation))
    rows = built_rows(there)
    assert np.abs(rows.value[: rows.bilateral]).max() < 1e-10
    for one, other in zip(here.joints, there.joints, strict=True):
        for frame, moved in ((one.frame0, other.frame0), (one.frame1, other.frame1)):
            assert moved.position == pytest.approx(frame.position, abs=1e-10)
            axes, moved_axes = matrices(np.array([frame.rotation, moved.rotation]))
            # other joints have no axis, or x and y that the world's axes choose
            for column in AXES.get(one.type, ()):
                assert moved_axes[:, column] == pytest.approx(axes[:, column], abs=1e-10)
    for body, placed in zip(here.bodies, there.bodies, strict=True):
        assert placed.inertia == pytest.approx(body.inertia, abs=1e-12)


@pytest.mark.parametrize("name", VEHICLES)
def test_mass_is_the_description_s(name):
    spec: Any = VEHICLES[name]
    total = sum(part.mass for unit in spec.units for part in unit.chassis.components)
    for mount in spec.steerings:
        total += mount.steering.link.mass if hasattr(mount.steering, "link") else 0.0
        total += mount.steering.arm.mass if hasattr(mount.steering, "arm") else 0.0
    for axle in spec.all_axles:
        for field in dataclasses.fields(axle.suspension):
            part = getattr(axle.suspension, field.name)
            if isinstance(part, RigidPart):
                total += part.mass * (1.0 if field.name == "axle_tube" else 2.0)
        total += 2.0 * (axle.wheel.mass + axle.tire.mass)
        total += 0.0 if axle.antiroll_bar is None else 2.0 * axle.antiroll_bar.arm_mass
    builder = ModelBuilder()
    add_vehicle(builder, spec)
    assert sum(body.mass for body in builder.bodies) == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("name", VEHICLES)
@pytest.mark.sweep
def test_settles_and_keeps_its_joints(name):
    """Dropped with the brakes on, then steered: no trouble, exact joints, at rest in the end."""
    steering = ((0.0, 0.0), (1.5, 0.0), (2.0, 0.5))
    found = start(VEHICLES[name], ScriptSpec(braking=((0.0, 1.0),), steering=steering))
    run(found, 1.0)
    assert found.sim.problems() == []
    assert run(found, 2.0) < 1.0e-5
    assert found.sim.problems() == []
    # a vehicle with soft tires rocks on them for a while: its springs have come to rest
    speeds = found.sim.state.body_v.numpy()[0]
    assert np.abs(speeds[:, 2]).max() < 0.01
    height = found.sim.state.body_x.numpy()[0, found.parts.chassis, 2]
    assert height > 0.4 * found.builder.bodies[found.parts.chassis].pose.position[2]


def test_the_sedan_drives_straight_and_brakes():
    script = ScriptSpec(
        throttle=((0.0, 0.0), (1.0, 0.0), (1.5, 0.5), (4.0, 0.5), (4.0, 0.0)),
        braking=((0.0, 0.0), (4.0, 0.0), (4.2, 1.0)),
    )
    found = start(shipped("sedan"), script)
    assert run(found, 4.0) < 1.0e-5
    state = found.sim.state
    speed = state.body_v.numpy()[0, found.parts.chassis]
    assert speed[0] > 5.0
    assert abs(speed[1]) < 0.02
    run(found, 3.0)
    assert abs(state.body_v.numpy()[0, found.parts.chassis, 0]) < 0.1
    assert abs(state.body_x.numpy()[0, found.parts.chassis, 1]) < 0.1
    assert found.sim.problems() == []


@pytest.mark.parametrize("name", ["hmmwv", "sedan", "macpherson-strut", "multi-link", "solid-axle", "trailing-arm"])
@pytest.mark.sweep
def test_wheels_stand_where_the_kinematics_put_them(name):
    """A vehicle on its tires, steered: its wheels against its chassis are rows of the table."""
    spec = VEHICLES[name]
    found = start(spec, ScriptSpec(braking=((0.0, 1.0),), steering=((0.0, 0.0), (0.5, 0.4))))
    run(found, 2.0)
    positions = found.sim.state.body_x.numpy()[0]
    turns = matrices(found.sim.state.body_rot.numpy()[0])
    chassis = found.parts.chassis
    built = np.array([body.pose.position for body in found.builder.bodies])
    for axle in range(len(spec.axles)):
        sides = [side for side in found.parts.sides if side.axle == axle]
        places = [turns[chassis].T @ (positions[side.spindle] - positions[chassis]) for side in sides]
        travels = [
            place[2] - (built[side.spindle] - built[chassis])[2] for place, side in zip(places, sides, strict=True)
        ]
        table = travel_table(spec, axle, travels[0], 0.4, right=travels[1])
        for column, side in enumerate(sides):
            axis = turns[chassis].T @ turns[side.spindle][:, 1]
            assert np.degrees(np.arctan2(-axis[0], axis[1]) - table.steer[0, column]) == pytest.approx(0.0, abs=0.002)
            camber = -side.side * np.arcsin(axis[2])
            assert np.degrees(camber - table.camber[0, column]) == pytest.approx(0.0, abs=0.002)


@pytest.mark.parametrize("lift", [0.01, -0.02])
def test_an_antiroll_bar_resists_roll_alone(lift):
    """Its twist is the difference of its links' heights over the length of its arms; heave leaves it untwisted."""
    twist, heights = lifted_bar(lift, -lift)
    assert abs(twist) > 0.5 * 2.0 * abs(lift) / 0.4
    # the links lean a little and the arms' ends go round
    assert twist == pytest.approx((heights[0] - heights[1]) / 0.4, rel=0.01)
    assert lifted_bar(lift, lift)[0] == pytest.approx(0.0, abs=1e-6)


def lifted_bar(left: float, right: float) -> tuple[float, list[float]]:
    """Twist of the front bar of a held sedan with its wheels lifted [rad], and how far its links' lower ends rose."""
    spec: Any = with_antiroll_bars(shipped("sedan"))
    builder = ModelBuilder(gravity=(0.0, 0.0, 0.0))
    parts = add_vehicle(builder, spec)
    builder.add_joint_fixed("held", sw.WORLD, parts.chassis)
    planes = [
        builder.add_joint_point_on_plane(
            f"height{k}", sw.WORLD, side.spindle, anchor=builder.bodies[side.spindle].pose.position,
            normal=(0.0, 0.0, 1.0),
        )
        for k, side in enumerate(parts.sides[:2])
    ]  # fmt: skip
    model = builder.finalize(1, "cpu", per_world=["joint_anchor0"])
    sim = sw.Simulation(model, 1.0e-3)
    anchors: Any = model.parameters.joint_anchor0
    values = anchors.numpy().copy()
    values[0, planes, 2] += (left, right)
    anchors.assign(values)
    sim.set_joint_state(None, None, None)
    assert sim.problems() == []
    heights = []
    for side in parts.sides[:2]:
        link = next(j for j in builder.joints if j.name.endswith(f"{side.name.split('.')[-1]}_droplink"))
        arm = builder.bodies[side.bar].pose
        built = arm.position + matrices(arm.rotation)[0] @ link.frame1.position
        turn = matrices(sim.state.body_rot.numpy()[0, side.bar])[0]
        heights.append((sim.state.body_x.numpy()[0, side.bar] + turn @ link.frame1.position - built)[2])
    return float(sim.state.joint_q.numpy()[0, model.dof("axle0.antiroll_bar.torsion", 0)]), heights


def test_an_antiroll_bar_stiffens_roll():
    """Cornering steadily, the sedan rolls less with bars."""
    script = ScriptSpec(speed=((0.0, 8.0),), steering=((0.0, 0.0), (3.0, 0.0), (3.5, 0.3)))
    rolls = []
    for spec in (shipped("sedan"), with_antiroll_bars(shipped("sedan"), 30000.0)):
        found = start(spec, script)
        run(found, 6.0)
        up = matrices(found.sim.state.body_rot.numpy()[0])[found.parts.chassis][:, 1]
        rolls.append(abs(np.arcsin(up[2])))
    assert rolls[1] < 0.9 * rolls[0]


def test_an_antiroll_bar_needs_springs():
    gator = shipped("gator")
    assert isinstance(gator.axles[1].suspension, RigidSuspension)
    with pytest.raises(SpecError, match="antiroll_bar"):
        add_vehicle(ModelBuilder(), with_antiroll_bars(gator))


@pytest.mark.parametrize("soft", [False, True])
def test_an_antiroll_bar_on_the_hinge_line_is_an_error(soft):
    """There its drop links do not move, and half a hand beside it they do."""
    spec: Any = shipped("sedan")
    axle = spec.axles[0]
    suspension = axle.suspension
    front, back = (np.array(point) for point in (suspension.lower_arm_front, suspension.lower_arm_back))
    if soft:
        bushing = Bushing(stiffness_linear=1e7, damping_linear=1e4, stiffness_rotational=1e5, damping_rotational=1e2)
        suspension = dataclasses.replace(suspension, lower_arm_bushing=bushing)
    for aside, is_error in ((0.0, True), (0.05, False)):
        foot = 0.5 * (front + back) + (0.0, aside, 0.0)
        bar = AntirollBar(
            location=(axle.location[0] + foot[0] - 0.4, 0.0, axle.location[2] + foot[2] + 0.08), arm_mass=1.0,
            arm_inertia=(0.03, 0.005, 0.03), arm_length=float(foot[1]), arm_width=0.4, droplink_height=-0.08,
            stiffness=1e4,
        )  # fmt: skip
        axles = (dataclasses.replace(axle, suspension=suspension, antiroll_bar=bar), *spec.axles[1:])
        if is_error:
            with pytest.raises(
                SpecError, match=r"antiroll_bar: its drop links must stand away .* got a lever of .* mm"
            ):
                add_vehicle(ModelBuilder(), dataclasses.replace(spec, axles=axles))
        else:
            add_vehicle(ModelBuilder(), dataclasses.replace(spec, axles=axles))


def test_bushings_give_way_where_hinges_hold():
    """Full brakes at speed push the wheels of the HMMWV back against the chassis by the bushings' softness."""
    moves = []
    for name in ("hmmwv", "bushings"):
        found = start(VEHICLES[name], ScriptSpec(braking=((0.0, 1.0),)))
        run(found, 2.0)
        state = found.sim.state
        turn = matrices(state.body_rot.numpy()[0])[found.parts.chassis]
        offset = state.body_x.numpy()[0, found.parts.sides[0].spindle] - state.body_x.numpy()[0, found.parts.chassis]
        moves.append(turn.T @ offset)
    # 6 kN on a wheel and two bushings of 70 kN/mm: tenths of a millimetre and what their rotation adds
    assert 1e-5 < np.abs(moves[1] - moves[0]).max() < 0.01


def test_a_stiff_spring_and_its_damper_are_one_row():
    """Between the same points; and on a MacPherson strut they cost none."""
    for name, (front, rear) in LINES_OF_A_SIDE.items():
        builder = ModelBuilder()
        add_vehicle(builder, VEHICLES[name])
        for axle, count in ((0, front), (1, rear)):
            lines = [joint.name for joint in builder.joints if joint.name.startswith(f"axle{axle}.left.spring")]
            assert len(lines) == count, name


def test_rows_of_the_loops():
    """The size of the dense solve per vehicle: what templates are chosen for."""
    counts = {}
    for name, spec in VEHICLES.items():
        builder = ModelBuilder()
        add_vehicle(builder, spec)
        counts[name] = build_tables(builder).row_count
    assert counts == {
        "artcar": 18, "gator": 2, "hmmwv": 18, "hmmwv-reduced": 24, "sedan": 16, "skid-steer": 0, "sedan-trailer": 19,
        "truck": 12, "truck-semitrailer": 27,
        "macpherson-strut": 16, "multi-link": 36, "solid-axle": 24, "pinned-axle": 8, "trailing-arm": 8,
        "antiroll-bar": 20, "bushings": 62,
    }  # fmt: skip


def test_a_spring_takes_the_map_of_its_damper():
    """On a strut's slide, whose coordinate starts at zero, both count from the length as built."""
    spec: Any = samples()["macpherson-strut"]
    strut: Any = spec.axles[0].suspension
    lengths, rates, forces = (0.2, 0.5), (-1.0, 0.0, 1.0), ((-100.0, -300.0), (0.0, 0.0), (200.0, 600.0))
    damper = dataclasses.replace(strut.springs[1], damping=0.0, damper_map=(lengths, rates, forces))
    changed = dataclasses.replace(strut, springs=(strut.springs[0], damper))
    front = dataclasses.replace(spec.axles[0], suspension=changed)
    builder = ModelBuilder()
    add_vehicle(builder, dataclasses.replace(spec, axles=(front, spec.axles[1])))
    (slide,) = (joint.dofs[0] for joint in builder.joints if joint.name == "axle0.left.strut.slide")
    built = float(np.linalg.norm(np.subtract(strut.strut_upright, strut.strut_chassis)))
    assert slide.stiffness == strut.springs[0].stiffness
    assert slide.rest == pytest.approx(strut.springs[0].rest_length - built)
    assert slide.damper_map is not None
    assert slide.damper_map[0] == pytest.approx([length - built for length in lengths])
    assert slide.damper_map[1:] == (rates, forces)


def test_pitman_arm_is_driven_in_the_tree():
    """Its angle is prescribed: a coordinate of the tree, no row."""
    spec = shipped("hmmwv")
    assert isinstance(spec.steerings[0].steering, PitmanArm)
    builder = ModelBuilder()
    parts = add_vehicle(builder, spec)
    tables = build_tables(builder)
    assert tables.dof_to_tree_dof[builder.dof_start(parts.steerings[0].joint)] >= 0
