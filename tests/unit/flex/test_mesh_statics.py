"""Meshes at rest under loads: patch tests, beams, plates and membranes with known answers."""

import numpy as np
import pytest
import scipy.sparse
import trimesh
from scipy.spatial.transform import Rotation

from simwarp.meshes.lattices import box_of_hexahedra, box_of_tetrahedra, rectangle_of_triangles
from simwarp.meshes.materials import Elastic
from simwarp.meshes.mesh_parts import MeshPart
from tests.unit.flex.free_meshes import FreeMeshes, make_mesh
from tests.unit.flex.loaded_meshes import loads, small_displacements

YOUNG = 1e6
SOLIDS = {"tetrahedra": box_of_tetrahedra, "hexahedra": box_of_hexahedra}


def mesh_of(points, elements, poisson=0.3, thickness=None, young=YOUNG, pressure=0.0):
    material = Elastic(young=young, poisson=poisson, density=1000.0)
    part = MeshPart(elements=elements, material=material, thickness=thickness, pressure=pressure)
    return make_mesh("mesh", points, [part], device="cpu")


def displaced(mesh, held, given):
    """(n, 3) displacements of a mesh without loads, of which some nodes are displaced."""
    _, matrix, _ = loads(mesh, mesh.points)
    fixed = np.repeat(held, 3)
    found = np.where(np.repeat(held, 3), np.asarray(given).reshape(-1), 0.0)
    dense = matrix.toarray()
    found[~fixed] = np.linalg.solve(dense[np.ix_(~fixed, ~fixed)], -dense[np.ix_(~fixed, fixed)] @ found[fixed])
    return found.reshape(-1, 3)


@pytest.mark.parametrize("kind", ["tetrahedra", "hexahedra", "triangles"])
@pytest.mark.parametrize("seed", range(3))
def test_a_patch_of_irregular_elements_has_constant_strain(kind, seed):
    rng = np.random.default_rng(seed)
    if kind == "triangles":
        points, elements = rectangle_of_triangles((3, 3), (1.0, 1.0))
        inside = ((points[:, :2] > 0.0) & (points[:, :2] < 1.0)).all(axis=1)
        points[inside, :2] += 0.15 * rng.uniform(-0.5, 0.5, (inside.sum(), 2))
    else:
        points, elements = SOLIDS[kind]((3, 3, 3), (1.0, 1.0, 1.0))
        inside = ((points > 0.0) & (points < 1.0)).all(axis=1)
        points[inside] += 0.15 * rng.uniform(-0.5, 0.5, (inside.sum(), 3))
    mesh = mesh_of(points, elements, thickness=0.1 if kind == "triangles" else None)
    gradient = 1e-3 * rng.standard_normal((3, 3))
    if kind == "triangles":
        gradient[:, 2] = gradient[2] = 0.0
    exact = points @ gradient.T
    found = displaced(mesh, ~inside, exact)
    assert np.abs(found - exact).max() < 1e-5 * np.abs(exact).max()
    strain = (gradient + gradient.T) / 2.0
    for nodes in elements:
        edges = points[nodes[1:4]] - points[nodes[0]]
        stretched = np.einsum("ki,ij,kj->k", edges, strain, edges)
        moved = found[nodes[1:4]] - found[nodes[0]]
        assert np.einsum("ki,ki->k", edges, moved) == pytest.approx(stretched, abs=1e-7)


def beam(kind, cells, poisson):
    """Tip of a clamped beam of 8 x 1 x 1 over Timoshenko's."""
    points, elements = SOLIDS[kind](cells, (8.0, 1.0, 1.0))
    mesh = mesh_of(points, elements, poisson)
    tip = points[:, 0] == 8.0
    share = np.zeros(len(points))
    for nodes in elements:
        # A uniform traction, as the faces' corners carry it
        face = nodes[tip[nodes]]
        if len(face) >= 3:
            x = points[face]
            area = np.linalg.norm(np.cross(x[1] - x[0], x[2] - x[0])) / (2.0 if len(face) == 3 else 1.0)
            share[face] += area / len(face)
    forces = np.zeros(points.shape)
    forces[:, 2] = share
    held = np.repeat(points[:, :1] == 0.0, 3, axis=1)
    found = small_displacements(mesh, forces, held)
    shear = YOUNG / 2.0 / (1.0 + poisson)
    exact = 8.0**3 / (3.0 * YOUNG / 12.0) + 8.0 / (shear * 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson))
    return float((share * found[:, 2]).sum() / share.sum() / exact)


@pytest.mark.parametrize(("kind", "cells", "poisson", "expected"), [
    # Incompatible modes bend as beams do; what is missing is the clamp, which holds the section's sides
    ("hexahedra", (8, 1, 1), 0.3, (0.95, 1.0)), ("hexahedra", (8, 1, 1), 0.49, (0.90, 1.0)),
    ("hexahedra", (16, 4, 4), 0.3, (0.96, 1.0)), ("hexahedra", (16, 4, 4), 0.49, (0.93, 1.0)),
    # Tetrahedra lock: why there should be six of them through a thickness
    ("tetrahedra", (8, 1, 1), 0.3, (0.3, 0.4)), ("tetrahedra", (16, 4, 4), 0.3, (0.70, 0.80)),
])  # fmt: skip
def test_a_clamped_beam_bends_as_timoshenko_says(kind, cells, poisson, expected):
    assert expected[0] < beam(kind, cells, poisson) < expected[1]


