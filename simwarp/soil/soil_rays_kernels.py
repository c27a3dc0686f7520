"""Rays against soil: the undeformed ground, and the triangles between nodes that wheels have touched.

All nodes of a world lie in a layer about the undeformed ground, between its copies raised by the greatest raise and
lowered by the greatest drop. Within the layer a ray walks the soil's cells (Amanatides and Woo 1987). It knows on which
side of the ground it is, and hits where it changes sides: no ray slips through between a cell of nodes and one of
undeformed ground, whose edges may lie apart by the crease of a height field.
"""

import warp as wp

from simwarp.kernels.collision.shape import HEIGHT_FIELD, Assets
from simwarp.kernels.collision.surfaces import NEVER, SurfaceHit, height_field_ray
from simwarp.kernels.core.vector_math import to_double
from simwarp.kernels.rays.primitives import plane_ray
from simwarp.sensors.ray_hit_kernels import RayHit, RayTarget, TargetExtent
from simwarp.soil.deformed_surface_kernels import (
    FARTHEST,
    SoilCell,
    SoilCover,
    cell_of,
    facet_normal,
    facet_of,
    level_range,
    soil_cell,
)
from simwarp.vehicle.tires.ground_kernels import open_ground_below

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

AWAY = wp.constant(1.0e-3)
"""Distance from the layer beyond which a ray has left it, far above the rounding of where it is [m]."""
LAYERS = wp.constant(64)
"""Times that a ray may come into the layer: hills have as many crests."""
NARROWED = wp.constant(12)
"""Steps of false position in a cell of undeformed ground, which is plane or has a few creases."""


@wp.struct
class SoilPlace:
    """The undeformed ground in one world of a scene, as rays have it."""

    origin: wp.vec3d  # to which the positions of rays are relative, world [m]
    x: wp.vec3  # of its frame [m]
    rot: wp.mat33  # its axes to world axes
    size: wp.vec3
    asset: int
    levels: wp.vec2  # greatest raise and greatest drop of the soil's nodes [m]


@wp.struct
class SoilView:
    """The instance that a soil covers, with all that rays need of it. Arrays are those of the scene."""

    instances: int  # 0: there is none, 1: it is `instance`
    instance: int
    origin: wp.array[wp.vec3d]
    x: wp.array2d[wp.vec3]
    rot: wp.array2d[wp.mat33]
    size: wp.array2d[wp.vec3]
    asset: wp.array2d[int]
    lower: wp.array2d[wp.vec3]
    upper: wp.array2d[wp.vec3]
    levels: wp.array[wp.vec2]  # (W,) greatest raise and greatest drop of the soil's nodes [m]
    cover: SoilCover
    assets: Assets


@wp.struct
class SoilWalk:
    """State of a ray in the layer."""

    t: float  # as far as it has come [m]
    side: float  # 1: above the ground, -1: below it, 0: not known yet
    done: int  # 1: it hit, 2: there is no more ground
    hit: RayHit


@wp.func
def base_ray(
    kind: int, shift: float, start: wp.vec3, direction: wp.vec3, reach: float, place: SoilPlace, assets: Assets
) -> RayHit:  # fmt: skip
    """First hit of a ray with the undeformed ground, a plane or height field, raised by a shift [m]."""
    s = wp.transpose(place.rot) * (start - wp.vec3(0.0, 0.0, shift) - place.x)
    d = wp.transpose(place.rot) * direction
    found = SurfaceHit()
    if kind == HEIGHT_FIELD:
        found = height_field_ray(place.asset, place.size, to_double(s), d, reach, assets)
    else:
        found = plane_ray(s, d)
    hit = RayHit()
    hit.t = -1.0
    if found.t >= 0.0 and found.t <= reach:
        hit.t = found.t
        hit.triangle = found.triangle
        hit.normal = place.rot * found.normal
    return hit


@wp.func
def rise_of(world: int, entry: wp.vec3d, t: float, direction: wp.vec3, cover: SoilCover, assets: Assets) -> wp.vec4:
    """Height of a ray above the undeformed ground [m] and the ground's normal; the normal is 0 where there is none."""
    g = open_ground_below(world, entry, t * direction, cover.terrain, assets)
    if g.found == 0:
        return wp.vec4()
    return wp.vec4(t * direction[2] - g.arm[2], g.normal[0], g.normal[1], g.normal[2])


