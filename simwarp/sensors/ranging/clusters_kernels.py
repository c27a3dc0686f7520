"""Clusters of radar returns: DBSCAN with one point as its least (Ester et al. 1996), which is single linkage.

Two returns belong together if a chain of returns leads from one to the other in steps of at most `distance`. Returns
are sorted into cubic cells whose diagonal is just below `distance`, so that all of a cell belong together; only pairs
of cells at most two apart have to be looked at, until one pair of their returns is near enough (the grid of Gunawan
2013).
Cells are found through a hash table with open addressing. One thread per world: everything happens in the order of the
rays, clusters are numbered by their first ray.
"""

import warp as wp

from simwarp.kernels.core.world_range import WorldRange
from simwarp.sensors.clock_kernels import SampleEvents
from simwarp.sensors.ranging.radar_kernels import CHANNELS

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

CLUSTER_CHANNELS = wp.constant(6)
"""Of a cluster: centroid x, y, z, mean velocity, sum of amplitudes, number of returns."""
CELL = wp.constant(0.577)  # side of a cell over the distance; below 1 / sqrt(3)
REACH = wp.constant(2)  # cells between two returns at most `distance` apart


@wp.struct
class ClusterScratch:
    """Scratch of all worlds; P returns at most, H a power of two >= 2 P."""

    point: wp.array2d[wp.vec3]  # (W, P) of returns
    next: wp.array2d[int]  # the return before in the same cell, -1: none
    cell: wp.array2d[int]  # cell of a return; -1: no return
    table: wp.array2d[int]  # (W, H) cells, -1: free
    place: wp.array2d[wp.vec3i]  # of cells
    head: wp.array2d[int]  # last return of a cell
    parent: wp.array2d[int]  # union-find over cells: a smaller one, or itself
    size: wp.array2d[int]  # returns of a root's cluster
    label: wp.array2d[int]  # number of a root's cluster, -1: none yet


@wp.struct
class ClusterFrames:
    """Results per row of the ring."""

    cluster: wp.array2d[float]  # (W·slots, capacity · CLUSTER_CHANNELS)
    count: wp.array[int]  # clusters found, at most the capacity
    overflow: wp.array[int]  # clusters that found no place


@wp.func
def slot_of(world: int, place: wp.vec3i, scratch: ClusterScratch) -> int:
    """Slot of a cell in the hash table, or the free slot in which it belongs."""
    mask = scratch.table.shape[1] - 1
    h = wp.uint32(place[0]) * wp.uint32(73856093)
    h = h ^ (wp.uint32(place[1]) * wp.uint32(19349663))
    h = h ^ (wp.uint32(place[2]) * wp.uint32(83492791))
    h = h ^ (h >> wp.uint32(15))
    slot = int(h & wp.uint32(mask))
    found = int(0)
    while found == 0:
        cell = scratch.table[world, slot]
        if cell < 0 or scratch.place[world, cell] == place:
            found = 1
        else:
            slot = (slot + 1) & mask
    return slot


@wp.func
def root_of(world: int, cell: int, scratch: ClusterScratch) -> int:
    """Representative of a cell's cluster; halves the path to it."""
    at = int(cell)
    while scratch.parent[world, at] != at:
        up = scratch.parent[world, scratch.parent[world, at]]
        scratch.parent[world, at] = up
        at = up
    return at


@wp.func
def fill_cells(world: int, row: int, distance: float, returns: wp.array2d[float], scratch: ClusterScratch) -> int:
    """Sorts the returns into cells; the number of cells."""
    for slot in range(scratch.table.shape[1]):
        scratch.table[world, slot] = -1
    cells = int(0)
    inverse = 1.0 / (CELL * distance)
    for ray in range(returns.shape[1] / CHANNELS):
        at = CHANNELS * ray
        scratch.cell[world, ray] = -1
        if returns[row, at + 4] > 0.0:
            flat = wp.cos(returns[row, at + 2])
            d = wp.vec3(
                flat * wp.cos(returns[row, at + 1]), flat * wp.sin(returns[row, at + 1]), wp.sin(returns[row, at + 2])
            )
            p = returns[row, at] * d
            scratch.point[world, ray] = p
            place = wp.vec3i(
                int(wp.floor(p[0] * inverse)), int(wp.floor(p[1] * inverse)), int(wp.floor(p[2] * inverse))
            )
            slot = slot_of(world, place, scratch)
            cell = scratch.table[world, slot]
            if cell < 0:
                cell = cells
                cells += 1
                scratch.table[world, slot] = cell
                scratch.place[world, cell] = place
                scratch.head[world, cell] = -1
                scratch.parent[world, cell] = cell
                scratch.size[world, cell] = 0
                scratch.label[world, cell] = -1
            scratch.next[world, ray] = scratch.head[world, cell]
            scratch.head[world, cell] = ray
            scratch.cell[world, ray] = cell
    return cells


