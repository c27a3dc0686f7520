"""Rods of the engine: against cases with known answers, laws, closed forms, and the float64 reference."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.model.rods import apart_along
from tests.physics import rod_cases
from tests.reference import rods as reference
from tests.reference.rod_models import loads_of, rods_of, supports_of

STEEL = sw.flex.Elastic(young=2.1e11, density=7850.0)
ENDS = {rod_cases.End.LOOSE: None, rod_cases.End.CLAMP: sw.flex.Clamp(), rod_cases.End.HINGE: sw.flex.Hinge()}


def section_of(section):
    """A section of a case, whose round ones are given by radii."""
    sizes = section.sizes
    if section.shape is rod_cases.Shape.ROUND:
        return sw.flex.Round(diameter=2.0 * sizes[0])
    if section.shape is rod_cases.Shape.TUBE:
        return sw.flex.Tube(outer=2.0 * sizes[0], inner=2.0 * sizes[1])
    if section.shape is rod_cases.Shape.RECTANGLE:
        return sw.flex.Rectangle(width=sizes[0], height=sizes[1])
    names = ("area", "inertia_y", "inertia_z", "torsion", "shear_y", "shear_z")
    return sw.flex.Section(**dict(zip(names, sizes, strict=False)))


def case_rod(case):
    """Builder and rod of a case."""
    beam = case.beam
    builder = sw.ModelBuilder(gravity=case.gravity)
    material = sw.flex.Elastic(young=beam.young, poisson=beam.poisson, density=beam.density)
    rod = builder.add_rod(
        "rod", beam.points, section=section_of(beam.section), material=material, up=beam.up, start=ENDS[beam.start],
        end=ENDS[beam.end],
    )  # fmt: skip
    return builder, rod


def at_rest(case, *, steps=600, period=0.3):
    """Position of the case's node after long damped steps with loads that grow over the first third, and the largest
    change of position in the last one."""
    builder, rod = case_rod(case)
    numbers = rod.section
    stiff = case.beam.young * min(numbers.inertia_y, numbers.inertia_z)
    slowest = 3.5 * math.sqrt(stiff / (case.beam.density * numbers.area)) / case.beam.length**2
    dt = period / slowest
    sim = sw.Simulation(builder.finalize(1, "cpu"), dt, flex=sw.flex.Options(numerical_damping=1.0))
    dead = [sw.to_torch(each) for each in (sim.control.body_force, sim.control.body_torque)]
    follower = [sw.to_torch(each) for each in (sim.control.body_force_b, sim.control.body_torque_b)]
    for step in range(steps):
        share = min(1.0, 3.0 * (step + 1) / steps)
        for load in case.loads:
            force, torque = follower if load.follows else dead
            force[0, rod.bodies[load.node]] = torch.tensor(load.force) * share
            torque[0, rod.bodies[load.node]] = torch.tensor(load.moment) * share
        sim.step()
    return sim.body_position(rod.bodies[case.node]), dt * float(np.abs(sim.state.body_v.numpy()).max())


CASES = [case for case in rod_cases.static_cases() if case.beam.end in ENDS]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_rod_at_rest_is_where_theory_says(case):
    place, moving = at_rest(case)
    assert moving < 0.02 * case.tolerance  # it is at rest
    error = np.nan_to_num(place - np.array(case.expected))
    assert np.abs(error).max() <= case.tolerance


def helix(elements=12):
    """Points of a turn and a half of a helix."""
    angle = np.linspace(0.0, 3.0 * math.pi, elements + 1)
    return np.stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), 0.05 * angle], axis=1)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (1.0, -2.0, 0.5)])
def test_a_curved_twisted_rod_has_no_force_at_rest(turn, device):
    """Built anywhere, in any direction: strains are zero to the rounding of float64 poses."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    points = helix() @ Rotation.from_rotvec(turn).as_matrix().T + 100.0
    rod = builder.add_rod("rod", points, section=sw.flex.Rectangle(width=0.02, height=0.01), material=STEEL, twist=2.0)
    sim = sw.Simulation(builder.finalize(1, device), 1e-3, joint_reactions=True)
    # what float64 leaves of 100 m in an element of 0.2 m
    assert np.abs(sw.flex.rod_strains(sim, rod).numpy()).max() < 20.0 * 100.0 * 2.2e-16 / 0.2
    sim.step(1000)
    assert np.abs(sw.flex.rod_forces(sim, rod).numpy()).max() < 4.2e7 * 20.0 * 100.0 * 2.2e-16 / 0.2
    assert np.abs(sim.state.body_v.numpy()).max() < 1e-9