@wp.func
def facets_ray(
    walk: SoilWalk, cell: SoilCell, first: wp.vec2, rate: wp.vec2, low: float, high: float, fall: float, spacing: float
) -> SoilWalk:
    """Where a ray changes sides in the two triangles of a cell, between t = low and high from its entry.

    Args:
        walk: so far.
        cell: its heights are from the entry.
        first: place of the entry, in cells from the cell's first node.
        rate: of that place with t.
        low, high: of t.
        fall: rise of the ray with t.
        spacing: of the nodes [m].
    """
    w = walk
    # t at which it crosses the diagonal
    middle = float(high)
    across = rate[0] - rate[1]
    if across != 0.0:
        cut = (first[1] - first[0]) / across
        if cut > low and cut < high:
            middle = cut
    for part in range(2):
        a = wp.where(part == 0, low, middle)
        b = wp.where(part == 0, middle, high)
        if w.done == 0 and (part == 0 or b > a):
            centre = first + (0.5 * (a + b)) * rate
            facet = facet_of(cell, centre[1] > centre[0])
            begin = first + a * rate
            f = a * fall - facet.height - wp.dot(facet.height_slope, begin)
            change = (b - a) * (fall - wp.dot(facet.height_slope, rate))
            if w.side == 0.0:
                w.side = wp.where(f >= 0.0, 1.0, -1.0)
            t = float(-1.0)
            if w.side * f <= 0.0:
                t = a
            elif w.side * (f + change) <= 0.0:
                t = a - f / change * (b - a)
            if t >= 0.0:
                w.done = 1
                w.hit.t = t
                w.hit.triangle = -1
                w.hit.normal = facet_normal(facet, spacing)
                w.hit.drop = facet.drop + wp.dot(facet.drop_slope, first + t * rate)
    return w


@wp.func
def undeformed_ray(
    walk: SoilWalk, world: int, entry: wp.vec3d, low: float, high: float, direction: wp.vec3, levels: wp.vec2,
    cover: SoilCover, assets: Assets,
) -> SoilWalk:  # fmt: skip
    """Where a ray changes sides in a cell that nobody touched, between t = low and high from its entry."""
    w = walk
    a = rise_of(world, entry, low, direction, cover, assets)
    b = rise_of(world, entry, high, direction, cover, assets)
    if a[3] == 0.0 or b[3] == 0.0:
        w.done = 2
        return w
    if w.side == 0.0:
        w.side = wp.where(a[0] >= 0.0, 1.0, -1.0)
    t = float(-1.0)
    at = wp.vec4(a)
    if w.side * a[0] <= 0.0:
        t = low
    elif w.side * b[0] <= 0.0:
        left = float(low)
        right = float(high)
        f_left = a[0]
        f_right = b[0]
        for _ in range(NARROWED):
            t = left + f_left / (f_left - f_right) * (right - left)
            at = rise_of(world, entry, t, direction, cover, assets)
            if w.side * at[0] > 0.0:
                left = t
                f_left = at[0]
            else:
                right = t
                f_right = at[0]
            if wp.abs(at[0]) < 1.0e-7 or f_left == f_right:
                break
    elif w.side * b[0] > wp.where(w.side > 0.0, levels[0], levels[1]) + AWAY:
        w.t = -1.0  # it has left the layer
    if t >= 0.0:
        w.done = 1
        w.hit.t = t
        w.hit.triangle = -1
        w.hit.normal = wp.vec3(at[1], at[2], at[3])
        w.hit.drop = 0.0
    return w


@wp.func
def walk_layer(
    walk: SoilWalk, base: RayHit, world: int, start: wp.vec3, direction: wp.vec3, reach: float, place: SoilPlace,
    cover: SoilCover, assets: Assets,
) -> SoilWalk:  # fmt: skip
    """The way of a ray from walk.t on, until it hits, leaves the layer, or ends.

    `base` is the next hit with the undeformed ground, which counts unless the ray comes through touched cells before.
    """
    w = walk
    spacing = cover.spacing
    entry = place.origin + to_double(start) + to_double(direction) * wp.float64(w.t)
    if not wp.max(wp.abs(entry[0]), wp.abs(entry[1])) < FARTHEST * wp.float64(spacing):
        w.done = 1
        w.hit = base
        return w
    column0 = cell_of(entry[0], spacing)
    row0 = cell_of(entry[1], spacing)
    at_x = float(entry[0] / wp.float64(spacing) - wp.float64(column0))
    at_y = float(entry[1] / wp.float64(spacing) - wp.float64(row0))
    rate = wp.vec2(direction[0] / spacing, direction[1] / spacing)
    levels = place.levels
    before = float(w.t)
    length = reach - before
    column = int(column0)
    row = int(row0)
    fresh = int(1)  # the base hit is still ahead
    inside = int(1)
    t = float(0.0)
    while inside == 1 and w.done == 0 and t <= length:
        next_x = float(NEVER)
        next_y = float(NEVER)
        if rate[0] != 0.0:
            next_x = (float(column - column0 + wp.where(rate[0] > 0.0, 1, 0)) - at_x) / rate[0]
        if rate[1] != 0.0:
            next_y = (float(row - row0 + wp.where(rate[1] > 0.0, 1, 0)) - at_y) / rate[1]
        end = wp.max(t, wp.min(length, wp.min(next_x, next_y)))
        cell = soil_cell(world, column, row, entry, cover, assets)
        if cell.touched == 1:
            first = wp.vec2(at_x - float(column - column0), at_y - float(row - row0))
            w = facets_ray(w, cell, first, rate, t, end, direction[2], spacing)
            if w.done == 1:
                w.hit.t += before
            if base.t - before <= end:
                fresh = 0
            rise = end * direction[2]
            if w.side > 0.0 and rise > cell.top + levels[0] + AWAY:
                inside = 0
            if w.side < 0.0 and rise < cell.bottom - levels[1] - AWAY:
                inside = 0
        elif fresh == 1 and base.t >= 0.0:
            if base.t - before <= end:
                w.done = 1
                w.hit = base
        else:
            w = undeformed_ray(w, world, entry, t, end, direction, levels, cover, assets)
            if w.done == 1:
                w.hit.t += before
            if w.t < 0.0:
                inside = 0
        if next_x <= next_y:
            column += wp.where(rate[0] > 0.0, 1, -1)
        else:
            row += wp.where(rate[1] > 0.0, 1, -1)
        t = end
        if end >= length:
            t = NEVER
    w.t = before + t
    return w