@wp.func
def cells_touch(world: int, cell0: int, cell1: int, square: float, scratch: ClusterScratch) -> bool:
    """True if a return of one cell is near enough to one of the other."""
    ray0 = int(scratch.head[world, cell0])
    while ray0 >= 0:
        p = scratch.point[world, ray0]
        ray1 = int(scratch.head[world, cell1])
        while ray1 >= 0:
            if wp.length_sq(scratch.point[world, ray1] - p) <= square:
                return True
            ray1 = scratch.next[world, ray1]
        ray0 = scratch.next[world, ray0]
    return False


@wp.func
def join_cells(world: int, cells: int, distance: float, scratch: ClusterScratch):
    """Unites the cells that touch; each pair is looked at from one side."""
    side = 2 * REACH + 1
    for cell in range(cells):
        centre = scratch.place[world, cell]
        for k in range((side * side * side) / 2):
            place = centre + wp.vec3i(k / (side * side) - REACH, (k / side) % side - REACH, k % side - REACH)
            other = scratch.table[world, slot_of(world, place, scratch)]
            if other >= 0:
                root0 = root_of(world, cell, scratch)
                root1 = root_of(world, other, scratch)
                if root0 != root1:
                    if cells_touch(world, cell, other, distance * distance, scratch):
                        scratch.parent[world, wp.max(root0, root1)] = wp.min(root0, root1)


@wp.func
def add_return(
    row: int, at: int, point: wp.vec3, entry: int, returns: wp.array2d[float], frames: ClusterFrames
):  # fmt: skip
    """Adds the return at `entry` to the cluster at `at`: running means, so that no sum in float32 grows large."""
    n = frames.cluster[row, at + 5] + 1.0
    for k in range(3):
        mean = frames.cluster[row, at + k]
        frames.cluster[row, at + k] = mean + (point[k] - mean) / n
    mean = frames.cluster[row, at + 3]
    frames.cluster[row, at + 3] = mean + (returns[row, entry + 3] - mean) / n
    frames.cluster[row, at + 4] = frames.cluster[row, at + 4] + returns[row, entry + 4]
    frames.cluster[row, at + 5] = n


@wp.kernel
def cluster_returns(
    # inputs
    worlds: WorldRange,
    distance: float,  # between neighbours, at most [m]
    least: int,  # returns of a cluster, at least
    capacity: int,
    returns: wp.array2d[float],  # (W·slots, P · CHANNELS)
    scratch: ClusterScratch,
    tick: SampleEvents,
    # outputs
    frames: ClusterFrames,
):
    """The clusters of frames that are complete."""
    world = worlds.first + wp.tid()
    if tick.complete[world] == 0:
        return
    row = tick.row[world]
    cells = fill_cells(world, row, distance, returns, scratch)
    join_cells(world, cells, distance, scratch)
    rays = returns.shape[1] / CHANNELS
    for ray in range(rays):
        cell = scratch.cell[world, ray]
        if cell >= 0:
            root = root_of(world, cell, scratch)
            scratch.size[world, root] = scratch.size[world, root] + 1
    for entry in range(frames.cluster.shape[1]):
        frames.cluster[row, entry] = 0.0
    found = int(0)
    for ray in range(rays):
        cell = scratch.cell[world, ray]
        if cell >= 0:
            root = root_of(world, cell, scratch)
            if scratch.size[world, root] >= least:
                if scratch.label[world, root] < 0:
                    scratch.label[world, root] = found
                    found += 1
                at = CLUSTER_CHANNELS * scratch.label[world, root]
                if at < frames.cluster.shape[1]:
                    add_return(row, at, scratch.point[world, ray], CHANNELS * ray, returns, frames)
    frames.count[row] = wp.min(found, capacity)
    frames.overflow[row] = wp.max(found - capacity, 0)