def loose_rod(worlds, stiffness=1.0, **options):
    """A rod that floats, of seven elements and a heavier node, so that links lie on both sides of their joints."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    material = sw.flex.Elastic(young=1e7 * stiffness, density=1000.0)
    rod = builder.add_rod(
        "rod", helix(7), section=sw.flex.Rectangle(width=0.04, height=0.02), material=material, twist=0.7, **options
    )
    lump = builder.add_body("lump", mass=2.0, inertia=(0.01, 0.02, 0.015), pose=sw.pose(helix(7)[3]))
    builder.add_joint_fixed("glue", rod.bodies[3], lump)
    return builder, rod, builder.finalize(worlds, "cpu", per_world=["joint_stiffness"])


def coordinates(model, joint, x, q):
    """(6,) of an elastic joint by its definition, in float64."""
    spec = model.builder.joints[joint]
    turns = [Rotation.from_quat(q[body]).as_matrix() for body in (spec.parent, spec.child)]
    f0 = turns[0] @ model.joint_frame0.numpy()[0, joint]
    f1 = turns[1] @ model.joint_frame1.numpy()[0, joint]
    span = x[spec.child] + turns[1] @ model.joint_anchor1.numpy()[0, joint]
    span = span - x[spec.parent] - turns[0] @ model.joint_anchor0.numpy()[0, joint]
    turn = Rotation.from_matrix(f0.T @ f1).as_rotvec()
    middle = f0 @ Rotation.from_rotvec(0.5 * turn).as_matrix()
    return np.concatenate([middle.T @ span - [spec.offset, 0.0, 0.0], turn])


def test_coordinates_and_rates_are_those_of_the_definition():
    """Set, measured, and against differences of the definition along the velocities; links point both ways."""
    _, rod, model = loose_rod(1)
    assert {link.sign for link in model.tables.links if link.joint in rod.joints} == {1.0, -1.0}
    sim = sw.Simulation(model, 1e-3)
    random = np.random.default_rng(3)
    q, qd = random.normal(size=(2, 1, model.dof_count)) * 0.4
    q.reshape(1, -1, 6)[..., :3] *= 0.1
    sim.set_joint_state(None, q, qd)
    assert np.abs(sim.state.joint_x.numpy() - q).max() < 2e-7
    assert np.abs(sim.state.joint_qd.numpy() - qd).max() < 1e-6
    x, turn = sim.state.body_x.numpy()[0].copy(), sim.state.body_rot.numpy()[0].copy()
    v, omega = sim.state.body_v.numpy()[0].astype(float), sim.state.body_omega.numpy()[0].astype(float)

    def moved(h):
        turned = [
            (Rotation.from_rotvec(h * w) * Rotation.from_quat(p)).as_quat() for w, p in zip(omega, turn, strict=True)
        ]
        return x + h * v, np.array(turned)

    for place, joint in enumerate(rod.joints):
        first = model.joint_dof_start[joint]
        assert (
            np.abs(coordinates(model, joint, x, turn) - sim.state.joint_x.numpy()[0, first : first + 6]).max() < 1e-13
        )
        slope = (coordinates(model, joint, *moved(1e-6)) - coordinates(model, joint, *moved(-1e-6))) / 2e-6
        assert np.abs(slope - qd[0, first : first + 6]).max() < 2e-6, place


def momenta(sim):
    """Momentum, and angular momentum about the origin, of world 0."""
    model = sim.model
    v, omega = sim.state.body_v.numpy()[0].astype(float), sim.state.body_omega.numpy()[0].astype(float)
    mass, inertia = model.body_mass.numpy()[0].astype(float), model.body_inertia_b.numpy()[0].astype(float)
    x = sim.state.body_x.numpy()[0]
    spin = np.zeros(3)
    for body, q in enumerate(sim.state.body_rot.numpy()[0]):
        turn = Rotation.from_quat(q).as_matrix()
        spin += mass[body] * np.cross(x[body], v[body]) + turn @ inertia[body] @ turn.T @ omega[body]
    return (mass[:, None] * v).sum(axis=0), spin


@pytest.mark.parametrize("damping", [1.0, 0.1, 0.0])
def test_a_floating_rod_keeps_its_momenta_and_gains_no_energy(damping):
    """Two seconds of large waves while it turns; momenta to rounding, the energy of the trapezoidal rule to 0.5 %:
    it is measured with velocities of half a step before the poses.
    """
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    material = sw.flex.Elastic(young=1e7, density=1000.0)
    builder.add_rod("rod", [(0, 0, 0), (1, 0, 0)], elements=16, section=sw.flex.Round(diameter=0.02), material=material)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 2.5e-4, flex=sw.flex.Options(numerical_damping=damping))
    along = np.linspace(-0.5, 0.5, 17)
    v = np.zeros((1, 17, 3), np.float32)
    v[0, :, 1] = 2.0 * along + 0.3 * np.cos(6.0 * along)
    v[0, :, 2] = 0.4 * np.sin(5.0 * along)
    sim.state.body_v.assign(v)
    omega = np.zeros((1, 17, 3), np.float32)
    omega[0, :, 2] = 2.0
    sim.state.body_omega.assign(omega)
    start, energy = momenta(sim), [float(sim.measure_energy().numpy()[0])]
    for _ in range(40):
        sim.step(200)
        energy.append(float(sim.measure_energy().numpy()[0]))
    p, spin = momenta(sim)
    size = np.abs(start[1]).max()
    assert np.abs(p - start[0]).max() < 1e-6 * 0.314 * 2.0
    # waves that nothing damps have momenta of their own, some two times the whole, rounded 8000 times
    assert np.abs(spin - start[1]).max() < (2e-6 if damping > 0.0 else 2e-5) * size
    assert max(energy) < energy[0] * (1.0 + (1e-4 if damping > 0.0 else 0.005))
    if damping == 0.0:
        assert min(energy) > 0.995 * energy[0]


@pytest.mark.parametrize(("damping", "order"), [(1.0, 1), (0.0, 2)])
def test_order_under_refinement(damping, order):
    """A flexible pendulum from rest, its tip after 0.3 s against a finer step. Velocities belong to the middle of a
    step: the one before the start is half a step of the acceleration there away from rest.
    """

    def pendulum(dt):
        builder = sw.ModelBuilder()
        material = sw.flex.Elastic(young=1e7, density=1000.0)
        rod = builder.add_rod(
            "rod", [(0, 0, 0), (1, 0, 0)], elements=8, section=sw.flex.Round(diameter=0.02), material=material,
            start=sw.flex.Hinge(),
        )  # fmt: skip
        return sw.Simulation(builder.finalize(1, "cpu"), dt, flex=sw.flex.Options(numerical_damping=damping)), rod

    short, _ = pendulum(1e-6)
    short.step()
    start = [array.numpy() / 1e-6 for array in (short.state.body_v, short.state.body_omega)]

    def tip(dt):
        sim, rod = pendulum(dt)
        sim.state.body_v.assign(-0.5 * dt * start[0])
        sim.state.body_omega.assign(-0.5 * dt * start[1])
        sim.step(round(0.3 / dt))
        return sim.body_position(rod.bodies[-1])

    exact = tip(2.5e-5)
    errors = [float(np.linalg.norm(tip(dt) - exact)) for dt in (1e-3, 5e-4)]
    measured = math.log2(errors[0] / errors[1])
    assert abs(measured - order) < 0.25


@pytest.mark.parametrize("damping", [1.0, 0.1])
def test_a_bending_wave_decays_by_the_law(damping):
    """Of a simply bent cantilever: damping · dt · w² / 2 per second, within 3 %; period within 1 % of theory."""
    dt, length = 1e-3, 1.0
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    section = sw.flex.Round(diameter=0.02)
    rod = builder.add_rod(
        "rod", [(0, 0, 0), (length, 0, 0)], elements=20, section=section, material=STEEL, start=sw.flex.Clamp()
    )
    sim = sw.Simulation(builder.finalize(1, "cpu"), dt, flex=sw.flex.Options(numerical_damping=damping))
    numbers = section.numbers
    beta = 1.87510407
    x = np.linspace(0.0, 1.0, 21) * beta
    ratio = (math.cosh(beta) + math.cos(beta)) / (math.sinh(beta) + math.sin(beta))
    shape = (np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))) / 2.0
    speed = np.zeros((1, 21, 3), np.float32)
    speed[0, :, 2] = 0.05 * shape
    sim.state.body_v.assign(speed)
    steps = 400 if damping == 1.0 else 1500
    heights = []
    for _ in range(steps):
        sim.step()
        heights.append(sim.body_position(rod.bodies[-1])[2])
    height = np.array(heights)
    rises = [k + height[k] / (height[k] - height[k + 1]) for k in range(steps - 1) if height[k] <= 0.0 < height[k + 1]]
    frequency = 1.0 / (np.mean(np.diff(rises)) * dt)
    theory = (beta / length) ** 2 * math.sqrt(
        STEEL.young * numbers.inertia_y / (STEEL.density * numbers.area)
    ) / (2.0 * math.pi)  # fmt: skip
    assert frequency == pytest.approx(theory, rel=0.01)
    peaks = np.array([k for k in range(1, steps - 1) if height[k] > height[k - 1] and height[k] >= height[k + 1]])
    decay = -np.polyfit(peaks * dt, np.log(height[peaks]), 1)[0]
    assert decay == pytest.approx(damping * dt * (2.0 * math.pi * frequency) ** 2 / 2.0, rel=0.03)


@pytest.mark.parametrize(("mass", "dt"), [(10.0, 1e-3), (100.0, 1e-3), (10.0, 5e-3), (100.0, 5e-3)])
def test_a_cable_carries_a_load_ten_thousand_times_its_nodes(mass, dt):
    """Period of the stretched pendulum within 1 %, and no growth: taut elements resist crossing in the step."""
    angle, length = 0.1, 2.0
    points = np.linspace(0.0, length, 21)[:, None] * [math.sin(angle), 0.0, -math.cos(angle)]
    builder = sw.ModelBuilder()
    rod = builder.add_rod("cable", points, section=sw.flex.Round(diameter=0.004), material=STEEL, start=sw.flex.Hinge())
    load = builder.add_body("load", mass=mass, inertia=(mass * 0.01,) * 3, pose=sw.pose(points[-1]))
    builder.add_joint_fixed("hook", rod.bodies[-1], load)
    sim = sw.Simulation(builder.finalize(1, "cpu"), dt)
    start = float(sim.measure_energy().numpy()[0])
    place, energy = [], []
    for _ in range(round(8.0 / dt)):
        sim.step()
        place.append(sim.body_position(load)[0])
        if len(place) % 20 == 0:
            energy.append(float(sim.measure_energy().numpy()[0]) - start)
    x = np.array(place)
    falls = [k + x[k] / (x[k] - x[k + 1]) for k in range(len(x) - 1) if x[k] > 0.0 >= x[k + 1]]
    stretched = length + mass * 9.81 * length / (STEEL.young * rod.section.area)
    theory = 2.0 * math.pi * math.sqrt((stretched**2 + 0.01) / (stretched * 9.81)) * (1.0 + angle**2 / 16.0)
    assert np.mean(np.diff(falls)) * dt == pytest.approx(theory, rel=0.01)
    assert max(energy) < 0.01 * mass * 9.81 * length * (1.0 - math.cos(angle))


def test_worlds_do_not_see_each_other():
    """Seventeen worlds of which one is stiffer: the others are that one alone, bit by bit, and on any threads."""
    _, _, model = loose_rod(17)
    stiffness = np.repeat(model.joint_stiffness.numpy()[:1], 17, axis=0)
    stiffness[3] *= 4.0
    model.joint_stiffness.assign(stiffness)
    random = np.random.default_rng(5)
    q, qd = random.normal(size=(2, 1, model.dof_count)) * 0.2
    q.reshape(1, -1, 6)[..., :3] *= 0.1
    found = []
    for threads in (1, 2):
        sim = sw.Simulation(model, 1e-3, threads=threads)
        sim.set_joint_state(None, np.repeat(q, 17, axis=0), np.repeat(qd, 17, axis=0))
        sim.step(200)
        found.append(sim.state.body_x.numpy().copy())
    assert np.array_equal(*found)
    _, _, single = loose_rod(1)
    alone = sw.Simulation(single, 1e-3)
    alone.set_joint_state(None, q, qd)
    alone.step(200)
    for world in range(17):
        same = np.array_equal(found[0][world], alone.state.body_x.numpy()[0])
        assert same == (world != 3)


@pytest.mark.cuda
@pytest.mark.parametrize("floor", [False, True])
def test_a_gpu_moves_a_rod_as_a_cpu_does(floor):
    """A curved rod that waves and turns, and one that falls on a floor: poses within 1e-4 m after 60 steps."""
    places = []
    for device in ("cpu", "cuda:0"):
        builder = sw.ModelBuilder()
        if floor:
            builder.add_shape_plane()
        surface = sw.Material(friction=0.5) if floor else None
        points = [(0, 0, 0.05), (1, 0, 0.06)] if floor else helix(7)
        material = sw.flex.Elastic(young=1e7, density=1000.0)
        builder.add_rod(
            "rod", points, elements=6 if floor else None, section=sw.flex.Round(diameter=0.03), material=material,
            start=None if floor else sw.flex.Hinge(), surface=surface,
        )  # fmt: skip
        sim = sw.Simulation(builder.finalize(3, device), 2e-3)
        random = np.random.default_rng(11)
        sim.state.body_v.assign(random.normal(size=sim.state.body_v.numpy().shape).astype(np.float32) * 0.2)
        sim.step(60)
        places.append(sim.state.body_x.numpy())
    assert np.abs(places[0] - places[1]).max() < 1e-4


def test_a_ring_closes_and_its_ends_stay_together():
    """The last point at the first, clamped to it: a loop of elastic joints with six rows."""
    angle = np.linspace(0.0, 2.0 * math.pi, 25)
    points = np.stack([np.cos(angle), np.sin(angle), np.zeros(25)], axis=1)
    points[-1] = points[0]
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, -9.81))
    rod = builder.add_rod(
        "ring", points, section=sw.flex.Round(diameter=0.03), material=sw.flex.Elastic(young=1e8, density=1000.0),
        start=sw.flex.Hinge(), end=sw.flex.Clamp("ring_0"),
    )  # fmt: skip
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.step(500)
    gap = sim.body_position(rod.bodies[0]) - sim.body_position(rod.bodies[-1])
    assert np.linalg.norm(gap) < 1e-6
    assert sim.body_position(rod.bodies[12])[2] < -0.2  # it hangs and swings


def test_a_ring_of_elastic_joints_alone_is_refused():
    builder = sw.ModelBuilder()
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    for name, corner in zip("abc", corners, strict=True):
        builder.add_body(name, mass=1.0, inertia=(1.0, 1.0, 1.0), pose=sw.pose(corner))
    for first, second in ((0, 1), (1, 2), (2, 0)):
        builder.add_joint_elastic(
            f"{first}{second}", first, second, anchor0=corners[first], anchor1=corners[second], stiffness=(1.0,) * 6
        )
    with pytest.raises(sw.ModelError, match=r"closes a ring of elastic joints.*split a body"):
        builder.finalize(1, "cpu")


def test_a_rod_on_the_floor_is_carried_and_lies_still():
    """Capsules of nodes: the floor carries the weight, nothing sinks, neighbours do not push each other."""
    builder = sw.ModelBuilder()
    builder.add_shape_plane()
    rod = builder.add_rod(
        "rod", [(0, 0, 0.25), (1, 0, 0.35)], elements=10, section=sw.flex.Round(diameter=0.02),
        material=sw.flex.Elastic(young=1e7, density=1000.0, damping_time=1e-3), surface=sw.Material(friction=0.5),
    )  # fmt: skip
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3)
    sim.step(1500)
    weight = 9.81 * float(sim.model.body_mass.numpy().sum())
    force = float(sim.contacts.body_contact_force.numpy()[0, :, 2].sum())
    assert force == pytest.approx(weight, rel=0.02)
    assert np.abs(sim.state.body_x.numpy()[0, :, 2] - 0.01).max() < 1e-4
    assert np.abs(sim.state.body_v.numpy()).max() < 1e-2
    assert rod.shapes


def test_nodes_near_each_other_along_a_rod_never_touch():
    assert apart_along((0.1,) * 5, 0.02) == []
    assert apart_along((0.01,) * 3, 0.03) == [(0, 2), (0, 3), (1, 3)]


def test_forces_and_stresses_of_a_hanging_and_a_bent_rod():
    """A weight of 100 N at the end: N = 100 N; held level, the moment grows to P L at the wall."""
    section = sw.flex.Round(diameter=0.02)
    for direction, part in (((0.0, 0.0, -1.0), 0), ((1.0, 0.0, 0.0), 4)):
        builder = sw.ModelBuilder()
        light = dataclasses.replace(STEEL, density=1.0, damping_time=1e-3)
        rod = builder.add_rod(
            "rod", [(0, 0, 0), direction], elements=10, section=section, material=light, start=sw.flex.Clamp()
        )
        load = builder.add_body("load", mass=100.0 / 9.81, inertia=(0.01,) * 3, pose=sw.pose(direction))
        builder.add_joint_fixed("hook", rod.bodies[-1], load)
        flex = sw.flex.Options(numerical_damping=1.0)
        sim = sw.Simulation(builder.finalize(1, "cpu"), 0.02, flex=flex, joint_reactions=True)
        sim.step(2000)
        forces = sw.flex.rod_forces(sim, rod).numpy()[0]
        expected = 100.0 if part == 0 else 100.0 * 0.95
        assert abs(forces[0, part]) == pytest.approx(expected, rel=3e-3)
        stress = sw.flex.rod_stress(sim, rod).numpy()[0, 0]
        area, second = math.pi * 1e-4, math.pi * 1e-8 / 4.0
        most = 100.0 / area if part == 0 else expected * 0.01 / second
        assert stress[0] == pytest.approx(most, rel=0.01)
        assert sw.flex.rod_strains(sim, rod).numpy()[0, 0, 0] == pytest.approx(forces[0, 0] / (2.1e11 * area), rel=1e-4)


@pytest.mark.parametrize("damping", [1.0, 0.1])
def test_forces_are_those_that_act_in_what_spins(damping):
    """A floating steel rod at 20 rad/s and 1 ms: 123 N in its middle, rho A w^2 L^2 / 8. The stretch that a step leaves
    in what spins, times the stiffness, would be some thousand newtons.
    """
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    section = sw.flex.Round(diameter=0.02)
    rod = builder.add_rod("rod", [(-0.5, 0, 0), (0.5, 0, 0)], elements=20, section=section, material=STEEL)
    flex = sw.flex.Options(numerical_damping=damping)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3, flex=flex, joint_reactions=True)
    speed = np.zeros((1, 21, 3), np.float32)
    speed[..., 2] = 20.0
    sim.state.body_omega.assign(speed)
    sim.state.body_v.assign(np.cross(speed, sim.state.body_x.numpy()).astype(np.float32))
    sim.step(3000)
    omega = float(sim.state.body_omega.numpy()[0, :, 2].mean())
    found = sw.flex.rod_forces(sim, rod).numpy()[0, 9:11, 0].mean()
    assert found == pytest.approx(STEEL.density * section.numbers.area * omega**2 / 8.0, rel=0.01)


def test_forces_need_reactions():
    _, rod, model = loose_rod(1)
    with pytest.raises(sw.ModelError, match=r"forces of rod 'rod' are reactions of its joints.*joint_reactions=True"):
        sw.flex.rod_forces(sw.Simulation(model, 1e-3), rod)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"points": [(0, 0, 0)]}, "points must be two or more of three finite numbers"),
        ({"points": [(0, 0, 0), (0, 0, 0), (1, 0, 0)]}, "points that follow each other must be apart"),
        ({"points": [(0, 0, 0), (1, 0, 0), (0, 0.1, 0)]}, "neighbouring elements must meet at less than 90 degrees"),
        ({"points": [(0, 0, 0), (math.nan, 0, 0)]}, "points must be two or more"),
        ({"elements": 0}, "elements must be"),
        ({"up": (1.0, 0.0, 0.0)}, "up must not be along the rod"),
        ({"section": 0.02}, "section must be a Round, Tube, Rectangle or Section"),
        ({"material": "steel"}, "material must have young, poisson, density and damping_time"),
        ({"start": sw.flex.Clamp("wall")}, "an end must be held by a body that was added, got 'wall'"),
        ({"end": "wall"}, "an end must be a Clamp or Hinge, got 'wall'"),
        ({"radius": -1.0, "surface": sw.Material()}, "every size (radius, half_length, half) must be finite and > 0 m"),
    ],
)
def test_bad_rods_are_one_line(change, line):
    builder = sw.ModelBuilder()
    given = {"points": [(0, 0, 0), (1, 0, 0)], "section": sw.flex.Round(diameter=0.02), "material": STEEL} | change
    with pytest.raises(sw.ModelError) as error:
        builder.add_rod("rod", given.pop("points"), **given)
    assert line in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda: sw.flex.Elastic(young=0.0, density=1.0), "young must be"),
        (lambda: sw.flex.Elastic(young=1.0, density=-1.0), "density must be"),
        (lambda: sw.flex.Elastic(young=1.0, density=1.0, poisson=0.5), "poisson must be"),
        (lambda: sw.flex.Tube(outer=0.02, inner=0.02), "inner must be below outer"),
        (lambda: sw.flex.Round(diameter=0.0), "diameter must be"),
        (lambda: sw.flex.Options(numerical_damping=2.0), "numerical_damping must be"),
    ],
)
def test_bad_materials_and_sections_are_one_line(make, line):
    with pytest.raises(sw.ModelError, match=line) as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("case", [CASES[0], CASES[-1]], ids=lambda case: case.name)
def test_the_engine_and_the_reference_rest_at_the_same_place(case):
    """The same elements in float64, by Newton's method."""
    place, _ = at_rest(case)
    model, pose = rods_of(case.beam)
    found = reference.equilibrium(model, pose, loads_of(case, model), supports_of(case.beam), steps=case.steps)
    node = found[0] if isinstance(found, tuple) else found
    assert np.abs(place - node.position[case.node]).max() < 2e-5 * case.beam.length


