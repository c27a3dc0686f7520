"""Soil that is pushed aside: what a shape pressed down since the last flow rises around it, and steep heaps slide.

After Project Chrono's SCM (commit 7689fbc, `SCMTerrain.cpp`): equal raises of the nodes around a patch, then Jacobi
steps of erosion. Amounts are heights of a cell's column, and what one node gives its neighbour gets: volume is kept.
All sums are in the order of the grid, in one thread per world.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.soil.deformed_surface_kernels import greatest_raise, node_drop
from simwarp.soil.footprint_kernels import Pose, footprint_of, node_number, shape_pose, surface_above
from simwarp.soil.pages_kernels import claim_page, find_page, slot_in
from simwarp.soil.soil_tables_kernels import BLADE, SoilNodes, SoilShapes, SoilTables
from simwarp.soil.wheel_surface_kernels import NOTHING
from simwarp.vehicle.tires.ground_kernels import ground_below

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

CLOSED = wp.constant(1.0e30)
"""Level of a node that takes no part: something presses on it, there is no ground, or it is beyond the rectangle."""
LEAST = wp.constant(1.0e-6)
"""Raise of each node below which soil waits for more: a float32 height keeps no less [m]."""


@wp.struct
class FlowTables:
    """Constants of bulldozing."""

    every: int  # steps between flows
    steepest: float  # difference of neighbours' levels that stays [m]
    iterations: int
    margin: int  # nodes around a patch that take part


@wp.struct
class FlowScratch:
    """Nodes of a rectangle, row by row with a closed ring around it; (slots, nodes of the largest). From a centre."""

    level: wp.array3d[float]  # (slots, 2, nodes) [m]
    top: wp.array2d[float]  # what is above, where soil cannot rise [m]
    moved: wp.array2d[float]  # what came so far [m]
    mine: wp.array2d[int]  # 1: the shape presses on it


@wp.struct
class Area:
    """Nodes from column x0 to x1 and row y0 to y1, in a table of `width` columns from (left, low)."""

    left: int
    low: int
    width: int
    x0: int
    x1: int
    y0: int
    y1: int


@wp.func
def place_of(column: int, row: int, a: Area) -> int:
    """A node's index in the scratch."""
    return (row - a.low) * a.width + column - a.left


@wp.func
def read_levels(world: int, at: int, p: Pose, a: Area, soil: SoilTables, assets: Assets, nodes: SoilNodes,
    scratch: FlowScratch,
):  # fmt: skip
    """Levels of an area from a shape's centre."""
    spacing = wp.float64(soil.spacing)
    for row in range(a.y0, a.y1 + 1):
        dy = float(wp.float64(row) * spacing - p.x[1])
        page_x = int(0x7FFFFFFF)
        page = int(-1)
        for column in range(a.x0, a.x1 + 1):
            k = place_of(column, row, a)
            dx = float(wp.float64(column) * spacing - p.x[0])
            g = ground_below(world, p.x, wp.vec3(dx, dy, 0.0), p.radius, soil.terrain, assets)
            if column >> 3 != page_x:
                page_x = column >> 3
                page = find_page(world, page_x, row >> 3, nodes)
            level = g.arm[2]
            if page >= 0:
                level -= node_drop(world, slot_in(page, column, row), g.normal, nodes)
            scratch.level[at, 0, k] = wp.where(g.found == 1, level, CLOSED)
            scratch.top[at, k] = CLOSED
            scratch.moved[at, k] = 0.0
            scratch.mine[at, k] = 0


@wp.func
def close_ring(at: int, a: Area, scratch: FlowScratch):
    """Closes the nodes around an area."""
    for column in range(a.x0 - 1, a.x1 + 2):
        for end in range(2):
            k = place_of(column, wp.where(end == 0, a.y0 - 1, a.y1 + 1), a)
            scratch.level[at, 0, k] = CLOSED
            scratch.level[at, 1, k] = CLOSED
            scratch.mine[at, k] = 0
    for row in range(a.y0, a.y1 + 1):
        for end in range(2):
            k = place_of(wp.where(end == 0, a.x0 - 1, a.x1 + 1), row, a)
            scratch.level[at, 0, k] = CLOSED
            scratch.level[at, 1, k] = CLOSED
            scratch.mine[at, k] = 0


