"""What is no mesh is refused in one line, with its rule, value and remedy; what is one has its masses and volumes."""

import dataclasses
import re

import numpy as np
import pytest

import simwarp as sw
from simwarp.meshes.lattices import box_of_hexahedra, box_of_tetrahedra, rectangle_of_triangles
from simwarp.meshes.mesh_parts import MeshPart
from simwarp.meshes.solid_elements import hexahedra_constants
from tests.unit.flex.free_meshes import make_mesh

RUBBER = sw.flex.Rubber(young=1e6, density=1000.0)


def solid(make=box_of_hexahedra):
    points, elements = make((2, 1, 1), (0.2, 0.1, 0.1))
    return points, MeshPart(elements=elements, material=RUBBER)


def sheet():
    points, elements = rectangle_of_triangles((2, 2), (0.2, 0.2))
    return points, MeshPart(elements=elements, material=RUBBER, thickness=1e-3)


def refused(points, part, **options):
    with pytest.raises(sw.ModelError) as raised:
        make_mesh("mesh 'pad'", points, [part], device="cpu", **options)
    text = str(raised.value)
    assert text.startswith("mesh 'pad': ")
    assert ", got " in text
    assert "; " in text
    assert "\n" not in text
    return text


def changed(part, **fields):
    return dataclasses.replace(part, **fields)


def test_points_must_be_numbers_of_space():
    points, part = solid()
    assert "shape (n, 3)" in refused(points[:, :2], part)
    for value in (np.nan, np.inf, 1e39):
        wrong = points.copy()
        wrong[3, 1] = value
        assert "node 3" in refused(wrong, part)


def test_elements_must_be_of_a_known_kind_and_of_nodes_that_are_there():
    points, part = solid()
    for elements in (part.elements[:, :5], part.elements[:0], part.elements.astype(float), part.elements[0]):
        assert "elements must be" in refused(points, changed(part, elements=elements))
    for node in (-1, len(points)):
        elements = part.elements.copy()
        elements[1, 2] = node
        assert "element 1" in refused(points, changed(part, elements=elements))


@pytest.mark.parametrize("make", [box_of_hexahedra, box_of_tetrahedra])
def test_a_solid_must_have_a_volume(make):
    points, part = solid(make)
    elements = part.elements.copy()
    elements[1] = elements[1][[1, 0, 3, 2, 5, 4, 7, 6][: elements.shape[1]]]
    if make is box_of_tetrahedra:
        elements[1] = part.elements[1][[1, 0, 2, 3]]
    assert "inside out" in refused(points, changed(part, elements=elements))
    assert "flat" in refused(points * (1.0, 1.0, 0.0), part)


def test_a_hexahedron_that_is_inside_out_at_a_corner_is_refused():
    points, part = solid()
    points[np.isclose(points, 0.0).all(axis=1)] = (0.09, 0.09, 0.09)
    assert "inside out" in refused(points, part)


def test_sheets_have_a_thickness_and_sides_of_two_triangles():
    points, part = sheet()
    for thickness in (None, 0.0, -1.0, np.nan, np.inf):
        assert "thickness" in refused(points, changed(part, thickness=thickness))
    assert "pressure" in refused(points, changed(part, pressure=np.nan))
    doubled = np.concatenate([part.elements, part.elements[:1]])
    assert "must be two" in refused(points, changed(part, elements=doubled))
    turned = part.elements.copy()
    turned[0] = turned[0][[1, 0, 2]]
    assert "must be two" in refused(points, changed(part, elements=turned))
    assert "flat" in refused(points * (1.0, 0.0, 1.0), part)


def test_solids_have_neither_thickness_nor_pressure():
    points, part = solid()
    assert "thickness" in refused(points, changed(part, thickness=0.1))
    assert "pressure" in refused(points, changed(part, pressure=1.0))


def test_tetrahedra_keep_from_what_keeps_its_volume():
    points, part = solid(box_of_tetrahedra)
    stiff = sw.flex.Rubber(young=1e6, poisson=0.46, density=1000.0)
    assert "hexahedra" in refused(points, changed(part, material=stiff))


