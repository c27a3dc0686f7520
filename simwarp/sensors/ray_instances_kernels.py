"""Instances that rays of a world can hit: shared geometry, placed per world, and the tree over their bounds.

The tree is built anew for every frame, by one thread per world: instances in Morton order, eight to a node, eight nodes
to a node of the next level, so that no link is stored. A refit would keep the topology of the first frame, which says
nothing any more once an episode has placed its obstacles elsewhere.
"""

import warp as wp

from simwarp.kernels.collision.shape import (
    BOX,
    CAPSULE,
    CONE,
    CYLINDER,
    ELLIPSOID,
    HEIGHT_FIELD,
    HULL,
    MESH,
    SPHERE,
    Assets,
)
from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import matrix_to_float, to_double, to_float, turned_extent
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.rays.wide_tree import Trees
from simwarp.sensors.ray_targets_kernels import RayTargets, target_extent

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

ENDLESS = wp.constant(1.0e18)  # half size of a plane [m]


@wp.struct
class RayScene:
    """Instances of all worlds. Constant per instance: (I,). `(1 or W, I)`: shared or each world's own. The rest is
    written by `place_instances`. Positions in float32 are relative to `origin`, which goes with a body.
    """

    instance_count: int
    origin_body: int  # -1: the world's origin
    mask: int  # a ray meets instances whose group has one of these bits

    kind: wp.array[int]  # ShapeType, or that of a `RayTarget`
    body: wp.array[int]  # -1: world
    shape: wp.array[int]  # the model's shape that it shows, -1: none, its placement is below
    tree: wp.array[int]  # of a hull or mesh: number of the first tree of its kind, to which its asset is added
    group: wp.array[int]
    label: wp.array[int]

    x: wp.array2d[wp.vec3d]  # (1 or W, I) from the body's centre of mass, body axes [m]
    rot: wp.array2d[wp.quat]
    size: wp.array2d[wp.vec3]
    asset: wp.array2d[int]
    enabled: wp.array2d[int]
    color: wp.array2d[wp.vec3]  # linear albedo
    texture: wp.array2d[int]  # -1: none
    reflectance: wp.array2d[float]

    origin: wp.array[wp.vec3d]  # (W,) world [m]
    place_x: wp.array2d[wp.vec3]  # (W, I)
    place_rot: wp.array2d[wp.mat33]  # instance axes to world axes
    place_size: wp.array2d[wp.vec3]
    place_asset: wp.array2d[int]  # of a hull or mesh: its tree
    lower: wp.array2d[wp.vec3]
    upper: wp.array2d[wp.vec3]
    order: wp.array2d[int]  # scratch
    code: wp.array2d[int]
    node: wp.array2d[float]  # (W, nodes x NODE_WORDS)

    trees: Trees
    targets: RayTargets