@wp.func
def put_shape(world: int, at: int, shape: int, mine: int, p: Pose, a: Area, soil: SoilTables, shapes: SoilShapes,
    state: StateArrays, scratch: FlowScratch,
) -> Area:  # fmt: skip
    """Puts a shape over an area: closes nodes that it presses on, and tells others how far they may rise. The nodes
    that it presses on, none where x1 < x0.
    """
    patch = Area()
    patch.x0 = a.x1 + 1
    patch.y0 = a.y1 + 1
    patch.x1 = a.x0 - 1
    patch.y1 = a.y0 - 1
    q = shape_pose(world, shape, 0.0, shapes, state)
    if q.kind == BLADE:
        return patch
    away = to_float(q.x - p.x)
    half = q.radius + q.half_width + soil.spacing
    widest = soil.spacing * float(wp.max(a.x1 - a.x0, a.y1 - a.y0)) + 2.0 * half + p.radius + p.half_width
    if not wp.max(wp.abs(away[0]), wp.abs(away[1])) < widest:
        return patch
    cell = soil.spacing * float(soil.weighted)
    spacing = wp.float64(soil.spacing)
    x1 = wp.min(a.x1, node_number(q.x[0], half, soil.spacing))
    for row in range(
        wp.max(a.y0, node_number(q.x[1], -half, soil.spacing)),
        wp.min(a.y1, node_number(q.x[1], half, soil.spacing)) + 1,
    ):
        dy = float(wp.float64(row) * spacing - q.x[1])
        for column in range(wp.max(a.x0, node_number(q.x[0], -half, soil.spacing)), x1 + 1):
            dx = float(wp.float64(column) * spacing - q.x[0])
            above = surface_above(dx, dy, q, q.axis, q.side, cell)
            if above.height != NOTHING and above.share > 0.0:
                k = place_of(column, row, a)
                low = above.height + away[2]
                if low < scratch.level[at, 0, k]:
                    if scratch.level[at, 0, k] != CLOSED and mine == 1:
                        scratch.mine[at, k] = 1
                        patch.x0 = wp.min(patch.x0, column)
                        patch.x1 = wp.max(patch.x1, column)
                        patch.y0 = wp.min(patch.y0, row)
                        patch.y1 = wp.max(patch.y1, row)
                    scratch.level[at, 0, k] = CLOSED
                else:
                    scratch.top[at, k] = wp.min(scratch.top[at, k], low)
    return patch


@wp.func
def is_beside(at: int, k: int, width: int, scratch: FlowScratch) -> bool:
    """True where a node is free and next to one that the shape presses on."""
    around = (
        scratch.mine[at, k - 1] + scratch.mine[at, k + 1] + scratch.mine[at, k - width] + scratch.mine[at, k + width]
    )
    return around > 0 and scratch.level[at, 0, k] != CLOSED


@wp.func
def spread(at: int, amount: float, patch: Area, a: Area, scratch: FlowScratch) -> float:
    """Raises the nodes beside a patch equally, as far as there is room above them; what is left of the amount."""
    count = int(0)
    for row in range(patch.y0 - 1, patch.y1 + 2):
        for column in range(patch.x0 - 1, patch.x1 + 2):
            if is_beside(at, place_of(column, row, a), a.width, scratch):
                count += 1
    left = wp.float64(amount)
    if float(count) * LEAST <= amount and count > 0:
        each = amount / float(count)
        for row in range(patch.y0 - 1, patch.y1 + 2):
            for column in range(patch.x0 - 1, patch.x1 + 2):
                k = place_of(column, row, a)
                if is_beside(at, k, a.width, scratch):
                    level = scratch.level[at, 0, k]
                    raised = wp.clamp(scratch.top[at, k] - level, 0.0, each)
                    scratch.level[at, 0, k] = level + raised
                    scratch.moved[at, k] = raised
                    left -= wp.float64(raised)
    return float(left)


@wp.func
def slide(at: int, now: int, k: int, other: int, steepest: float, scratch: FlowScratch) -> float:
    """What comes to a node from a neighbour, negative where it goes there: bit by bit minus what that one finds.

    No more than a quarter of the room above: four neighbours may give.
    """
    mine = scratch.level[at, now, k]
    theirs = scratch.level[at, now, other]
    steep = wp.abs(theirs - mine) - steepest
    if steep <= 0.0 or theirs == CLOSED:
        return 0.0
    if theirs > mine:
        return wp.min(0.125 * steep, 0.25 * wp.max(scratch.top[at, k] - mine, 0.0))
    return -wp.min(0.125 * steep, 0.25 * wp.max(scratch.top[at, other] - theirs, 0.0))


@wp.func
def erode(at: int, a: Area, flow: FlowTables, scratch: FlowScratch):
    """Jacobi steps of what slides from each node to its lower neighbours."""
    now = int(0)
    for _ in range(flow.iterations):
        steep = int(0)
        for row in range(a.y0, a.y1 + 1):
            for column in range(a.x0, a.x1 + 1):
                k = place_of(column, row, a)
                level = scratch.level[at, now, k]
                if level != CLOSED:
                    change = slide(at, now, k, k - 1, flow.steepest, scratch)
                    change += slide(at, now, k, k + 1, flow.steepest, scratch)
                    change += slide(at, now, k, k - a.width, flow.steepest, scratch)
                    change += slide(at, now, k, k + a.width, flow.steepest, scratch)
                    if change != 0.0:
                        steep = 1
                        scratch.moved[at, k] = scratch.moved[at, k] + change
                        level += change
                scratch.level[at, 1 - now, k] = level
        now = 1 - now
        if steep == 0:
            break


