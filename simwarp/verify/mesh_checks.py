"""Flexible meshes, solids and sheets, against beam, plate and contact theory, and laws; part of the scene "flexible".

Tolerances are those of the elements: hexahedra bend as beams do to 1 % of their length, triangles at 24 cells per side
to 4 %; what a bound adds to that stands beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, Material, pose
from simwarp.flex import Elastic, FlexibleMesh, Options, Rubber, VolumeMesh, box, mesh_positions, mesh_stress
from simwarp.model.builder import ModelBuilder
from simwarp.simulation.simulation import Simulation
from simwarp.verify.check_result import CheckResult, below, near

Array: TypeAlias = npt.NDArray[np.floating]

NAME: Final = "flexible"
WEIGHTLESS: Final = (0.0, 0.0, 0.0)
DAMPED: Final = Options(numerical_damping=1.0)
GRAVITY: Final = 9.81
BEAM_FIRST: Final = 1.87510407
"""The first root of cosh β cos β = -1, of a cantilever (Euler and Bernoulli)."""


def meshes(device: str = "cpu") -> list[CheckResult]:
    """Patch, cantilevers, plate, sphere under pressure, Hertz, weight, momentum, spin, a pendulum."""
    parts: tuple[Callable[[str], list[CheckResult]], ...] = (
        patch, cantilever, beam_frequency, plate, inflated_sphere, ball_on_block, block_at_rest, momentum, spin, bob,
    )  # fmt: skip
    return [row for part in parts for row in part(device)]


def settled(sim: Simulation, mesh: FlexibleMesh, most: int = 4000, still: float = 1e-8) -> None:
    """Steps until nodes move slower than this [m/s], with a share of their velocity taken every few steps."""
    nodes = [mesh.bodies[node] for node in mesh.nodes]
    for _ in range(most // 20):
        sim.step(20)
        v = sim.state.body_v.numpy().copy()
        if float(np.abs(v[:, nodes]).max()) < still:
            return
        v[:, nodes] *= 0.85
        sim.state.body_v.assign(v)


def pull(sim: Simulation, bodies: Sequence[int], forces: Array) -> None:
    """Forces (bodies, 3) on bodies [N]."""
    given = np.zeros((1, sim.model.body_count, 3), np.float32)
    given[0, list(bodies)] = forces
    sim.control.body_force.assign(given)


def patch(device: str = "cpu") -> list[CheckResult]:
    """Hexahedra of uneven shapes without lateral contraction under an even pull: all strains are σ / E. What is left of
    1e-5 is the square of the strain of 1e-5, rounding of float32 elements and what still moves: 1e-4 of it.
    """
    cube = box((1.0, 1.0, 1.0), (3, 3, 3))
    points = cube.points.copy()
    inside = (np.abs(points) < 0.49).all(axis=1)
    points[inside] += 0.15 * np.random.default_rng(0).uniform(-0.5, 0.5, (int(inside.sum()), 3))
    uneven = VolumeMesh(points=points, elements=cube.elements, sets=cube.sets, name="patch")
    builder = ModelBuilder(WEIGHTLESS)
    material = Elastic(young=1e6, poisson=0.0, density=1000.0, damping_time=0.02)
    mesh = builder.add_solid_mesh("patch", uneven, material=material, fixed="x_min", double=True)
    sim = Simulation(builder.finalize(1, device), 2e-3, flex=DAMPED)
    end = np.flatnonzero(np.isclose(points[:, 0], 0.5))
    edges = np.isclose(np.abs(points[end, 1:]), 0.5).sum(axis=1)
    stress = 10.0
    pull(sim, [mesh.bodies[node] for node in end], np.outer(stress / 9.0 * 0.5**edges, [1.0, 0.0, 0.0]))
    settled(sim, mesh, still=1e-9)
    moved = mesh_positions(sim, mesh).numpy()[0] - points
    exact = np.outer(stress / 1e6 * (points[:, 0] + 0.5), [1.0, 0.0, 0.0])
    return [below(NAME, "patch of uneven hexahedra: error of strains", float(np.abs(moved - exact).max()), 1e-9)]


def cantilever(device: str = "cpu") -> list[CheckResult]:
    """A tip load on 8 x 1 x 1 hexahedra over PL³/3EI + PL/kGA, k by Cowper (1966): .95 to 1. Incompatible modes bend as
    beams; the clamp, whose nodes cannot contract, and elements as long as the beam is thick cost 2 %.
    """
    length, side, load = 0.8, 0.1, 2.0
    rows = []
    for poisson, expected in ((0.3, 0.975), (0.0, 0.975)):
        builder = ModelBuilder(WEIGHTLESS)
        material = Elastic(young=1e8, poisson=poisson, density=1000.0, damping_time=0.02)
        beam = box((length, side, side), (8, 1, 1))
        mesh = builder.add_solid_mesh("beam", beam, material=material, fixed="x_min", double=True)
        sim = Simulation(builder.finalize(1, device), 5e-3, flex=DAMPED)
        end = [mesh.bodies[node] for node in np.flatnonzero(np.isclose(mesh.points[:, 0], 0.5 * length))]
        pull(sim, end, np.tile([0.0, 0.0, load / len(end)], (len(end), 1)))
        settled(sim, mesh)
        shear = 1e8 / 2.0 / (1.0 + poisson) * 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson)
        theory = load * length**3 / (3.0 * 1e8 * side**4 / 12.0) + load * length / (shear * side**2)
        tip = float(sim.state.body_x.numpy()[0, end, 2].mean())
        title = f"cantilever of 8 hexahedra, ν {poisson}: tip over Timoshenko's"
        rows.append(near(NAME, title, expected, tip / theory, 0.025))
    return rows


def struck(sim: Simulation, mesh: FlexibleMesh, length: float, seconds: float) -> tuple[float, float]:
    """Frequency [Hz] and decay [1/s] of the last node after nodes were struck with a cantilever's first wave."""
    x = BEAM_FIRST * (mesh.points[list(mesh.nodes), 0] / length + 0.5)
    ratio = (math.cosh(BEAM_FIRST) + math.cos(BEAM_FIRST)) / (math.sinh(BEAM_FIRST) + math.sin(BEAM_FIRST))
    v = np.zeros((1, sim.model.body_count, 3), np.float32)
    shape = np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))
    v[0, [mesh.bodies[node] for node in mesh.nodes], 2] = 0.005 * shape
    sim.state.body_v.assign(v)
    end = mesh.bodies[-1]
    start = float(sim.body_position(end)[2])
    height = []
    for _ in range(round(seconds / sim.dt)):
        sim.step()
        height.append(float(sim.body_position(end)[2]) - start)
    h = np.array(height)
    rises = [k + h[k] / (h[k] - h[k + 1]) for k in range(len(h) - 1) if h[k] <= 0.0 < h[k + 1]]
    peaks = np.array([k for k in range(1, len(h) - 1) if h[k - 1] < h[k] >= h[k + 1] and h[k] > 0.0])
    decay = -float(np.polyfit(peaks * sim.dt, np.log(h[peaks]), 1)[0])
    return 1.0 / (float(np.mean(np.diff(rises))) * sim.dt), decay