@wp.func
def ground_ray(
    world: int, start: wp.vec3, direction: wp.vec3, reach: float, place: SoilPlace, cover: SoilCover, assets: Assets
) -> RayHit:
    """First hit of a ray with the deformed ground, from above or below, in world axes."""
    kind = cover.terrain.kind
    base = base_ray(kind, 0.0, start, direction, reach, place, assets)
    levels = place.levels
    if levels[0] <= 0.0 and levels[1] <= 0.0:
        return base
    w = SoilWalk()
    here = rise_of(world, place.origin + to_double(start), 0.0, direction, cover, assets)
    w.side = 1.0
    inside = int(0)
    if here[3] == 0.0:
        if wp.dot(base.normal, direction) > 0.0:
            w.side = -1.0
    elif here[0] < -levels[1]:
        w.side = -1.0
    elif here[0] <= levels[0]:
        w.side = 0.0
        inside = 1
    nothing = RayHit()
    nothing.t = -1.0
    for _ in range(LAYERS):
        ahead = start + w.t * direction
        if inside == 0:
            shift = wp.where(w.side > 0.0, levels[0], -levels[1])
            into = base.t
            if shift != 0.0:
                shifted = base_ray(kind, shift, ahead, direction, reach - w.t, place, assets)
                into = wp.where(shifted.t >= 0.0, shifted.t + w.t, -1.0)
            if into < 0.0:
                return nothing
            w.t = into
        w = walk_layer(w, base, world, start, direction, reach, place, cover, assets)
        if w.done == 1:
            return w.hit
        if w.done == 2 or not w.t <= reach:
            return nothing
        inside = 0
        base = base_ray(kind, 0.0, start + w.t * direction, direction, reach - w.t, place, assets)
        if base.t >= 0.0:
            base.t += w.t
    return base


@wp.func
def soil_ray(world: int, start: wp.vec3, direction: wp.vec3, reach: float, soil: wp.array[SoilView]) -> RayHit:
    """The ray against the instance that a soil covers, within reach [m].

    It is looked for apart from the others and with few arguments: what scenes without soil carry along is one test.
    """
    hit = RayHit()
    hit.t = -1.0
    i = soil[0].instance
    if soil[0].lower[world, i][2] <= soil[0].upper[world, i][2]:
        place = SoilPlace()
        place.origin = soil[0].origin[world]
        place.x = soil[0].x[world, i]
        place.rot = soil[0].rot[world, i]
        place.size = soil[0].size[world, i]
        place.asset = soil[0].asset[world, i]
        place.levels = soil[0].levels[world]
        hit = ground_ray(world, start, direction, reach, place, soil[0].cover, soil[0].assets)
        hit.instance = i
        hit.local = wp.transpose(place.rot) * (start + hit.t * direction - place.x)
    return hit


@wp.func
def soil_extent(world: int, soil: wp.array[SoilView]) -> TargetExtent:
    """The undeformed ground, and how far nodes rise above it and lie below it; keeps these levels for `soil_ray`."""
    view = soil[0]
    levels = level_range(world, view.cover.nodes)
    view.levels[world] = levels
    extent = TargetExtent()
    extent.kind = view.cover.terrain.kind
    extent.above = levels[0]
    extent.below = levels[1]
    return extent


SOIL_TARGET = RayTarget(name="soil", kind=65, view=SoilView, extent=soil_extent, ray=soil_ray)
"""A plane or height field that a soil covers."""
