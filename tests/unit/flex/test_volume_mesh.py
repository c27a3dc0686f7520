"""Volumes in cells: shares of cut cells are exact, surfaces stay in place, boundaries are closed, sets are named."""

import copy
import dataclasses
import itertools
import pickle
from typing import Any

import numpy as np
import pytest
import trimesh

import simwarp as sw
from simwarp.meshes.mesh_parts import MeshPart
from simwarp.meshes.volume_lattices import LIGHTEST, grid_shares
from tests.unit.flex.free_meshes import FreeMeshes, make_mesh
from tests.unit.flex.loaded_meshes import loads, small_displacements

RUBBER = sw.flex.Rubber(young=1e6, density=1000.0)
FLEX: Any = sw.flex
"""The same without types, for what no type checker lets through."""
SPHERE = trimesh.creation.icosphere(3)


def enclosed(points, triangles):
    return np.linalg.det(points[triangles]).sum() / 6.0


def check_closed(triangles):
    """Each side is passed as often in one direction as in the other."""
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    forth, count = np.unique(sides, axis=0, return_counts=True)
    back, opposite = np.unique(sides[:, ::-1], axis=0, return_counts=True)
    assert np.array_equal(forth, back)
    assert np.array_equal(count, opposite)


def refused(call, *words):
    with pytest.raises(sw.ModelError) as raised:
        call()
    text = str(raised.value)
    assert ", got" in text
    assert "; " in text
    assert "\n" not in text
    for word in words:
        assert word in text
    return text


def carved(where, cells=(12, 6, 6), size=(1.2, 0.6, 0.6)):
    """Surface of the cells of a box whose middles are where a function says."""
    mesh = sw.flex.box(size, cells)
    kept = where(*mesh.points[mesh.elements].mean(axis=1).T)
    nodes, elements = np.unique(mesh.elements[kept], return_inverse=True)
    part = FLEX.VolumeMesh(points=mesh.points[nodes], elements=elements.reshape(-1, 8))
    return part.points, part.boundary_triangles


@pytest.mark.parametrize("elements", ["hexahedra", "tetrahedra"])
def test_a_box_has_its_volume_a_closed_outside_and_named_sides(elements):
    mesh = sw.flex.box((2.0, 1.0, 0.5), (4, 3, 2), elements=elements)
    assert mesh.kind == elements
    assert np.array_equal(mesh.bounds, [(-1.0, -0.5, -0.25), (1.0, 0.5, 0.25)])
    assert mesh.volume == pytest.approx(1.0, rel=1e-14)
    check_closed(mesh.boundary_triangles)
    assert enclosed(mesh.points, mesh.boundary_triangles) == pytest.approx(1.0, rel=1e-14)
    inner = (np.abs(mesh.points) < (0.999, 0.499, 0.249)).all(axis=1)
    assert np.array_equal(mesh.boundary_nodes, np.flatnonzero(~inner))
    for axis, letter in enumerate("xyz"):
        for side, end in (("min", 0), ("max", 1)):
            expected = np.flatnonzero(mesh.points[:, axis] == mesh.bounds[end, axis])
            assert np.array_equal(mesh.sets[f"{letter}_{side}"], expected)
    assert len(mesh.sets) == 6


def test_one_number_of_cells_is_that_along_each_side():
    assert sw.flex.box((1, 2, 3), 2).elements.shape == (8, 8)


def test_shares_of_a_box_are_the_products_of_what_it_covers_of_each_side():
    low, high = np.array([0.3, 1.0, 0.25]), np.array([3.6, 2.5, 3.0])
    surface = trimesh.creation.box(bounds=[low, high])
    shares = grid_shares(np.asarray(surface.triangles), (4, 3, 4))
    covered = [
        np.clip(np.minimum(high[axis], np.arange(count) + 1.0) - np.maximum(low[axis], np.arange(count)), 0.0, 1.0)
        for axis, count in enumerate((4, 3, 4))
    ]
    assert np.abs(shares - np.einsum("i,j,k->ijk", *covered)).max() < 1e-14


