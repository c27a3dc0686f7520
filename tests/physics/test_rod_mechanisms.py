"""Rods of the engine in motion: vibrations, decay, a flexible pendulum, mechanisms, a leaf spring, a ring, a wall.

Cases, answers and tolerances are those of `tests.physics.rod_motion_cases`, which knows nothing of the engine.
"""

import dataclasses
import math

import numpy as np
import pytest

import simwarp as sw
from tests.physics import rod_cases, rod_motion_cases as cases
from tests.physics.test_rods import ENDS, section_of


def rod_of(builder, beam, **options):
    """A beam of the cases as a rod of the engine."""
    given = {"start": ENDS.get(beam.start), "end": ENDS.get(beam.end), "up": beam.up} | options
    material = sw.flex.Elastic(
        young=beam.young, poisson=beam.poisson, density=beam.density, damping_time=given.pop("damping_time", 0.0)
    )
    return builder.add_rod(
        given.pop("name", "rod"), beam.points, section=section_of(beam.section), material=material, **given
    )


def set_velocities(sim, rod, velocities):
    """(N, 6) of the nodes: velocity, spin."""
    v, omega = (np.zeros((1, sim.model.body_count, 3), np.float32) for _ in range(2))
    v[0, list(rod.bodies)], omega[0, list(rod.bodies)] = velocities[:, :3], velocities[:, 3:]
    sim.state.body_v.assign(v)
    sim.state.body_omega.assign(omega)
    sim.measure()


