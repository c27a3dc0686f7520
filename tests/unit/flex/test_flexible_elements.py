"""Forces and matrices of flexible elements against energies and their differences in float64."""

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from simwarp.kernels.meshes.solid_loads import tensile_part
from simwarp.meshes.lattices import box_of_hexahedra, box_of_tetrahedra, rectangle_of_triangles
from simwarp.meshes.materials import Elastic, Rubber
from simwarp.meshes.mesh_parts import MeshPart
from simwarp.meshes.solid_elements import hexahedra_constants, incompatible_stiffness
from simwarp.meshes.triangle_elements import with_neighbours
from tests.reference import flexible_elements as reference
from tests.unit.flex.free_meshes import make_mesh
from tests.unit.flex.loaded_meshes import loads

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

YOUNG, POISSON, THICKNESS = 3e5, 0.4, 0.02
KINDS = ("tetrahedra", "hexahedra", "triangles")
SOLIDS = ("tetrahedra", "hexahedra")
MATERIALS: dict[str, type[Elastic | Rubber]] = {"elastic": Elastic, "rubber": Rubber}
DENSITIES = {"elastic": reference.elastic_density, "rubber": reference.rubber_density}


def mesh_of(kind, material="elastic", *, damping_time=0.0, skew=0.1, pressure=0.0, bent=0.0, cells=2):
    """A small irregular mesh."""
    rng = np.random.default_rng(7)
    if kind == "triangles":
        points, elements = rectangle_of_triangles((cells + 1, cells), (1.0, 0.8))
        points[:, 2] = bent * points[:, 0] ** 2
    else:
        make = box_of_tetrahedra if kind == "tetrahedra" else box_of_hexahedra
        points, elements = make((cells, 1, 1), (1.0, 0.6, 0.5))
    points += skew * rng.uniform(-0.5, 0.5, points.shape) * (1.0, 1.0, kind != "triangles" or bent != 0.0)
    made = MATERIALS[material](young=YOUNG, poisson=POISSON, density=1000.0, damping_time=damping_time)
    options = {"thickness": THICKNESS, "pressure": pressure} if kind == "triangles" else {}
    part = MeshPart(elements=elements, material=made, **options)
    return make_mesh("mesh", points, [part], device="cpu"), elements


def energy_of(mesh, elements, kind, material="elastic"):
    """The energy of all elements, of positions."""
    rest = mesh.points
    if kind == "triangles":
        six = with_neighbours(elements)
        inside = np.where(six >= 0, six, six[:, :1])

        def sheet(x):
            return sum(
                reference.triangle_energy(x[nodes], rest[nodes], there[3:] >= 0, YOUNG, POISSON, THICKNESS)
                for nodes, there in zip(inside, six, strict=True)
            )

        return sheet
    held = None
    if kind == "hexahedra":
        held = hexahedra_constants(rest, elements, np.full(len(elements), POISSON)).hourglass_stiffness

    def solid(x):
        total = 0.0
        for index, nodes in enumerate(elements):
            f, volume = reference.deformation(x[nodes], rest[nodes])
            total += volume * DENSITIES[material](f, YOUNG, POISSON)
            if held is not None:
                q = reference.hourglass_amplitudes(x[nodes], rest[nodes]).reshape(-1)
                total += YOUNG / 2.0 * q @ held[index].reshape(12, 12) @ q
        return total

    return solid


def moved(mesh, size, seed=1):
    """Positions of nodes that were all pushed somewhere, and the whole turned."""
    rng = np.random.default_rng(seed)
    x = mesh.points + size * rng.uniform(-0.5, 0.5, mesh.points.shape)
    return Rotation.from_rotvec([0.7, -1.1, 0.4]).apply(x) + np.array([3.0, -2.0, 5.0])


CASES = [("tetrahedra", "elastic"), ("tetrahedra", "rubber"), ("hexahedra", "elastic"), ("hexahedra", "rubber"),
         ("triangles", "elastic")]  # fmt: skip


@pytest.mark.parametrize(("kind", "material"), CASES)
def test_forces_are_the_slope_of_the_energy(kind, material):
    mesh, elements = mesh_of(kind, material, bent=0.3)
    x = moved(mesh, 0.15)
    forces, _, inverted = loads(mesh, x)
    exact = -reference.gradient(energy_of(mesh, elements, kind, material), x, 1e-4)
    # Sums of shares in float32
    assert np.abs(forces - exact).max() < 2e-6 * np.abs(exact).max()
    assert inverted == 0


