"""Torques of shafts and of rotations between bodies, and the pose at which a joint's reaction stands."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.rotation import matrix_of

DT = 1e-3
RAMP = 40.0
"""Acceleration of a prescribed shaft [rad/s²]."""
TABLE = ([0.0, 10.0], [0.0, 10.0 * RAMP])


def ramp() -> sw.PrescribedSpeed:
    return sw.PrescribedSpeed(table=TABLE)


def stepped(builder: sw.ModelBuilder, steps: int = 20, worlds: int = 1, **options) -> sw.Simulation:
    sim = sw.Simulation(builder.finalize(worlds, "cpu"), DT, joint_reactions=True, **options)
    sim.step(steps)
    return sim


def torque_of(sim: sw.Simulation, joint: int, world: int = 0) -> float:
    """Of a shaft, along it [N·m]; a shaft transmits nothing else."""
    found = sim.diagnostics.joint_reaction_torque.numpy()[world, joint]
    assert found[1] == found[2] == 0.0
    assert not sim.diagnostics.joint_reaction_force.numpy()[world, joint].any()
    return float(found[0])


def rounding(inertia: float, rate: float) -> float:
    """A change of speed is a difference of two float32 speeds: half a unit of each over the step's time [N·m]."""
    return 2.0 * inertia * abs(rate) * 6e-8 / DT


def test_a_prescribed_shaft_reports_inertia_times_acceleration():
    builder = sw.ModelBuilder()
    shaft = builder.add_shaft("shaft", inertia=0.3, drive=ramp())
    sim = stepped(builder)
    assert torque_of(sim, shaft) == pytest.approx(0.3 * RAMP, abs=rounding(0.3, RAMP * 20 * DT))


def test_it_bears_what_is_geared_to_it():
    """q_second = 3 q_first: the second one's inertia counts nine times, its torque three times."""
    builder = sw.ModelBuilder()
    first = builder.add_shaft("first", inertia=0.3, drive=ramp())
    second = builder.add_shaft("second", inertia=0.05, damping=0.7)
    builder.add_coupling("gear", [(first, 3.0), (second, -1.0)])
    sim = stepped(builder)
    rate = 3.0 * RAMP * 20 * DT
    allowed = rounding(0.3 + 3.0 * 0.05, rate)
    # the damper is implicit: it takes the speed after the step
    assert torque_of(sim, second) == pytest.approx(-0.7 * rate, abs=allowed)
    assert torque_of(sim, first) == pytest.approx((0.3 + 9.0 * 0.05) * RAMP + 3.0 * 0.7 * rate, abs=3.0 * allowed)


def test_it_bears_a_spring_between_two_shafts():
    """A combination's spring, which acts on both of its shafts, is none of their own."""
    builder = sw.ModelBuilder()
    first = builder.add_shaft("first", inertia=0.3, drive=sw.PrescribedPosition())
    second = builder.add_shaft("second", inertia=1.0e6)
    builder.add_combination("twist", [(first, 1.0), (second, -1.0)], stiffness=500.0)
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, joint_reactions=True)
    sim.control.joint_target_q.assign(np.array([[0.02, 0.0, 0.0]], np.float32))
    sim.step(20)  # a jump of the target is made up for at 3 rad/s
    # the second one has turned by 1e-5 rad/s² (20 ms)² / 2 = 2e-9 rad; the first stands still
    assert torque_of(sim, first) == pytest.approx(500.0 * 0.02, abs=1e-4)
    # half a unit of its speed of 2e-7 rad/s, times inertia over the step: 1e-5 N·m
    assert torque_of(sim, second) == pytest.approx(0.0, abs=1e-4)


def test_a_stop_of_a_combination_is_none_of_its_shafts():
    builder = sw.ModelBuilder()
    first = builder.add_shaft("first", inertia=0.3)
    second = builder.add_shaft("second", inertia=0.5, damping=2.0)
    builder.add_combination("play", [(first, 1.0), (second, -1.0)], limit=(-0.01, 0.01))
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, joint_reactions=True)
    force = np.zeros((1, 3), np.float32)
    force[0, 0] = 4.0
    sim.control.joint_force.assign(force)
    sim.step(400)
    rate = float(sim.state.joint_qd.numpy()[0, 1])
    assert rate > 1.0  # the play is used up and the second one is taken along
    assert torque_of(sim, first) == pytest.approx(4.0, abs=1e-3)
    assert torque_of(sim, second) == pytest.approx(-2.0 * rate, abs=1e-3)


def test_what_else_drives_a_shaft_is_its_torque_too():
    builder = sw.ModelBuilder()
    motor = builder.add_shaft("motor", inertia=0.2, drive=sw.VelocityMotor(effort_limit=3.0))
    pushed = builder.add_shaft("pushed", inertia=0.4, friction=1.5)
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, joint_reactions=True)
    sim.control.joint_target_qd.assign(np.array([[1.0e3, 0.0]], np.float32))
    sim.control.joint_force.assign(np.array([[0.0, 5.0]], np.float32))
    sim.step(10)
    assert torque_of(sim, motor) == pytest.approx(3.0, abs=1e-3)
    assert torque_of(sim, pushed) == pytest.approx(5.0 - 1.5, abs=1e-3)