def vibration(case, damping, damping_time=0.0, *, step=None, periods=None):
    """Times [s] and velocities of what a case observes."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    rod = rod_of(builder, case.beam, damping_time=damping_time)
    dt = 1e-5 if step is None else step
    sim = sw.Simulation(builder.finalize(1, "cpu"), dt, flex=sw.flex.Options(numerical_damping=damping))
    parts = np.linspace(0.0, 1.0, len(case.beam.points))
    set_velocities(sim, rod, case.velocities(parts))
    array = sim.state.body_v if case.component < 3 else sim.state.body_omega
    values = []
    for _ in range(round((case.periods if periods is None else periods) / case.frequency / dt)):
        sim.step()
        values.append(float(array.numpy()[0, rod.bodies[case.node], case.component % 3]))
    return dt * np.arange(1, len(values) + 1), np.array(values)


@pytest.mark.parametrize("case", cases.vibration_cases(), ids=lambda case: case.name)
def test_frequencies(case):
    times, values = vibration(case, 0.0)
    assert cases.mean_frequency(times, values) == pytest.approx(case.frequency, rel=case.tolerance)


@pytest.mark.parametrize(("damping", "step", "damping_time"), cases.DECAYS)
def test_decay_by_numerical_damping_and_by_the_material(damping, step, damping_time):
    case = cases.vibration_cases()[0]
    times, values = vibration(case, damping, damping_time, step=step, periods=30 if damping < 1.0 else 10)
    expected = cases.decay(damping, step, case.frequency, damping_time)
    # of 0.08 per second, what rounding leaves in thirty periods is 8 %
    assert cases.decay_rate(times, values) == pytest.approx(expected, rel=0.08 if damping == 0.02 else 0.03)


def test_a_pendulum_of_rubber_is_where_160_elements_are():
    """20 elements, at half of the step of 1 ms: within 1 % of the length to half a second, before its tip whips."""
    builder = sw.ModelBuilder()
    rod = rod_of(builder, cases.PENDULUM, start=sw.flex.Hinge())
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-4)
    for tip in cases.PENDULUM_TIPS[:5]:
        sim.step(1000)
        place = sim.body_position(rod.bodies[-1])[[0, 2]]
        assert np.linalg.norm(place - tip) < 0.01 * cases.PENDULUM.length


def crank_run(case, dt=1e-4, times=10):
    """Deflection of the middle of a slider-crank's rod, and the slider's place, every 2 ms."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    crank = builder.add_body("crank", mass=1.0, inertia=(0.1, 0.1, 0.1))
    turning = [0.0, 1.0], [0.0, case.rate]
    builder.add_joint_revolute("motor", sw.WORLD, crank, axis=(0, 0, 1), drive=sw.PrescribedPosition(table=turning))
    axis = (0.0, 0.0, 1.0)
    rod = rod_of(builder, case.beam, start=sw.flex.Hinge("crank", axis=axis), end=None)
    slider = builder.add_body("slider", mass=case.slider, inertia=(1e-4,) * 3, pose=sw.pose(case.beam.points[-1]))
    builder.add_joint_prismatic("rail", sw.WORLD, slider, axis=(1, 0, 0))
    builder.add_joint_revolute("wrist", slider, rod.bodies[-1], axis=axis, anchor=case.beam.points[-1])
    sim = sw.Simulation(builder.finalize(1, "cpu"), dt)
    set_velocities(sim, rod, case.velocities())
    v, omega = sim.state.body_v.numpy().copy(), sim.state.body_omega.numpy().copy()
    omega[0, crank, 2] = case.rate
    sim.state.body_v.assign(v)
    sim.state.body_omega.assign(omega)
    sim.measure()
    bends, places = [], []
    for _ in range(times):
        sim.step(round(2e-3 / dt))
        x = sim.state.body_x.numpy()[0, list(rod.bodies), :2]
        line = x[-1] - x[0]
        off = x[len(x) // 2] - x[0]
        bends.append((line[0] * off[1] - line[1] * off[0]) / np.linalg.norm(line))
        places.append(x[-1, 0])
    return np.array(bends), np.array(places)


def test_a_slider_crank_bends_as_160_elements_do():
    """Meijaard's of 6 mm steel at 150 rad/s. Lumped masses cost 1.2 % of the deflection at 20 elements; a half more is
    left for joints with masses of their own.
    """
    found, _ = crank_run(cases.slider_crank())
    expected = np.array(cases.SLIDER_CRANK_DEFLECTIONS[0])
    assert np.abs(found - expected).max() < 0.02 * np.abs(expected).max()


def test_a_stiff_slider_crank_is_the_rigid_mechanism():
    case = cases.slider_crank(young=2e14)
    _, places = crank_run(case)
    expected = [case.rigid_slider(2e-3 * (k + 1)) for k in range(10)]
    assert np.abs(places - expected).max() < 1e-4 * case.beam.length


def test_a_four_bar_of_rods_follows_rigid_bars():
    """Three rods, pins about z, a loop of five rows: closed to 1e-5 m while it turns, within 1 mm of rigid bars."""
    case = cases.FourBar()
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    axis = (0.0, 0.0, 1.0)
    drive = builder.add_body("drive", mass=1.0, inertia=(0.1, 0.1, 0.1))
    builder.add_joint_revolute(
        "motor", sw.WORLD, drive, axis=axis, drive=sw.PrescribedPosition(table=([0.0, 1.0], [0.0, case.rate]))
    )
    rods, holder = [], "drive"
    for k in range(3):
        beam = rod_cases.Beam(
            tuple(map(tuple, np.linspace(case.joints[k], case.joints[k + 1], 9))), case.section, case.young, up=axis
        )
        start = sw.flex.Clamp(holder) if k == 0 else sw.flex.Hinge(holder, axis=axis)
        rods.append(rod_of(builder, beam, name=f"bar{k}", start=start, end=None))
        holder = f"bar{k}_8"
    builder.add_joint_revolute("ground", sw.WORLD, rods[-1].bodies[-1], axis=axis, anchor=case.joints[3])
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    for k in range(5):
        sim.step(100)
        assert sim.diagnostics.position_error.numpy()[0] < 1e-5
        place = sim.body_position(rods[1].bodies[-1])
        assert np.linalg.norm(place - case.coupler_end(0.1 * (k + 1))) < 1e-3


def test_a_leaf_on_a_shackle_sags_by_the_beam_formula():
    case = cases.leaf_spring()
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    axis = (0.0, 1.0, 0.0)
    leaf = rod_of(builder, case.beam, start=sw.flex.Hinge(axis=axis), damping_time=0.01)
    end = case.beam.points[-1]
    middle = (np.array(end) + case.shackle) / 2.0
    shackle = builder.add_body("shackle", mass=1.0, inertia=(1e-3,) * 3, pose=sw.pose(middle))
    builder.add_joint_revolute("eye", shackle, leaf.bodies[-1], axis=axis, anchor=end)
    builder.add_joint_revolute("hanger", sw.WORLD, shackle, axis=axis, anchor=case.shackle)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 0.01, flex=sw.flex.Options(numerical_damping=1.0))
    force = np.zeros((1, sim.model.body_count, 3), np.float32)
    force[0, leaf.bodies[len(leaf.bodies) // 2], 2] = -case.force
    sim.control.body_force.assign(force)
    sim.step(2000)
    sag = -sim.body_position(leaf.bodies[len(leaf.bodies) // 2])[2]
    assert sag == pytest.approx(case.sag, rel=0.01)


def test_a_ring_writhes_beyond_its_critical_twist():
    """Michell's: one of straight material, cut and twisted by less and by more than 2 pi sqrt(3) EI/GJ. It is the bent,
    twisted shape that must be stressed: the rest of its elements is straight.
    """
    off = {}
    for share in (0.9, 1.15):
        count, radius = 24, 1.0
        angle = np.linspace(0.0, 2.0 * math.pi, count + 1)
        points = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(count + 1)], axis=1)
        points[-1] = points[0]
        builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
        rod = builder.add_rod(
            "ring", points, section=sw.flex.Round(diameter=0.05), start=sw.flex.Clamp(), end=sw.flex.Clamp("ring_0"),
            material=sw.flex.Elastic(young=1e8, density=1000.0, damping_time=0.02), up=(0.0, 0.0, 1.0),
        )  # fmt: skip
        model = builder.finalize(1, "cpu")
        rest = model.joint_rest.numpy()
        for joint in rod.joints:
            first = model.joint_dof_start[joint]
            rest[0, first + 3] = share * cases.michell_twist() / count  # the twist that it is forced out of
            rest[0, first + 5] = -2.0 * math.pi / count  # its elements are straight at rest
        model.joint_rest.assign(rest)
        sim = sw.Simulation(model, 0.01, flex=sw.flex.Options(numerical_damping=1.0))
        push = np.zeros((1, sim.model.body_count, 3), np.float32)
        push[0, rod.bodies[count // 2], 2] = 0.5
        sim.control.body_force.assign(push)
        sim.step(100)
        sim.control.body_force.zero_()
        sim.step(3000)
        off[share] = float(np.abs(sim.state.body_x.numpy()[0, :, 2]).max())
    assert off[0.9] < 0.02
    assert off[1.15] > 0.1


def test_a_bar_that_hits_a_wall_leaves_it_after_its_wave_came_back():
    """Of steel, end on at 1 m/s and a hundredth of a millisecond: 2 L/c within 10 %."""
    case = cases.WALL
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    upright = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
    smooth = sw.Material(friction=0.0)
    builder.add_shape_plane(sw.WORLD, pose=sw.pose((0.0, 0.0, 0.0), upright), material=smooth)
    points = tuple(tuple(np.add(p, (0.0101, 0.0, 0.0))) for p in case.beam.points)
    rod = rod_of(builder, dataclasses.replace(case.beam, points=points))
    builder.add_shape_sphere(rod.bodies[0], radius=0.01, material=smooth)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-5, flex=sw.flex.Options(numerical_damping=0.1))
    velocities = np.zeros((len(points), 6))
    velocities[:, 0] = -case.speed
    set_velocities(sim, rod, velocities)
    touched = []
    for step in range(round(2.0 * case.contact_time / 1e-5) + 20):
        sim.step()
        if float(sim.contacts.body_contact_force.numpy()[0, rod.bodies[0], 0]) > 0.0:
            touched.append(step)
    assert (touched[-1] - touched[0] + 1) * 1e-5 == pytest.approx(case.contact_time, rel=0.1)
