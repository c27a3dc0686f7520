"""Device half of solid elements: strains from float64 positions, forces, damping on strain rates, tangent.

    F = Σ x_a ∇N_aᵀ,  E = (FᵀF - 1) / 2
    Elastic (Saint Venant-Kirchhoff)     P = F S,  S = 2μE + λ tr E
    Rubber (stable neo-Hookean)          P = μF + ((λ + μ)(J - 1) - μ) cof F
    forces                               f_a = -V (P + F (τ + ζh)(2μĖ + λ tr Ė)) ∇N_a,  Ė = sym(Fᵀ Σ v_a ∇N_aᵀ)
    tangent                              V [λ (F∇N_a)(F∇N_b)ᵀ + μ FFᵀ ∇N_a·∇N_b + μ (F∇N_b)(F∇N_a)ᵀ + ∇N_aᵀ S⁺ ∇N_b 1]

S⁺ has the eigenvalues of S above zero. A hexahedron adds the energy of q = Rᵀ Σ γ_a x_a, with R of the polar
decomposition of F; its forces are the gradient of that energy, rotation included, so that they have no moment.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

LAW_ELASTIC = wp.constant(0)
LAW_RUBBER = wp.constant(1)
POLAR_STEPS = wp.constant(6)
"""Steps of Newton's method for the rotation of a deformation; it converges in order 2."""
FLATTEST = wp.constant(0.05)
"""Volume over that at rest, below which a rotation comes of a singular value decomposition."""

Corners = wp.types.matrix(shape=(8, 3), dtype=wp.float32)


@wp.struct
class SolidTables:
    """Elements of a mesh, the lists that gather what they compute, and the law of their material."""

    corners: int  # of an element
    law: int
    first: float  # Lamé's λ [Pa]
    second: float  # Lamé's μ [Pa]
    damping_time: float  # [s]
    elements: wp.array2d[int]
    gradients: wp.array2d[wp.vec3d]
    volumes: wp.array[float]
    hourglass: wp.array3d[wp.float64]  # (E, 4, 8), empty for tetrahedra
    hourglass_stiffness: wp.array3d[wp.mat33]  # (E, 4, 4)
    hourglass_blocks: wp.array2d[wp.mat33]  # (E, 36), of pairs of corners
    masses: wp.array[float]  # by place in the order of elimination
    held: wp.array[int]  # by place; 1: the node does not move
    node_of: wp.array[int]  # node of the mesh at a place
    node_start: wp.array[int]
    node_corner: wp.array[int]
    block_start: wp.array[int]
    block_pair: wp.array[int]
    block_nodes: wp.array2d[int]  # places of row and column


@wp.struct
class SolidStep:
    """Numbers of one linearly implicit step."""

    dt: float
    numerical_damping: float  # ζ
    average: float  # β
    gravity: wp.vec3


@wp.func
def rotation_of(f: wp.mat33) -> wp.mat33:
    """Rotation of the polar decomposition of F; of an inverted one the nearest rotation."""
    if wp.determinant(f) < FLATTEST:
        u = wp.mat33()
        sigma = wp.vec3()
        v = wp.mat33()
        wp.svd3(f, u, sigma, v)
        if wp.determinant(u) * wp.determinant(v) < 0.0:
            u = u * wp.mat33(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0)
        return u * wp.transpose(v)
    r = f
    for _ in range(POLAR_STEPS):
        r = 0.5 * (r + wp.transpose(wp.inverse(r)))
    return r


@wp.func
def cofactors(f: wp.mat33d) -> wp.mat33d:
    """J F⁻ᵀ, of any F."""
    a, b, c = (
        wp.vec3d(f[0, 0], f[1, 0], f[2, 0]),
        wp.vec3d(f[0, 1], f[1, 1], f[2, 1]),
        wp.vec3d(f[0, 2], f[1, 2], f[2, 2]),
    )
    return wp.matrix_from_cols(wp.cross(b, c), wp.cross(c, a), wp.cross(a, b))


@wp.func
def tensile(s: wp.mat33) -> wp.mat33:
    """S without its eigenvalues below zero."""
    minor = s[0, 0] * s[1, 1] - s[0, 1] * s[1, 0]
    whole = wp.determinant(s)
    if minor >= 0.0:
        if s[0, 0] >= 0.0 and whole >= 0.0 and s[2, 2] >= 0.0:
            return s
        if s[0, 0] <= 0.0 and whole <= 0.0 and s[2, 2] <= 0.0:
            return wp.mat33()
    axes, values = wp.eig3(s)
    kept = wp.diag(wp.vec3(wp.max(values[0], 0.0), wp.max(values[1], 0.0), wp.max(values[2], 0.0)))
    return axes * kept * wp.transpose(axes)


@wp.func
def axial(a: wp.mat33) -> wp.vec3:
    """Vector of the skew matrix A - Aᵀ."""
    return wp.vec3(a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1])