def test_a_rod_comes_back_from_a_file_and_a_snapshot(tmp_path):
    """The same states bit by bit, and the same readings by the handle that add_rod gave."""
    builder, rod, model = loose_rod(2)
    sw.save_model(builder, tmp_path / "rod.json")
    again = sw.load_model(tmp_path / "rod.json").finalize(2, "cpu", per_world=["joint_stiffness"])
    sims = [sw.Simulation(each, 1e-3, joint_reactions=True) for each in (model, again)]
    random = np.random.default_rng(7)
    q, qd = random.normal(size=(2, 2, model.dof_count)) * 0.2
    q.reshape(2, -1, 6)[..., :3] *= 0.1
    for sim in sims:
        sim.set_joint_state(None, q, qd)
        sim.step(50)
    kept = sims[0].snapshot()
    for sim in sims:
        sim.step(50)
    places = [sim.state.body_x.numpy().copy() for sim in sims]
    assert np.array_equal(*places)
    assert np.array_equal(*(sw.flex.rod_forces(sim, rod).numpy() for sim in sims))
    sims[0].restore(kept)
    sims[0].step(50)
    assert np.array_equal(sims[0].state.body_x.numpy(), places[0])


def test_exporters_refuse_a_rod_by_name():
    _, _, model = loose_rod(1)
    with pytest.raises(sw.ModelError, match=r"joint 'rod:\d': its type must be one .* got ELASTIC") as error:
        sw.exporters.mjcf_of(model)
    assert "\n" not in str(error.value)


