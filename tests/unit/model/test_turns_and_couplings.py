"""Couplings on the rotation between two bodies, viscous couplings, dampers given by maps, and force elements."""

import numpy as np
import pytest
import warp as wp

import simwarp as sw
from simwarp.core.arrays import reinterpret_int32
from simwarp.core.rotation import matrix_of
from simwarp.core.types import ModelError

DT = 1e-3


def steered_wheel(gravity=(0.0, 0.0, 0.0), damping: float = 0.0):
    """A floating frame with a wheel on a steered knuckle, driven by a shaft: q_turn = q_shaft / 4."""
    builder = sw.ModelBuilder(gravity=gravity)
    frame = builder.add_body("frame", mass=100.0, inertia=(10.0, 10.0, 10.0))
    builder.add_joint_free("float", frame)
    knuckle = builder.add_body("knuckle", mass=1.0, inertia=(0.1, 0.1, 0.1), pose=sw.pose((0.0, 1.0, 0.0)))
    wheel = builder.add_body("wheel", mass=2.0, inertia=(0.2, 0.4, 0.2), pose=sw.pose((0.0, 1.0, 0.0)))
    steer = sw.PrescribedPosition(table=([0.0, 0.5, 1.0, 2.0], [0.0, 0.0, 0.5, 0.5]))
    builder.add_joint_revolute("steer", frame, knuckle, axis=(0.0, 0.0, 1.0), drive=steer)
    builder.add_joint_revolute("spin", knuckle, wheel, axis=(0.0, 1.0, 0.0))
    turn = builder.add_joint_relative_rotation("turn", frame, wheel, axis=(0.0, 1.0, 0.0))
    shaft = builder.add_shaft("shaft", inertia=0.5)
    builder.add_coupling("axle", [(turn, 1.0), (shaft, -0.25)], damping=damping)
    return builder, turn, shaft


def push(sim, column: int, torque: float) -> None:
    force = np.zeros(sim.control.joint_force.shape, np.float32)
    force[:, column] = torque
    sim.control.joint_force.assign(force)


def momentum(sim) -> np.ndarray:
    """Angular momentum about the origin [N·m·s], of the bodies alone."""
    inertias = [np.diag(d) for d in ((10.0, 10.0, 10.0), (0.1, 0.1, 0.1), (0.2, 0.4, 0.2))]
    state = sim.state
    total = np.zeros(3)
    for body, (mass, inertia) in enumerate(zip((100.0, 1.0, 2.0), inertias, strict=True)):
        r = matrix_of(state.body_rot.numpy()[0, body])
        total += r @ inertia @ r.T @ state.body_omega.numpy()[0, body]
        total += mass * np.cross(state.body_x.numpy()[0, body], state.body_v.numpy()[0, body])
    return total


def test_a_shaft_drives_a_wheel_that_steers():
    builder, turn, shaft = steered_wheel()
    sim = sw.Simulation(builder.finalize(2, "cpu"), DT)
    column = builder.dof_start(shaft)
    push(sim, column, 5.0)
    for _ in range(1500):
        sim.step()
    state = sim.state
    omega = state.body_omega.numpy()[0]
    frame, axis = (matrix_of(state.body_rot.numpy()[0, body]) for body in (0, 2))
    axis = axis[:, 1]
    assert frame[:, 0] @ axis == pytest.approx(-np.sin(0.5), abs=1e-5)  # it has steered by half a radian
    shaft_rate = state.joint_qd.numpy()[0, column]
    # float32 rates of some 10 rad/s, and the axis' turn within a step
    assert (omega[2] - omega[0]) @ axis == pytest.approx(0.25 * shaft_rate, abs=2e-5 * float(shaft_rate))
    x = state.joint_x.numpy()[0]
    assert x[builder.dof_start(turn)] == pytest.approx(0.25 * x[column], abs=1e-6)
    # the wheel turns against frame and knuckle, geared by four; that it steers meanwhile is worth less than 0.1 %
    reduced = 1.0 / (1.0 / 0.4 + 1.0 / (10.0 + 0.1))
    assert shaft_rate == pytest.approx(5.0 * 1.5 / (0.5 + reduced / 16.0), rel=1e-3)


