"""Forces and matrices of rotation-free triangles (Flores and Oñate 2005): membrane, bending, damping, pressure."""

import warp as wp

from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float
from simwarp.kernels.meshes.flexible_laws import FlexibleMaterials, FlexibleStep, law_of

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class TriangleTables:
    """Triangles. First axis of arrays without another word: element."""

    node: wp.array2d[
        int
    ]  # (e, 6) its own and its neighbours'; where there is none, its first one, whose slopes are zero
    slope: wp.array3d[wp.vec2d]  # (e, 3, 4) of shape functions at the middles of sides [1/m]
    plain: wp.array2d[wp.vec2d]  # (e, 3) of the flat triangle's [1/m]
    area: wp.array[float]  # [m²]
    curvature: wp.array[wp.vec3d]  # of the rest shape [1/m]
    part: wp.array[int]
    thickness: wp.array2d[float]  # (1 or W, parts) [m]
    pressure: wp.array2d[float]  # (1 or W, parts) along the normal about which the nodes go counter-clockwise [Pa]
    first_share: int  # place of the first element's first node among all elements' nodes
    first_block: int  # place of its first block among all elements' blocks


@wp.func
def plane_stress(stiffness: wp.float64, poisson: wp.float64, strain: wp.vec3d) -> wp.vec3d:
    """Stresses xx, yy, xy of strains xx, yy and twice xy."""
    one, half = wp.float64(1.0), wp.float64(0.5)
    factor = stiffness / (one - poisson * poisson)
    return factor * wp.vec3d(
        strain[0] + poisson * strain[1], poisson * strain[0] + strain[1], half * (one - poisson) * strain[2]
    )  # fmt: skip


@wp.func
def tensile_plane(n: wp.vec3d) -> wp.vec3d:
    """Plane stresses xx, yy, xy without the eigenvalue below zero."""
    half = wp.float64(0.5)
    middle = half * (n[0] + n[1])
    reach = wp.sqrt(half * (n[0] - n[1]) * half * (n[0] - n[1]) + n[2] * n[2])
    low, high = middle - reach, middle + reach
    if low >= wp.float64(0.0):
        return n
    if high <= wp.float64(0.0):
        return wp.vec3d()
    # high times its projector: (n - low 1) / (high - low)
    share = high / (high - low)
    return share * wp.vec3d(n[0] - low, n[1] - low, n[2])


@wp.struct
class TriangleStrain:
    """Strains of a triangle: along both axes, and twice the mixed one."""

    stretch: wp.vec3d
    curvature: wp.vec3d  # beyond that of the rest shape [1/m]
    normal: wp.vec3d
    push: wp.vec3d  # of a pressure of one on each of its nodes [m²]


@wp.func
def triangle_strain(
    element: int, s: TriangleTables, x: wp.array[wp.vec3d], stretch: wp.fixedarray(dtype=wp.vec3d, shape=18),
    bending: wp.fixedarray(dtype=wp.vec3d, shape=6),
) -> TriangleStrain:  # fmt: skip
    """Strains, and what they change with nodes: a node's stretch in three vectors, its bending along the normal."""
    strain = TriangleStrain()
    two = wp.float64(2.0)
    third = wp.float64(1.0) / wp.float64(3.0)
    origin = x[s.node[element, 0]]
    edge1 = x[s.node[element, 1]] - origin
    edge2 = x[s.node[element, 2]] - origin
    strain.push = wp.cross(edge1, edge2) / wp.float64(6.0)
    p1 = s.plain[element, 1]
    p2 = s.plain[element, 2]
    tangent0 = p1[0] * edge1 + p2[0] * edge2
    tangent1 = p1[1] * edge1 + p2[1] * edge2
    across = wp.cross(tangent0, tangent1)
    strain.normal = wp.normalize(across)
    metric = wp.vec3d()
    h00 = wp.vec3d()
    h11 = wp.vec3d()
    h01 = wp.vec3d()
    for side in range(3):
        g0 = wp.vec3d()
        g1 = wp.vec3d()
        for k in range(4):
            node = s.node[element, wp.where(k < 3, k, 3 + side)]
            slope = s.slope[element, side, k]
            g0 += slope[0] * (x[node] - origin)
            g1 += slope[1] * (x[node] - origin)
        metric += third * wp.vec3d(wp.dot(g0, g0), wp.dot(g1, g1), two * wp.dot(g0, g1))
        plain = s.plain[element, side]
        h00 -= two * plain[0] * g0
        h11 -= two * plain[1] * g1
        h01 -= plain[0] * g1 + plain[1] * g0
        for k in range(4):
            at = wp.where(k < 3, k, 3 + side)
            slope = s.slope[element, side, k]
            stretch[3 * at] = stretch[3 * at] + third * slope[0] * g0
            stretch[3 * at + 1] = stretch[3 * at + 1] + third * slope[1] * g1
            stretch[3 * at + 2] = stretch[3 * at + 2] + third * (slope[0] * g1 + slope[1] * g0)
            bending[at] = bending[at] - two * wp.vec3d(
                plain[0] * slope[0], plain[1] * slope[1], plain[0] * slope[1] + plain[1] * slope[0]
            )  # fmt: skip
    one = wp.float64(1.0)
    strain.stretch = wp.float64(0.5) * wp.vec3d(metric[0] - one, metric[1] - one, metric[2])
    strain.curvature = along(strain.normal, h00, h11, h01) - s.curvature[element]
    # Turning the flat triangle turns its normal: parts of the curvature along the dual base of its tangents
    lean0 = along(wp.cross(tangent1, across), h00, h11, h01) / wp.dot(across, across)
    lean1 = along(wp.cross(across, tangent0), h00, h11, h01) / wp.dot(across, across)
    for k in range(3):
        plain = s.plain[element, k]
        bending[k] = bending[k] - plain[0] * lean0 - plain[1] * lean1
    return strain


