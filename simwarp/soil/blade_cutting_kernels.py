"""Soil that blades cut: what stands above a blade's edge where that has passed goes ahead of it, slides down by its
angle of repose, and round the ends. Amounts are heights of a cell's column, as in bulldozing: volume is kept.
"""

import warp as wp

from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.soil.blade_wedge_kernels import STRIPS, BladePose, blade_pose
from simwarp.soil.bulldozing_kernels import (
    CLOSED,
    Area,
    FlowScratch,
    FlowTables,
    claim_pages_moved,
    close_ring,
    erode,
    place_of,
    put_shape,
    read_levels,
    write_raises,
)
from simwarp.soil.footprint_kernels import node_number, shape_pose
from simwarp.soil.soil_tables_kernels import SoilBlades, SoilNodes, SoilShapes, SoilTables

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

BAND = wp.constant(1.5)
"""Of the spacing: how far ahead of the edge soil is put, and how thick a blade is at least. A square of that side holds
a node, however it is turned.
"""

vec_strips = wp.types.vector(length=8, dtype=float)


@wp.func
def area_around(b: BladePose, reach: float, half: float, spacing: float) -> Area:
    """Nodes up to `reach` ahead of an edge, behind it and beyond its ends: banks slide into the trench as well."""
    low = wp.vec2(1.0e9, 1.0e9)
    high = wp.vec2(-1.0e9, -1.0e9)
    for corner in range(4):
        x = wp.where((corner & 1) == 0, -reach, reach)
        y = wp.where(corner < 2, -half - reach, half + reach)
        place = x * b.ahead + y * b.across
        low = wp.min(low, place)
        high = wp.max(high, place)
    a = Area()
    a.x0 = node_number(b.x[0], low[0], spacing) + 1
    a.x1 = node_number(b.x[0], high[0], spacing)
    a.y0 = node_number(b.x[1], low[1], spacing) + 1
    a.y1 = node_number(b.x[1], high[1], spacing)
    a.left = a.x0 - 1
    a.low = a.y0 - 1
    a.width = a.x1 - a.x0 + 3
    return a


@wp.func
def from_edge(b: BladePose, column: int, row: int, spacing: float) -> wp.vec2:
    """A node's place ahead of the middle of an edge, and to its left [m]."""
    dx = float(wp.float64(column) * wp.float64(spacing) - b.x[0])
    dy = float(wp.float64(row) * wp.float64(spacing) - b.x[1])
    return wp.vec2(dx * b.ahead[0] + dy * b.ahead[1], dx * b.across[0] + dy * b.across[1])


@wp.func
def strip_of(along: float, width: float) -> int:
    """Which strip of a blade a place is in."""
    return wp.clamp(int(wp.floor((along / width + 0.5) * float(STRIPS))), 0, STRIPS - 1)


@wp.func
def cut_and_pile(
    at: int, b: BladePose, back: float, width: float, pending: float, a: Area, spacing: float, scratch: FlowScratch
) -> float:  # fmt: skip
    """Lowers the nodes that an edge has passed to its level, and puts that much on those ahead of the same strip; what
    found no place.
    """
    amount = vec_strips()
    room = vec_strips()
    for strip in range(STRIPS):
        amount[strip] = pending / float(STRIPS)
    for row in range(a.y0, a.y1 + 1):
        for column in range(a.x0, a.x1 + 1):
            place = from_edge(b, column, row, spacing)
            k = place_of(column, row, a)
            level = scratch.level[at, 0, k]
            if wp.abs(place[1]) <= 0.5 * width and level != CLOSED:
                strip = strip_of(place[1], width)
                edge = b.slope * place[1]
                if place[0] <= 0.0 and place[0] >= -back:
                    scratch.top[at, k] = edge  # nothing rises into the blade
                    if level > edge:
                        amount[strip] += level - edge
                        scratch.moved[at, k] = edge - level
                        scratch.level[at, 0, k] = edge
                elif place[0] > 0.0 and place[0] <= BAND * spacing:
                    room[strip] += 1.0
    left = float(0.0)
    for strip in range(STRIPS):
        if room[strip] == 0.0:  # a strip narrower than a cell
            left += amount[strip]
            amount[strip] = 0.0
    for row in range(a.y0, a.y1 + 1):
        for column in range(a.x0, a.x1 + 1):
            place = from_edge(b, column, row, spacing)
            k = place_of(column, row, a)
            ahead = place[0] > 0.0 and place[0] <= BAND * spacing and wp.abs(place[1]) <= 0.5 * width
            if ahead and scratch.level[at, 0, k] != CLOSED:
                strip = strip_of(place[1], width)
                raised = amount[strip] / room[strip]
                scratch.moved[at, k] = raised
                scratch.level[at, 0, k] = scratch.level[at, 0, k] + raised
    return left


@wp.func
def cut_ahead(
    world: int, at: int, blade: int, dt: float, flow: FlowTables, soil: SoilTables, shapes: SoilShapes,
    blades: SoilBlades, assets: Assets, state: StateArrays, nodes: SoilNodes, scratch: FlowScratch,
):  # fmt: skip
    """Moves the soil ahead of one blade."""
    b = blade_pose(world, blade, blades, shapes, state)
    shape = blades.shape[blade]
    turning = wp.length(wp.vec2(b.omega[0], b.omega[1])) + wp.abs(b.omega[2])
    speed = wp.dot(wp.vec2(b.v[0], b.v[1]), b.ahead)
    half = 0.5 * blades.width[blade]
    fastest = speed + turning * (half + wp.length(b.arm))
    if b.cuts == 0 or not fastest > 0.0:
        return
    back = BAND * soil.spacing + fastest * dt * float(flow.every)
    if not back < blades.reach[blade]:
        back = blades.reach[blade]
    a = area_around(b, blades.reach[blade], half, soil.spacing)
    if a.width * (a.y1 - a.y0 + 3) > scratch.top.shape[1]:
        return
    p = shape_pose(world, shape, 0.0, shapes, state)
    read_levels(world, at, p, a, soil, assets, nodes, scratch)
    close_ring(at, a, scratch)
    for other in range(shapes.body.shape[0]):
        put_shape(world, at, other, 0, p, a, soil, shapes, state, scratch)
    pending = nodes.pending[world, shape]
    left = cut_and_pile(at, b, back, 2.0 * half, pending, a, soil.spacing, scratch)
    steps = flow
    steps.steepest = soil.spacing * blades.repose[blade]
    erode(at, a, steps, scratch)
    claim_pages_moved(world, at, a, nodes, scratch)
    nodes.pending[world, shape] = left + write_raises(world, at, shape, p, a, soil, assets, nodes, scratch)


@wp.kernel
def cut_soil(
    # inputs
    worlds: WorldRange,
    dt: float,
    flow: FlowTables,
    soil: SoilTables,
    shapes: SoilShapes,
    blades: SoilBlades,
    assets: Assets,
    state: StateArrays,
    # in and out
    nodes: SoilNodes,
    scratch: FlowScratch,
):
    """What all blades of a world cut, one after the other, in every `flow.every`-th step; dim W."""
    world = worlds.first + wp.tid()
    if nodes.step[world] % flow.every != 0:
        return
    at = scratch_slot_of(world, worlds)
    for blade in range(blades.shape.shape[0]):
        cut_ahead(world, at, blade, dt, flow, soil, shapes, blades, assets, state, nodes, scratch)