@wp.func_native("""
    const int n = lower.shape[1];
    const wp::vec3* lo = (const wp::vec3*)((const char*)lower.data + (size_t)world * lower.strides[0]);
    const wp::vec3* hi = (const wp::vec3*)((const char*)upper.data + (size_t)world * upper.strides[0]);
    int* list = (int*)((char*)order.data + (size_t)world * order.strides[0]);
    int* key = (int*)((char*)code.data + (size_t)world * code.strides[0]);
    float* nodes = (float*)((char*)node.data + (size_t)world * node.strides[0]);
    // the box of all centres of what is finite
    float a[3] = {3.0e38f, 3.0e38f, 3.0e38f}, b[3] = {-3.0e38f, -3.0e38f, -3.0e38f};
    for (int i = 0; i < n; ++i)
        for (int k = 0; k < 3; ++k) {
            const float c = 0.5f * (lo[i][k] + hi[i][k]);
            if (hi[i][k] >= lo[i][k] && hi[i][k] - lo[i][k] < 1.0e17f) {
                a[k] = c < a[k] ? c : a[k];
                b[k] = c > b[k] ? c : b[k];
            }
        }
    for (int i = 0; i < n; ++i) {
        int morton = 0;
        bool finite = true, there = true;
        for (int k = 0; k < 3; ++k) {
            const float c = 0.5f * (lo[i][k] + hi[i][k]);
            there = there && hi[i][k] >= lo[i][k];
            finite = finite && hi[i][k] - lo[i][k] < 1.0e17f;
            const float span = b[k] - a[k];
            float part = span > 0.0f ? (c - a[k]) / span * 1023.0f : 0.0f;
            part = part >= 0.0f ? (part <= 1023.0f ? part : 1023.0f) : 0.0f;
            unsigned bits = (unsigned)part;
            bits = (bits | (bits << 16)) & 0x030000FFu;
            bits = (bits | (bits << 8)) & 0x0300F00Fu;
            bits = (bits | (bits << 4)) & 0x030C30C3u;
            bits = (bits | (bits << 2)) & 0x09249249u;
            morton |= (int)(bits << k);
        }
        // what is missing comes last, what has no end first
        key[i] = there ? (finite ? morton : -1) : 0x7fffffff;
        list[i] = i;
    }
    for (int gap = n / 2; gap > 0; gap /= 2)
        for (int i = gap; i < n; ++i) {
            const int item = list[i], k = key[item];
            int j = i;
            while (j >= gap && (key[list[j - gap]] > k || (key[list[j - gap]] == k && list[j - gap] > item))) {
                list[j] = list[j - gap];
                j -= gap;
            }
            list[j] = item;
        }
    const float inf = 3.0e38f;
    int first = 0, count = (n + 7) / 8;
    for (int j = 0; j < count; ++j) {
        float* p = nodes + 56 * j;
        for (int k = 0; k < 8; ++k) {
            const int i = 8 * j + k < n ? list[8 * j + k] : -1;
            const bool there = i >= 0 && hi[i][0] >= lo[i][0];
            for (int c = 0; c < 3; ++c) {
                p[8 * c + k] = there ? lo[i][c] : inf;
                p[24 + 8 * c + k] = there ? hi[i][c] : -inf;
            }
            ((int*)p)[48 + k] = -1 - i;
        }
    }
    while (count > 1) {
        const int parents = (count + 7) / 8;
        for (int j = 0; j < parents; ++j) {
            float* p = nodes + 56 * (first + count + j);
            for (int k = 0; k < 8; ++k) {
                const int child = 8 * j + k;
                ((int*)p)[48 + k] = first + (child < count ? child : 0);
                for (int c = 0; c < 3; ++c) {
                    float low = inf, high = -inf;
                    if (child < count) {
                        const float* q = nodes + 56 * (first + child);
                        for (int m = 0; m < 8; ++m) {
                            low = q[8 * c + m] < low ? q[8 * c + m] : low;
                            high = q[24 + 8 * c + m] > high ? q[24 + 8 * c + m] : high;
                        }
                    }
                    p[8 * c + k] = low;
                    p[24 + 8 * c + k] = high;
                }
            }
        }
        first += count;
        count = parents;
    }
""")
def build_instance_tree(
    world: int, lower: wp.array2d[wp.vec3], upper: wp.array2d[wp.vec3], order: wp.array2d[int], code: wp.array2d[int],
    node: wp.array2d[float],
):  # fmt: skip
    """Nodes of one world, level by level; the last is the root."""
    ...


@wp.func
def half_extent(kind: int, size: wp.vec3) -> wp.vec3:
    """Of a primitive about its origin, own axes [m]."""
    if kind == BOX or kind == ELLIPSOID or kind == SPHERE:
        return size
    if kind == CYLINDER or kind == CONE:
        return wp.vec3(size[0], size[0], size[1])
    if kind == CAPSULE:
        return wp.vec3(size[0], size[0], size[1] + size[0])
    return wp.vec3(ENDLESS, ENDLESS, ENDLESS)