def beam_frequency(device: str = "cpu") -> list[CheckResult]:
    """The first wave of a cantilever of 16 x 2 x 2 hexahedra: Euler and Bernoulli's, lowered by shear and the turning
    of sections by (r/L)² 4.648 (1 + 2.4) / 2 = 1 % (Rayleigh's quotient with Timoshenko's terms), and by 16 cells by
    0.1 %. It decays by ζ h ω² / 2, within 3 %: other waves swing along.
    """
    length, side, young, density, dt = 0.8, 0.1, 1e7, 1000.0, 1e-3
    builder = ModelBuilder(WEIGHTLESS)
    material = Elastic(young=young, poisson=0.0, density=density)
    mesh = builder.add_solid_mesh(
        "beam", box((length, side, side), (16, 2, 2)), material=material, fixed="x_min", double=True
    )
    sim = Simulation(builder.finalize(1, device), dt, flex=DAMPED)
    slender = BEAM_FIRST**2 * math.sqrt(young * side**2 / 12.0 / density) / length**2 / (2.0 * math.pi)
    expected = slender * (1.0 - 0.5 * 4.648 * 3.4 * side**2 / 12.0 / length**2)
    got, decay = struck(sim, mesh, length, 8.0 / slender)
    law = 0.5 * dt * (2.0 * math.pi * got) ** 2
    return [
        near(NAME, "cantilever of hexahedra: frequency [Hz]", expected, got, 5e-3 * expected),
        near(NAME, "the same, damping 1: decay [1/s]", law, decay, 0.03 * law),
    ]


