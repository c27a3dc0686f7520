"""Euclidean projection of impulses onto the sets of the blocks: boxes, friction cones, cones with rolling friction.

The Coulomb cone with cohesion has its apex at n = -cohesion. Rolling and spinning friction share the normal impulse of
the contact, so that the six rows are projected together: one cone after another would only be approximate.
"""

import warp as wp

from simwarp.kernels.cones.problem import BOX, CONTACT, ConeProblem

wp.set_module_options({"enable_backward": False})


@wp.func
def project_contact(p: wp.vec3, friction: float, cohesion: float) -> wp.vec3:
    """The point nearest to p = (n, t1, t2) [N·s] with |t| <= friction (n + cohesion)."""
    n = p[0] + cohesion
    square = p[1] * p[1] + p[2] * p[2]
    # Compared as squares: only sliding needs the root.
    if n <= 0.0 and friction * friction * square <= n * n:
        return wp.vec3(-cohesion, 0.0, 0.0)
    if n >= 0.0 and square <= friction * friction * n * n:
        return p
    t = wp.sqrt(square)
    pull = (n + friction * t) / (t * (1.0 + friction * friction))
    return wp.vec3(pull * t - cohesion, friction * pull * p[1], friction * pull * p[2])


@wp.func
def joint_projection_normal(n: float, lengths: wp.vec3, slopes: wp.vec3) -> float:
    """Normal impulse of the joint projection onto lengths[i] <= slopes[i] n, i = 0, 1, 2.

    Groups enter in the order of their ratio length / slope; each that is still outside pulls n up.
    """
    pulled = n
    weight = float(1.0)
    normal = n
    left = wp.vec3(1.0, 1.0, 1.0)
    for _ in range(3):
        pick = int(-1)
        for i in range(3):
            # Ratios compared as products: a slope of zero is a ratio of infinity.
            if left[i] > 0.0:
                if pick < 0:
                    pick = i
                elif lengths[i] * slopes[pick] > lengths[pick] * slopes[i]:
                    pick = i
        left[pick] = 0.0
        if lengths[pick] > slopes[pick] * wp.max(normal, 0.0):
            pulled += slopes[pick] * lengths[pick]
            weight += slopes[pick] * slopes[pick]
            normal = pulled / weight
    return normal


@wp.func
def shortened(length: float, limit: float) -> float:
    """Factor that brings a length down to a limit."""
    if length > limit:
        return limit / length
    return 1.0


@wp.func
def project_rolling(values: wp.array[float], row: int, slopes: wp.vec3, cohesion: float):
    """Rows (n, t1, t2, r1, r2, s) of `values` <- the nearest with |t|, |r|, |s| <= slopes (n + cohesion)."""
    t = wp.sqrt(values[row + 1] * values[row + 1] + values[row + 2] * values[row + 2])
    r = wp.sqrt(values[row + 3] * values[row + 3] + values[row + 4] * values[row + 4])
    s = wp.abs(values[row + 5])
    normal = wp.max(joint_projection_normal(values[row] + cohesion, wp.vec3(t, r, s), slopes), 0.0)
    shrink_t = shortened(t, slopes[0] * normal)
    shrink_r = shortened(r, slopes[1] * normal)
    values[row] = normal - cohesion
    values[row + 1] = values[row + 1] * shrink_t
    values[row + 2] = values[row + 2] * shrink_t
    values[row + 3] = values[row + 3] * shrink_r
    values[row + 4] = values[row + 4] * shrink_r
    values[row + 5] = values[row + 5] * (shortened(s, slopes[2] * normal))


@wp.func
def slopes_of(problem: ConeProblem, block: int) -> wp.vec3:
    """Coefficients of sliding [-], rolling [m] and spinning friction [m] of a ROLLING block."""
    return wp.vec3(problem.friction[block], problem.rolling[block], problem.spinning[block])


@wp.func
def project_block(problem: ConeProblem, values: wp.array[float], block: int):
    """The rows of one block in `values` <- their projection onto the block's set."""
    row = problem.block_row[block]
    kind = problem.block_kind[block]
    if kind == CONTACT:
        p = wp.vec3(values[row], values[row + 1], values[row + 2])
        q = project_contact(p, problem.friction[block], problem.cohesion[block])
        values[row] = q[0]
        values[row + 1] = q[1]
        values[row + 2] = q[2]
    elif kind == BOX:
        values[row] = wp.clamp(values[row], problem.lower[row], problem.upper[row])
    else:
        project_rolling(values, row, slopes_of(problem, block), problem.cohesion[block])


@wp.func
def project_all(problem: ConeProblem, values: wp.array[float]):
    """All rows of `values` <- their projection."""
    for block in range(problem.block_count):
        project_block(problem, values, block)
