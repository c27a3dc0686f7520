"""What a wheel meets of the ground and of static shapes: one normal and one deflection, by rays in its plane.

Rays leave the wheel's centre in three planes across its width, 2° apart, up to 120° from straight down. Where a ray
meets ground or a shape at a distance t below the radius r, the sector beyond shares (r² - t²) / 2 times its angle with
it. The sum of these shares along the rays of a plane is a vector v. A disc that a straight line cuts off at the half
angle q shares

    |v| = r² (sin q - cos² q asinh(tan q)),   deflection = r (1 - cos q)

with what is beyond, along its normal: this deflection against v stands for what the plane meets, and the mean of the
three, as vectors, for what the wheel meets. So flat ground gives its own normal and deflection, a stone under a third
of the width a third, an edge a part that grows as it moves in, and the two walls of a ditch hold the wheel together.
Across the wheel's plane the normal leans as much as what is met, on the average of the shares.

What is met twice counts once: of each ray the nearest hit counts. A shape that holds the wheel's centre is not met.
"""

import warp as wp

from simwarp.kernels.collision.shape import HULL, PLANE, Assets, Shape
from simwarp.kernels.collision.support import core_radius, inner_point, shape_bounds
from simwarp.kernels.collision.surfaces import SurfaceHit, is_triangle_surface, rotate_wide, triangle_surface_bounds
from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double, to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.rays.primitives import no_hit, primitive_ray
from simwarp.vehicle.tires.ground_kernels import TerrainTables, ground_ray, surface_ray
from simwarp.vehicle.tires.parameter_vector_kernels import Common
from simwarp.vehicle.tires.patch_kernels import FLATTEST, Envelopes, Wheel, lowest
from simwarp.vehicle.tires.tires_kernels import TireTables, wheel_state

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

RAYS = wp.constant(120)
SPREAD = wp.constant(0.0349065850)  # between rays [rad]
PLANES = wp.constant(3)
GRAZING = wp.constant(0.1)  # least cosine between a ray and the normal that a margin is taken along
LARGEST_SHARE = wp.constant(0.98)  # of r²: the disc is half sunk


@wp.struct
class ObstacleTables:
    """The static shapes that wheels meet."""

    shape: wp.array[int]
    kind: wp.array[int]  # ShapeType of each
    near: wp.array3d[int]  # (W, wheels, shapes) scratch: numbers of those that are close


@wp.func
def hull_ray(asset: int, scale: wp.vec3, start: wp.vec3, direction: wp.vec3, assets: Assets) -> SurfaceHit:
    """First hit of a ray from outside with a convex hull: the last face that it enters, unless it left another one
    before.
    """
    hit = no_hit()
    s = wp.cw_div(start, scale)
    d = wp.cw_div(direction, scale)
    first = float(-1.0)
    last = float(3.0e38)
    vertices = assets.hull_vertex_start[asset]
    for face in range(assets.hull_face_start[asset], assets.hull_face_start[asset + 1]):
        n = assets.hull_normal[face]
        corner = assets.hull_vertex[vertices + assets.hull_face[assets.hull_face_vertex_start[face]]]
        height = wp.dot(n, corner - s)
        rate = wp.dot(n, d)
        if rate < 0.0:
            if height / rate > first:
                first = height / rate
                hit.normal = n
        elif rate > 0.0:
            last = wp.min(last, height / rate)
        elif height < 0.0:
            last = float(-1.0)
    if first >= 0.0 and first <= last:
        hit.t = first
        hit.normal = wp.normalize(wp.cw_div(hit.normal, scale))
    return hit


@wp.func
def placed_shape(world: int, shape: int, kind: int, parameters: Parameters) -> Shape:
    """A static shape about its own origin."""
    s = Shape()
    s.kind = kind
    s.rot = wp.quat_to_matrix(parameters.shape_rot[world_row(world, parameters.shape_rot.shape[0]), shape])
    s.size = parameters.shape_size[world_row(world, parameters.shape_size.shape[0]), shape]
    s.margin = parameters.shape_margin[world_row(world, parameters.shape_margin.shape[0]), shape]
    s.asset = parameters.shape_asset[world_row(world, parameters.shape_asset.shape[0]), shape]
    return s