@wp.func
def instance_bounds(instance: int, world: int, scene: RayScene, assets: Assets):
    """Bounds of a placed instance, from its own box turned into the world."""
    extent = target_extent(world, scene.kind[instance], scene.targets)
    kind = extent.kind
    size = scene.place_size[world, instance]
    asset = scene.place_asset[world, instance]
    middle = wp.vec3()
    half = wp.vec3()
    if kind == HULL or kind == MESH:
        low = wp.cw_mul(size, scene.trees.lower[asset])
        high = wp.cw_mul(size, scene.trees.upper[asset])
        middle = 0.5 * (low + high)
        half = 0.5 * wp.vec3(wp.abs(high[0] - low[0]), wp.abs(high[1] - low[1]), wp.abs(high[2] - low[2]))
    elif kind == HEIGHT_FIELD:
        spacing = assets.field_spacing[asset]
        nodes = assets.field_nodes[asset]
        z = assets.field_range[asset] * size[2]
        middle = wp.vec3(0.0, 0.0, 0.5 * (z[0] + z[1]))
        half = wp.vec3(
            0.5 * size[0] * float(spacing[0]) * float(nodes[0] - 1),
            0.5 * size[1] * float(spacing[1]) * float(nodes[1] - 1),
            0.5 * wp.abs(z[1] - z[0]),
        )
    else:
        half = half_extent(kind, size)
    rot = scene.place_rot[world, instance]
    centre = scene.place_x[world, instance] + rot * middle
    reach = turned_extent(rot, half) * 1.000001
    for k in range(3):
        reach[k] += 1.0e-6 * wp.abs(centre[k]) + 1.0e-7
    scene.lower[world, instance] = centre - reach - wp.vec3(0.0, 0.0, extent.below)
    scene.upper[world, instance] = centre + reach + wp.vec3(0.0, 0.0, extent.above)


@wp.kernel
def place_instances(
    worlds: WorldRange, due: wp.array[int], parameters: Parameters, assets: Assets, state: StateArrays, scene: RayScene
):  # fmt: skip
    """Places the instances of the worlds that are due and builds their tree. One thread per world."""
    world = worlds.first + wp.tid()
    if due[world] == 0:
        return
    origin = wp.vec3d()
    if scene.origin_body >= 0:
        origin = state.body_x[world, scene.origin_body]
    scene.origin[world] = origin
    for instance in range(scene.instance_count):
        shape = scene.shape[instance]
        x = wp.vec3d()
        q = wp.quat()
        there = int(0)
        if shape >= 0:
            ws = world_row(world, parameters.shape_x.shape[0])
            x = parameters.shape_x[ws, shape]
            q = parameters.shape_rot[world_row(world, parameters.shape_rot.shape[0]), shape]
            scene.place_size[world, instance] = parameters.shape_size[
                world_row(world, parameters.shape_size.shape[0]), shape
            ]
            scene.place_asset[world, instance] = (
                scene.tree[instance] + parameters.shape_asset[world_row(world, parameters.shape_asset.shape[0]), shape]
            )
            there = parameters.shape_enabled[world_row(world, parameters.shape_enabled.shape[0]), shape]
        else:
            x = scene.x[world_row(world, scene.x.shape[0]), instance]
            q = scene.rot[world_row(world, scene.rot.shape[0]), instance]
            scene.place_size[world, instance] = scene.size[world_row(world, scene.size.shape[0]), instance]
            scene.place_asset[world, instance] = (
                scene.tree[instance] + scene.asset[world_row(world, scene.asset.shape[0]), instance]
            )
            there = scene.enabled[world_row(world, scene.enabled.shape[0]), instance]
        if shape >= 0:
            there = there * scene.enabled[world_row(world, scene.enabled.shape[0]), instance]
        body = scene.body[instance]
        rot = wp.quat_to_matrix(q)
        if body >= 0:
            turn = wp.quat_to_matrix(state.body_rot[world, body])
            x = state.body_x[world, body] + turn * x
            rot = matrix_to_float(turn) * rot
        scene.place_x[world, instance] = to_float(x - origin)
        scene.place_rot[world, instance] = rot
        if there == 0 or (scene.group[instance] & scene.mask) == 0:
            scene.lower[world, instance] = wp.vec3(3.0e38, 3.0e38, 3.0e38)
            scene.upper[world, instance] = wp.vec3(-3.0e38, -3.0e38, -3.0e38)
        else:
            instance_bounds(instance, world, scene, assets)
    build_instance_tree(world, scene.lower, scene.upper, scene.order, scene.code, scene.node)


@wp.func
def start_of_ray(world: int, x: wp.vec3d, scene: RayScene) -> wp.vec3:
    """A world position as rays take it: relative to the scene's origin in that world [m]."""
    return to_float(x - scene.origin[world])


@wp.func
def world_position(world: int, x: wp.vec3, scene: RayScene) -> wp.vec3d:
    """The way back: where a ray's point is in the world [m]."""
    return scene.origin[world] + to_double(x)