@pytest.mark.parametrize("shape", ["ellipsoid", "torus"])
def test_shares_are_those_of_points_inside(shape):
    if shape == "torus":
        surface = trimesh.creation.torus(2.0, 0.8, major_sections=256, minor_sections=128)

        def inside(x):
            return (np.hypot(x[..., 0], x[..., 1]) - 2.0) ** 2 + x[..., 2] ** 2 < 0.64
    else:
        surface = trimesh.creation.icosphere(5)
        surface.vertices = surface.vertices * (2.7, 1.9, 1.3)

        def inside(x):
            return ((x / (2.7, 1.9, 1.3)) ** 2).sum(axis=-1) < 1.0

    shares = grid_shares(np.asarray(surface.triangles) + 3.0, (6, 6, 6))
    steps = (np.arange(20) + 0.5) / 20.0
    samples = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3) - 3.0
    found = np.array([inside(samples + cell).mean() for cell in np.ndindex(6, 6, 6)]).reshape(6, 6, 6)
    # 8000 points of a cell; those near its surface err by some thousandths, chords of the triangles by less
    assert np.abs(shares - found).max() < 0.006
    assert np.count_nonzero((found > 0.01) & (found < 0.99)) > 50


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0, 1.0), (0.3, -0.5, 0.2, 0.8)])
def test_a_lattice_has_the_volume_of_its_surface(turn):
    vertices, triangles = carved(lambda x, y, z: (np.abs(x) < 0.3) | (np.abs(y) < 0.2) & (z > 0.0))
    pose = sw.pose((0.1, 0.2, 0.3), turn)
    vertices = vertices @ sw.flex.box((1, 1, 1), 1).placed(pose).points[[0, 1, 2, 4]].T[:, :3] + 1.0
    surface = trimesh.Trimesh(vertices, triangles, process=False)
    if surface.volume < 0.0:
        surface.invert()
    for spacing in (0.3, 0.11, (0.07, 0.2, 0.13)):
        mesh = sw.flex.lattice(surface, spacing=spacing, least_fill=0.0)
        added = LIGHTEST * np.count_nonzero(mesh.fill <= LIGHTEST) * np.prod(np.broadcast_to(spacing, 3))
        assert mesh.volume == pytest.approx(surface.volume, abs=added + 1e-12)


def test_full_cells_err_by_the_first_order_of_their_size_and_shares_do_not():
    excess = []
    spacings = np.array([0.17, 0.083, 0.041])
    for spacing in spacings:
        mesh = sw.flex.lattice(SPHERE, spacing=spacing, least_fill=0.0)
        assert mesh.volume == pytest.approx(SPHERE.volume, rel=1e-4)
        excess.append((mesh.volumes / mesh.fill).sum() - SPHERE.volume)
    # A plane meets |n|₁ of the cells of a layer, half of each lies beyond it: of a sphere 3 π r² spacing
    ratio = np.array(excess) / (3.0 * np.pi * spacings)
    assert np.abs(ratio - 1.0).max() < 0.15
    assert abs(ratio[-1] - 1.0) < 0.03
    assert np.polyfit(np.log(spacings), np.log(excess), 1)[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("spacing", [0.5, 0.25, 0.1])
def test_the_mass_of_a_sphere_is_that_of_its_surface_but_for_cells_left_out(spacing):
    mesh = sw.flex.lattice(SPHERE, spacing=spacing)
    part = MeshPart(elements=mesh.elements, material=RUBBER, fill=mesh.fill)
    model = make_mesh("ball", mesh.points, [part], device="cpu") if spacing > 0.2 else None
    mass = 1000.0 * mesh.volume if model is None else float(model.tables.node_mass.numpy().sum())
    # 6 π r² / spacing² cells are cut; less than all of them are left out, each with less than a twentieth
    assert -0.05 * 6.0 * np.pi * spacing < mass / 1000.0 - SPHERE.volume < 1e-3
    assert mass == pytest.approx(1000.0 * mesh.volume, rel=1e-6)


def test_a_surface_that_fits_the_grid_gives_full_cells():
    surface = trimesh.creation.box((1.0, 0.5, 0.3))
    mesh = sw.flex.lattice(surface, spacing=0.1)
    assert mesh.elements.shape == (150, 8)
    assert (mesh.fill == 1.0).all()
    assert np.abs(mesh.bounds - surface.bounds).max() < 1e-15
    assert mesh.volume == pytest.approx(0.15, rel=1e-14)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_faces_on_planes_of_the_grid_touch_no_cell_beyond(side):
    vertices, triangles = carved(lambda x, y, z: (side * x < -0.2) | (side * z < -0.1))
    used, triangles = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], triangles.reshape(-1, 3)
    mesh = sw.flex.lattice((vertices + 0.377, triangles), spacing=0.1)
    assert len(mesh.elements) == 4 * 6 * 6 + 8 * 6 * 2
    assert (mesh.fill == 1.0).all()
    assert np.abs(mesh.surface_vertices() - vertices - 0.377).max() < 1e-14