@pytest.mark.parametrize(("kind", "material"), CASES)
def test_the_matrix_at_rest_is_the_second_slope(kind, material):
    mesh, _ = mesh_of(kind, material, bent=0.3)
    _, matrix, _ = loads(mesh, mesh.points)
    stiffness = 4.0 * matrix.toarray()  # h² (β + ζ) is 1/4
    found = np.zeros_like(stiffness)
    step = 1e-5
    for place in range(len(stiffness)):
        shift = np.zeros(mesh.points.size)
        shift[place] = step
        shift = shift.reshape(-1, 3)
        difference = loads(mesh, mesh.points + shift)[0] - loads(mesh, mesh.points - shift)[0]
        found[:, place] = -difference.reshape(-1) / (2.0 * step)
    assert np.abs(stiffness - found).max() < 1e-4 * np.abs(found).max()


@pytest.mark.parametrize("kind", ["tetrahedra", "triangles"])
def test_the_matrix_under_tension_has_what_stress_adds(kind):
    mesh, _ = mesh_of(kind, skew=0.1)
    pulled = mesh.points * (1.1, 1.15, 1.0 if kind == "triangles" else 1.12)
    stiffness = 4.0 * loads(mesh, pulled)[1].toarray()
    rng = np.random.default_rng(5)
    for _ in range(3):
        direction = rng.standard_normal(pulled.shape)
        difference = loads(mesh, pulled + 1e-5 * direction)[0] - loads(mesh, pulled - 1e-5 * direction)[0]
        exact = -difference.reshape(-1) / 2e-5
        assert np.abs(stiffness @ direction.reshape(-1) - exact).max() < 3e-4 * np.abs(exact).max()


@pytest.mark.parametrize(("kind", "material"), CASES)
def test_the_matrix_is_never_indefinite(kind, material):
    mesh, _ = mesh_of(kind, material, damping_time=0.01)
    for size, squeeze in ((0.0, 0.5), (0.4, 1.0), (1.5, 1.0)):
        _, matrix, _ = loads(mesh, moved(mesh, size) * squeeze, zeta=0.1)
        values = np.linalg.eigvalsh(matrix.toarray())
        assert values[0] > -1e-6 * values[-1]


@pytest.mark.parametrize(("kind", "material"), CASES)
def test_turned_and_moved_without_strain_there_is_no_force(kind, material):
    mesh, _ = mesh_of(kind, material, bent=0.3, damping_time=0.1, cells=3)
    x = moved(mesh, 0.0)
    spin = np.array([3.0, -2.0, 5.0])
    v = np.cross(spin, x - x.mean(axis=0)) + np.array([1.0, 2.0, 3.0])
    area = 0.3 if kind != "triangles" else 0.8 * THICKNESS
    forces, _, _ = loads(mesh, x)
    assert np.abs(forces).max() < 1e-13 * YOUNG * area
    damped, _, _ = loads(mesh, x, v, zeta=0.5)
    # Velocities are float32: a stress of E (τ + ζ h) times their rounding over the size of an element
    assert np.abs(damped).max() < 1e-6 * YOUNG * area


@pytest.mark.parametrize("kind", KINDS)
def test_damping_is_a_time_and_a_share_of_the_step_times_the_stiffness(kind):
    h, zeta, time = 1e-3, 0.2, 0.03
    mesh, _ = mesh_of(kind, damping_time=time, bent=0.3)
    v = np.random.default_rng(2).standard_normal(mesh.points.shape).astype(np.float32)
    forces, matrix, _ = loads(mesh, mesh.points, v, h=h, zeta=zeta)
    gain = h * time + h * h * (0.25 * (1.0 - zeta) ** 2 + zeta)
    exact = -(time + zeta * h) / gain * (matrix @ v.reshape(-1)).reshape(-1, 3)
    assert np.abs(forces - exact).max() < 1e-5 * np.abs(exact).max()


