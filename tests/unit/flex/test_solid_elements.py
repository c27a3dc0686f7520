"""Solid elements: forces against the slope of a float64 energy, tangents, rotations, patches, refused meshes."""

import numpy as np
import pytest

import simwarp as sw
from simwarp.flex.materials import Elastic, Rubber
from simwarp.flex.solid_elements import incompatible_stiffness, lame, solid_elements
from simwarp.flex.solid_meshes import box_mesh
from tests.reference import solids
from tests.unit.flex.measured_solids import Measured

SOFT = Elastic(young=1e6, poisson=0.3, density=1000.0)
GUM = Rubber(young=1e6, poisson=0.45, density=1100.0)
KINDS = pytest.mark.parametrize("tetrahedra", [False, True], ids=["hexahedra", "tetrahedra"])
LAWS = pytest.mark.parametrize("material", [SOFT, GUM], ids=["elastic", "rubber"])


def irregular(*, tetrahedra, cells=(3, 2, 2), size=(0.3, 0.2, 0.2), share=0.15, seed=0):
    """A box whose inner nodes are moved, and which of its nodes are inner."""
    vertices, elements = box_mesh(size, cells, tetrahedra=tetrahedra)
    inner = np.all(np.abs(vertices) < 0.499 * np.array(size), axis=1)
    random = np.random.default_rng(seed)
    vertices[inner] += share * size[0] / cells[0] * random.uniform(-1.0, 1.0, (inner.sum(), 3))
    return vertices, elements, inner


def turn(seed):
    """A random rotation."""
    return solids.rotation(np.random.default_rng(seed).normal(size=(3, 3)))


def reference_forces(mesh, vertices, x, material):
    """Forces on the nodes as slopes of the energy."""
    first, second = lame(material)
    total = np.zeros_like(x)
    for index, nodes in enumerate(mesh.solid.elements):
        hourglass = None
        if len(nodes) == 8:
            hourglass = mesh.solid.hourglass[index], mesh.solid.hourglass_stiffness[index]

        def energy(corners, rest=vertices[nodes], hourglass=hourglass):
            return solids.energy(corners, rest, first, second, rubber=isinstance(material, Rubber), hourglass=hourglass)

        total[nodes] -= solids.slope(energy, x[nodes], 1e-4 * np.ptp(vertices[nodes, 0]))
    return total


@KINDS
@LAWS
@pytest.mark.parametrize("strain", [1e-3, 0.2])
def test_forces_are_the_slope_of_the_energy(tetrahedra, material, strain):
    """In float32 to 1e-5; differences are exact to 1e-8."""
    vertices, elements, _ = irregular(tetrahedra=tetrahedra, cells=(2, 1, 1), share=0.0)
    random = np.random.default_rng(1)
    rest = vertices + 0.01 * random.uniform(-1.0, 1.0, vertices.shape)
    mesh = Measured.of(rest, elements, material)
    x = (rest + strain * 0.1 * random.uniform(-1.0, 1.0, rest.shape)) @ turn(2).T
    expected = reference_forces(mesh, rest, x, material)
    assert np.abs(mesh.measure(x)[0] - expected).max() < 1e-5 * np.abs(expected).max()


@KINDS
@LAWS
def test_forces_have_no_resultant_and_no_moment(tetrahedra, material):
    vertices, elements, _ = irregular(tetrahedra=tetrahedra)
    mesh = Measured.of(vertices, elements, material)
    random = np.random.default_rng(3)
    x = vertices + 0.01 * random.uniform(-1.0, 1.0, vertices.shape)
    forces, _ = mesh.measure(x, random.normal(size=x.shape), dt=1e-3, damping=0.1)
    size = np.abs(forces).max()
    assert np.abs(forces.sum(axis=0)).max() < 1e-5 * size
    assert np.abs(np.cross(x, forces).sum(axis=0)).max() < 2e-6 * size


@KINDS
@LAWS
def test_a_rigid_motion_strains_nothing(tetrahedra, material):
    """Turned, moved 10 km and spinning, with dampers."""
    vertices, elements, _ = irregular(tetrahedra=tetrahedra)
    mesh = Measured.of(vertices, elements, material)
    x = vertices @ turn(4).T + (1e4, -1e4, 3.0)
    spin = np.cross(np.array((20.0, -30.0, 10.0)), x)
    assert np.abs(mesh.measure(x)[0]).max() < 1e-6 * material.young * 0.04
    assert np.abs(mesh.measure(x, spin, dt=1e-3, damping=1.0)[0]).max() < 1e-6 * material.young * 0.04


