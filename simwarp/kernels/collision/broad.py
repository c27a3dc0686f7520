"""Broad phase: shapes that a shape may touch, from the list of pairs or, in worlds of many shapes, a uniform grid.

The grid is sorted by counting, so that it is deterministic; candidates come in the order of their index. Shapes much
larger than the average (the ground) would spoil the cells: they are candidates of every shape.
"""

import warp as wp

from simwarp.core.types import PairRule
from simwarp.kernels.core.scratch import ScratchGroup, scratch_array
from simwarp.kernels.core.tables import Topology, given_pair

wp.set_module_options({"enable_backward": False})

LARGE = wp.constant(4.0)  # times the average edge
EITHER = wp.constant(int(PairRule.EITHER))
ENDLESS = wp.constant(1.0e9)  # [m] planes have bounds beyond this


class GridScratch(ScratchGroup, packed=False):
    """Uniform grid of one world."""

    cell = scratch_array(wp.vec3i, "in_grid")  # per shape: cell of its centre
    home = scratch_array(wp.int32, "in_grid")  # per shape: bucket, -1: large
    start = scratch_array(wp.int32, "bucket_ends")
    member = scratch_array(wp.int32, "in_grid")  # shapes by bucket, then the large ones
    candidate = scratch_array(wp.int32, "shapes")


Grid = GridScratch.struct("Grid", __name__)


@wp.func
def bucket_of(cell: wp.vec3i, buckets: int) -> int:
    """Bucket of a cell (Teschner et al. 2003); `buckets` is a power of two."""
    return ((cell[0] * 73856093) ^ (cell[1] * 19349663) ^ (cell[2] * 83492791)) & (buckets - 1)


@wp.func
def fill_grid(
    margin: float, topology: Topology, x: wp.array[wp.vec3d], lower: wp.array[wp.vec3], upper: wp.array[wp.vec3],
    grid: Grid,
):  # fmt: skip
    """Sorts the shapes into cells as wide as the largest of them, `margin` included."""
    mean = float(0.0)
    finite = int(0)
    for shape in range(topology.shape_count):
        edge = wp.max(upper[shape] - lower[shape])
        if edge < ENDLESS:
            mean += edge
            finite += 1
    mean /= float(wp.max(finite, 1))
    width = float(0.0)
    small = int(0)
    for shape in range(topology.shape_count):
        edge = wp.max(upper[shape] - lower[shape])
        grid.home[shape] = -1
        if edge <= LARGE * mean:
            grid.home[shape] = 0
            small += 1
            width = wp.max(width, edge + 2.0 * margin)
    large = int(small)
    for bucket in range(topology.grid_buckets + 1):
        grid.start[bucket] = 0
    inverse = wp.float64(1.0 / wp.max(width, 1.0e-9))
    for shape in range(topology.shape_count):
        if grid.home[shape] == 0:
            middle = 0.5 * (lower[shape] + upper[shape])
            cell = wp.vec3i(
                int(wp.floor((x[shape][0] + wp.float64(middle[0])) * inverse)),
                int(wp.floor((x[shape][1] + wp.float64(middle[1])) * inverse)),
                int(wp.floor((x[shape][2] + wp.float64(middle[2])) * inverse)),
            )
            bucket = bucket_of(cell, topology.grid_buckets)
            grid.cell[shape] = cell
            grid.home[shape] = bucket
            grid.start[bucket + 1] = grid.start[bucket + 1] + 1
        else:
            grid.member[large] = shape
            large += 1
    for bucket in range(topology.grid_buckets):
        grid.start[bucket + 1] = grid.start[bucket + 1] + grid.start[bucket]
    # backwards, so that members of a bucket are in order and `start` ends up where it was
    for index in range(topology.shape_count):
        shape = topology.shape_count - 1 - index
        bucket = grid.home[shape]
        if bucket >= 0:
            place = grid.start[bucket + 1] - 1
            grid.start[bucket + 1] = place
            grid.member[place] = shape
    for bucket in range(topology.grid_buckets):
        grid.start[bucket] = grid.start[bucket + 1]
    grid.start[topology.grid_buckets] = small


@wp.func
def allowed(shape0: int, shape1: int, topology: Topology) -> bool:
    """True if two shapes, the smaller index first, were given as a pair, or bodies, groups and exclusions allow it."""
    body0 = topology.shape_body[shape0]
    body1 = topology.shape_body[shape1]
    if body0 == body1:
        return False
    if topology.given_count > 0:
        if given_pair(shape0, shape1, topology) >= 0:
            return True
    meets = (topology.shape_group[shape0] & topology.shape_mask[shape1]) != 0
    met = (topology.shape_group[shape1] & topology.shape_mask[shape0]) != 0
    if not (meets and met) and (topology.pair_rule != EITHER or not (meets or met)):
        return False
    low = wp.min(body0, body1)
    high = wp.max(body0, body1)
    for index in range(topology.excluded_start[low + 1], topology.excluded_start[low + 2]):
        if topology.excluded_body[index] == high:
            return False
    for index in range(topology.apart_start[shape0], topology.apart_start[shape0 + 1]):
        if topology.apart_shape[index] == shape1:
            return False
    return True


@wp.func
def insert_candidate(count: int, shape: int, grid: Grid):
    """Keeps the list sorted."""
    place = int(count)
    while place > 0 and grid.candidate[place - 1] > shape:
        grid.candidate[place] = grid.candidate[place - 1]
        place -= 1
    grid.candidate[place] = shape


@wp.func
def grid_candidates(shape: int, topology: Topology, grid: Grid) -> int:
    """Shapes of higher index near `shape`, in order; returns how many."""
    count = int(0)
    if grid.home[shape] < 0:
        for other in range(shape + 1, topology.shape_count):
            if allowed(shape, other, topology):
                grid.candidate[count] = other
                count += 1
        return count
    centre = grid.cell[shape]
    for neighbour in range(27):
        cell = centre + wp.vec3i(neighbour % 3 - 1, neighbour // 3 % 3 - 1, neighbour // 9 - 1)
        bucket = bucket_of(cell, topology.grid_buckets)
        for index in range(grid.start[bucket], grid.start[bucket + 1]):
            other = grid.member[index]
            if other > shape and grid.cell[other] == cell and allowed(shape, other, topology):
                insert_candidate(count, other, grid)
                count += 1
    for index in range(grid.start[topology.grid_buckets], topology.shape_count):
        other = grid.member[index]
        if other > shape and allowed(shape, other, topology):
            insert_candidate(count, other, grid)
            count += 1
    return count


@wp.func
def candidates(shape: int, topology: Topology, grid: Grid) -> int:
    """Shapes of higher index that `shape` may touch, in order, into `grid.candidate`; returns how many."""
    if topology.grid_buckets > 0:
        return grid_candidates(shape, topology, grid)
    first = topology.pair_start[shape]
    count = topology.pair_start[shape + 1] - first
    for index in range(count):
        grid.candidate[index] = topology.pair_other[first + index]
    return count