def test_vertices_are_where_they_were_and_go_with_the_cells():
    surface = trimesh.creation.torus(1.0, 0.3)
    mesh = FLEX.lattice(surface, spacing=0.2)
    assert np.array_equal(mesh.surface.triangles, surface.faces)
    assert np.abs(mesh.surface_vertices() - surface.vertices).max() < 1e-14
    assert np.abs(mesh.surface.weights.sum(axis=1) - 1.0).max() < 1e-14
    assert mesh.surface.weights.min() >= 0.0
    change = np.array([(1.1, 0.2, 0.0), (-0.3, 0.9, 0.1), (0.0, 0.4, 1.3)])
    moved = mesh.surface_vertices(mesh.points @ change.T + (1.0, 2.0, 3.0))
    assert np.abs(moved - (surface.vertices @ change.T + (1.0, 2.0, 3.0))).max() < 1e-13
    # A product of coordinates is what corners of a cell can carry beyond that
    product = mesh.points[:, [0, 1, 0]] * mesh.points[:, [1, 2, 2]]
    wanted = surface.vertices[:, [0, 1, 0]] * surface.vertices[:, [1, 2, 2]]
    assert np.abs(mesh.surface_vertices(product) - wanted).max() < 0.2**2 / 2.0


def test_a_lattices_outside_is_closed_and_encloses_its_cells():
    mesh = sw.flex.lattice(SPHERE, spacing=0.23)
    check_closed(mesh.boundary_triangles)
    assert enclosed(mesh.points, mesh.boundary_triangles) == pytest.approx((mesh.volumes / mesh.fill).sum(), rel=1e-12)
    assert set(mesh.boundary_nodes) == set(mesh.boundary_triangles.reshape(-1))
    lowest = mesh.sets["z_min"]
    assert (mesh.points[lowest, 2] == mesh.points[:, 2].min()).all()


def pieces(mesh):
    """Number of parts of a mesh of hexahedra that share no face."""
    sides: dict[tuple[int, ...], list[int]] = {}
    for cell, nodes in enumerate(mesh.elements.tolist()):
        for face in ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)):
            sides.setdefault(tuple(sorted(nodes[node] for node in face)), []).append(cell)
    group = list(range(len(mesh.elements)))
    for cells in sides.values():
        for a, b in itertools.pairwise(cells):
            old, new = group[a], group[b]
            group = [new if each == old else each for each in group]
    return len(set(group))


def test_a_thin_plate_has_no_holes():
    surface = trimesh.creation.box((1.0, 1.0, 0.004))
    mesh = sw.flex.lattice(surface, spacing=0.1)
    assert len(mesh.elements) == 100
    assert mesh.fill == pytest.approx(0.04)
    assert mesh.volume == pytest.approx(0.004)