@KINDS
@LAWS
def test_at_rest_the_tangent_is_the_slope_of_the_forces(tetrahedra, material):
    vertices, elements, _ = irregular(tetrahedra=tetrahedra, cells=(1, 1, 1))
    vertices = (vertices + 0.01 * np.random.default_rng(5).uniform(-1.0, 1.0, vertices.shape)) @ turn(6).T
    mesh = Measured.of(vertices, elements, material)
    _, tangent = mesh.measure(vertices)
    change = 1e-4 * np.random.default_rng(7).uniform(-1.0, 1.0, vertices.shape)
    slope = (mesh.measure(vertices - change)[0] - mesh.measure(vertices + change)[0]) / 2.0
    assert np.abs(tangent @ change.ravel() - slope.ravel()).max() < 1e-4 * np.abs(slope).max()


@KINDS
def test_under_tension_the_tangent_has_its_geometric_part(tetrahedra):
    """A box drawn along all axes: all stresses are positive, and the tangent of an elastic material is exact."""
    vertices, elements, _ = irregular(tetrahedra=tetrahedra, share=0.0)
    mesh = Measured.of(vertices, elements, SOFT)
    x = vertices * (1.2, 1.1, 1.15) @ turn(8).T
    _, tangent = mesh.measure(x)
    change = 1e-4 * np.random.default_rng(9).uniform(-1.0, 1.0, x.shape)
    slope = (mesh.measure(x - change)[0] - mesh.measure(x + change)[0]) / 2.0
    assert np.abs(tangent @ change.ravel() - slope.ravel()).max() < 1e-3 * np.abs(slope).max()


@KINDS
@LAWS
@pytest.mark.parametrize("scale", [(0.5, 0.6, 0.4), (-0.3, 1.0, 1.0), (0.01, 1.0, 1.0)])
def test_the_tangent_is_never_negative(tetrahedra, material, scale):
    """Also pressed, flat and inside out; and forces stay finite."""
    vertices, elements, _ = irregular(tetrahedra=tetrahedra, share=0.0)
    mesh = Measured.of(vertices, elements, material)
    x = vertices * scale + 0.01 * np.random.default_rng(10).uniform(-1.0, 1.0, vertices.shape)
    forces, tangent = mesh.measure(x)
    assert np.all(np.isfinite(forces))
    values = np.linalg.eigvalsh(0.5 * (tangent + tangent.T))
    assert values[0] > -1e-5 * values[-1]


@KINDS
@LAWS
@pytest.mark.parametrize("column", range(9))
def test_a_patch_of_irregular_elements_strains_evenly(tetrahedra, material, column):
    """Boundary nodes follow a small linear field; inner ones then do so too."""
    vertices, elements, inner = irregular(tetrahedra=tetrahedra)
    mesh = Measured.of(vertices, elements, material)
    field = np.zeros(9)
    field[column] = 1e-3
    exact = vertices + vertices @ field.reshape(3, 3)
    x = np.where(inner[:, None], vertices, exact)
    free = np.repeat(inner, 3)
    for _ in range(12):
        forces, tangent = mesh.measure(x)
        x[inner] += np.linalg.solve(tangent[np.ix_(free, free)], forces[inner].ravel()).reshape(-1, 3)
    assert np.abs(x - exact).max() < 1e-5 * np.abs(exact - vertices).max()


@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_of_a_box_one_point_and_hourglass_are_the_incompatible_element(poisson):
    material = Elastic(young=1e6, poisson=poisson, density=1.0)
    corners, elements = box_mesh((0.3, 0.2, 0.1), (1, 1, 1))
    mesh = Measured.of(corners, elements, material)
    order = elements[0]
    whole = incompatible_stiffness(corners[order], *lame(material))
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    assert np.abs(mesh.measure(corners)[1][np.ix_(dofs, dofs)] - whole).max() < 1e-6 * np.abs(whole).max()


@pytest.mark.parametrize(
    ("elements", "text"),
    [
        ([[0, 1, 2]], r"elements must be of shape \(E, 4\) or \(E, 8\)"),
        ([[0, 1, 2, 9]], "numbers of vertices, 0 to 4"),
        ([[0, 1, 2, 3]], "each vertex must have an element, got none at vertex 4"),
        ([[0, 1, 2, 2], [0, 1, 3, 4]], "an element must have different vertices"),
        ([[0, 2, 1, 3], [0, 1, 2, 4]], "each element must have a positive volume"),
    ],
)  # fmt: skip
def test_a_wrong_mesh_is_refused_in_one_line(elements, text):
    vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 2)], dtype=np.float64)
    with pytest.raises(sw.ModelError, match=text) as raised:
        solid_elements(vertices, np.array(elements), SOFT)
    assert "\n" not in str(raised.value)
    assert "; " in str(raised.value)


@KINDS
def test_the_mass_is_the_volume_times_the_density(tetrahedra):
    vertices, elements, _ = irregular(tetrahedra=tetrahedra, share=0.0)
    assert np.isclose(solid_elements(vertices, elements, SOFT).masses.sum(), 1000.0 * 0.3 * 0.2 * 0.2, rtol=1e-12)
