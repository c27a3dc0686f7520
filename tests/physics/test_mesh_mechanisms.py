"""Meshes on bodies of mechanisms: one step against dense algebra, momentum, energy, pendulums, several meshes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import simwarp as sw
from simwarp.core.types import WORLD
from tests.physics.mesh_models import (
    RUBBER,
    SIZE,
    DenseStep,
    energy,
    momenta,
    node_masses,
    own_bodies,
    set_motion,
    settle,
    simulation,
)

NYLON = sw.flex.Elastic(young=2e7, poisson=0.3, density=1100.0, damping_time=1e-3)
STIFF = sw.flex.Elastic(young=3e6, poisson=0.3, density=1200.0)
TURN = Rotation.from_rotvec([0.4, -0.7, 0.3])


def link(builder, name, at, mass=0.5):
    """A body of three different moments of inertia, turned."""
    return builder.add_body(
        name, mass=mass, inertia=(2e-3 * mass, 3e-3 * mass, 4e-3 * mass), pose=sw.pose(at, TURN.as_quat())
    )


def sheet(side=0.2, cells=3):
    """A square of triangles in its plane, and the nodes of one of its sides."""
    grid = np.linspace(0.0, side, cells + 1)
    points = np.array([(x, y, 0.0) for x in grid for y in grid])
    triangles = []
    for i in range(cells):
        for j in range(cells):
            a = i * (cells + 1) + j
            b = a + cells + 1
            triangles += [(a, b, b + 1), (a, b + 1, a + 1)]
    return points, np.array(triangles, np.int32), list(range(cells + 1))


def chain(gravity=(0.3, -0.2, -9.81), *, floating=False, double=False, hook=False):
    """Three hinged bodies; on the first a sheet, on the second two blocks, a third on the last, of tetrahedra; with a
    hook a weight hangs on a node of that one; a free block beside them.
    """
    builder = sw.ModelBuilder(gravity=gravity)
    bodies = [link(builder, f"link{k}", (0.3 * k, 0.0, 1.0), 0.4 + 0.2 * k) for k in range(3)]
    if not floating:
        builder.add_joint_spherical("root", WORLD, bodies[0], anchor=(-0.1, 0.05, 1.0))
    builder.add_joint_revolute("knee", bodies[0], bodies[1], anchor=(0.15, 0.0, 1.0), axis=(0.0, 1.0, 0.3))
    builder.add_joint_revolute("ankle", bodies[1], bodies[2], anchor=(0.45, 0.0, 1.0), axis=(0.0, 0.2, 1.0))
    points, triangles, side = sheet()
    builder.add_shell(
        "flag", points, triangles, thickness=2e-3, material=NYLON, glue={"link0": side}, double=double,
        pose=sw.pose((0.0, 0.1, 1.0), TURN.as_quat()),
    )  # fmt: skip
    box = sw.flex.box(SIZE, (2, 2, 2))
    builder.add_solid_mesh("upper", box, material=RUBBER, glue={"link1": "z_min"}, pose=sw.pose((0.3, 0.0, 1.1)))
    builder.add_solid_mesh(
        "lower", box, material=STIFF, glue={"link1": "z_max"}, pose=sw.pose((0.3, 0.0, 0.9), TURN.as_quat())
    )
    pyramid = sw.flex.box(SIZE, (2, 1, 2), elements="tetrahedra")
    last = builder.add_solid_mesh(
        "foot", pyramid, material=RUBBER, glue={"link2": "x_min"}, pose=sw.pose((0.7, 0.0, 1.0))
    )
    builder.add_solid_mesh("loose", box, material=RUBBER, pose=sw.pose((0.0, -1.0, 1.0), TURN.as_quat()))
    held = []
    if hook:
        node = int(np.flatnonzero(np.isclose(last.points, (0.06, 0.05, -0.04)).all(axis=1))[0])
        at = last.places[node]
        weight = link(builder, "weight", at - (0.0, 0.0, 0.05), 0.3)
        builder.add_joint_spherical("hook", last.bodies[node], weight, anchor=tuple(at))
        held.append(last.bodies[node])
    return builder, held


def disturb(sim, held=(), seed=4, size=2e-3):
    """Displaces all nodes but some, at rest."""
    nodes = [b for mesh in sim.model.builder.flexible_meshes for b in own_bodies(mesh) if b not in held]
    x = sim.state.body_x.numpy().copy()
    x[0, nodes] += size * np.random.default_rng(seed).uniform(-1.0, 1.0, (len(nodes), 3))
    set_motion(sim, x=x)


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("hook", [False, True])
def test_a_step_of_a_mechanism_with_meshes_is_that_of_dense_algebra(hook, floating, double):
    """From rest, with all nodes displaced: no velocity makes its own forces, and joints are exact."""
    builder, held = chain(floating=floating, double=double, hook=hook)
    sim = simulation(builder)
    disturb(sim, held)
    lin, ang = DenseStep(sim).solve()
    sim.step()
    v, omega = sim.state.body_v.numpy()[0], sim.state.body_omega.numpy()[0]
    # float32 elements of a matrix whose entries differ by a hundred
    assert np.abs(v - lin).max() < 1e-5 * np.abs(lin).max()
    assert np.abs(omega - ang).max() < 1e-5 * np.abs(ang).max()


def spinning(sim, spin, drift=(0.0, 0.0, 0.0)):
    """Sets all bodies moving as one rigid body about the first, with its middle link turning faster."""
    v, omega = sim.state.body_v.numpy(), sim.state.body_omega.numpy()
    x = sim.state.body_x.numpy()[0]
    v[0] = np.cross(spin, x - x[0]) + drift
    links = [body for body, name in enumerate(sim.model.body_names) if name.startswith("link")]
    omega[0, links] = spin
    set_motion(sim, v=v, omega=omega)


@pytest.mark.parametrize("damping", [0.1, 1.0])
def test_a_floating_mechanism_with_meshes_keeps_its_momenta(damping):
    """A second of tumbling about hinges, with waves in all meshes: linear momentum to rounding. Levers change within a
    step by h v, so the angular one has an error of the step's order, of vibrations alone.
    """
    found = {}
    for dt in (1e-3, 5e-4):
        sim = simulation(chain((0.0, 0.0, 0.0), floating=True)[0], dt, damping=damping)
        disturb(sim)
        spinning(sim, np.array([2.0, -1.0, 3.0]), (0.3, 0.2, -0.1))
        start, before = momenta(sim), energy(sim)
        worst = np.zeros(2)
        for _ in range(20):
            sim.step(round(0.05 / dt))
            now = momenta(sim)
            worst = np.maximum(worst, [np.abs(b - a).max() / np.abs(a).max() for a, b in zip(start, now, strict=True)])
            assert energy(sim) < before * (1.0 + 1e-4)
        assert worst[0] < 1e-6
        found[dt] = worst[1]
    assert found[1e-3] < 1e-4
    assert found[5e-4] < 0.7 * found[1e-3]


def pendulum(dt, material, damping=0.1, **options):
    """A block on an arm that hangs on a hinge along y at the origin, along x at the start."""
    builder = sw.ModelBuilder()
    arm = builder.add_body("arm", mass=0.2, inertia=(1e-3, 1e-3, 1e-3), pose=sw.pose((0.1, 0.0, 0.0)))
    builder.add_joint_revolute("hinge", WORLD, arm, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0))
    box = sw.flex.box((0.2, 0.06, 0.06), (4, 1, 1))
    mesh = builder.add_solid_mesh(
        "bob", box, material=material, glue={arm: "x_min"}, pose=sw.pose((0.3, 0.0, 0.0)), **options
    )
    return simulation(builder, dt, damping=damping), mesh


def test_a_bob_of_stiff_rubber_swings_as_a_rigid_one():
    """Period of the compound pendulum of these masses at 0.1 rad, 1 + a²/16: what the bob gives, its sag of 2e-5 of
    the length, and the step's (h ω)² / 24 = 1e-6 are below 1e-4.
    """
    stiff = sw.flex.Rubber(young=1e7, poisson=0.4, density=1000.0)
    sim, mesh = pendulum(1e-3, stiff)
    mass, x = node_masses(sim), sim.state.body_x.numpy()[0].copy()
    inertia = 1e-3 + float(mass @ (x[:, 0] ** 2 + x[:, 2] ** 2))
    turn = Rotation.from_rotvec([0.0, 0.5 * np.pi - 0.1, 0.0])
    rot = sim.state.body_rot.numpy()
    rot[0, 0] = turn.as_quat()
    sim.state.body_rot.assign(rot)
    set_motion(sim, x=x @ turn.as_matrix().T)
    angle = []
    for _ in range(6000):
        sim.step()
        end = sw.flex.mesh_positions(sim, mesh).numpy()[0, -1]
        angle.append(np.arctan2(-end[0], -end[2]))
    angle = np.array(angle) - 0.5 * (np.max(angle) + np.min(angle))
    rises = [k + angle[k] / (angle[k] - angle[k + 1]) for k in range(5999) if angle[k] <= 0.0 < angle[k + 1]]
    period = 1e-3 * np.mean(np.diff(rises))
    expected = 2.0 * np.pi * np.sqrt(inertia / (9.81 * float(mass @ x[:, 0]))) * (1.0 + 0.1**2 / 16.0)
    assert period == pytest.approx(expected, rel=1e-4)
    assert angle.max() == pytest.approx(0.1, rel=2e-3)  # nothing brakes it


@pytest.mark.parametrize(("damping", "order"), [(1.0, 1), (0.0, 2)])
def test_order_under_refinement(damping, order):
    """A soft bob let go from the side, its corner after 0.3 s against a finer step. Velocities belong to the middle of
    a step: the one before the start is half a step of the acceleration there away from rest.
    """
    soft = sw.flex.Rubber(young=1e5, poisson=0.4, density=1000.0)
    short, _ = pendulum(1e-6, soft, double=True)
    short.step()
    start = [array.numpy() / 1e-6 for array in (short.state.body_v, short.state.body_omega)]

    def corner(dt):
        sim, mesh = pendulum(dt, soft, damping, double=True)
        set_motion(sim, v=-0.5 * dt * start[0], omega=-0.5 * dt * start[1])
        sim.step(round(0.3 / dt))
        return sw.flex.mesh_positions(sim, mesh).numpy()[0, -1]

    exact = corner(2.5e-5)
    errors = [float(np.linalg.norm(corner(dt) - exact)) for dt in (1e-3, 5e-4)]
    # the finer step's own error is a 20th of the smaller one, of first order
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.15


def test_where_a_glued_mesh_rests_does_not_depend_on_which_body_holds_it():
    """Fixed in the world, glued to a body that is welded to it, or to one welded to that: 1e-8 m of a sag of 14 mm, of
    which a settling speed of 1e-8 m/s is left.
    """
    damped = sw.flex.Rubber(young=1e5, poisson=0.4, density=1000.0, damping_time=2e-3)
    found = []
    for held in ("world", "one", "two"):
        builder = sw.ModelBuilder()
        one, two = link(builder, "one", (0.0, 0.0, 0.0)), link(builder, "two", (0.05, 0.1, 0.02))
        builder.add_joint_fixed("weld", WORLD, one)
        builder.add_joint_fixed("next", one, two)
        options = {"fixed": "x_min"} if held == "world" else {"glue": {held: "x_min"}}
        box = sw.flex.box((0.12, 0.05, 0.05), (3, 1, 1))
        mesh = builder.add_solid_mesh("arm", box, material=damped, pose=sw.pose((0.06, 0.0, 0.0)), **options)
        sim = simulation(builder, 2e-3, damping=1.0)
        assert settle(sim, mesh, still=1e-8) < 1e-8
        found.append(sw.flex.mesh_positions(sim, mesh).numpy()[0])
    assert found[0][-1, 2] < 0.025 - 0.01
    for other in found[1:]:
        assert np.abs(other - found[0]).max() < 1e-8


@pytest.mark.parametrize("double", [False, True])
def test_two_meshes_that_touch_move_as_their_forces_say(double):
    """Blocks on bodies of two mechanisms meet at 1 m/s. The velocities after the step are those of dense algebra under
    the contact forces that it reports, no node approaches another that it pushes, and nothing pulls.
    """
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    one, two = link(builder, "one", (0.0, 0.0, 0.0)), link(builder, "two", (0.0, 0.0, 0.4))
    arm = link(builder, "arm", (0.2, 0.0, 0.45))
    builder.add_joint_revolute("hinge", two, arm, axis=(0.0, 1.0, 0.2), anchor=(0.1, 0.0, 0.42))
    box, surface = sw.flex.box(SIZE, (2, 2, 2)), sw.Material(friction=0.5)
    options = {"material": RUBBER, "radius": 3e-3, "surface": surface, "double": double}
    lower = builder.add_solid_mesh("lower", box, glue={one: "z_min"}, pose=sw.pose((0.0, 0.0, 0.1)), **options)
    upper = builder.add_solid_mesh("upper", box, glue={two: "z_max"}, pose=sw.pose((0.0, 0.0, 0.1865)), **options)
    sim = simulation(builder)
    v = sim.state.body_v.numpy().copy()
    v[0, [one, *own_bodies(lower)]] = (0.1, 0.05, 1.0)
    set_motion(sim, v=v)
    start, dense = momenta(sim), DenseStep(sim)
    x = sim.state.body_x.numpy()[0].copy()
    sim.step()
    force = sim.contacts.body_contact_force.numpy()[0].astype(float)
    for body, k in dense.first.items():
        dense.impulse[k : k + 3] += dense.h * force[body]
    lin, _ = dense.solve()
    after = sim.state.body_v.numpy()[0]
    # float32 velocities of 1 m/s
    assert np.abs(after - v[0] - lin).max() < 1e-6
    now = momenta(sim)
    assert np.abs(now[0] - start[0]).max() < 1e-6 * np.abs(start[0]).max()
    # nodes have no rotation that could take the friction's lever, the distance of their centres
    turned = dense.h * np.cross(x, force).sum(axis=0)
    assert np.abs(turned).max() < dense.h * 7e-3 * np.abs(force[:, :2]).sum()
    assert np.abs(now[1] - start[1] - turned).max() < 1e-6 * np.abs(start[0]).max()
    pushed = [[body for body in own_bodies(mesh) if np.abs(force[body]).max() > 0.0] for mesh in (lower, upper)]
    pairs = [(a, b) for a in pushed[0] for b in pushed[1] if np.abs(x[a, :2] - x[b, :2]).max() < 1e-3]
    assert len(pairs) == 9
    for a, b in pairs:
        assert np.abs(force[a] + force[b]).max() < 1e-6
        assert force[b, 2] > 0.0
        # a gap of half a millimetre is there before the step, and may close within it
        assert after[b, 2] - after[a, 2] > -0.5 - 1e-3


@pytest.mark.slow
def test_rods_and_meshes_in_one_model():
    """A rod on the mechanism's last body, a block on the rod's end, all falling: momentum to rounding, and no energy
    is made. Kernels with both are ones of their own.
    """
    gravity = np.array([0.3, -0.2, -9.81])
    builder, _ = chain(tuple(gravity), floating=True)
    material = sw.flex.Elastic(young=1e7, density=1000.0)
    rod = builder.add_rod(
        "rod", [(1.0, 0.0, 1.0), (2.0, 0.0, 1.0)], elements=4, section=sw.flex.Round(diameter=0.02), material=material,
        start=sw.flex.Clamp("link2"),
    )  # fmt: skip
    box = sw.flex.box(SIZE, (2, 2, 2))
    tip = builder.add_solid_mesh(
        "tip", box, material=RUBBER, glue={rod.bodies[-1]: "x_min"}, pose=sw.pose((2.06, 0.0, 1.0))
    )
    sim = simulation(builder)
    start, total = energy(sim), node_masses(sim).sum()
    for k in range(20):
        sim.step(50)
        assert np.abs(momenta(sim)[0] - gravity * total * 0.05 * (k + 1)).max() < 1e-6 * total * 9.81
        # velocities of half a step before: falling makes them lag by h/2 g, which the sum sees as h/2 of the power
        lag = 0.5 * sim.dt * total * gravity @ gravity * 0.05 * (k + 1)
        assert energy(sim) < start + 1e-4 * abs(start)
        assert energy(sim) > start - 1.01 * lag - 0.01 * abs(start)
    assert np.isfinite(sw.flex.mesh_positions(sim, tip).numpy()).all()


def test_joints_carry_what_hangs_on_them():
    """A block below the second of two welded bodies, and a weight on one of its lowest nodes: forces are weights, the
    torque about the first weld is that of all of them, to 1e-5 of what is left of the motion.
    """
    builder = sw.ModelBuilder()
    one, two = link(builder, "one", (0.0, 0.0, 1.0)), link(builder, "two", (0.3, 0.0, 1.0))
    builder.add_joint_fixed("root", WORLD, one, anchor=(0.0, 0.0, 1.0))
    builder.add_joint_fixed("next", one, two, anchor=(0.3, 0.0, 1.0))
    damped = sw.flex.Rubber(young=1e5, poisson=0.4, density=1000.0, damping_time=2e-3)
    box = sw.flex.box(SIZE, (2, 2, 2))
    mesh = builder.add_solid_mesh("block", box, material=damped, glue={two: "z_max"}, pose=sw.pose((0.3, 0.0, 0.9)))
    node = int(np.flatnonzero(np.isclose(mesh.points, (0.0, 0.0, -0.04)).all(axis=1))[0])
    at = mesh.places[node]
    weight = link(builder, "weight", at - (0.0, 0.0, 0.05), 0.2)
    builder.add_joint_spherical("hook", mesh.bodies[node], weight, anchor=tuple(at))
    flex = sw.flex.Options(numerical_damping=1.0)
    sim = sw.Simulation(builder.finalize(1, "cpu"), 1e-3, flex=flex, joint_reactions=True)
    settle(sim, mesh, still=1e-7)
    mass, x = node_masses(sim), sim.state.body_x.numpy()[0]
    hanging = [weight, *own_bodies(mesh)]
    loads = 9.81 * np.array([mass.sum(), mass[[two, *hanging]].sum(), mass[weight]])
    force = sim.diagnostics.joint_reaction_force.numpy()[0].astype(float)
    assert np.abs(force - np.outer(loads, (0.0, 0.0, 1.0))).max() < 1e-5 * loads[0]
    turning = 9.81 * np.cross(x - (0.0, 0.0, 1.0), np.outer(mass, (0.0, 0.0, 1.0))).sum(axis=0)
    torque = sim.diagnostics.joint_reaction_torque.numpy()[0].astype(float)
    assert np.abs(torque[0] - turning).max() < 1e-5 * np.abs(turning).max()
