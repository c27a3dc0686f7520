"""Meshes at a state: places of all nodes, the energy that elements store."""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.meshes.flexible_laws import RUBBER, FlexibleMaterials, FlexibleStep, Law, law_of
from simwarp.kernels.meshes.mesh_loads import MeshTables
from simwarp.kernels.meshes.solid_loads import MODES, SolidTables, deformation, isotropic, rotation_of, unit_matrix
from simwarp.kernels.meshes.triangle_loads import TriangleTables, plane_stress, triangle_strain

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.kernel
def measure_nodes(
    # inputs
    worlds: WorldRange,
    meshes: MeshTables,
    state: StateArrays,
    # outputs
    nodes: wp.array2d[wp.vec3d],
):
    """Positions of all nodes, glued and fixed ones too, world [m]."""
    k, node = wp.tid()
    world = worlds.first + k
    body = meshes.glue.body[node]
    x = meshes.glue.place[node]
    if body >= 0:
        if meshes.glue.is_glued[node] == 1:
            x = state.body_x[world, body] + wp.quat_rotate(state.body_rot[world, body], x)
        else:
            x = state.body_x[world, body]
    nodes[world, node] = x


@wp.func
def hourglass_energy(
    element: int, s: SolidTables, law: Law, rotation: wp.mat33d, x: wp.array[wp.vec3d]
) -> wp.float64:  # fmt: skip
    """Of the shapes that one strain does not see [J]."""
    amplitude = wp.zeros(shape=4, dtype=wp.vec3d)
    origin = x[s.node[element, 0]]
    for mode in range(MODES):
        for a in range(8):
            amplitude[mode] = amplitude[mode] + s.hourglass[element, a][mode] * (x[s.node[element, a]] - origin)
    total = wp.float64(0.0)
    for mode in range(MODES):
        for other in range(MODES):
            stiffness = wp.mat33d(s.hourglass_stiffness[element, mode, other])
            q = wp.transpose(rotation) * amplitude[mode]
            total += wp.dot(q, stiffness * (wp.transpose(rotation) * amplitude[other]))
    return wp.float64(0.5) * wp.float64(law.young) * total


@wp.func
def solid_energy(
    element: int, world: int, s: SolidTables, materials: FlexibleMaterials, x: wp.array[wp.vec3d], v: wp.array[wp.vec3]
) -> wp.float64:
    """Strain energy of a solid element [J], zero at rest."""
    half = wp.float64(0.5)
    law = law_of(world, s.part[element], materials, FlexibleStep())
    f = deformation(element, s, x, v)
    right = wp.transpose(f.gradient) * f.gradient
    density = wp.float64(0.0)
    if law.kind == RUBBER:
        # µ/2 (tr C - 3) - µ (J - 1) + (λ + µ)/2 (J - 1)², whose derivative by F is the stress of load_solid
        grown = f.determinant - wp.float64(1.0)
        density = half * law.shear * (wp.trace(right) - wp.float64(3.0)) - law.shear * grown
        density += half * (law.lame + law.shear) * grown * grown
    else:
        strain = half * (right - unit_matrix())
        density = half * wp.ddot(strain, isotropic(law, strain))
    energy = density * wp.float64(s.volume[element])
    if s.hourglass.shape[0] > 0:
        energy += hourglass_energy(element, s, law, rotation_of(f.gradient), x)
    return energy


@wp.func
def triangle_energy(
    element: int, world: int, s: TriangleTables, materials: FlexibleMaterials, x: wp.array[wp.vec3d]
) -> wp.float64:
    """Strain energy of a triangle [J], zero at rest; pressure has none."""
    half = wp.float64(0.5)
    part = s.part[element]
    law = law_of(world, part, materials, FlexibleStep())
    stretch = wp.zeros(shape=18, dtype=wp.vec3d)
    bending = wp.zeros(shape=6, dtype=wp.vec3d)
    strain = triangle_strain(element, s, x, stretch, bending)
    thickness = wp.float64(s.thickness[world_row(world, s.thickness.shape[0]), part])
    poisson = wp.float64(materials.poisson[part])
    stiff = wp.float64(s.area[element]) * wp.float64(law.young) * thickness
    energy = half * wp.dot(strain.stretch, plane_stress(stiff, poisson, strain.stretch))
    stiff_bending = stiff * thickness * thickness / wp.float64(12.0)
    return energy + half * wp.dot(strain.curvature, plane_stress(stiff_bending, poisson, strain.curvature))


@wp.kernel
def add_strain_energy(
    # inputs
    worlds: WorldRange,
    meshes: MeshTables,
    nodes: wp.array2d[wp.vec3d],
    still: wp.array[wp.vec3],
    # outputs
    energy: wp.array[wp.float64],
):
    """Adds the energy that elements of meshes store [J]; `still` are zeros, one for each node."""
    world = worlds.first + wp.tid()
    total = wp.float64(0.0)
    for element in range(meshes.tetrahedra.node.shape[0]):
        total += solid_energy(element, world, meshes.tetrahedra, meshes.materials, nodes[world], still)
    for element in range(meshes.hexahedra.node.shape[0]):
        total += solid_energy(element, world, meshes.hexahedra, meshes.materials, nodes[world], still)
    for element in range(meshes.triangles.node.shape[0]):
        total += triangle_energy(element, world, meshes.triangles, meshes.materials, nodes[world])
    energy[world] = energy[world] + total