def test_the_turn_acts_back_on_its_first_body():
    # The shaft's torque comes from outside; what it passes on is internal to frame and wheel.
    builder, _, shaft = steered_wheel()
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT)
    push(sim, builder.dof_start(shaft), 5.0)
    for _ in range(1500):
        sim.step()
    # of a wheel with 0.4 · 3.6 = 1.4 N·m·s that turns by half a radian: gyroscopic torques are of second order in dt
    assert np.abs(momentum(sim)).max() < 1e-3


def test_reactions_account_for_the_turn():
    builder, _, shaft = steered_wheel()
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT, joint_reactions=True)
    push(sim, builder.dof_start(shaft), 5.0)
    for _ in range(20):
        sim.step()
    spin = sim.diagnostics.joint_reaction_torque.numpy()[0, 2]
    # a hinge passes nothing about its own axis, whatever the coupling passes beside it
    assert abs(spin[1]) < 1e-4


def test_a_viscous_coupling_slips_by_its_torque_over_its_damping():
    builder = sw.ModelBuilder()
    first = builder.add_shaft("first", inertia=0.3)
    second = builder.add_shaft("second", inertia=2.0, damping=4.0)
    builder.add_coupling("viscous", [(first, 0.2), (second, -1.0)], damping=50.0)
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT)
    push(sim, 0, 6.0)
    for _ in range(40000):
        sim.step()
    rates = sim.state.joint_qd.numpy()[0]
    # steady: the torque behind it is 6 / 0.2 = 30 N·m; it slips by 30 / 50 rad/s; 30 = 4 w. A shaft's speed is one
    # float32 word, which stops gaining at half a unit per step: 2.4e-7 / 1 ms · 9.5 kg·m² = 2.3e-3 of 4 N·m·s/rad
    assert rates[1] == pytest.approx(7.5, abs=2e-3)
    assert 0.2 * rates[0] - rates[1] == pytest.approx(30.0 / 50.0, rel=1e-3)


def test_the_rate_of_a_viscous_coupling_does_not_depend_on_the_step():
    ends = []
    for dt in (1e-3, 4e-3):
        builder = sw.ModelBuilder()
        first = builder.add_shaft("first", inertia=0.3, speed=10.0)
        second = builder.add_shaft("second", inertia=0.3)
        builder.add_coupling("viscous", [(first, 1.0), (second, -1.0)], damping=1.5)
        sim = sw.Simulation(builder.finalize(1, "cpu"), dt)
        for _ in range(round(0.1 / dt)):
            sim.step()
        ends.append(np.subtract(*sim.state.joint_qd.numpy()[0]))
    # d' = -(2 c / J) d with 2 c / J = 10 / s, over 0.1 s; backward Euler is off by (10 / s)² dt t / 2 = 5 dt / s
    assert ends[0] == pytest.approx(10.0 * np.exp(-1.0), rel=6e-3)
    assert ends[1] == pytest.approx(10.0 * np.exp(-1.0), rel=2.2e-2)


def test_a_rigid_coupling_is_the_limit_of_a_viscous_one():
    rates = []
    for damping in (0.0, 1e6):
        builder, _, shaft = steered_wheel(damping=damping)
        sim = sw.Simulation(builder.finalize(1, "cpu"), DT)
        push(sim, builder.dof_start(shaft), 5.0)
        for _ in range(300):
            sim.step()
        rates.append(sim.state.joint_qd.numpy()[0, builder.dof_start(shaft)])
    assert rates[0] == pytest.approx(rates[1], rel=1e-5)


@pytest.mark.parametrize("damping", [-1.0, float("nan")])
def test_a_coupling_refuses_a_damping_below_zero(damping):
    builder = sw.ModelBuilder()
    shafts = [builder.add_shaft(name, inertia=1.0) for name in ("a", "b")]
    with pytest.raises(ModelError, match="coupling 'c': damping"):
        builder.add_coupling("c", [(shafts[0], 1.0), (shafts[1], -1.0)], damping=damping)


# ---- damper maps -----------------------------------------------------------------------------------------------------

MAP = ([0.9, 1.0, 1.2], [-1.0, 0.0, 2.0], [[-10.0, -40.0, -20.0], [0.0, 0.0, 0.0], [30.0, 60.0, 90.0]])