def test_couplings_and_laws_of_strains_are_refused():
    """A strain is no angle that a gear drives; drives, limits and tables act on joints at the ends."""
    builder, rod, _ = loose_rod(1)
    builder.add_coupling("gear", [(rod.joints[0], 3, 1.0), (rod.joints[1], 3, -1.0)])
    with pytest.raises(sw.ModelError, match=r"joint 'rod:0' is ELASTIC, whose coordinates are strains"):
        builder.finalize(1, "cpu")
    with pytest.raises(sw.ModelError, match=r"an ELASTIC joint has stiffness, damping, rest and preload, got limit="):
        builder.add_joint_elastic(
            "more", 0, 3, anchor0=(0, 0, 0), anchor1=(1, 0, 0), dofs=[sw.Dof(limit=(0.0, 1.0))] * 6
        )


def test_a_rest_that_is_written_shortens_and_bends():
    """As heat or a tendon would: `joint_rest` of world 1 alone."""
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    rod = builder.add_rod(
        "rod", [(0, 0, 0), (1, 0, 0)], elements=10, section=sw.flex.Round(diameter=0.02),
        material=sw.flex.Elastic(young=1e7, density=1000.0, damping_time=0.2), start=sw.flex.Clamp(),
    )  # fmt: skip
    model = builder.finalize(2, "cpu", per_world=["joint_rest"])
    rest = model.joint_rest.numpy()
    rest[1].reshape(-1, 6)[:, 0] = -0.002
    rest[1].reshape(-1, 6)[:, 4] = -0.05
    model.joint_rest.assign(rest)
    flex = sw.flex.Options(numerical_damping=1.0)
    sim = sw.Simulation(model, 0.05, flex=flex, joint_reactions=True)
    sim.step(1500)
    tips = [sim.body_position(rod.bodies[-1], world) for world in (0, 1)]
    assert np.abs(tips[0] - [1.0, 0.0, 0.0]).max() < 1e-9
    # ten chords of 0.098 m at angles of 0.05, 0.10, ... less half of the first
    angle = 0.05 * (np.arange(10) + 0.5)
    expected = 0.098 * np.array([np.cos(angle).sum(), 0.0, np.sin(angle).sum()])
    assert np.abs(tips[1] - expected).max() < 1e-5
    assert np.abs(sw.flex.rod_forces(sim, rod).numpy()[1]).max() < 1e-3
