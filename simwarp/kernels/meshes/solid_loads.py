"""Forces and matrices of tetrahedra and hexahedra with one strain each, from float64 positions; objective damping.

Linear elasticity is that of Saint Venant and Kirchhoff, rubber is stable neo-Hookean (Smith, de Goes and Kim 2018). The
matrix has the material part, which is positive, and of the part that stress causes only that of tension. A hexahedron's
hourglass shapes are held by constant stiffness in the axes of R = polar(F), whose change with the shape counts too:
momentum is kept.
"""

import warp as wp

from simwarp.kernels.core.vector_math import matrix_to_float, to_double, to_float
from simwarp.kernels.meshes.flexible_laws import (
    RUBBER,
    FlexibleMaterials,
    FlexibleStep,
    Law,
    law_of,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

MODES = wp.constant(4)
"""Hourglass shapes of a hexahedron."""
POLAR_STEPS = wp.constant(20)
UPRIGHT = wp.constant(wp.float64(0.05))
"""Determinant of a deformation above which its rotation is found by Newton's method."""


@wp.struct
class SolidTables:
    """Solid elements of one kind. First axis: element, second its nodes."""

    node: wp.array2d[int]
    gradient: wp.array2d[wp.vec3d]  # of the shape functions in the rest shape [1/m]
    volume: wp.array[float]  # [m³]
    part: wp.array[int]
    hourglass: wp.array2d[wp.vec4d]  # (e, nodes) weights of a node in the four amplitudes; no elements of tetrahedra
    hourglass_stiffness: wp.array3d[wp.mat33]  # (e, 4, 4) for a Young's modulus of one [m]
    hourglass_blocks: wp.array2d[wp.mat33]  # (e, 36) the same between pairs of nodes [m]
    first_share: int  # place of the first element's first node among all elements' nodes
    first_block: int  # place of its first block among all elements' blocks


@wp.struct
class Deformation:
    """An element's deformation."""

    gradient: wp.mat33d  # F
    rate: wp.mat33d  # its change in time [1/s]
    determinant: wp.float64


@wp.func
def cofactor(f: wp.mat33d) -> wp.mat33d:
    """det(F) F⁻ᵀ, finite for every F."""
    a = wp.vec3d(f[0, 0], f[1, 0], f[2, 0])
    b = wp.vec3d(f[0, 1], f[1, 1], f[2, 1])
    c = wp.vec3d(f[0, 2], f[1, 2], f[2, 2])
    return wp.matrix_from_cols(wp.cross(b, c), wp.cross(c, a), wp.cross(a, b))


@wp.func
def unit_matrix() -> wp.mat33d:
    """The unit matrix."""
    return wp.identity(n=3, dtype=wp.float64)


@wp.func
def isotropic(law: Law, strain: wp.mat33d) -> wp.mat33d:
    """2 µ E + λ tr E."""
    return wp.float64(2.0) * law.shear * strain + law.lame * wp.trace(strain) * unit_matrix()


@wp.func
def tensile_part(stress: wp.mat33d) -> wp.mat33d:
    """A symmetric matrix without its eigenvalues below zero.

    Eigenvalues come from the cubic; the one whose sign is not that of the others has a projector that is well defined.
    """
    unit = unit_matrix()
    mean = wp.trace(stress) / wp.float64(3.0)
    rest = stress - mean * unit
    size = wp.sqrt(wp.ddot(rest, rest) / wp.float64(6.0))
    if size <= wp.float64(1.0e-14) * wp.abs(mean):
        return wp.max(mean, wp.float64(0.0)) * unit
    cosine = wp.determinant(rest) / (wp.float64(2.0) * size * size * size)
    turn = wp.cos(wp.acos(wp.clamp(cosine, wp.float64(-1.0), wp.float64(1.0))) / wp.float64(3.0))
    high = mean + wp.float64(2.0) * size * turn
    low = mean - size * (turn + wp.sqrt(wp.max(wp.float64(3.0) - wp.float64(3.0) * turn * turn, wp.float64(0.0))))
    middle = wp.float64(3.0) * mean - high - low
    zero = wp.float64(0.0)
    if low >= zero:
        return stress
    if high <= zero:
        return wp.mat33d()
    if middle <= zero:
        share = high / ((high - middle) * (high - low))
        return share * (stress - middle * unit) * (stress - low * unit)
    share = low / ((low - middle) * (low - high))
    return stress - share * (stress - high * unit) * (stress - middle * unit)


@wp.func
def rotation_of(f: wp.mat33d) -> wp.mat33d:
    """The rotation nearest to F."""
    j = wp.determinant(f)
    if j > UPRIGHT:
        r = f
        for _ in range(POLAR_STEPS):
            following = wp.float64(0.5) * (r + cofactor(r) / wp.determinant(r))
            change = wp.ddot(following - r, following - r)
            r = following
            if change < wp.float64(1.0e-14):  # what is left is the square of that
                break
        return r
    u = wp.mat33()
    sigma = wp.vec3()
    v = wp.mat33()
    wp.svd3(matrix_to_float(f), u, sigma, v)
    return wp.mat33d(u * wp.transpose(v))


@wp.func
def axial(m: wp.mat33d) -> wp.vec3d:
    """The vector of M - Mᵀ."""
    return wp.vec3d(m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])