def test_too_many_nodes_are_refused_with_what_they_would_cost():
    points, elements = box_of_hexahedra((15, 10, 10), (1.0, 1.0, 1.0))
    assert re.search(r"got 1936: .* \d+ ms .* \d+ MiB", refused(points, MeshPart(elements=elements, material=RUBBER)))
    points, elements = rectangle_of_triangles((50, 50), (1.0, 1.0))
    refused(points, MeshPart(elements=elements, material=RUBBER, thickness=1e-3))


@pytest.mark.parametrize("make", [box_of_hexahedra, box_of_tetrahedra])
def test_a_mass_is_volume_times_density(make):
    points, part = solid(make)
    rng = np.random.default_rng(0)
    points = points + 0.003 * rng.uniform(-1.0, 1.0, points.shape)
    masses = make_mesh("mesh", points, [part], device="cpu").tables.node_mass.numpy()
    tetrahedra = points[box_of_tetrahedra((2, 1, 1), (1.0, 1.0, 1.0))[1]]
    volume = np.linalg.det(tetrahedra[:, 1:] - tetrahedra[:, :1]).sum() / 6.0
    # Faces of hexahedra are not flat: tetrahedra divide them a little otherwise
    assert masses.sum() == pytest.approx(1000.0 * volume, rel=1e-6 if make is box_of_tetrahedra else 0.02)


def test_a_sheets_mass_is_area_times_thickness_times_density():
    points, part = sheet()
    masses = make_mesh("mesh", points, [part], device="cpu").tables.node_mass.numpy()
    assert masses.sum() == pytest.approx(0.04 * 1e-3 * 1000.0, rel=1e-6)


def test_the_mean_gradient_of_a_hexahedron_is_that_of_linear_fields():
    points, part = solid()
    points = points + 0.02 * np.random.default_rng(1).uniform(-1.0, 1.0, points.shape)
    found = hexahedra_constants(points, part.elements, np.full(2, 0.3))
    unit = np.einsum("eai,eaj->eij", points[part.elements], found.gradient)
    assert np.abs(unit - np.eye(3)).max() < 1e-13
    assert np.abs(found.gradient.sum(axis=1)).max() < 1e-12
    assert np.abs(np.einsum("eam,eai->emi", found.hourglass, points[part.elements])).max() < 1e-16


def test_a_mesh_may_have_several_kinds_and_materials():
    points, hexahedra = box_of_hexahedra((2, 1, 1), (0.2, 0.1, 0.1))
    skin = rectangle_of_triangles((2, 1), (1.0, 1.0))[1]
    lower = np.flatnonzero(points[:, 2] == 0.0)
    cloth = sw.flex.Elastic(young=1e9, density=900.0)
    parts = [
        MeshPart(elements=lower[skin].astype(np.int32), material=cloth, thickness=1e-3),
        MeshPart(elements=hexahedra, material=RUBBER),
    ]  # fmt: skip
    mesh = make_mesh("mesh", points, parts, device="cpu")
    assert mesh.tables.node_mass.numpy().sum() == pytest.approx(1000.0 * 0.002 + 900.0 * 0.02 * 1e-3, rel=1e-6)
    assert mesh.sizes.shares == 2 * 8 + 4 * 6


def test_a_body_that_nothing_is_glued_to_does_not_own_the_mesh():
    """Nodes of the other one are its own then, without a ball at each."""
    builder = sw.ModelBuilder()
    for name in ("a", "b"):
        builder.add_body(name, mass=1.0, inertia=(0.01, 0.01, 0.01))
    rubber = sw.flex.Rubber(young=1e5, poisson=0.4, density=1000.0)
    glue = {"a": [], "b": "z_max"}
    mesh = builder.add_solid_mesh("pad", sw.flex.box((0.1, 0.1, 0.1), 1), material=rubber, glue=glue)
    assert mesh.owner == 1
    assert not builder.joints
