"""Rays against the instances of a world: nearest hit, or any.

The instances whose boxes a ray meets come in the order of their boxes, eight at a time, so that the first hit mostly
ends the search.
"""

from typing import Any

import warp as wp

from simwarp.kernels.collision.shape import HEIGHT_FIELD, HULL, MESH, Assets
from simwarp.kernels.collision.surfaces import SurfaceHit, height_field_ray
from simwarp.kernels.core.vector_math import to_double
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.rays.primitives import primitive_ray
from simwarp.kernels.rays.ray_modules import RAY_MODULE_OPTIONS
from simwarp.kernels.rays.wide_tree import tree_ray
from simwarp.sensors.ray_hit_kernels import RayHit
from simwarp.sensors.ray_instances_kernels import RayScene, start_of_ray
from simwarp.sensors.ray_targets_kernels import targets_ray

wp.set_module_options(RAY_MODULE_OPTIONS)

NEAR_COUNT = 8
Candidates: Any = wp.types.vector(length=2 * NEAR_COUNT + 1, dtype=wp.float32)


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    typedef float Lanes __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool Mask __attribute__((ext_vector_type(8)));
#endif
    const float* nodes = (const float*)((const char*)node.data + (size_t)world * node.strides[0]);
    const float tiny = 1.0e-18f;
    const float dx = fabsf(direction[0]) < tiny ? tiny : direction[0];
    const float dy = fabsf(direction[1]) < tiny ? tiny : direction[1];
    const float dz = fabsf(direction[2]) < tiny ? tiny : direction[2];
    const float ix = 1.0f / dx, iy = 1.0f / dy, iz = 1.0f / dz;
    const float ox = start[0], oy = start[1], oz = start[2];
    const int near_x = ix < 0.0f ? 24 : 0, near_y = iy < 0.0f ? 32 : 8, near_z = iz < 0.0f ? 40 : 16;
    const int far_x = 24 - near_x, far_y = 40 - near_y, far_z = 56 - near_z;
    float near_t[8];
    int near_i[8];
    int count = 0;
    int stack[64];
    int depth = 1;
    stack[0] = node.shape[1] / 56 - 1;
    while (depth > 0) {
        const float* p = nodes + 56 * stack[--depth];
        const int* child = (const int*)(p + 48);
        const float limit = count == 8 && near_t[7] < reach ? near_t[7] : reach;
        float distance[8];
        unsigned hits = 0;
#if defined(__CUDA_ARCH__)
        for (int k = 0; k < 8; ++k) {
            const float a = fmaxf(fmaxf((p[near_x + k] - ox) * ix, (p[near_y + k] - oy) * iy),
                                  fmaxf((p[near_z + k] - oz) * iz, 0.0f));
            const float b = fminf(fminf((p[far_x + k] - ox) * ix, (p[far_y + k] - oy) * iy),
                                  fminf((p[far_z + k] - oz) * iz, limit));
            distance[k] = a;
            hits |= (a <= b ? 1u : 0u) << k;
        }
#else
        const Lanes ax = (*(const Lanes*)(p + near_x) - ox) * ix;
        const Lanes ay = (*(const Lanes*)(p + near_y) - oy) * iy;
        const Lanes az = (*(const Lanes*)(p + near_z) - oz) * iz;
        const Lanes bx = (*(const Lanes*)(p + far_x) - ox) * ix;
        const Lanes by = (*(const Lanes*)(p + far_y) - oy) * iy;
        const Lanes bz = (*(const Lanes*)(p + far_z) - oz) * iz;
        // comparisons are one instruction each; the minimum of C, which heeds NaN, takes four
        #define MORE(p, q) ((p) > (q) ? (p) : (q))
        #define LESS(p, q) ((p) < (q) ? (p) : (q))
        const Lanes axy = MORE(ax, ay), az0 = MORE(az, (Lanes)(0.0f));
        const Lanes bxy = LESS(bx, by), bzl = LESS(bz, (Lanes)(limit));
        const Lanes a = MORE(axy, az0), b = LESS(bxy, bzl);
        #undef MORE
        #undef LESS
        const Mask mask = __builtin_convertvector(a <= b, Mask);
        unsigned char bits;
        __builtin_memcpy(&bits, &mask, 1);
        hits = bits;
        *(Lanes*)distance = a;
#endif
        for (int k = 0; k < 8; ++k) {
            if (!(hits >> k & 1u))
                continue;
            if (child[k] >= 0) {
                stack[depth++] = child[k];
                continue;
            }
            const int instance = -1 - child[k];
            const float t = distance[k];
            // those up to (floor_t, floor_i) were looked at before
            if (t < floor_t || (t == floor_t && instance <= floor_i))
                continue;
            if (count == 8 && !(t < near_t[7] || (t == near_t[7] && instance < near_i[7])))
                continue;
            int place = count < 8 ? count++ : 7;
            while (place > 0 && (near_t[place - 1] > t || (near_t[place - 1] == t && near_i[place - 1] > instance))) {
                near_t[place] = near_t[place - 1];
                near_i[place] = near_i[place - 1];
                --place;
            }
            near_t[place] = t;
            near_i[place] = instance;
        }
    }
    wp::vec_t<17, float> found;
    for (int k = 0; k < count; ++k) {
        found[k] = near_t[k];
        found[8 + k] = (float)near_i[k];
    }
    found[16] = (float)count;
    return found;