@wp.func
def spin_gain(f: wp.mat33, r: wp.mat33) -> wp.mat33:
    """G of the spin G axial(Rᵀ F') of R, in turned axes; zero where the deformation leaves no rotation of its own."""
    u = wp.transpose(r) * f
    turned = wp.trace(u) * wp.identity(n=3, dtype=wp.float32) - 0.5 * (u + wp.transpose(u))
    if wp.determinant(turned) < FLATTEST:
        return wp.mat33()
    return wp.inverse(turned)


@wp.struct
class SolidStrain:
    """Deformation of an element, in world axes."""

    exact: wp.mat33d  # F
    f: wp.mat33
    rate: wp.mat33  # F' [1/s]
    stress: wp.mat33  # S of the law [Pa], in rest axes
    pressed: wp.mat33  # V P, dampers included [J]
    rotation: wp.mat33  # of the hourglass stiffness


@wp.func
def strain_solid(element: int, solid: SolidTables, x: wp.array[wp.vec3d], v: wp.array[wp.vec3d]):
    """Deformation of an element and its rate."""
    strained = SolidStrain()
    origin = x[solid.elements[element, 0]]
    drift = v[solid.elements[element, 0]]
    exact = wp.mat33d()
    rates = wp.mat33d()
    for a in range(1, solid.corners):
        node = solid.elements[element, a]
        slope = solid.gradients[element, a]
        exact += wp.outer(x[node] - origin, slope)
        rates += wp.outer(v[node] - drift, slope)
    strained.exact = exact
    strained.f = wp.mat33(exact)
    strained.rate = wp.mat33(rates)
    strained.rotation = wp.identity(n=3, dtype=wp.float32)
    return strained


@wp.func
def stress_solid(element: int, solid: SolidTables, delay: float, strained: SolidStrain):
    """Stresses of an element's deformation; what comes back has them. `delay`: τ + ζh."""
    found = strained
    first, second = solid.first, solid.second
    eye = wp.identity(n=3, dtype=wp.float32)
    f = strained.f
    pressed = wp.mat33()
    if solid.law == LAW_ELASTIC:
        h = strained.exact - wp.identity(n=3, dtype=wp.float64)
        strain = wp.mat33(wp.float64(0.5) * (h + wp.transpose(h) + wp.transpose(h) * h))
        stress = 2.0 * second * strain + first * wp.trace(strain) * eye
        pressed = f * stress
        found.stress = stress
    else:
        cofactor = cofactors(strained.exact)
        volume = wp.determinant(strained.exact)
        push = wp.float64(first + second) * (volume - wp.float64(1.0))
        pressed = wp.mat33(wp.float64(second) * (strained.exact - cofactor) + push * cofactor)
        ratio = float(volume)
        if wp.abs(ratio) < FLATTEST:
            ratio = wp.where(ratio < 0.0, -FLATTEST, FLATTEST)
        turned = wp.mat33(cofactor)
        found.stress = second * eye + (float(push) - second) / ratio * (wp.transpose(turned) * turned)
    flow = wp.transpose(f) * strained.rate
    flow = 0.5 * (flow + wp.transpose(flow))
    pressed += delay * (f * (2.0 * second * flow + first * wp.trace(flow) * eye))
    found.pressed = solid.volumes[element] * pressed
    return found


@wp.func
def resist_hourglass(
    element: int, solid: SolidTables, delay: float, x: wp.array[wp.vec3d], v: wp.array[wp.vec3d],
    strained: SolidStrain, forces: wp.array[wp.vec3],
):  # fmt: skip
    """Add the hourglass forces of a hexahedron to `forces`; what comes back has its rotation, and the stress that
    turns the amounts with it.
    """
    found = strained
    rotation = rotation_of(strained.f)
    back = wp.transpose(rotation)
    gain = spin_gain(strained.f, rotation)
    spin = gain * axial(back * strained.rate)
    origin = x[solid.elements[element, 0]]
    drift = v[solid.elements[element, 0]]
    amounts = wp.matrix(shape=(4, 3), dtype=wp.float32)
    delayed = wp.matrix(shape=(4, 3), dtype=wp.float32)
    for i in range(4):
        place = wp.vec3d()
        speed = wp.vec3d()
        for a in range(1, 8):
            node = solid.elements[element, a]
            place += solid.hourglass[element, i, a] * (x[node] - origin)
            speed += solid.hourglass[element, i, a] * (v[node] - drift)
        amount = back * wp.vec3(place)
        amounts[i] = amount
        delayed[i] = amount + delay * (back * wp.vec3(speed) - wp.cross(spin, amount))
    moment = wp.vec3()
    for i in range(4):
        push = wp.vec3()
        for j in range(4):
            push += solid.hourglass_stiffness[element, i, j] * delayed[j]
        moment += wp.cross(amounts[i], push)
        push = rotation * push
        for a in range(1, 8):
            forces[element * 8 + a] -= float(solid.hourglass[element, i, a]) * push
    found.rotation = rotation
    found.pressed = strained.pressed - rotation * wp.skew(wp.transpose(gain) * moment)
    return found