@pytest.mark.parametrize("kind", KINDS)
def test_no_element_pushes_or_turns_itself(kind):
    mesh, _ = mesh_of(kind, damping_time=0.02, bent=0.3)
    x = moved(mesh, 0.15)
    v = np.random.default_rng(2).standard_normal(mesh.points.shape)
    forces, _, _ = loads(mesh, x, v, zeta=0.3)
    scale = np.abs(forces).sum()
    assert np.abs(forces.sum(axis=0)).max() < 1e-7 * scale
    assert np.abs(np.cross(x - x.mean(axis=0), forces).sum(axis=0)).max() < 1e-7 * scale


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
def test_a_box_is_the_element_with_incompatible_modes(poisson):
    points, elements = box_of_hexahedra((1, 1, 1), (0.9, 0.4, 0.6))
    exact = reference.incompatible_hexahedron(points[elements[0]], YOUNG, poisson)
    part = MeshPart(elements=elements, material=Elastic(young=YOUNG, poisson=poisson, density=1.0))
    _, matrix, _ = loads(make_mesh("box", points, [part], device="cpu"), points)
    order = np.argsort(elements[0])
    found = 4.0 * matrix.toarray().reshape(8, 3, 8, 3)[np.argsort(order)][:, :, np.argsort(order)].reshape(24, 24)
    assert np.abs(found - exact).max() < 1e-6 * np.abs(exact).max()


def test_an_irregular_hexahedron_has_the_incompatible_stiffness_of_the_paper():
    mesh, elements = mesh_of("hexahedra", skew=0.3)
    nodes = mesh.points[elements[0]]
    exact = reference.incompatible_hexahedron(nodes, 1.0, 0.3)
    assert np.abs(incompatible_stiffness(nodes, 0.3) - exact).max() < 1e-12 * np.abs(exact).max()


def test_pressure_pushes_along_the_normal_of_what_a_sheet_is_now():
    mesh, _ = mesh_of("triangles", pressure=50.0, skew=0.0)
    x = Rotation.from_rotvec([0.3, 0.5, -0.2]).apply(mesh.points * (1.1, 1.0, 1.0))
    plain, _ = mesh_of("triangles", skew=0.0)
    push = loads(mesh, x)[0].sum(axis=0) - loads(plain, x)[0].sum(axis=0)
    normal = Rotation.from_rotvec([0.3, 0.5, -0.2]).apply([0.0, 0.0, 1.0])
    assert push == pytest.approx(50.0 * 1.1 * 0.8 * normal, rel=1e-5, abs=1e-4)


@pytest.mark.parametrize("kind", SOLIDS)
def test_what_is_inside_out_is_counted_and_has_finite_forces(kind):
    mesh, elements = mesh_of(kind, "rubber")
    forces, matrix, inverted = loads(mesh, mesh.points * (1.0, 1.0, -0.7))
    assert inverted == len(elements)
    assert np.isfinite(forces).all()
    assert np.isfinite(matrix.data).all()


@wp.kernel
def find_tensile_parts(stress: wp.array[wp.mat33d], found: wp.array(dtype=wp.mat33d)):  # type: ignore[valid-type]
    found[wp.tid()] = tensile_part(stress[wp.tid()])


def test_the_tensile_part_has_the_eigenvalues_above_zero():
    rng = np.random.default_rng(0)
    values = [
        *rng.standard_normal((200, 3)), (1, 1, 1), (-1, -1, -1), (2, 2, -3), (-2, -2, 3), (1, 0, 0), (-1, 0, 0),
        (0, 0, 0), (1e-9, -1e-9, 1), (1, 1, 0), (1e9, 1, -1e9), (1, 1 + 1e-12, -1e-12),
    ]  # fmt: skip
    axes = Rotation.random(len(values), rng=rng).as_matrix()

    def with_values(kept):
        return axes @ (np.array(kept)[:, :, None] * axes.swapaxes(1, 2))

    found = wp.zeros(len(values), dtype=wp.mat33d, device="cpu")
    given: wp.array = wp.array(with_values(values), dtype=wp.mat33d, device="cpu")
    wp.launch(find_tensile_parts, len(values), inputs=[given, found], device="cpu")
    exact = with_values(np.maximum(values, 0.0))
    size = np.abs(values).max(axis=1)[:, None, None]
    assert (np.abs(found.numpy() - exact) <= 1e-7 * size).all()