@wp.func
def deformation(
    element: int, s: SolidTables, x: wp.array[wp.vec3d], v: wp.array[wp.vec3]
) -> Deformation:  # fmt: skip
    """The deformation gradient and its rate at an element's point."""
    d = Deformation()
    origin = x[s.node[element, 0]]
    at_origin = v[s.node[element, 0]]
    for a in range(1, s.node.shape[1]):
        node = s.node[element, a]
        slope = s.gradient[element, a]
        d.gradient += wp.outer(x[node] - origin, slope)
        d.rate += wp.outer(to_double(v[node]) - to_double(at_origin), slope)
    d.determinant = wp.determinant(d.gradient)
    return d


@wp.func
def load_solid(
    element: int, world: int, s: SolidTables, materials: FlexibleMaterials, step: FlexibleStep,
    x: wp.array[wp.vec3d], v: wp.array[wp.vec3], shares: wp.array[wp.vec3], blocks: wp.array[wp.mat33],
) -> int:  # fmt: skip
    """Writes an element's impulses on its nodes and its blocks of the matrix; returns 1 if it is turned inside out."""
    law = law_of(world, s.part[element], materials, step)
    d = deformation(element, s, x, v)
    f = d.gradient
    right = wp.transpose(f) * f
    stress = wp.mat33d()
    second = wp.mat33d()  # Piola and Kirchhoff's second stress
    if law.kind == RUBBER:
        # Of the shape of a rest volume: λ' = λ + µ leaves λ for small strains
        bulk = (law.lame + law.shear) * (d.determinant - wp.float64(1.0)) - law.shear
        stress = law.shear * f + bulk * cofactor(f)
        j = d.determinant
        second = law.shear * unit_matrix() + (bulk * j / wp.max(j * j, wp.float64(0.01))) * cofactor(right)
    else:
        second = isotropic(law, wp.float64(0.5) * (right - unit_matrix()))
        stress = f * second
    turning = wp.transpose(f) * d.rate
    strain_rate = wp.float64(0.5) * (turning + wp.transpose(turning))
    stress += law.rate * f * isotropic(law, strain_rate)
    volume = s.volume[element]
    rotation = wp.mat33d()
    if s.hourglass.shape[0] > 0:
        rotation = rotation_of(f)
        stress += load_hourglass(element, s, law, d, rotation, step.h, x, v, shares)
    nodes = s.node.shape[1]
    place = s.first_share + element * nodes
    for a in range(nodes):
        impulse = -step.h * to_float(wp.float64(volume) * (stress * s.gradient[element, a]))
        if s.hourglass.shape[0] > 0:
            impulse += shares[place + a]
        shares[place + a] = impulse
    tension = matrix_to_float(tensile_part(second))
    write_solid_blocks(element, s, law, matrix_to_float(f), matrix_to_float(rotation), tension, blocks)
    return wp.where(d.determinant > wp.float64(0.0), 0, 1)