def test_cells_left_out_leave_no_part_alone():
    # Two blocks, and a neck so thin that its cells are small; the largest of them have no vertex
    coarse = carved(lambda x, y, z: (np.abs(x) > 0.2) | (y**2 + z**2 < 0.005), cells=(3, 3, 3), size=(1.2, 0.24, 0.24))
    dense = trimesh.Trimesh(*coarse).subdivide().subdivide()
    for surface in (coarse, dense):
        for spacing in ((0.15, 0.24, 0.24), 0.05, 0.13, 0.24):
            mesh = sw.flex.lattice(surface, spacing=spacing, least_fill=0.3)
            assert pieces(mesh) == 1
    few = sw.flex.lattice(SPHERE, spacing=0.1, least_fill=0.3)
    every = sw.flex.lattice(SPHERE, spacing=0.1, least_fill=0.0)
    assert pieces(few) == 1
    assert len(few.elements) < len(every.elements)


def test_a_hollow_body_is_hollow():
    inner = trimesh.creation.icosphere(3, radius=0.8)
    inner.invert()
    surface = trimesh.util.concatenate([SPHERE, inner])
    mesh = FLEX.lattice(surface, spacing=0.1, least_fill=0.0)
    assert mesh.volume == pytest.approx(SPHERE.volume * (1.0 - 0.8**3), rel=1e-3)
    middles = mesh.points[mesh.elements].mean(axis=1)
    assert np.linalg.norm(middles, axis=1).min() > 0.8 - 0.1 * np.sqrt(3.0)


def test_a_half_filled_beam_has_half_the_mass_and_stiffness():
    beam = sw.flex.box((0.4, 0.1, 0.1), (4, 1, 1))
    x = beam.points + 0.01 * np.random.default_rng(3).uniform(-1.0, 1.0, beam.points.shape)
    v = np.random.default_rng(4).uniform(-1.0, 1.0, beam.points.shape)
    material = dataclasses.replace(RUBBER, damping_time=0.01)
    found = []
    for fill in (1.0, 0.5):
        mesh = dataclasses.replace(beam, fill=np.full(4, fill))
        part = MeshPart(elements=mesh.elements, material=material, fill=mesh.fill)
        model = make_mesh("beam", mesh.points, [part], device="cpu")
        forces, matrix, _ = loads(model, x, v, h=0.01, zeta=0.1)
        found.append((model.tables.node_mass.numpy().astype(float), forces, matrix.toarray(), mesh.volume))
    for full, half in zip(*found, strict=True):
        assert np.abs(np.asarray(half) - 0.5 * np.asarray(full)).max() < 2e-6 * np.abs(full).max()


def test_a_beam_of_cut_cells_bends_as_one_of_full_cells():
    """Cells that are half full across the beam's width have its section, and without Poisson's ratio its stiffness."""
    surface = trimesh.creation.box((0.8, 0.1, 0.1))
    material = sw.flex.Elastic(young=1e6, poisson=0.0, density=1000.0)
    found = []
    for width, fill in ((0.1, 1.0), (0.2, 0.5)):
        mesh = sw.flex.lattice(surface, spacing=(0.1, width, 0.1))
        assert mesh.fill == pytest.approx(fill)
        part = MeshPart(elements=mesh.elements, material=material, fill=mesh.fill)
        model = make_mesh("beam", mesh.points, [part], device="cpu")
        held = np.zeros(mesh.points.shape, dtype=bool)
        held[mesh.nodes_of("x_min")] = True
        forces = np.zeros(mesh.points.shape)
        forces[mesh.nodes_of("x_max"), 2] = -0.25
        tip = small_displacements(model, forces, held)[mesh.nodes_of("x_max"), 2]
        assert np.ptp(tip) < 1e-4 * abs(tip.mean())
        found.append(tip.mean())
    inertia = 0.1 * 0.1**3 / 12.0
    expected = -(0.8**3) / (3.0 * 1e6 * inertia) - 0.8 / (5e5 * 0.01 * 5.0 / 6.0)
    assert found[0] == pytest.approx(expected, rel=0.05)
    assert found[1] == pytest.approx(found[0], rel=3e-3)  # entries of the matrix are of float32