@wp.func
def is_near(s: Shape, centre: wp.vec3, reach: float, assets: Assets) -> bool:
    """True if a shape's bounds come within reach of a point, which is relative to its origin."""
    if s.kind == PLANE:
        return True
    if s.kind == HULL:
        return wp.length(centre - inner_point(s, assets)) < reach + core_radius(s, assets) + s.margin
    bounds = shape_bounds(s, assets)
    if is_triangle_surface(s.kind):
        bounds = triangle_surface_bounds(s, assets)
    out = wp.max(bounds.lower - centre, centre - bounds.upper)
    return wp.max(out) < reach


@wp.func
def shape_ray(s: Shape, x: wp.vec3d, direction: wp.vec3, reach: float, assets: Assets) -> SurfaceHit:
    """First hit of a ray from outside with a shape, from x relative to its origin; world axes."""
    back = wp.transpose(s.rot)
    start = rotate_wide(back, x)
    d = back * direction
    hit = no_hit()
    if s.kind == PLANE or is_triangle_surface(s.kind):
        hit = surface_ray(s.kind, s.asset, s.size, start, d, reach, assets)
    elif s.kind == HULL:
        hit = hull_ray(s.asset, s.size, to_float(start), d, assets)
    else:
        hit = primitive_ray(s.kind, s.size, to_float(start), d)
    facing = -wp.dot(hit.normal, d)
    if hit.t >= 0.0:
        if facing > 0.0:
            hit.t = wp.max(hit.t - s.margin / wp.max(facing, GRAZING), 0.0)
        else:
            hit.t = -1.0
    hit.normal = s.rot * hit.normal
    return hit


@wp.func
def shared_by_plane(q: float) -> float:
    """|v| / r² of a plane that cuts off the half angle q; by its series where the difference would lose digits."""
    if q < 0.3:
        return q * q * q * (2.0 / 3.0 - q * q * (0.2 - 0.01825397 * q * q))
    t = wp.tan(q)
    return wp.sin(q) - wp.cos(q) * wp.cos(q) * wp.log(t + wp.sqrt(1.0 + t * t))


@wp.func
def cut_angle(share: float) -> float:
    """The half angle q of a share: Newton, of a function whose slope is sin 2 q asinh(tan q)."""
    goal = wp.min(share, LARGEST_SHARE)
    q = wp.min(wp.pow(1.5 * goal, 1.0 / 3.0), 1.5)
    for _ in range(8):
        t = wp.tan(q)
        slope = wp.sin(2.0 * q) * wp.log(t + wp.sqrt(1.0 + t * t))
        if slope > 1.0e-9:
            q = wp.clamp(q - (shared_by_plane(q) - goal) / slope, 1.0e-4, 1.55)
    return q


@wp.func
def nearest_hit(
    world: int, x: wp.vec3d, direction: wp.vec3, radius: float, count: int, near: wp.array[int],
    obstacles: ObstacleTables, terrain: TerrainTables, parameters: Parameters, assets: Assets,
) -> SurfaceHit:  # fmt: skip
    """What a ray from x meets first within the radius: ground, or one of the shapes that are near."""
    best = ground_ray(world, x, direction, radius, terrain, assets)
    for k in range(count):
        number = near[k]
        shape = obstacles.shape[number]
        s = placed_shape(world, shape, obstacles.kind[number], parameters)
        origin = parameters.shape_x[world_row(world, parameters.shape_x.shape[0]), shape]
        hit = shape_ray(s, x - origin, direction, radius, assets)
        if hit.t >= 0.0 and (best.t < 0.0 or hit.t < best.t):
            best = hit
    if best.t > radius:
        best.t = -1.0
    return best