def sheet(cells: int, side: float) -> tuple[Array, list[tuple[int, int, int]]]:
    """Nodes and triangles of a square, whose diagonals all point one way, centred."""
    along = np.linspace(-0.5 * side, 0.5 * side, cells + 1)
    points = np.array([(x, y, 0.0) for x in along for y in along])
    triangles = []
    for i in range(cells):
        for j in range(cells):
            a = i * (cells + 1) + j
            b = a + cells + 1
            triangles += [(a, b, b + 1), (a, b + 1, a + 1)]
    return points, triangles


def plate(device: str = "cpu") -> list[CheckResult]:
    """A square plate on simple supports under a pressure: 0.00406235 q L⁴ / D in its middle (Timoshenko and
    Woinowsky-Krieger 1959, table 8), within 4 % at 24 cells per side.
    """
    cells, thickness, young, poisson, load = 24, 0.01, 1e8, 0.3, 1.0
    points, triangles = sheet(cells, 1.0)
    edge = np.flatnonzero(np.isclose(np.abs(points[:, :2]), 0.5).any(axis=1))
    builder = ModelBuilder(WEIGHTLESS)
    material = Elastic(young=young, poisson=poisson, density=1000.0, damping_time=0.02)
    mesh = builder.add_shell(
        "plate", points, triangles, thickness=thickness, material=material, fixed=edge, pressure=load, double=True
    )
    sim = Simulation(builder.finalize(1, device), 0.01, flex=DAMPED)
    settled(sim, mesh, 600, 1e-7)
    middle = float(np.abs(mesh_positions(sim, mesh).numpy()[0, :, 2]).max())
    got = middle * young * thickness**3 / 12.0 / (1.0 - poisson**2) / load
    return [near(NAME, "supported plate: sag over q L⁴ / D", 0.00406235, got, 0.04 * 0.00406235)]


def geodesic(radius: float) -> tuple[Array, list[tuple[int, int, int]]]:
    """Nodes and triangles of a sphere: an icosahedron whose sides are halved twice."""
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    points = [np.array(p) for p in (
        (-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0), (0, -1, golden), (0, 1, golden),
        (0, -1, -golden), (0, 1, -golden), (golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1),
    )]  # fmt: skip
    faces = [
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
        (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7),
        (9, 8, 1),
    ]  # fmt: skip
    for _ in range(2):
        middles: dict[tuple[int, int], int] = {}
        halved = []
        for face in faces:
            between = []
            for a, b in ((face[0], face[1]), (face[1], face[2]), (face[2], face[0])):
                side = min(a, b), max(a, b)
                if side not in middles:
                    middles[side] = len(points)
                    points.append((points[a] + points[b]) / 2.0)
                between.append(middles[side])
            (a, b, c), (p, q, r) = face, between
            halved += [(a, p, r), (p, b, q), (r, q, c), (p, q, r)]
        points = [each / np.linalg.norm(each) for each in points]
        faces = halved
    return radius * np.array(points), faces


