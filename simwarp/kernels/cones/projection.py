"""Euclidean projection of impulses onto the sets of the blocks: boxes, friction cones, cones with rolling friction.

The Coulomb cone with cohesion has its apex at n = -cohesion. Rolling and spinning friction share the normal impulse of
the contact, so that the six rows are projected together: one cone after another would only be approximate.
"""

import warp as wp

from simwarp.core.types import BlockKind
from simwarp.kernels.cones.problem import ROLLING, ConeProblem
from simwarp.kernels.core.lanes import LANES, lane_of, meet, stride_of
from simwarp.kernels.core.native_views import VIEWS

wp.set_module_options({"enable_backward": False})


NEAREST_IN_CONE = """
    // Compared as squares: only sliding needs the root.
    auto nearest_in_cone = [](float n, float t1, float t2, float slope, float apex, auto q) {
        const float m = n + apex;
        const float square = t1 * t1 + t2 * t2;
        q[0] = n;
        q[1] = t1;
        q[2] = t2;
        if (m <= 0.0f && slope * slope * square <= m * m) {
            q[0] = -apex;
            q[1] = q[2] = 0.0f;
        } else if (!(m >= 0.0f && square <= slope * slope * m * m)) {
            const float t = sqrtf(square);
            const float pull = (m + slope * t) / (t * (1.0f + slope * slope));
            q[0] = pull * t - apex;
            q[1] = slope * pull * t1;
            q[2] = slope * pull * t2;
        }
    };
"""
"""C++: q <- the point nearest to (n, t1, t2) [N·s] with |t| <= slope (n + apex), `apex` the cohesion."""


@wp.func_native(
    f"""
    constexpr int BOX = {int(BlockKind.BOX)}, CONTACT = {int(BlockKind.CONTACT)};
"""
    + VIEWS
    + LANES
    + NEAREST_IN_CONE
    + """
    const Floats x = elements(values), slopes = elements(friction), apexes = elements(cohesion);
    const Floats lows = elements(lower), highs = elements(upper);
    const Ints rows = elements(block_row), kinds = elements(block_kind);
    ROLLED for (int b = first + lane; b < end; b += stride) {
        const int at = rows[b], kind = kinds[b];
        if (kind == CONTACT)
            nearest_in_cone(x[at], x[at + 1], x[at + 2], slopes[b], apexes[b], x + at);
        else if (kind == BOX)
            x[at] = wp::clamp(x[at], lows[at], highs[at]);
    }
    meet_lanes();
"""
)
def project_simple(
    first: int, end: int, block_row: wp.array[int], block_kind: wp.array[int], friction: wp.array[float],
    cohesion: wp.array[float], lower: wp.array[float], upper: wp.array[float], values: wp.array[float],
    lanes: int,
):  # fmt: skip
    """The rows of the BOX and CONTACT blocks in first..end-1 <- their projection."""
    ...


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
def project_blocks(problem: ConeProblem, values: wp.array[float], first: int, end: int):
    """The rows of the blocks first..end-1 in `values` <- their projection onto the blocks' sets."""
    project_simple(
        first, end, problem.block_row, problem.block_kind, problem.friction, problem.cohesion, problem.lower,
        problem.upper, values, problem.lanes,
    )  # fmt: skip
    if problem.rolling_count > 0:
        for block in range(first + lane_of(problem.lanes), end, stride_of(problem.lanes)):
            if problem.block_kind[block] == ROLLING:
                project_rolling(values, problem.block_row[block], slopes_of(problem, block), problem.cohesion[block])
        meet(problem.lanes)


@wp.func
def project_all(problem: ConeProblem, values: wp.array[float]):
    """All rows of `values` <- their projection."""
    project_blocks(problem, values, 0, problem.block_count)