""")
def near_instances(
    world: int, node: wp.array2d[float], start: wp.vec3, direction: wp.vec3, reach: float, floor_t: float, floor_i: int
) -> Candidates:  # fmt: skip
    """The eight nearest boxes after (floor_t, floor_i) that a ray meets: distances, instances, their number."""
    ...


@wp.func
def instance_ray(
    world: int, instance: int, start: wp.vec3, direction: wp.vec3, reach: float, any_one: int, scene: RayScene,
    assets: Assets,
) -> RayHit:  # fmt: skip
    """The ray against one instance; `any_one` 1: any triangle of a mesh will do."""
    hit = RayHit()
    hit.t = -1.0
    hit.instance = -1
    hit.triangle = -1
    kind = scene.kind[instance]
    rot = scene.place_rot[world, instance]
    size = scene.place_size[world, instance]
    s = wp.transpose(rot) * (start - scene.place_x[world, instance])
    d = wp.transpose(rot) * direction
    if kind == MESH or kind == HULL:
        tree = scene.place_asset[world, instance]
        s = wp.cw_div(s, size)
        d = wp.cw_div(d, size)
        found = tree_ray(tree, s, d, reach, any_one, scene.trees)
        if found.triangle >= 0:
            hit.t = found.t
            hit.bary = found.bary
            hit.triangle = found.triangle
            hit.normal = wp.normalize(rot * wp.cross(wp.cw_mul(size, found.edge1), wp.cw_mul(size, found.edge2)))
    else:
        surface = SurfaceHit()
        if kind == HEIGHT_FIELD:
            asset = scene.place_asset[world, instance]
            surface = height_field_ray(asset, size, to_double(s), d, reach, assets)
        else:
            surface = primitive_ray(kind, size, s, d)
        if surface.t >= 0.0 and surface.t <= reach:
            hit.t = surface.t
            hit.triangle = surface.triangle
            hit.normal = rot * surface.normal
    if hit.t >= 0.0:
        hit.instance = instance
        hit.local = s + hit.t * d
    return hit


@wp.func
def closest_hit(
    world: int, start: wp.vec3, direction: wp.vec3, reach: float, scene: RayScene, assets: Assets
) -> RayHit:  # fmt: skip
    """The nearest surface along a ray, within reach [m], seen from either side. `start`: see `start_of_ray`."""
    best = RayHit()
    best.t = -1.0
    best.instance = -1
    best.triangle = -1
    limit = float(reach)
    floor_t = float(-1.0)
    floor_i = int(-1)
    more = int(1)
    while more == 1:
        near = near_instances(world, scene.node, start, direction, limit, floor_t, floor_i)
        count = int(near[16])
        k = int(0)
        while k < count and near[k] <= limit:
            hit = instance_ray(world, int(near[8 + k]), start, direction, limit, 0, scene, assets)
            if hit.t >= 0.0 and (best.t < 0.0 or hit.t < best.t):
                best = hit
                limit = hit.t
            k += 1
        more = int(0)
        if count == 8 and k == 8:
            more = int(1)
            floor_t = near[7]
            floor_i = int(near[15])
    target = targets_ray(world, start, direction, limit, scene.targets)
    if target.t >= 0.0 and (best.t < 0.0 or target.t < best.t):
        best = target
    return best


@wp.func
def any_hit(world: int, start: wp.vec3, direction: wp.vec3, reach: float, scene: RayScene, assets: Assets) -> int:
    """1 where a ray meets anything within reach [m]."""
    floor_t = float(-1.0)
    floor_i = int(-1)
    more = int(1)
    while more == 1:
        near = near_instances(world, scene.node, start, direction, reach, floor_t, floor_i)
        count = int(near[16])
        for k in range(count):
            hit = instance_ray(world, int(near[8 + k]), start, direction, reach, 1, scene, assets)
            if hit.t >= 0.0:
                return 1
        more = int(0)
        if count == 8:
            more = int(1)
            floor_t = near[7]
            floor_i = int(near[15])
    if targets_ray(world, start, direction, reach, scene.targets).t >= 0.0:
        return 1
    return 0


@wp.kernel
def cast_rays(
    worlds: WorldRange, scene: RayScene, assets: Assets, start: wp.array2d[wp.vec3d], direction: wp.array2d[wp.vec3],
    reach: float,
    distance: wp.array2d[float], normal: wp.array2d[wp.vec3], instance: wp.array2d[int],
):  # fmt: skip
    """Closest hits of (W, R) rays from world positions: distance (-1: nothing), normal, instance."""
    index, ray = wp.tid()
    world = worlds.first + index
    hit = closest_hit(world, start_of_ray(world, start[world, ray], scene), direction[world, ray], reach, scene, assets)
    distance[world, ray] = hit.t
    normal[world, ray] = hit.normal
    instance[world, ray] = hit.instance