def inflated_sphere(device: str = "cpu") -> list[CheckResult]:
    """A thin sphere under pressure: stress p r / 2t, radius p r² (1 - ν) / 2 E t wider; 2 %, as its 320 triangles are
    flat and touch the sphere at their corners.
    """
    radius, thickness, young, poisson, pressure = 0.5, 5e-3, 1e6, 0.3, 10.0
    points, triangles = geodesic(radius)
    builder = ModelBuilder(WEIGHTLESS)
    material = Elastic(young=young, poisson=poisson, density=1000.0, damping_time=2e-3)
    mesh = builder.add_shell("ball", points, triangles, thickness=thickness, material=material, pressure=pressure)
    sim = Simulation(builder.finalize(1, device), 2e-3, flex=DAMPED)
    settled(sim, mesh, still=1e-7)
    x = mesh_positions(sim, mesh).numpy()[0]
    grown = float(np.linalg.norm(x - x.mean(axis=0), axis=1).mean()) - radius
    stress = float(mesh_stress(sim, mesh).numpy().mean())
    wider = pressure * radius**2 * (1.0 - poisson) / (2.0 * young * thickness)
    tight = pressure * radius / (2.0 * thickness)
    return [
        near(NAME, "sphere under pressure: wider by [m]", wider, grown, 0.02 * wider),
        near(NAME, "sphere under pressure: stress [Pa]", tight, stress, 0.02 * tight),
    ]


def graded_block(fine: float, steps: int, depth: float) -> VolumeMesh:
    """A block whose cells are small below the middle of its upper side, at z = 0."""
    half = [*np.linspace(0.0, fine, steps + 1), 1.7 * fine, 3.5 * fine, 8.0 * fine]
    along = np.array([-x for x in half[:0:-1]] + half)
    down = -depth * np.array([1.0, 0.55, 0.28, 0.15, 0.075, 0.03, 0.0])
    x, y, z = len(along) - 1, len(along) - 1, len(down) - 1
    cells = box((float(x), float(y), float(z)), (x, y, z))
    place = np.round(cells.points + 0.5 * np.array([x, y, z])).astype(int)
    points = np.stack([along[place[:, 0]], along[place[:, 1]], down[place[:, 2]]], axis=1)
    return VolumeMesh(points=points, elements=cells.elements, sets=cells.sets, name="graded block")


def layer_force(depth: float, radius: float, thickness: float, young: float, poisson: float) -> float:
    """Force that presses a ball into a layer that is bonded below: Hertz's with the layer's terms (Dimitriadis et al.,
    Biophysical Journal 82, 2002, equation 12) [N].
    """
    share, pi = math.sqrt(radius * depth) / thickness, math.pi
    a = -(1.2876 - 1.4678 * poisson + 1.3442 * poisson**2) / (1.0 - poisson)
    b = (0.6387 - 1.0277 * poisson + 1.5164 * poisson**2) / (1.0 - poisson)
    layer = 1.0 - 2.0 * a / pi * share + 4.0 * a**2 / pi**2 * share**2
    layer -= 8.0 / pi**3 * (a**3 + 4.0 * pi**2 / 15.0 * b) * share**3
    layer += 16.0 * a / pi**4 * (a**3 + 3.0 * pi**2 / 5.0 * b) * share**4
    return 4.0 / 3.0 * young / (1.0 - poisson**2) * math.sqrt(radius) * depth**1.5 * layer


