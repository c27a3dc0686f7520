"""The ground as tires ask for it: height, normal and friction below a point.

A plane, a height field or a mesh (the queries are those of contact, kernels/collision/surfaces.py), placed per world.
"""

import warp as wp

from simwarp.kernels.collision.shape import HEIGHT_FIELD, MESH, PLANE, Assets
from simwarp.kernels.collision.surfaces import (
    SurfaceHit,
    height_field_height,
    height_field_ray,
    mesh_ray,
    rotate_wide,
)
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

LONGEST_DROP = wp.constant(1.0e4)  # distance below a wheel within which a mesh is looked for [m]
STEEPEST = wp.constant(1.0e-3)  # least vertical part of a normal that counts as ground


@wp.struct
class TerrainTables:
    """The ground of all worlds. Arrays have leading dimension 1 (shared) or W.

    A plane is z = 0 of its frame and may lean. A height field may turn about the vertical only. Beyond the border of a
    height field or mesh there is no ground.
    """

    kind: int  # ShapeType: PLANE, HEIGHT_FIELD or MESH
    x: wp.array[wp.vec3d]  # origin, world [m]
    rot: wp.array[wp.mat33]  # its axes to world axes
    scale: wp.array[wp.vec3]
    asset: wp.array[int]  # index among the height fields or meshes of `Assets`
    friction_map: wp.array2d[float]  # (rows along y, columns along x) factors of the friction; no entries: 1 everywhere
    friction_origin: wp.vec2d  # corner of the map's first cell, world [m]
    friction_cell: wp.vec2d  # size of its cells [m]


@wp.struct
class GroundPoint:
    """A point of the ground."""

    found: int  # 0: there is none
    arm: wp.vec3  # to it, from the point to which the query is relative, world axes [m]
    normal: wp.vec3  # unit, upwards


@wp.func
def open_ground_below(
    world: int, x: wp.vec3d, offset: wp.vec3, terrain: TerrainTables, assets: Assets
) -> GroundPoint:  # fmt: skip
    """`ground_below` of a plane or a height field: they have one level at a place."""
    found = GroundPoint()
    origin = terrain.x[world_row(world, terrain.x.shape[0])]
    rot = terrain.rot[world_row(world, terrain.rot.shape[0])]
    relative = x - origin + to_double(offset)
    if not wp.isfinite(relative[0] + relative[1] + relative[2]):
        return found
    # height above the point of the query
    rise = float(0.0)
    if terrain.kind == PLANE:
        n = wp.vec3(rot[0, 2], rot[1, 2], rot[2, 2])
        up = to_double(n)
        if n[2] > STEEPEST:
            found.found = 1
            found.normal = n
            rise = float(-wp.dot(relative, up) / up[2])
    elif terrain.kind == HEIGHT_FIELD:
        scale = terrain.scale[world_row(world, terrain.scale.shape[0])]
        asset = terrain.asset[world_row(world, terrain.asset.shape[0])]
        place = rotate_wide(wp.transpose(rot), wp.vec3d(relative[0], relative[1], wp.float64(0.0)))
        point = height_field_height(asset, scale, place[0], place[1], assets)
        found.found = point.inside
        found.normal = rot * point.normal
        rise = float(point.height - relative[2])
    found.arm = offset + wp.vec3(0.0, 0.0, rise)
    return found


@wp.func
def ground_below(
    world: int, x: wp.vec3d, offset: wp.vec3, lift: float, terrain: TerrainTables, assets: Assets
) -> GroundPoint:
    """The ground vertically below x + offset + lift z; `arm` is relative to x. Only a mesh has several levels: there
    the first one below counts.
    """
    if terrain.kind != MESH:
        return open_ground_below(world, x, offset, terrain, assets)
    found = GroundPoint()
    origin = terrain.x[world_row(world, terrain.x.shape[0])]
    rot = terrain.rot[world_row(world, terrain.rot.shape[0])]
    relative = x - origin + to_double(offset)
    if not wp.isfinite(relative[0] + relative[1] + relative[2]):
        return found
    scale = terrain.scale[world_row(world, terrain.scale.shape[0])]
    asset = terrain.asset[world_row(world, terrain.asset.shape[0])]
    start = relative + wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(lift))
    down = wp.transpose(rot) * wp.vec3(0.0, 0.0, -1.0)
    hit = mesh_ray(asset, scale, to_float(rotate_wide(wp.transpose(rot), start)), down, LONGEST_DROP, assets)
    found.normal = rot * hit.normal
    if found.normal[2] < 0.0:
        found.normal = -found.normal
    if hit.t >= 0.0 and found.normal[2] > STEEPEST:
        found.found = 1
    found.arm = offset + wp.vec3(0.0, 0.0, lift - hit.t)
    return found


@wp.func
def surface_ray(
    kind: int, asset: int, scale: wp.vec3, start: wp.vec3d, direction: wp.vec3, reach: float, assets: Assets
) -> SurfaceHit:  # fmt: skip
    """First hit of a ray in the frame of a plane, height field or mesh; from above only, but for a mesh."""
    hit = SurfaceHit()
    hit.t = -1.0
    if kind == PLANE:
        if direction[2] < 0.0 and start[2] > wp.float64(0.0):
            hit.t = float(-start[2] / wp.float64(direction[2]))
            hit.normal = wp.vec3(0.0, 0.0, 1.0)
    elif kind == HEIGHT_FIELD:
        hit = height_field_ray(asset, scale, start, direction, reach, assets)
        if wp.dot(hit.normal, direction) >= 0.0:
            hit.t = -1.0
    elif kind == MESH:
        hit = mesh_ray(asset, scale, to_float(start), direction, reach, assets)
        if wp.dot(hit.normal, direction) > 0.0:
            hit.normal = -hit.normal
    if hit.t > reach:
        hit.t = -1.0
    return hit


@wp.func
def ground_ray(
    world: int, x: wp.vec3d, direction: wp.vec3, reach: float, terrain: TerrainTables, assets: Assets
) -> SurfaceHit:
    """First hit of a ray from x with the ground; world axes."""
    rot = terrain.rot[world_row(world, terrain.rot.shape[0])]
    back = wp.transpose(rot)
    scale = terrain.scale[world_row(world, terrain.scale.shape[0])]
    asset = terrain.asset[world_row(world, terrain.asset.shape[0])]
    start = rotate_wide(back, x - terrain.x[world_row(world, terrain.x.shape[0])])
    hit = surface_ray(terrain.kind, asset, scale, start, back * direction, reach, assets)
    hit.normal = rot * hit.normal
    return hit


@wp.func
def friction_at(world: int, x: wp.vec3d, ground_friction: wp.array[float], terrain: TerrainTables) -> float:
    """Friction of the road at (x, y): the world's own, times the map's factor; outside the map its nearest cell."""
    friction = ground_friction[world_row(world, ground_friction.shape[0])]
    rows = terrain.friction_map.shape[0]
    columns = terrain.friction_map.shape[1]
    if rows * columns > 0:
        place = wp.vec2d(
            (x[0] - terrain.friction_origin[0]) / terrain.friction_cell[0],
            (x[1] - terrain.friction_origin[1]) / terrain.friction_cell[1],
        )
        if wp.isfinite(place[0] + place[1]):
            zero = wp.float64(0.0)
            column = int(wp.clamp(wp.floor(place[0]), zero, wp.float64(columns - 1)))
            row = int(wp.clamp(wp.floor(place[1]), zero, wp.float64(rows - 1)))
            friction *= terrain.friction_map[row, column]
    return friction