@wp.func
def along(direction: wp.vec3d, h00: wp.vec3d, h11: wp.vec3d, h01: wp.vec3d) -> wp.vec3d:
    """Parts of the curvature along a direction, of which the mixed one counts twice."""
    return wp.vec3d(wp.dot(direction, h00), wp.dot(direction, h11), wp.float64(2.0) * wp.dot(direction, h01))


@wp.func
def load_triangle(
    element: int, world: int, s: TriangleTables, materials: FlexibleMaterials, step: FlexibleStep,
    x: wp.array[wp.vec3d], v: wp.array[wp.vec3], shares: wp.array[wp.vec3], blocks: wp.array[wp.mat33],
):  # fmt: skip
    """Writes an element's impulses on its nodes and its blocks of the matrix."""
    part = s.part[element]
    law = law_of(world, part, materials, step)
    stretch = wp.zeros(shape=18, dtype=wp.vec3d)
    bending = wp.zeros(shape=6, dtype=wp.vec3d)
    strain = triangle_strain(element, s, x, stretch, bending)
    stretch_rate = wp.vec3d()
    curvature_rate = wp.vec3d()
    for k in range(6):
        u = to_double(v[s.node[element, k]])
        stretch_rate += wp.vec3d(
            wp.dot(stretch[3 * k], u), wp.dot(stretch[3 * k + 1], u), wp.dot(stretch[3 * k + 2], u)
        )  # fmt: skip
        curvature_rate += wp.dot(strain.normal, u) * bending[k]
    thickness = wp.float64(s.thickness[world_row(world, s.thickness.shape[0]), part])
    poisson = wp.float64(materials.poisson[part])
    stiff = wp.float64(s.area[element]) * wp.float64(law.young) * thickness
    stiff_bending = stiff * thickness * thickness / wp.float64(12.0)
    pull = plane_stress(stiff, poisson, strain.stretch)
    tension = tensile_plane(pull)
    pull += plane_stress(stiff, poisson, law.rate * stretch_rate)
    moment = plane_stress(stiff_bending, poisson, strain.curvature + law.rate * curvature_rate)
    pressure = wp.float64(s.pressure[world_row(world, s.pressure.shape[0]), part])
    for k in range(6):
        force = pull[0] * stretch[3 * k] + pull[1] * stretch[3 * k + 1] + pull[2] * stretch[3 * k + 2]
        force += wp.dot(moment, bending[k]) * strain.normal
        if k < 3:
            force -= pressure * strain.push
        shares[s.first_share + 6 * element + k] = -step.h * to_float(force)
    gain = wp.float64(law.material_gain)
    write_triangle_blocks(
        element, s, gain * stiff, gain * stiff_bending, poisson, wp.float64(law.geometric_gain) * tension,
        to_float(strain.normal), stretch, bending, blocks,
    )  # fmt: skip


@wp.func
def write_triangle_blocks(
    element: int, s: TriangleTables, stiff: wp.float64, stiff_bending: wp.float64, poisson: wp.float64,
    tension: wp.vec3d, normal: wp.vec3, stretch: wp.fixedarray(dtype=wp.vec3d, shape=18),
    bending: wp.fixedarray(dtype=wp.vec3d, shape=6), blocks: wp.array[wp.mat33],
):  # fmt: skip
    """An element's blocks of the matrix."""
    law = plane_stress(stiff, poisson, wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0)))
    direct = float(law[0])
    mixed = float(law[1])
    third = wp.float64(1.0) / wp.float64(3.0)
    place = s.first_block + 21 * element
    for k in range(6):
        pulled0 = direct * to_float(stretch[3 * k]) + mixed * to_float(stretch[3 * k + 1])
        pulled1 = mixed * to_float(stretch[3 * k]) + direct * to_float(stretch[3 * k + 1])
        pulled2 = 0.5 * (direct - mixed) * to_float(stretch[3 * k + 2])
        bent = plane_stress(stiff_bending, poisson, bending[k])
        for other in range(k + 1):
            total = wp.outer(pulled0, to_float(stretch[3 * other])) + wp.outer(
                pulled1, to_float(stretch[3 * other + 1])
            )
            total += wp.outer(pulled2, to_float(stretch[3 * other + 2]))
            total += float(wp.dot(bent, bending[other])) * wp.outer(normal, normal)
            taut = wp.float64(0.0)
            for side in range(3):
                a = slope_of(element, side, k, s)
                b = slope_of(element, side, other, s)
                taut += third * (tension[0] * a[0] * b[0] + tension[1] * a[1] * b[1])
                taut += third * tension[2] * (a[0] * b[1] + a[1] * b[0])
            blocks[place] = total + float(taut) * wp.identity(n=3, dtype=float)
            place += 1


@wp.func
def slope_of(element: int, side: int, node: int, s: TriangleTables) -> wp.vec2d:
    """Slope of a node's shape function at the middle of a side."""
    if node < 3:
        return s.slope[element, side, node]
    if node == 3 + side:
        return s.slope[element, side, 3]
    return wp.vec2d()
