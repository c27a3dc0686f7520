"""Readings of one mesh: places of its nodes, stresses of its elements."""

import warp as wp

from simwarp.kernels.core.tables import world_row
from simwarp.kernels.meshes.flexible_laws import RUBBER, FlexibleStep, law_of
from simwarp.kernels.meshes.mesh_loads import MeshTables
from simwarp.kernels.meshes.solid_loads import SolidTables, cofactor, deformation, isotropic, unit_matrix
from simwarp.kernels.meshes.triangle_loads import plane_stress, triangle_strain

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.kernel
def copy_nodes(all_nodes: wp.array2d[wp.vec3d], first: int, nodes: wp.array2d[wp.vec3d]):
    """The nodes of one mesh among those of all."""
    world, node = wp.tid()
    nodes[world, node] = all_nodes[world, first + node]


@wp.func
def von_mises(s: wp.mat33d) -> float:
    """Von Mises's stress of Cauchy's stress."""
    mean = wp.trace(s) / wp.float64(3.0)
    rest = s - mean * unit_matrix()
    return float(wp.sqrt(wp.float64(1.5) * wp.ddot(rest, rest)))


@wp.func
def solid_stress(
    element: int, world: int, s: SolidTables, meshes: MeshTables, x: wp.array[wp.vec3d], v: wp.array[wp.vec3]
) -> float:
    """Von Mises's stress at the point of a solid element [Pa]."""
    law = law_of(world, s.part[element], meshes.materials, FlexibleStep())
    f = deformation(element, s, x, v)
    right = wp.transpose(f.gradient) * f.gradient
    first = wp.mat33d()  # Piola and Kirchhoff's first stress
    if law.kind == RUBBER:
        bulk = (law.lame + law.shear) * (f.determinant - wp.float64(1.0)) - law.shear
        first = law.shear * f.gradient + bulk * cofactor(f.gradient)
    else:
        first = f.gradient * isotropic(law, wp.float64(0.5) * (right - unit_matrix()))
    volume = wp.max(wp.abs(f.determinant), wp.float64(1.0e-6))
    return von_mises(first * wp.transpose(f.gradient) / volume)


@wp.kernel
def measure_solid_stress(
    s: SolidTables, meshes: MeshTables, nodes: wp.array2d[wp.vec3d], still: wp.array[wp.vec3], first: int,
    place: int, stress: wp.array2d[float],
):  # fmt: skip
    """Of elements from `first` on, into columns from `place` on."""
    world, element = wp.tid()
    stress[world, place + element] = solid_stress(first + element, world, s, meshes, nodes[world], still)


@wp.kernel
def measure_triangle_stress(
    meshes: MeshTables, nodes: wp.array2d[wp.vec3d], first: int, place: int, stress: wp.array2d[float]
):
    """Likewise of triangles: the larger one of both sides of the sheet."""
    world, element = wp.tid()
    s = meshes.triangles
    part = s.part[first + element]
    law = law_of(world, part, meshes.materials, FlexibleStep())
    stretch = wp.zeros(shape=18, dtype=wp.vec3d)
    bending = wp.zeros(shape=6, dtype=wp.vec3d)
    strain = triangle_strain(first + element, s, nodes[world], stretch, bending)
    half = wp.float64(0.5) * wp.float64(s.thickness[world_row(world, s.thickness.shape[0]), part])
    poisson = wp.float64(meshes.materials.poisson[part])
    worst = float(0.0)
    for side in range(2):
        across = half
        if side == 1:
            across = -half
        found = plane_stress(wp.float64(law.young), poisson, strain.stretch + across * strain.curvature)
        square = found[0] * found[0] - found[0] * found[1] + found[1] * found[1]
        square += wp.float64(3.0) * found[2] * found[2]
        worst = wp.max(worst, float(wp.sqrt(square)))
    stress[world, place + element] = worst


@wp.kernel
def count_inverted(
    s: SolidTables, nodes: wp.array2d[wp.vec3d], still: wp.array[wp.vec3], first: int, count: wp.array[int]
):
    """Of elements from `first` on, those whose determinant is not above zero are added, world by world."""
    world, element = wp.tid()
    if not deformation(first + element, s, nodes[world], still).determinant > wp.float64(0.0):
        wp.atomic_add(count, world, 1)