def ball_on_block(device: str = "cpu") -> list[CheckResult]:
    """A rigid ball pressed into a block: by 3 mm under the force that theory has for it; 7 % (10 % of the force), as
    nodes are 5 mm apart under a contact of 12 mm.
    """
    ball_radius, node, thickness, young, poisson, depth = 0.05, 1e-4, 0.1, 1e5, 0.3, 3e-3
    builder = ModelBuilder(WEIGHTLESS)
    smooth = Material(friction=0.0)
    material = Elastic(young=young, poisson=poisson, density=1000.0)
    block = graded_block(0.012, 2, thickness)
    builder.add_solid_mesh("block", block, material=material, radius=node, surface=smooth, fixed="z_min")
    ball = builder.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0), pose=pose((0.0, 0.0, ball_radius + node)))
    builder.add_shape_sphere(ball, radius=ball_radius, material=smooth)
    builder.add_joint_prismatic("guide", WORLD, ball, axis=(0.0, 0.0, 1.0))
    sim = Simulation(builder.finalize(1, device), 0.01, flex=DAMPED)
    force = layer_force(depth, ball_radius + node, thickness, young, poisson)
    pull(sim, [ball], np.array([[0.0, 0.0, -force]]))
    sim.step(150)
    sunk = ball_radius + node - float(sim.body_position(ball)[2])
    return [near(NAME, "ball pressed into a block: depth by Hertz [m]", depth, sunk, 0.07 * depth)]


def block_at_rest(device: str = "cpu") -> list[CheckResult]:
    """A block of rubber on a slope of 20 %, friction 0.5: the floor's force is its weight within 1e-3, and in a second
    it creeps by less than a micrometre.
    """
    angle = math.atan(0.2)
    builder = ModelBuilder((GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle)))
    builder.add_shape_plane(material=Material(friction=0.5))
    rubber = Rubber(young=1e5, poisson=0.4, density=1000.0, damping_time=2e-3)
    block = box((0.12, 0.1, 0.08), (2, 2, 2))
    builder.add_solid_mesh("block", block, material=rubber, radius=2e-3, pose=pose((0.0, 0.0, 0.042)))
    sim = Simulation(builder.finalize(1, device), 1e-3)
    sim.step(2000)
    before = sim.state.body_x.numpy().copy()
    sim.step(1000)
    creep = float(np.abs(sim.state.body_x.numpy() - before).max())
    weight = GRAVITY * float(sim.model.body_mass.numpy()[0].sum())
    force = sim.contacts.body_contact_force.numpy()[0].sum(axis=0)
    return [
        near(NAME, "block on a slope: force of the floor [N]", weight, float(np.linalg.norm(force)), 1e-3 * weight),
        below(NAME, "block on a slope: creep in a second [m]", creep, 1e-6),
    ]


def momentum(device: str = "cpu") -> list[CheckResult]:
    """Two hinged bodies, a block on one, a sheet on the other, tumbling in free space for a second: momentum to the
    rounding of float32 velocities, 1e-6, as one step's sums cancel.
    """
    builder = ModelBuilder(WEIGHTLESS)
    bodies = [
        builder.add_body(f"body{k}", mass=0.5, inertia=(1e-3, 1.5e-3, 2e-3), pose=pose((0.3 * k, 0.0, 0.0)))
        for k in range(2)
    ]
    builder.add_joint_revolute("hinge", *bodies, anchor=(0.15, 0.0, 0.0), axis=(0.0, 1.0, 0.3))
    rubber = Rubber(young=1e5, poisson=0.4, density=1000.0, damping_time=1e-3)
    cells = box((0.12, 0.1, 0.08), (2, 2, 2))
    builder.add_solid_mesh("block", cells, material=rubber, glue={bodies[0]: "z_min"}, pose=pose((0.0, 0.0, 0.1)))
    points, triangles = sheet(3, 0.2)
    nylon = Elastic(young=2e7, density=1100.0)
    side = np.flatnonzero(np.isclose(points[:, 0], -0.1))
    builder.add_shell(
        "flag", points, triangles, thickness=2e-3, material=nylon, glue={bodies[1]: side}, pose=pose((0.45, 0.0, 0.0))
    )
    sim = Simulation(builder.finalize(1, device), 1e-3)
    place, spin_of = sim.state.body_x.numpy()[0], np.array([2.0, -1.0, 3.0])
    v = np.add(np.cross(spin_of, place), (0.3, 0.2, -0.1))[None].astype(np.float32)
    omega = np.zeros(v.shape, np.float32)
    omega[0, bodies] = spin_of
    sim.state.body_v.assign(v)
    sim.state.body_omega.assign(omega)
    mass = sim.model.body_mass.numpy()[0].astype(float)
    start = mass @ v[0].astype(float)
    sim.step(1000)
    change = float(np.abs(mass @ sim.state.body_v.numpy()[0].astype(float) - start).max())
    return [below(NAME, "mechanism with meshes: change of momentum", change / float(np.abs(start).max()), 1e-6)]