def test_cooks_membrane():
    """Middle of the loaded side, 23.96 where plane stress has converged: trapezoid of 48, 44, 16 (Cook 1974)."""
    cells = 16
    points, elements = box_of_hexahedra((cells, cells, 1), (1.0, 1.0, 1.0))
    s, t = points[:, 0].copy(), points[:, 1].copy()
    points[:, 0] = 48.0 * s
    points[:, 1] = 44.0 * s + t * (44.0 + s * (16.0 - 44.0))
    mesh = mesh_of(points, elements, 1.0 / 3.0, young=1.0)
    forces = np.zeros(points.shape)
    right = np.isclose(s, 1.0)
    forces[right, 1] = np.where(np.isclose(t[right] * (1.0 - t[right]), 0.0), 0.5, 1.0) / (2.0 * cells)
    held = np.zeros(points.shape, dtype=bool)
    held[np.isclose(s, 0.0), :2] = True
    held[np.isclose(points[:, 2], 0.0), 2] = True  # in the plane, free to become thinner
    found = small_displacements(mesh, forces, held)
    tip = found[right & np.isclose(t, 0.5), 1].mean()
    assert tip == pytest.approx(23.96, rel=0.02)


def plate(cells):
    """Centre of a square plate under a pressure over q L⁴ / D."""
    thickness, poisson = 0.01, 0.3
    points, elements = rectangle_of_triangles((cells, cells), (1.0, 1.0))
    edge = np.isclose(points[:, :2] * (1.0 - points[:, :2]), 0.0).any(axis=1)
    held = np.zeros(points.shape, dtype=bool)
    held[:, :2] = True
    held[edge] = True
    mesh = mesh_of(points, elements, poisson, thickness)
    forces = np.zeros(points.shape)
    for nodes in elements:
        forces[nodes, 2] += 0.5 / cells**2 / 3.0
    found = small_displacements(mesh, forces, held)
    middle = found[np.isclose(points[:, :2], 0.5).all(axis=1), 2][0]
    return middle * YOUNG * thickness**3 / 12.0 / (1.0 - poisson**2)


def test_a_supported_plate_sags_as_the_series_says():
    exact = 0.00406235  # Timoshenko and Woinowsky-Krieger 1959, table 8
    coarse, fine = plate(8), plate(32)
    assert fine == pytest.approx(exact, rel=0.04)
    assert abs(fine - exact) < abs(coarse - exact) < 0.12 * exact


def test_a_strip_of_triangles_rolls_up_without_a_force():
    # A rest shape that is curved is one without stress, turned or not
    points, elements = rectangle_of_triangles((12, 3), (1.0, 0.2))
    radius = 0.3
    points = np.column_stack([
        radius * np.sin(points[:, 0] / radius), points[:, 1], radius * (1.0 - np.cos(points[:, 0] / radius)),
    ])  # fmt: skip
    mesh = mesh_of(points, elements, thickness=0.01)
    forces, _, _ = loads(mesh, Rotation.from_rotvec([1.0, 0.2, -2.0]).apply(points))
    assert np.abs(forces).max() < 1e-12 * YOUNG * 0.01 * 0.2


def test_a_sphere_under_pressure_grows_as_membranes_do():
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    thickness, poisson, pressure = 0.005, 0.3, 10.0
    points = np.array(sphere.vertices)
    mesh = mesh_of(points, np.array(sphere.faces, dtype=np.int32), poisson, thickness, pressure=pressure)
    forces, matrix, _ = loads(mesh, points)
    # Nothing holds it: soft springs to where each node is, a millionth of the stiffness
    held = 4.0 * matrix + 1e-6 * abs(4.0 * matrix).max() * scipy.sparse.eye_array(points.size)
    found = scipy.sparse.linalg.spsolve(held.tocsc(), forces.reshape(-1)).reshape(-1, 3)
    radial = np.einsum("ij,ij->i", found, points) / 0.5
    exact = pressure * 0.5**2 * (1.0 - poisson) / (2.0 * YOUNG * thickness)
    assert radial.mean() == pytest.approx(exact, rel=0.02)
    # Uneven triangles: equal thirds of their pressure are not what each node's surroundings are
    assert radial.std() < 0.05 * exact


def test_a_strip_bends_far_by_a_force_at_its_end():
    """10 x 1 x 0.1, E = 1.2e6, ν = 0, P = 4: 6.698 down, 3.286 back (Sze, Liu and Lo 2004, table 1)."""
    cells, length, pull = 32, 10.0, 4.0
    side = length / cells
    points, elements = rectangle_of_triangles((cells + 1, 3), (length + side, 1.0))
    points[:, 0] -= side  # a row of nodes before the clamp, which holds the slope
    material = Elastic(young=1.2e6, poisson=0.0, density=1.0, damping_time=0.02)
    fixed = np.flatnonzero(points[:, 0] < 1e-9).tolist()
    part = MeshPart(elements=elements, material=material, thickness=0.1)
    mesh = make_mesh("strip", points, [part], fixed=fixed, double=True, device="cpu")
    sim = FreeMeshes(mesh, 1, 2e-3, numerical_damping=1.0, gravity=(0.0, 0.0, 0.0), device="cpu")
    end = np.isclose(points[:, 0], length)
    force = np.zeros((1, len(points), 3), dtype=np.float32)
    force[0, end, 2] = pull * np.array([0.5, 1.0, 1.0, 0.5]) / 3.0
    sim.node_force.assign(force)
    for _ in range(400):
        sim.step(20)
        sim.node_v.assign(0.85 * sim.node_v.numpy())  # about critical damping of the slowest vibration
    assert np.abs(sim.node_v.numpy()).max() < 1e-2
    moved = (sim.node_x.numpy()[0] - points)[end].mean(axis=0)
    assert moved[2] == pytest.approx(6.698, rel=0.03)
    assert -moved[0] == pytest.approx(3.286, rel=0.06)