def test_cells_of_small_shares_go_with_the_others():
    """A ring that spins and falls: nodes of a thousandth of the others' mass neither stay behind nor take its spin."""
    ring = sw.flex.lattice(trimesh.creation.torus(0.05, 0.018), spacing=0.011)
    material = dataclasses.replace(RUBBER, damping_time=1e-3)
    part = MeshPart(elements=ring.elements, material=material, fill=ring.fill)
    model = make_mesh("ring", ring.points, [part], device="cpu")
    mass = model.tables.node_mass.numpy()[0].astype(float)
    assert mass.max() > 500.0 * mass.min()
    meshes = FreeMeshes(model, 1, 1e-3, device="cpu")
    meshes.node_v.assign(np.cross((0.0, 0.0, 10.0), ring.points)[None].astype(np.float32))

    def motion(x, v):
        middle, speed = mass @ x / mass.sum(), mass @ v / mass.sum()
        return middle, mass @ np.cross(x - middle, v - speed)

    start, spin = motion(ring.points, meshes.node_v.numpy()[0].astype(float))
    meshes.step(200)
    x = meshes.node_x.numpy()[0]
    middle, found = motion(x, meshes.node_v.numpy()[0].astype(float))
    assert np.abs(middle - start - (0.0, 0.0, -9.81 * 0.001**2 * 200 * 201 / 2)).max() < 1e-6
    assert np.abs(found - spin).max() < 1e-5 * spin[2]
    corners = ring.points[ring.elements], x[ring.elements]
    rest, now = (np.linalg.norm(each - np.roll(each, 1, axis=1), axis=2) for each in corners)
    # ρ ω² r² / E = 5e-4
    assert np.abs(now / rest - 1.0).max() < 1e-3


@pytest.mark.parametrize("make", [lambda: SPHERE, lambda: (SPHERE.vertices, SPHERE.faces), "obj", "stl", "ply"])
def test_a_surface_may_be_a_file_a_trimesh_or_arrays(make, tmp_path):
    if isinstance(make, str):
        path = tmp_path / f"ball.{make}"
        scaled = SPHERE.copy()
        scaled.apply_scale(1000.0)
        scaled.export(path)
        mesh = sw.flex.lattice(path, spacing=0.4, scale=0.001)
        assert mesh.name == path.name
    else:
        mesh = sw.flex.lattice(make(), spacing=0.4)
        assert mesh.name == "lattice"
    assert mesh.volume == pytest.approx(sw.flex.lattice(SPHERE, spacing=0.4).volume, rel=1e-6)
    assert mesh.surface_vertices().max() == pytest.approx(1.0, rel=1e-6)


def test_a_surface_must_be_closed_face_outwards_and_not_overlap():
    def of(surface, **options):
        return lambda: FLEX.lattice(surface, **({"spacing": 0.3} | options))

    inward = SPHERE.copy()
    inward.invert()
    apart = SPHERE.copy()
    apart.apply_translation((0.5, 0.0, 0.0))
    refused(of((SPHERE.vertices, SPHERE.faces[1:])), "enclose a volume")
    refused(of(inward), "face outwards")
    refused(of(trimesh.util.concatenate([SPHERE, apart])), "overlap")
    refused(of((SPHERE.vertices * np.nan, SPHERE.faces)), "vertices")
    refused(of((SPHERE.vertices[:, :2], SPHERE.faces)), "vertices")
    refused(of((SPHERE.vertices, SPHERE.faces + 1)), "triangles")
    refused(of((SPHERE.vertices, SPHERE.faces[:0])), "triangles")
    refused(of((SPHERE.vertices, [[0, 1], [1, 2, 3]])), "triangles")
    refused(of(7), "surface must be")
    refused(of("no-such-file.obj"), "there must be a file")


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf, (1.0, 1.0), "small", (0.1, 0.1, -0.1), None])
def test_a_spacing_is_positive(spacing):
    refused(lambda: FLEX.lattice(SPHERE, spacing=spacing), "spacing")


def test_other_numbers_of_a_lattice_keep_their_rules():
    for scale in (0.0, -1.0, np.nan, "mm"):
        refused(lambda scale=scale: FLEX.lattice(SPHERE, spacing=0.3, scale=scale), "scale")
    for least in (-0.1, 1.0, np.nan, "few", (0.1, 0.1)):
        refused(lambda least=least: FLEX.lattice(SPHERE, spacing=0.3, least_fill=least), "least_fill")
    refused(lambda: FLEX.lattice(SPHERE, spacing=0.001), "at most 1,000,000 cells", "scale=0.001")
    refused(lambda: FLEX.lattice(SPHERE, spacing=100.0), "smaller spacing")