@wp.func
def claim_pages_moved(world: int, at: int, a: Area, nodes: SoilNodes, scratch: FlowScratch):
    """Pages of the nodes that moved: marks those that there are, then takes the others, so that none is given away."""
    step = nodes.step[world]
    missing = int(0)
    for again in range(2):
        if again == 0 or missing == 1:
            for row in range(a.y0, a.y1 + 1):
                page_x = int(0x7FFFFFFF)
                for column in range(a.x0, a.x1 + 1):
                    if scratch.moved[at, place_of(column, row, a)] != 0.0 and column >> 3 != page_x:
                        page_x = column >> 3
                        page = find_page(world, page_x, row >> 3, nodes)
                        if page >= 0:
                            nodes.used_at[world, page] = step
                        elif again == 1:
                            claim_page(world, page_x, row >> 3, step, nodes)
                        else:
                            missing = 1


@wp.func
def write_raises(world: int, at: int, shape: int, p: Pose, a: Area, soil: SoilTables, assets: Assets, nodes: SoilNodes,
    scratch: FlowScratch,
) -> float:  # fmt: skip
    """Adds what moved to the nodes' raises; what a float32 height or a full memory did not take."""
    spacing = wp.float64(soil.spacing)
    left = wp.float64(0.0)
    highest = nodes.highest[world, shape]
    deepest = nodes.deepest[world, shape]
    for row in range(a.y0, a.y1 + 1):
        page_x = int(0x7FFFFFFF)
        page = int(-1)
        for column in range(a.x0, a.x1 + 1):
            moved = scratch.moved[at, place_of(column, row, a)]
            if moved != 0.0:
                if column >> 3 != page_x:
                    page_x = column >> 3
                    page = find_page(world, page_x, row >> 3, nodes)
                taken = float(0.0)
                if page >= 0:
                    slot = slot_in(page, column, row)
                    before = nodes.raised[world, slot]
                    after = before + moved
                    nodes.raised[world, slot] = after
                    taken = after - before
                    arm = wp.vec3(
                        float(wp.float64(column) * spacing - p.x[0]), float(wp.float64(row) * spacing - p.x[1]), 0.0
                    )
                    normal = ground_below(world, p.x, arm, p.radius, soil.terrain, assets).normal
                    drop = node_drop(world, slot, normal, nodes)
                    highest = wp.max(highest, -drop)
                    deepest = wp.max(deepest, drop)
                left += wp.float64(moved) - wp.float64(taken)
    nodes.highest[world, shape] = highest
    nodes.deepest[world, shape] = deepest
    return float(left)


@wp.func
def flow_around(
    world: int, at: int, shape: int, flow: FlowTables, soil: SoilTables, shapes: SoilShapes, assets: Assets,
    state: StateArrays, nodes: SoilNodes, scratch: FlowScratch,
):  # fmt: skip
    """Spreads what a shape pressed down around it, and lets heaps slide there."""
    p = shape_pose(world, shape, 0.0, shapes, state)
    foot = footprint_of(world, p, greatest_raise(world, nodes), soil, assets)
    if foot.x1 < foot.x0 or foot.y1 < foot.y0:
        return
    a = Area()
    a.x0 = foot.x0 - flow.margin
    a.x1 = foot.x1 + flow.margin
    a.y0 = foot.y0 - flow.margin
    a.y1 = foot.y1 + flow.margin
    a.left = a.x0 - 1
    a.low = a.y0 - 1
    a.width = a.x1 - a.x0 + 3
    if a.width * (a.y1 - a.y0 + 3) > scratch.top.shape[1]:
        return
    read_levels(world, at, p, a, soil, assets, nodes, scratch)
    under = a
    under.x0 = foot.x0
    under.x1 = foot.x1
    under.y0 = foot.y0
    under.y1 = foot.y1
    patch = put_shape(world, at, shape, 1, p, under, soil, shapes, state, scratch)
    if patch.x1 < patch.x0:
        return
    a.x0 = patch.x0 - flow.margin
    a.x1 = patch.x1 + flow.margin
    a.y0 = patch.y0 - flow.margin
    a.y1 = patch.y1 + flow.margin
    close_ring(at, a, scratch)
    for other in range(shapes.body.shape[0]):
        put_shape(world, at, other, 0, p, a, soil, shapes, state, scratch)
    left = spread(at, nodes.pending[world, shape], patch, a, scratch)
    erode(at, a, flow, scratch)
    claim_pages_moved(world, at, a, nodes, scratch)
    nodes.pending[world, shape] = left + write_raises(world, at, shape, p, a, soil, assets, nodes, scratch)


@wp.kernel
def push_soil_aside(
    # inputs
    worlds: WorldRange,
    flow: FlowTables,
    soil: SoilTables,
    shapes: SoilShapes,
    assets: Assets,
    state: StateArrays,
    # in and out
    nodes: SoilNodes,
    scratch: FlowScratch,
):
    """A flow around all shapes of a world, one after the other, in every `flow.every`-th step; dim W."""
    world = worlds.first + wp.tid()
    if nodes.step[world] % flow.every != 0:
        return
    at = scratch_slot_of(world, worlds)
    for shape in range(shapes.body.shape[0]):
        flow_around(world, at, shape, flow, soil, shapes, assets, state, nodes, scratch)