def spin(device: str = "cpu") -> list[CheckResult]:
    """A free block of rubber turns once at 20 rad/s: its angular momentum stays within 1e-6, whatever the damping."""
    rows = []
    for damping in (1.0, 0.1):
        builder = ModelBuilder(WEIGHTLESS)
        rubber = Rubber(young=1e5, poisson=0.45, density=1000.0)
        cube = box((0.1, 0.1, 0.1), (2, 2, 2))
        builder.add_solid_mesh("block", cube, material=rubber, omega=(0.0, 0.0, 20.0))
        sim = Simulation(builder.finalize(1, device), 1e-3, flex=Options(numerical_damping=damping))
        mass = sim.model.body_mass.numpy()[0].astype(float)

        def turning(sim: Simulation = sim, mass: Array = mass) -> float:
            x, v = sim.state.body_x.numpy()[0], sim.state.body_v.numpy()[0].astype(float)
            return float(mass @ (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]))

        start = turning()
        sim.step(314)
        rows.append(below(NAME, f"spinning block, damping {damping}: loss of spin", abs(turning() / start - 1.0), 1e-6))
    return rows


def bob(device: str = "cpu") -> list[CheckResult]:
    """An arm with a bob of stiff rubber swings by 0.1 rad as the rigid pendulum of these masses, 1 + a²/16; 1e-3, of
    which what the bob gives is a tenth.
    """
    builder = ModelBuilder((GRAVITY, 0.0, 0.0))
    arm = builder.add_body("arm", mass=0.2, inertia=(1e-3, 1e-3, 1e-3), pose=pose((0.1, 0.0, 0.0)))
    builder.add_joint_revolute("hinge", WORLD, arm, axis=(0.0, 1.0, 0.0), anchor=(0.0, 0.0, 0.0))
    rubber = Rubber(young=1e7, poisson=0.4, density=1000.0)
    mesh = builder.add_solid_mesh(
        "bob", box((0.2, 0.06, 0.06), (4, 1, 1)), material=rubber, glue={arm: "x_min"}, pose=pose((0.3, 0.0, 0.0))
    )
    sim = Simulation(builder.finalize(1, device), 1e-3)
    mass, x = sim.model.body_mass.numpy()[0].astype(float), sim.state.body_x.numpy()[0].copy()
    inertia = 1e-3 + float(mass @ (x[:, 0] ** 2 + x[:, 2] ** 2))
    rate = math.sqrt(GRAVITY * float(mass @ x[:, 0]) / inertia)
    omega = np.zeros((1, len(mass), 3), np.float32)
    omega[0, arm, 1] = swing = 0.1 * rate
    sim.state.body_v.assign(np.cross([0.0, swing, 0.0], x)[None].astype(np.float32))
    sim.state.body_omega.assign(omega)
    sim.measure()
    heights = []
    for _ in range(6000):
        sim.step()
        heights.append(float(sim.body_position(mesh.bodies[-1])[2]) - float(x[-1, 2]))
    h = np.array(heights)
    h -= 0.5 * (h.max() + h.min())
    rises = [k + h[k] / (h[k] - h[k + 1]) for k in range(len(h) - 1) if h[k] <= 0.0 < h[k + 1]]
    expected = 2.0 * math.pi / rate * (1.0 + 0.1**2 / 16.0)
    got = 1e-3 * float(np.mean(np.diff(rises)))
    return [near(NAME, "pendulum with a rubber bob: period [s]", expected, got, 1e-3 * expected)]
