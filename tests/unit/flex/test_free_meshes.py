"""Meshes that move by themselves: a step against dense algebra, and the laws of free bodies."""

import itertools

import numpy as np
import pytest
import warp as wp

from simwarp.meshes.lattices import box_of_hexahedra, box_of_tetrahedra, rectangle_of_triangles
from simwarp.meshes.materials import Elastic, Rubber
from simwarp.meshes.mesh_parts import MeshPart
from tests.unit.flex.free_meshes import FreeMeshes, make_mesh
from tests.unit.flex.loaded_meshes import loads

KINDS = ("tetrahedra", "hexahedra", "triangles")
BOX = (0.1, 0.1, 0.05)


def block(kind, *, cells=(3, 3, 2), young=1e6, damping_time=0.0, fixed=(), double=False, material=Rubber, device="cpu"):
    """A block, or a sheet."""
    made = material(young=young, poisson=0.4, density=1100.0, damping_time=damping_time)
    if kind == "triangles":
        points, elements = rectangle_of_triangles(cells[:2], BOX[:2])
        part = MeshPart(elements=elements, material=made, thickness=2e-3)
    else:
        points, elements = (box_of_tetrahedra if kind == "tetrahedra" else box_of_hexahedra)(cells, BOX)
        part = MeshPart(elements=elements, material=made)
    return make_mesh("block", points, [part], fixed=fixed, double=double, device=device)


def masses(mesh):
    return mesh.tables.node_mass.numpy()[0].astype(float)


def momenta(mesh, sim, world=0):
    """Momentum, and angular momentum about the origin."""
    x, v = sim.node_x.numpy()[world], sim.node_v.numpy()[world].astype(float)
    p = masses(mesh)[:, None] * v
    return p.sum(axis=0), np.cross(x, p).sum(axis=0)