def test_a_box_keeps_its_rules():
    for size in ((1.0, 1.0), (1.0, 0.0, 1.0), (1.0, -1.0, 1.0), (1.0, np.nan, 1.0), 1.0, "big"):
        refused(lambda size=size: FLEX.box(size, 2), "size")
    for cells in (0, -1, 1.5, (2, 2), (2, 0, 2), "two", np.nan):
        refused(lambda cells=cells: FLEX.box((1.0, 1.0, 1.0), cells), "cells")
    refused(lambda: FLEX.box((1, 1, 1), 1000), "at most")
    refused(lambda: FLEX.box((1, 1, 1), 1, elements="wedges"), "elements")


def test_nodes_are_found_by_a_box_or_a_property():
    mesh = FLEX.box((1.0, 1.0, 1.0), 2)
    assert np.array_equal(mesh.nodes_where(lambda x: x[:, 2] < -0.4), mesh.sets["z_min"])
    far = np.inf
    assert np.array_equal(mesh.nodes_where(((-far, -far, -0.5), (far, far, -0.5))), mesh.sets["z_min"])
    assert np.array_equal(mesh.nodes_where(((0.5, 0.5, 0.5), (-0.5, -0.5, -0.5))), np.arange(27))
    assert np.array_equal(mesh.nodes_where(((0, 0, 0), (0, 0, 0))), [13])
    refused(lambda: mesh.nodes_where(((2, 2, 2), (3, 3, 3))), "find a node")
    refused(lambda: mesh.nodes_where(lambda x: x[:, 2] > 1.0), "find a node")
    refused(lambda: mesh.nodes_where(lambda x: x), "truth values")
    for wrong in (1.0, ((0, 0), (1, 1)), ((0, 0, np.nan), (1, 1, 1)), "low", None):
        refused(lambda wrong=wrong: mesh.nodes_where(wrong), "two corners")


def test_sets_are_named_found_and_suggested():
    mesh = FLEX.box((1.0, 1.0, 1.0), 2).with_sets(base=[3, 1, 3])
    assert mesh.sets["base"].tolist() == [1, 3]
    assert len(mesh.sets) == 7
    assert mesh.nodes_of("base").tolist() == [1, 3]
    assert mesh.nodes_of([5, 2]).tolist() == [2, 5]
    assert mesh.with_sets(base=[0]).sets["base"].tolist() == [0]
    refused(lambda: mesh.nodes_of("bas"), "did you mean 'base'?")
    refused(lambda: mesh.nodes_of("top"), "'z_max'")
    for wrong in ([], [27], [-1], [0.5], "nodes", 3, [[1, 2]], [True]):
        refused(lambda wrong=wrong: mesh.with_sets(top=wrong), "set 'top'")


def test_a_mesh_is_scaled_and_placed_with_all_it_has():
    mesh = FLEX.lattice(SPHERE, spacing=0.4)
    large = mesh.scaled(2.0)
    assert large.volume == pytest.approx(8.0 * mesh.volume)
    assert np.allclose(mesh.scaled((1, 2, 3)).bounds, mesh.bounds * (1, 2, 3))
    quarter = sw.pose((1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 1.0))
    turned = FLEX.box((2.0, 1.0, 1.0), 1).placed(quarter)
    assert np.allclose(turned.bounds, [(0.5, -1.0, -0.5), (1.5, 1.0, 0.5)])
    moved = mesh.placed(sw.pose((0.0, 0.0, 5.0)))
    assert np.abs(moved.surface_vertices() - SPHERE.vertices - (0.0, 0.0, 5.0)).max() < 1e-14
    assert moved.sets.keys() == mesh.sets.keys()
    for wrong in (0.0, -1.0, np.nan, (1.0, 2.0), "mm"):
        refused(lambda wrong=wrong: mesh.scaled(wrong), "scaled")
    refused(lambda: mesh.placed((0.0, 0.0, 1.0)), "pose")