@wp.func
def tangent_solid(element: int, solid: SolidTables, step: SolidStep, strained: SolidStrain, blocks: wp.array[wp.mat33]):
    """Blocks of h d + h² (β + ζ) K of an element's pairs of corners."""
    n = solid.corners
    size = solid.volumes[element]
    second = solid.second
    implicit = step.dt * step.dt * (step.average + step.numerical_damping)
    elastic = step.dt * solid.damping_time + implicit
    left = strained.f * wp.transpose(strained.f)
    taut = implicit * size * tensile(strained.stress)
    rotation = strained.rotation
    eye = wp.identity(n=3, dtype=wp.float32)
    pushed = Corners()
    for a in range(n):
        pushed[a] = strained.f * wp.vec3(solid.gradients[element, a])
    pair = element * (n * (n + 1) / 2)
    for a in range(n):
        gradient_a = wp.vec3(solid.gradients[element, a])
        stretched = taut * gradient_a
        along = elastic * size * pushed[a]
        for b in range(a + 1):
            gradient_b = wp.vec3(solid.gradients[element, b])
            block = (elastic * size * second * wp.dot(gradient_a, gradient_b)) * left
            block += solid.first * wp.outer(along, pushed[b]) + second * wp.outer(pushed[b], along)
            block += wp.dot(stretched, gradient_b) * eye
            if n == 8:
                hourglass = solid.hourglass_blocks[element, a * (a + 1) / 2 + b]
                block += elastic * (rotation * hourglass * wp.transpose(rotation))
            blocks[pair] = block
            pair += 1


@wp.func
def measure_solid(
    element: int, solid: SolidTables, step: SolidStep, x: wp.array[wp.vec3d], v: wp.array[wp.vec3d],
    forces: wp.array[wp.vec3], blocks: wp.array[wp.mat33],
):  # fmt: skip
    """Forces on the corners of an element, dampers included, and blocks of h d + h² (β + ζ) K of its pairs."""
    n = solid.corners
    delay = solid.damping_time + step.numerical_damping * step.dt
    for a in range(n):
        forces[element * n + a] = wp.vec3()
    strained = stress_solid(element, solid, delay, strain_solid(element, solid, x, v))
    if n == 8:
        strained = resist_hourglass(element, solid, delay, x, v, strained, forces)
    total = wp.vec3()
    for a in range(1, n):
        force = forces[element * n + a] - strained.pressed * wp.vec3(solid.gradients[element, a])
        forces[element * n + a] = force
        total += force
    forces[element * n] = -total
    tangent_solid(element, solid, step, strained, blocks)


@wp.func
def gather_solid(
    solid: SolidTables, step: SolidStep, forces: wp.array[wp.vec3], blocks: wp.array[wp.mat33],
    rhs: wp.array(dtype=Any), values: wp.array(dtype=Any),
):  # fmt: skip
    """Impulses of a step, and blocks of M + h d + h² (β + ζ) K, from those of the elements. Held nodes get none."""
    for place in range(solid.masses.shape[0]):
        total = solid.masses[place] * step.gravity
        for entry in range(solid.node_start[place], solid.node_start[place + 1]):
            total += forces[solid.node_corner[entry]]
        if solid.held[place] == 1:
            total = wp.vec3()
        for k in range(3):
            rhs[3 * place + k] = rhs.dtype(step.dt * total[k])
    for index in range(solid.block_nodes.shape[0]):
        row, column = solid.block_nodes[index, 0], solid.block_nodes[index, 1]
        block = wp.mat33()
        if solid.held[row] + solid.held[column] == 0:
            for entry in range(solid.block_start[index], solid.block_start[index + 1]):
                pair = solid.block_pair[entry]
                if pair % 2 == 0:
                    block += blocks[pair / 2]
                else:
                    block += wp.transpose(blocks[pair / 2])
        if row == column:
            block += solid.masses[row] * wp.identity(n=3, dtype=wp.float32)
        for i in range(3):
            for j in range(3):
                values[9 * index + 3 * j + i] = values.dtype(block[i, j])


@wp.kernel(enable_backward=False)
def measure_solids(
    # inputs
    solid: SolidTables,
    step: SolidStep,
    x: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
    # outputs
    forces: wp.array2d[wp.vec3],
    blocks: wp.array2d[wp.mat33],
):
    """Forces and blocks of all elements: a thread for each in each world."""
    world, element = wp.tid()
    measure_solid(element, solid, step, x[world], v[world], forces[world], blocks[world])