def resisted(length: float, speed: float) -> float:
    """Force [N] of the damper between the origin and a body of 1000 kg, measured by its loss of speed in one step."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body(
        "body", mass=1000.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((length, 0.0, 0.0)), velocity=(speed, 0.0, 0.0)
    )
    builder.add_spring("damper", sw.WORLD, body, anchor0=(0.0, 0.0, 0.0), anchor1=(length, 0.0, 0.0), damper_map=MAP)
    sim = sw.Simulation(builder.finalize(1, "cpu"), DT)
    sim.step()
    words_of_speed = [float(array.numpy()[0, 0, 0]) for array in (sim.state.body_v, sim.state.body_v_low)]
    return 1000.0 * (speed - sum(words_of_speed)) / DT


@pytest.mark.parametrize(
    ("length", "speed", "force"),
    [
        (1.0, 2.0, 60.0), (1.0, 1.0, 30.0), (0.95, 1.0, 22.5), (1.1, 2.0, 75.0), (0.95, -0.5, -12.5),
        (0.5, 2.0, 30.0), (1.5, 2.0, 90.0), (1.0, 3.0, 90.0),
    ],
)  # fmt: skip
def test_a_damper_map_is_bilinear_held_beyond_the_lengths_extended_beyond_the_rates(length, speed, force):
    # the speed is kept in two float32 words; what the first loses, 2e-7 m/s, would be 0.2 N
    assert resisted(length, speed) == pytest.approx(force, abs=0.05)


@pytest.mark.parametrize(
    "bad",
    [
        ([0.0, 1.0], [0.0, 1.0], [[0.0, 0.0]]), ([0.0, 0.0], [0.0, 1.0], [[0.0, 0.0], [1.0, 1.0]]),
        ([0.0, 1.0], [1.0, 0.0], [[0.0, 0.0], [1.0, 1.0]]), (1.0, 2.0), "map",
    ],
)  # fmt: skip
def test_a_damper_map_that_cannot_be_used_is_refused(bad):
    builder = sw.ModelBuilder()
    body = builder.add_body("body", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose((1.0, 0.0, 0.0)))
    with pytest.raises(ModelError, match="spring 's': damper_map"):
        builder.add_spring("s", sw.WORLD, body, anchor0=(0.0,) * 3, anchor1=(1.0, 0.0, 0.0), damper_map=bad)


# ---- force elements --------------------------------------------------------------------------------------------------


@wp.kernel
def ramp(counter: wp.array[int], force: wp.array2d[wp.vec3], effort: wp.array2d[float]):
    """Forces that grow with every step: 1 N more on body 0 along x, 1 N more on its joint."""
    world = wp.tid()
    counter[world] = counter[world] + 1  # type: ignore[index]
    force[world, 0] = wp.vec3(float(counter[world]), 0.0, 0.0)  # type: ignore[index]
    effort[world, 0] = float(counter[world])  # type: ignore[index]


class Ramp(sw.ForceElement):
    """A force element with a counter of its own."""

    def __init__(self, worlds: int) -> None:
        self.counter = wp.zeros(worlds, dtype=int, device="cpu")

    @property
    def memory(self):
        return {"counter": self.counter}

    def record(self, simulation, dt):
        control = simulation.control
        return [
            wp.launch(
                ramp, dim=simulation.model.world_count, device="cpu", record_cmd=True, inputs=[self.counter],
                outputs=[control.element_force, control.element_joint_force],
            )
        ]  # fmt: skip


def ramped(worlds: int = 3):
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    body = builder.add_body("body", mass=1.0, inertia=(1.0, 1.0, 1.0))
    builder.add_joint_prismatic("slide", sw.WORLD, body, axis=(1.0, 0.0, 0.0))
    return sw.Simulation(builder.finalize(worlds, "cpu"), 0.1, elements=[Ramp(worlds)], substeps=2)


def test_an_element_acts_in_every_substep_beside_the_user():
    sim = ramped()
    sim.control.body_force[:, 0] = (10.0, 0.0, 0.0)
    sim.step()
    # two substeps of 0.05 s: 10 + 2·1 N, then 10 + 2·2 N
    assert sim.state.body_v.numpy()[:, 0, 0] == pytest.approx(np.full(3, 0.05 * (12.0 + 14.0)), rel=1e-6)


def test_a_reset_and_a_snapshot_know_the_element():
    sim = ramped()
    sim.step()
    kept = sim.snapshot()
    sim.step()
    after = sim.state.body_v.numpy().copy()
    sim.restore(kept)
    sim.step()
    assert sim.state.body_v.numpy().tobytes() == after.tobytes()
    sim.reset(np.array([True, False, False]))
    assert sim.elements[0].counter.numpy().tolist() == [0, 4, 4]
    sim.step()
    assert sim.state.body_v.numpy()[0, 0, 0] == pytest.approx(0.05 * (2.0 + 4.0), rel=1e-6)


def test_memory_that_is_not_the_worlds_is_refused():
    with pytest.raises(ModelError, match="leading dimension 4"):
        reinterpret_int32(wp.zeros((3, 2), dtype=float, device="cpu"), 4)
    with pytest.raises(ModelError, match="whole words"):
        reinterpret_int32(wp.zeros((4, 3), dtype=wp.uint8, device="cpu"), 4)


# ---- lines between neighbours ----------------------------------------------------------------------------------------


def arm_on_a_spring(order: int, k: float = 400.0, d: float = 30.0):
    """An arm of 2 kg on a hinge about y at the origin, held by a spring between (0, 0, 1) and its end at (1, 0, 0)."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, -9.81))
    arm = builder.add_body("arm", mass=2.0, inertia=(0.1, 0.3, 0.3), pose=sw.pose((0.5, 0.0, 0.0)))
    builder.add_joint_revolute("hinge", sw.WORLD, arm, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0))
    ends = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    bodies = (sw.WORLD, arm)
    if order < 0:
        ends, bodies = ends[::-1], (arm, sw.WORLD)
    builder.add_spring("spring", *bodies, anchor0=ends[0], anchor1=ends[1], rest=1.2, stiffness=k, damping=d)
    return builder.finalize(1, "cpu")