def test_what_is_no_mesh_is_refused():
    mesh = FLEX.box((1.0, 1.0, 1.0), 2)
    seen = FLEX.lattice(SPHERE, spacing=1.0).surface

    def of(**fields):
        return lambda: dataclasses.replace(mesh, **fields)

    refused(of(points=mesh.points[:, :2]), "volume mesh 'box': points")
    refused(of(points="here"), "points")
    refused(of(elements=mesh.elements[:, :5]), "elements")
    refused(of(elements=[[1, 2], [3]]), "elements")
    refused(of(elements=mesh.elements[:, :3]), "sw.flex.lattice")
    refused(of(elements=mesh.elements + 1), "nodes of an element")
    refused(of(elements=mesh.elements[:1]), "every node")
    refused(of(elements=mesh.elements[:, [0, 3, 2, 1, 4, 7, 6, 5]]), "inside out")
    for fill in (0.0, 1.1, np.nan, [1.0], np.ones(9), "half", [0.5] * 7 + [-1.0]):
        refused(of(fill=fill), "fill")
    sets: Any
    for sets in ([1, 2], {"": [1]}, {1: [1]}, {"a": []}):
        refused(of(sets=sets), "set")
    refused(of(surface=3), "surface")
    refused(of(surface=dataclasses.replace(seen, cells=seen.cells + 99)), "cells of its surface")
    refused(of(surface=dataclasses.replace(seen, weights=seen.weights * 2.0)), "weights of its surface")
    refused(of(surface=dataclasses.replace(seen, triangles=seen.triangles + 1)), "triangles of its surface")
    refused(mesh.surface_vertices, "boundary_triangles")
    carried = FLEX.lattice(SPHERE, spacing=1.0)
    refused(lambda: carried.surface_vertices(carried.points[1:]), "all nodes")


def test_a_part_has_a_share_for_each_solid_element():
    mesh = FLEX.box((1.0, 1.0, 1.0), 1)
    wrong: Any
    for wrong in (0.0, 2.0, np.nan, np.ones(2)):
        part = MeshPart(elements=mesh.elements, material=RUBBER, fill=wrong)
        refused(lambda part=part: make_mesh("pad", mesh.points, [part], device="cpu"), "pad: fill")
    sheet = MeshPart(elements=np.array([[0, 1, 2]]), material=RUBBER, thickness=0.01, fill=np.ones(1))
    refused(lambda: make_mesh("pad", mesh.points[[0, 1, 3]], [sheet], device="cpu"), "triangles")


def test_arrays_are_its_own_and_fixed():
    points = FLEX.box((1.0, 1.0, 1.0), 1).points.copy()
    mesh = FLEX.VolumeMesh(points=points, elements=np.array([[0, 4, 6, 2, 1, 5, 7, 3]]), fill=0.5)
    points[:] = 7.0
    assert mesh.points.max() == 0.5
    assert mesh.volume == pytest.approx(0.5)
    for array in (mesh.points, mesh.elements, mesh.fill, mesh.volumes):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        mesh.fill = np.ones(1)
    lattice = FLEX.lattice(SPHERE, spacing=0.5)
    for other in (pickle.loads(pickle.dumps(lattice)), copy.deepcopy(lattice)):
        assert np.array_equal(other.points, lattice.points)
        assert other.volume == lattice.volume


def test_a_mesh_prints_what_it_holds():
    assert repr(FLEX.box((1.0, 0.5, 0.25), 2)) == (
        "VolumeMesh 'box': 27 nodes, 8 hexahedra\n"
        "  extent  (-0.5, -0.25, -0.125) to (0.5, 0.25, 0.125) m\n"
        "  volume  0.125 m³\n"
        "  sets    6: x_min, x_max, y_min, y_max, z_min, z_max"
    )
    lines = repr(FLEX.lattice(SPHERE, spacing=0.5)).splitlines()
    assert lines[2].startswith("  volume   4.1")
    assert lines[2].endswith("% of its cells")
    assert lines[4] == "  surface  642 vertices, 1280 triangles"