@wp.func
def write_solid_blocks(
    element: int, s: SolidTables, law: Law, f: wp.mat33, rotation: wp.mat33, tension: wp.mat33,
    blocks: wp.array[wp.mat33],
):  # fmt: skip
    """An element's blocks of the matrix."""
    nodes = s.node.shape[1]
    volume = s.volume[element]
    shear = law.material_gain * volume * float(law.shear)
    lame = law.material_gain * volume * float(law.lame)
    left = f * wp.transpose(f)
    pushed = wp.zeros(shape=8, dtype=wp.vec3)
    place = s.first_block + element * (nodes * (nodes + 1) // 2)
    held = law.material_gain * law.young
    for a in range(nodes):
        slope = to_float(s.gradient[element, a])
        pushed[a] = f * slope
        pulled = law.geometric_gain * volume * (tension * slope)
        for b in range(a + 1):
            other = to_float(s.gradient[element, b])
            block = lame * wp.outer(pushed[a], pushed[b]) + shear * wp.outer(pushed[b], pushed[a])
            block += shear * wp.dot(slope, other) * left + wp.dot(pulled, other) * wp.identity(n=3, dtype=float)
            if s.hourglass.shape[0] > 0:
                block += held * (rotation * s.hourglass_blocks[element, a * (a + 1) // 2 + b] * wp.transpose(rotation))
            blocks[place] = block
            place += 1


@wp.func
def load_hourglass(
    element: int, s: SolidTables, law: Law, d: Deformation, rotation: wp.mat33d, h: float, x: wp.array[wp.vec3d],
    v: wp.array[wp.vec3], shares: wp.array[wp.vec3],
) -> wp.mat33d:  # fmt: skip
    """Writes the impulses of the hourglass shapes; returns the stress that the rotation's change with F causes."""
    upright = wp.transpose(rotation)
    stretch = upright * d.gradient
    turn = wp.inverse(wp.trace(stretch) * unit_matrix() - stretch)
    spin = turn * axial(upright * d.rate)
    amplitude = wp.zeros(shape=4, dtype=wp.vec3)  # γ·(Rᵀx - X), and its rate
    change = wp.zeros(shape=4, dtype=wp.vec3)
    origin = x[s.node[element, 0]]
    at_origin = v[s.node[element, 0]]
    for mode in range(MODES):
        q = wp.vec3d()
        rate = wp.vec3d()
        for a in range(8):
            weight = s.hourglass[element, a][mode]
            q += weight * (x[s.node[element, a]] - origin)
            rate += weight * (to_double(v[s.node[element, a]]) - to_double(at_origin))
        q = upright * q
        amplitude[mode] = to_float(q)
        change[mode] = to_float(upright * rate - wp.cross(spin, q))
    effort = wp.zeros(shape=4, dtype=wp.vec3)
    torque = wp.vec3d()
    for mode in range(MODES):
        total = wp.vec3()
        for other in range(MODES):
            strained = amplitude[other] + float(law.rate) * change[other]
            total += s.hourglass_stiffness[element, mode, other] * strained
        effort[mode] = law.young * total
        torque += wp.cross(to_double(amplitude[mode]), to_double(effort[mode]))
    turned = matrix_to_float(rotation)
    place = s.first_share + 8 * element
    for a in range(8):
        weights = s.hourglass[element, a]
        pull = wp.vec3()
        for mode in range(MODES):
            pull += float(weights[mode]) * effort[mode]
        shares[place + a] = -h * (turned * pull)
    return -rotation * wp.skew(turn * torque) / wp.float64(s.volume[element])
