"""Colours of surfaces by values of their elements or nodes."""

import warp as wp

from simwarp.sensors.cameras.appearance_kernels import AppearanceArrays

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class ValueTables:
    """A surface whose colours are values."""

    first_tree: int  # of it in world 0, those of the other worlds follow
    triangle: wp.array2d[int]  # (T, 3) vertices
    node: wp.array2d[int]  # (v, k) that carry each vertex
    weight: wp.array2d[float]
    source_start: wp.array[int]  # (n + 1,) CSR: columns of values whose mean is that of a node
    source: wp.array[int]
    ramp: wp.array[wp.vec3]  # linear albedos from the least value to the most


@wp.func
def value_of_vertex(world: int, vertex: int, s: ValueTables, values: wp.array2d[float]) -> float:
    """What the nodes that carry a vertex have, each the mean of its sources."""
    total = float(0.0)
    for part in range(s.node.shape[1]):
        weight = s.weight[vertex, part]
        if weight != 0.0:
            node = s.node[vertex, part]
            start = s.source_start[node]
            end = s.source_start[node + 1]
            found = float(0.0)
            for index in range(start, end):
                found += values[world, s.source[index]]
            total += weight * found / float(wp.max(end - start, 1))
    return total


@wp.func
def ramp_color(share: float, ramp: wp.array[wp.vec3]) -> wp.vec3:
    """The colour of a share from 0 to 1; what lies beyond has that of the end, what is no number is black."""
    if not (share == share):
        return wp.vec3()
    last = ramp.shape[0] - 1
    place = wp.clamp(share, 0.0, 1.0) * float(last)
    index = wp.min(int(place), last - 1)
    rest = place - float(index)
    return (1.0 - rest) * ramp[index] + rest * ramp[index + 1]


@wp.kernel
def color_corners(
    # inputs
    surface: ValueTables,
    values: wp.array2d[float],
    least: float,
    most: float,
    # outputs
    appearance: AppearanceArrays,
):
    """Colours of all corners of a surface in all worlds."""
    world, triangle = wp.tid()
    row = appearance.tree_visual[surface.first_tree + world] + triangle
    for corner in range(3):
        value = value_of_vertex(world, surface.triangle[triangle, corner], surface, values)
        appearance.corner_color[3 * row + corner] = ramp_color((value - least) / (most - least), surface.ramp)