@pytest.mark.parametrize("order", [1, -1])
def test_a_spring_beside_a_hinge_needs_no_row_and_acts_as_one(order):
    model = arm_on_a_spring(order)
    assert model.topology.row_count == 0
    sim = sw.Simulation(model, DT, joint_reactions=True)
    sim.step()
    k, d, inertia = 400.0, 30.0, 0.3 + 2.0 * 0.25
    length, lever = np.sqrt(2.0), np.sqrt(0.5)  # dL/dq: the end moves down, away from the upper anchor
    torque = 2.0 * 9.81 * 0.5 - k * (length - 1.2) * lever
    rate = DT * torque / (inertia + lever**2 * (DT * d + DT**2 * k))
    assert sim.state.joint_qd.numpy()[0, 0] == pytest.approx(rate, rel=1e-5)
    # backward Euler: the force at the end of the step
    force = k * (length + DT * lever * rate - 1.2) + d * lever * rate
    along = np.array([-1.0, 0.0, 1.0]) / np.sqrt(2.0)  # what pulls the arm's end
    reaction = sim.diagnostics.joint_reaction_force.numpy()[0]
    assert order * reaction[1] == pytest.approx(force * along, abs=1e-3)
    # the hinge carries the rest of what accelerates the arm
    wanted = 2.0 * np.array([0.0, 0.0, -0.5 * rate / DT]) - force * along + np.array([0.0, 0.0, 2.0 * 9.81])
    assert reaction[0] == pytest.approx(wanted, abs=2e-3)


def test_a_spring_beside_a_hinge_does_what_it_does_as_a_row():
    """The same arm with its hinge cut in two by a light body, so that the spring spans two joints."""
    runs = []
    for split in (False, True):
        builder = sw.ModelBuilder(gravity=(0.0, 0.0, -9.81))
        arm = builder.add_body("arm", mass=2.0, inertia=(0.1, 0.3, 0.3), pose=sw.pose((0.5, 0.0, 0.0)))
        parent = sw.WORLD
        if split:
            parent = builder.add_body("pin", mass=0.5, inertia=(0.01, 0.01, 0.01))
            builder.add_joint_fixed("fix", sw.WORLD, parent)
        builder.add_joint_revolute("hinge", parent, arm, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0))
        builder.add_spring(
            "spring", sw.WORLD, arm, anchor0=(0.0, 0.0, 1.0), anchor1=(1.0, 0.0, 0.0), rest=1.2, stiffness=400.0
        )
        sim = sw.Simulation(builder.finalize(1, "cpu"), DT)
        assert sim.model.topology.row_count == int(split)
        for _ in range(1000):
            sim.step()
        hinge = 0 if not split else builder.dof_start(1)
        runs.append(sim.state.joint_x.numpy()[0, hinge])
    assert runs[0] == pytest.approx(runs[1], abs=1e-5)  # a second at 14 rad/s in float32