@wp.func
def list_near(
    world: int, wheel: Wheel, reach: float, near: wp.array[int], obstacles: ObstacleTables, parameters: Parameters,
    assets: Assets,
) -> int:  # fmt: skip
    """Numbers of the shapes within reach of a wheel's centre; returns how many."""
    count = int(0)
    for number in range(obstacles.shape.shape[0]):
        shape = obstacles.shape[number]
        s = placed_shape(world, shape, obstacles.kind[number], parameters)
        origin = parameters.shape_x[world_row(world, parameters.shape_x.shape[0]), shape]
        if is_near(s, to_float(wheel.x - origin), reach, assets):
            near[count] = number
            count += 1
    return count


@wp.struct
class Met:
    """What one plane of a wheel, or all of it, meets."""

    push: wp.vec3  # deflection along the normal, in the wheel's plane [m]
    shared: float  # sum of shares [m²]
    lean: float  # of them, times the normals' part along the axis


@wp.func
def met_in_plane(
    world: int, wheel: Wheel, x: wp.vec3d, radius: float, count: int, near: wp.array[int], obstacles: ObstacleTables,
    terrain: TerrainTables, parameters: Parameters, assets: Assets,
) -> Met:  # fmt: skip
    """What rays from x meet."""
    met = Met()
    down = lowest(wheel, 1.0)
    ahead = wp.cross(down, wheel.axis)
    first = -0.5 * float(RAYS - 1) * SPREAD
    c = wp.cos(first)
    s = wp.sin(first)
    turn_c = wp.cos(SPREAD)
    turn_s = wp.sin(SPREAD)
    v = wp.vec3()
    for _ in range(RAYS):
        direction = c * down + s * ahead
        hit = nearest_hit(world, x, direction, radius, count, near, obstacles, terrain, parameters, assets)
        if hit.t >= 0.0:
            share = 0.5 * (radius * radius - hit.t * hit.t)
            v += share * direction
            met.shared += share
            met.lean += share * wp.dot(hit.normal, wheel.axis)
        next_c = c * turn_c - s * turn_s
        s = s * turn_c + c * turn_s
        c = next_c
    size = wp.length(v)
    if size > 0.0:
        q = cut_angle(size * SPREAD / (radius * radius))
        met.push = -(radius * (1.0 - wp.cos(q)) / size) * v
    return met


@wp.kernel
def find_envelopes(
    worlds: WorldRange,
    tables: TireTables,
    tire_parameter: wp.array3d[float],
    terrain: TerrainTables,
    obstacles: ObstacleTables,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    envelopes: Envelopes,
):  # fmt: skip
    """What all wheels meet; dim (W, wheels).

    Args:
        tables, tire_parameter, terrain, state: as of `apply_tires`.
        obstacles: see there; their scratch is written.
        parameters: of the model, where its shapes stand.
        assets: hulls, height fields and meshes.
        envelopes: out.
    """
    index, number = wp.tid()
    world = worlds.first + index
    p = tire_parameter[world_row(world, tire_parameter.shape[0]), number]
    wheel = wheel_state(world, number, tables, state)
    radius = p[Common.RADIUS]
    width = p[Common.WIDTH]
    envelopes.deflection[world, number] = 0.0
    upright = wp.cross(wheel.axis, wp.vec3(0.0, 0.0, 1.0))
    if not wp.isfinite(wheel.x[0] + wheel.x[1] + wheel.x[2]) or wp.length_sq(upright) < FLATTEST:
        return
    near = obstacles.near[world, number]
    reach = wp.sqrt(radius * radius + 0.25 * width * width)
    count = list_near(world, wheel, reach, near, obstacles, parameters, assets)
    met = Met()
    for plane in range(PLANES):
        aside = (float(plane) - 0.5 * float(PLANES - 1)) * width / float(PLANES)
        x = wheel.x + to_double(aside * wheel.axis)
        part = met_in_plane(world, wheel, x, radius, count, near, obstacles, terrain, parameters, assets)
        met.push += part.push / float(PLANES)
        met.shared += part.shared
        met.lean += part.lean
    deflection = wp.length(met.push)
    if deflection <= 0.0:
        return
    lean = met.lean / met.shared
    upright_part = wp.sqrt(wp.max(1.0 - lean * lean, 0.0)) / deflection
    envelopes.normal[world, number] = upright_part * met.push + lean * wheel.axis
    envelopes.deflection[world, number] = deflection