@pytest.mark.parametrize("projection", [0, 1])
def test_a_rotation_between_bodies_reports_what_the_shaft_gives(projection):
    """A wheel on a fixed knuckle, turned through a gear of 4 by a prescribed shaft."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    wheel = builder.add_body("wheel", mass=2.0, inertia=(0.2, 0.4, 0.2))
    spin = builder.add_joint_revolute("spin", sw.WORLD, wheel, axis=(0.0, 1.0, 0.0))
    turn = builder.add_joint_relative_rotation("turn", sw.WORLD, wheel, axis=(0.0, 1.0, 0.0))
    shaft = builder.add_shaft("shaft", inertia=0.05, drive=ramp())
    builder.add_coupling("axle", [(turn, 1.0), (shaft, -0.25)])
    sim = stepped(builder, solver=sw.SolverOptions(position_projection=projection))
    wanted = 0.4 * 0.25 * RAMP
    reactions = sim.diagnostics.joint_reaction_torque.numpy()[0]
    assert reactions[turn] == pytest.approx((0.0, wanted, 0.0), abs=1e-3)
    assert abs(reactions[spin][1]) < 1e-3  # the hinge passes nothing about its own axis
    assert torque_of(sim, shaft) == pytest.approx(0.05 * RAMP + 0.25 * wanted, abs=1e-3)


def test_worlds_report_their_own():
    builder = sw.ModelBuilder()
    shaft = builder.add_shaft("shaft", inertia=0.3, drive=sw.PrescribedSpeed())
    sim = sw.Simulation(builder.finalize(3, "cpu"), DT, joint_reactions=True)
    sim.control.joint_target_qd.assign(np.array([[1.0], [-2.0], [0.0]], np.float32))
    sim.step()
    found = [torque_of(sim, shaft, world) for world in range(3)]
    assert found == pytest.approx([300.0, -600.0, 0.0], rel=1e-6)
    sim.step()
    assert [torque_of(sim, shaft, world) for world in range(3)] == [0.0, 0.0, 0.0]


# ---- the pose of a reaction ----------------------------------------------------------------------------------------


def test_a_reaction_stands_at_the_pose_from_which_its_step_starts():
    """A bob of 2 kg on an arm of 0.5 m, turned by 0.1 rad each step: m ω² r points from where it was to the axis."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    bob = builder.add_body("bob", mass=2.0, inertia=(0.01, 0.01, 0.01), pose=sw.pose((0.5, 0.0, 0.0)))
    rate = 0.1 / DT
    hinge = builder.add_joint_revolute(
        "hinge", sw.WORLD, bob, axis=(0.0, 0.0, 1.0), anchor=(0.0, 0.0, 0.0), drive=sw.PrescribedSpeed()
    )
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, joint_reactions=True)
    sim.control.joint_target_qd.fill_(rate)
    sim.step(5)
    before = sim.state.body_x.numpy()[0, bob].copy()
    sim.step()
    after = sim.state.body_x.numpy()[0, bob]
    force = sim.diagnostics.joint_reaction_force.numpy()[0, hinge].astype(float)
    inwards = -force / np.linalg.norm(force)

    def angle(place):
        return float(np.arctan2(np.cross(place, inwards)[2], place @ inwards))

    # the chords of a polygon: between two of them the velocity turns by the angle of a step, about the corner between
    assert angle(before) == pytest.approx(0.0, abs=2e-3)
    assert angle(after) == pytest.approx(-0.1, abs=2e-3)
    # a chord is not an arc: of second order in the angle of a step, (0.1)² / 2
    assert np.linalg.norm(force) == pytest.approx(2.0 * rate**2 * 0.5, rel=5e-3)


def test_its_torque_is_about_anchor_one_in_world_axes():
    """An arm on a bracket off its centre, on a table that turns by 0.05 rad each step: the bracket's torque about its
    own place is that of the bob's inertia force about it, at the start of the step."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    table = builder.add_body("table", mass=1.0, inertia=(1.0, 1.0, 1.0))
    bob = builder.add_body("bob", mass=2.0, inertia=(0.01, 0.01, 0.01), pose=sw.pose((0.5, 0.0, 0.4)))
    builder.add_joint_revolute("turn", sw.WORLD, table, axis=(0.0, 0.0, 1.0), drive=sw.PrescribedSpeed())
    place = np.array([0.2, 0.3, 0.1])
    bracket = builder.add_joint_fixed("bracket", table, bob, anchor=tuple(place))
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, joint_reactions=True)
    sim.control.joint_target_qd.fill_(0.05 / DT)
    sim.step(5)
    center, turned = sim.state.body_x.numpy()[0, bob].copy(), matrix_of(sim.state.body_rot.numpy()[0, table])
    sim.step()
    force = sim.diagnostics.joint_reaction_force.numpy()[0, bracket].astype(float)
    torque = sim.diagnostics.joint_reaction_torque.numpy()[0, bracket].astype(float)
    # Euler about the bob's centre, whose spin about z does not change: torque + (anchor - centre) x force = 0
    expected = -np.cross(turned @ place - center, force)
    assert torque == pytest.approx(expected, abs=1e-3 * float(np.linalg.norm(expected)))
    later = matrix_of(sim.state.body_rot.numpy()[0, table]) @ place - sim.state.body_x.numpy()[0, bob]
    assert np.abs(torque + np.cross(later, force)).max() > 0.01 * np.linalg.norm(expected)