def spun(mesh, spin):
    """Velocities (n, 3) of a rotation about the centre of mass."""
    m = masses(mesh)[:, None]
    return np.cross(spin, mesh.points - (m * mesh.points).sum(axis=0) / m.sum())


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_a_step_is_the_dense_formula(kind, double):
    h, zeta, gravity = 2e-3, 0.15, np.array([0.5, -1.0, -9.81])
    mesh = block(kind, damping_time=1e-3, fixed=[0, 5], double=double)
    sim = FreeMeshes(mesh, 1, h, numerical_damping=zeta, gravity=gravity.tolist(), device="cpu")
    rng = np.random.default_rng(0)
    x = mesh.points + 2e-3 * rng.standard_normal(mesh.points.shape)
    v = rng.standard_normal(x.shape).astype(np.float32)
    v[[0, 5]] = 0.0
    push = rng.standard_normal(x.shape).astype(np.float32)
    sim.node_x.assign(x[None])
    sim.node_v.assign(v[None])
    sim.node_force.assign(push[None])
    forces, matrix, _ = loads(mesh, x, v, h=h, zeta=zeta)
    mass = masses(mesh)
    right = h * (forces + push + mass[:, None] * gravity)
    free = np.setdiff1d(np.arange(x.size), [0, 1, 2, 15, 16, 17])
    dense = (matrix.toarray() + np.diag(np.repeat(mass, 3)))[np.ix_(free, free)]
    change = np.zeros(x.size)
    change[free] = np.linalg.solve(dense, right.reshape(-1)[free])
    change = change.reshape(-1, 3)
    sim.step()
    assert np.abs(sim.node_v.numpy()[0] - v - change).max() < (2e-6 if double else 2e-5) * np.abs(change).max()
    assert np.abs(sim.node_x.numpy()[0] - x - float(np.float32(h)) * sim.node_v.numpy()[0].astype(float)).max() < 1e-15
    assert sim.raised.numpy().tolist() == [0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_free_block_keeps_its_momenta(kind):
    mesh = block(kind)
    sim = FreeMeshes(mesh, 1, 1e-3, gravity=(0.0, 0.0, 0.0), device="cpu")
    sim.node_v.assign((spun(mesh, (3.0, -8.0, 20.0)) + np.array([1.0, 2.0, -3.0]))[None])
    before = momenta(mesh, sim)
    sim.step(314)  # one turn
    after = momenta(mesh, sim)
    mass, size = masses(mesh).sum(), 0.1
    assert np.abs(after[0] - before[0]).max() < 1e-6 * mass * np.linalg.norm((1.0, 2.0, -3.0))
    # About the origin: what the block has by moving along as well
    moved = mass * np.linalg.norm((1.0, 2.0, -3.0)) * (size + 1.2)
    assert np.abs(after[1] - before[1]).max() < 1e-6 * (moved + np.linalg.norm(before[1]))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("zeta", [1.0, 0.1])
def test_numerical_damping_does_not_brake_rotation(kind, zeta):
    mesh = block(kind, young=1e7)
    sim = FreeMeshes(mesh, 1, 1e-3, numerical_damping=zeta, gravity=(0.0, 0.0, 0.0), device="cpu")
    sim.node_v.assign(spun(mesh, (0.0, 0.0, 20.0))[None])
    before = momenta(mesh, sim)[1][2]
    sim.step(300)
    assert momenta(mesh, sim)[1][2] == pytest.approx(before, rel=1e-5)


def energy(mesh, sim, h):
    """Kinetic and, of small displacements, strain energy in the middle of a step, where velocities belong."""
    v = sim.node_v.numpy()[0].astype(float)
    middle = sim.node_x.numpy()[0] - h / 2.0 * v
    forces, _, _ = loads(mesh, middle)
    return ((masses(mesh)[:, None] * v**2).sum() - (forces * (middle - mesh.points)).sum()) / 2.0


@pytest.mark.parametrize("kind", ["tetrahedra", "hexahedra"])
def test_a_stretched_bar_swings_at_its_frequency_and_decays_by_the_law(kind):
    # A bar clamped at one end so that it only stretches: ν = 0, lumped nodes in a row
    length, cells, young, density, h = 1.0, 10, 1e6, 1000.0, 5e-4
    points, elements = (box_of_tetrahedra if kind == "tetrahedra" else box_of_hexahedra)(
        (cells, 1, 1), (length, 0.1, 0.1)
    )  # fmt: skip
    part = MeshPart(elements=elements, material=Elastic(young=young, poisson=0.0, density=density))
    fixed = np.flatnonzero(points[:, 0] == 0.0).tolist()
    for zeta in (1.0, 0.1):
        mesh = make_mesh("bar", points, [part], fixed=fixed, double=True, device="cpu")
        sim = FreeMeshes(mesh, 1, h, numerical_damping=zeta, gravity=(0.0, 0.0, 0.0), device="cpu")
        shape = 1e-4 * np.sin(np.pi * points[:, 0] / 2.0 / length)
        sim.node_x.assign((points + shape[:, None] * (1.0, 0.0, 0.0))[None])
        mode = masses(mesh) * shape
        found = np.zeros(800)
        for index in range(len(found)):
            sim.step()
            found[index] = mode @ (sim.node_x.numpy()[0] - points)[:, 0]
        crossings = np.flatnonzero(found[:-1] * found[1:] < 0.0)
        exact = crossings + found[crossings] / (found[crossings] - found[crossings + 1])
        omega = np.pi / np.mean(np.diff(exact)) / h
        assert omega == pytest.approx(np.pi / 2.0 / length * np.sqrt(young / density), rel=5e-3)
        peaks = np.array([np.abs(found[a:b]).max() for a, b in itertools.pairwise(crossings)])
        decay = -np.polyfit(np.arange(len(peaks)) * np.pi / omega, np.log(peaks), 1)[0]
        assert decay == pytest.approx(zeta * h * omega**2 / 2.0, rel=0.03)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("zeta", [0.0, 0.1, 1.0])
def test_a_vibration_never_gains_energy(kind, zeta):
    h = 1e-3
    mesh = block(kind, young=1e5, cells=(2, 2, 1), double=True)
    sim = FreeMeshes(mesh, 1, h, numerical_damping=zeta, gravity=(0.0, 0.0, 0.0), device="cpu")
    rng = np.random.default_rng(4)
    sim.node_v.assign(1e-4 * rng.standard_normal((1, *mesh.points.shape)))
    found = [energy(mesh, sim, h)]
    for _ in range(50):
        sim.step(6)
        found.append(energy(mesh, sim, h))
    if zeta == 0.0:
        assert np.array(found) == pytest.approx(found[0], rel=1e-3)
    else:
        assert max(found) <= found[0] * (1.0 + 1e-4)
        assert found[-1] < 0.9 * found[0]


@pytest.mark.parametrize("kind", KINDS)
def test_worlds_do_not_touch_each_other(kind):
    mesh = block(kind)
    rng = np.random.default_rng(1)
    v = 0.1 * rng.standard_normal((3, *mesh.points.shape)).astype(np.float32)
    many = FreeMeshes(mesh, 3, 1e-3, device="cpu")
    many.node_v.assign(v)
    many.step(20)
    for world in range(3):
        alone = FreeMeshes(mesh, 1, 1e-3, device="cpu")
        alone.node_v.assign(v[world : world + 1])
        alone.step(20)
        assert (alone.node_x.numpy()[0] == many.node_x.numpy()[world]).all()
        assert (alone.node_v.numpy()[0] == many.node_v.numpy()[world]).all()


@pytest.mark.parametrize("kind", KINDS)
def test_each_world_has_its_own_parameters(kind):
    values = {"young": (1e5, 1e6, 3e6), "damping_time": (0.0, 1e-3, 1e-2), "density": (1100.0, 900.0, 2000.0),
              "thickness": (2e-3, 1e-3, 4e-3), "pressure": (0.0, 50.0, -20.0)}  # fmt: skip

    def with_values(worlds):
        mesh = block(kind)
        chosen = {name: np.array(row, dtype=np.float32)[worlds, None] for name, row in values.items()}
        for table, name in ((mesh.tables.materials, "young"), (mesh.tables.materials, "damping_time"),
                            (mesh.tables.triangles, "thickness"), (mesh.tables.triangles, "pressure")):  # fmt: skip
            setattr(table, name, wp.array(chosen[name], dtype=float, device="cpu"))
        heavier = mesh.tables.node_mass.numpy() * chosen["density"] / 1100.0
        mesh.tables.node_mass = wp.array(heavier.astype(np.float32), dtype=float, device="cpu")
        sim = FreeMeshes(mesh, len(worlds), 1e-3, device="cpu")
        v = 0.1 * np.random.default_rng(1).standard_normal((1, *mesh.points.shape))
        sim.node_v.assign(np.repeat(v, len(worlds), axis=0))
        sim.step(10)
        return sim.node_x.numpy()

    together = with_values([0, 1, 2])
    for world in range(3):
        assert (together[world] == with_values([world])[0]).all()
    assert np.abs(together[0] - together[1]).max() > 1e-5
    assert np.abs(together[2] - together[1]).max() > 1e-5


def test_far_from_the_origin_a_block_is_as_stiff():
    near, far = (FreeMeshes(block("hexahedra"), 1, 1e-3, gravity=(0.0, 0.0, 0.0), device="cpu") for _ in range(2))
    far.node_x.assign(far.node_x.numpy() + np.array([1e4, -1e4, 0.0]))
    v = 0.1 * np.random.default_rng(1).standard_normal((*near.node_v.shape, 3)).astype(np.float32)
    for sim in (near, far):
        sim.node_v.assign(v)
        sim.step(100)
    difference = far.node_x.numpy() - np.array([1e4, -1e4, 0.0]) - near.node_x.numpy()
    assert np.abs(difference).max() < 1e-3 * np.abs(v).max() * 0.1


def test_a_crushed_block_recovers():
    mesh = block("tetrahedra", young=2e4)
    sim = FreeMeshes(mesh, 1, 1e-3, gravity=(0.0, 0.0, 0.0), device="cpu")
    sim.node_x.assign((mesh.points * (1.0, 1.0, -0.2))[None])
    turned = []
    for _ in range(20):
        sim.step()
        turned.append(int(sim.inverted.numpy()[0]))
    assert turned[0] == len(mesh.parts[0].elements)
    sim.step(1500)
    assert sim.inverted.numpy()[0] == 0
    assert np.isfinite(sim.node_x.numpy()).all()


@pytest.mark.cuda
@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_lanes_of_a_gpu_find_what_a_cpu_finds(kind, double):
    found = []
    for device in ("cpu", "cuda:0", "cuda:0"):
        mesh = block(kind, cells=(2, 2, 1), double=double, fixed=[3], device=device)
        sim = FreeMeshes(mesh, 3, 1e-3, device=device)
        v = 0.1 * np.random.default_rng(1).standard_normal((3, len(mesh.points), 3)).astype(np.float32)
        v[:, 3] = 0.0
        sim.node_v.assign(v)
        sim.step(3)
        found.append((sim.node_x.numpy(), sim.node_v.numpy()))
    for cpu, gpu, again, bound in zip(*found, (1e-8, 1e-5), strict=True):
        assert np.abs(cpu - gpu).max() < bound
        assert (gpu == again).all()
