"""Rays through the trees of simwarp/geometry/triangle_tree.py: nearest or any triangle, from either side.

Written natively, with eight boxes or triangles in a vector of a CPU. The order is that of Embree's single rays (Wald et
al. 2014): near children first, the others on a stack with their distance. Triangles after Möller and Trumbore (1997).
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class Trees:
    """Trees of all meshes of a library, one after the other."""

    node: wp.array[float]  # NODE_WORDS each
    leaf: wp.array[float]  # LEAF_WORDS each
    node_start: wp.array[int]  # per mesh: its first node
    leaf_start: wp.array[int]
    lower: wp.array[wp.vec3]  # bounds per mesh
    upper: wp.array[wp.vec3]


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    struct Lanes { float v[8]; };
#else
    typedef float Lanes __attribute__((ext_vector_type(8), aligned(4)));
    typedef bool Mask __attribute__((ext_vector_type(8)));
#endif
    const float tiny = 1.0e-18f;
    const float dx = fabsf(direction[0]) < tiny ? tiny : direction[0];
    const float dy = fabsf(direction[1]) < tiny ? tiny : direction[1];
    const float dz = fabsf(direction[2]) < tiny ? tiny : direction[2];
    const float ix = 1.0f / dx, iy = 1.0f / dy, iz = 1.0f / dz;
    const float ox = start[0], oy = start[1], oz = start[2];
    const int near_x = ix < 0.0f ? 24 : 0, near_y = iy < 0.0f ? 32 : 8, near_z = iz < 0.0f ? 40 : 16;
    const int far_x = 24 - near_x, far_y = 40 - near_y, far_z = 56 - near_z;
    const float* __restrict__ nodes = node.data + 56 * (size_t)first_node;
    const float* __restrict__ leaves = leaf.data + 80 * (size_t)first_leaf;
    int stack[192];
    float entry[192];
    int depth = 0, current = 0;
    float best = reach, best_u = 0.0f, best_v = 0.0f;
    int found = -1;
    while (true) {
        if (current >= 0) {
            const float* __restrict__ p = nodes + 56 * (size_t)current;
            const int* child = (const int*)(p + 48);
            float distance[8];
            unsigned hits = 0;
#if defined(__CUDA_ARCH__)
            for (int k = 0; k < 8; ++k) {
                const float a = fmaxf(fmaxf((p[near_x + k] - ox) * ix, (p[near_y + k] - oy) * iy),
                                      fmaxf((p[near_z + k] - oz) * iz, 0.0f));
                const float b = fminf(fminf((p[far_x + k] - ox) * ix, (p[far_y + k] - oy) * iy),
                                      fminf((p[far_z + k] - oz) * iz, best));
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
            Lanes a = __builtin_elementwise_max(__builtin_elementwise_max(ax, ay), az);
            Lanes b = __builtin_elementwise_min(__builtin_elementwise_min(bx, by), bz);
            a = __builtin_elementwise_max(a, (Lanes)(0.0f));
            b = __builtin_elementwise_min(b, (Lanes)(best));
            const Mask mask = __builtin_convertvector(a <= b, Mask);
            unsigned char bits;
            __builtin_memcpy(&bits, &mask, 1);
            hits = bits;
            *(Lanes*)distance = a;
#endif
            if (hits) {
                int last = -1;
                float last_entry = 0.0f;
                while (hits) {
                    int k = 0;
#if defined(__CUDA_ARCH__)
                    k = __ffs(hits) - 1;
#else
                    k = __builtin_ctz(hits);
#endif
                    hits &= hits - 1;
                    const float t = distance[k];
                    if (last < 0) { last = k; last_entry = t; continue; }
                    int far_child = k;
                    float far_entry = t;
                    if (t < last_entry) { far_child = last; far_entry = last_entry; last = k; last_entry = t; }
                    int place = depth++;
                    // the nearest of this node's children lie on top
                    while (place > 0 && entry[place - 1] < far_entry) {
                        entry[place] = entry[place - 1];
                        stack[place] = stack[place - 1];
                        --place;
                    }
                    entry[place] = far_entry;
                    stack[place] = child[far_child];
                }
                current = child[last];
                continue;
            }
        } else {
            const float* __restrict__ q = leaves + 80 * (size_t)(-1 - current);
            float at[8], us[8], vs[8];
            unsigned hits = 0;
#if defined(__CUDA_ARCH__)
            for (int k = 0; k < 8; ++k) {
                const float ex = q[24 + k], ey = q[32 + k], ez = q[40 + k];
                const float fx = q[48 + k], fy = q[56 + k], fz = q[64 + k];
                const float hx = dy * fz - dz * fy, hy = dz * fx - dx * fz, hz = dx * fy - dy * fx;
                const float inv = 1.0f / (ex * hx + ey * hy + ez * hz);
                const float sx = ox - q[k], sy = oy - q[8 + k], sz = oz - q[16 + k];
                const float u = (sx * hx + sy * hy + sz * hz) * inv;
                const float gx = sy * ez - sz * ey, gy = sz * ex - sx * ez, gz = sx * ey - sy * ex;
                const float v = (dx * gx + dy * gy + dz * gz) * inv;
                const float t = (fx * gx + fy * gy + fz * gz) * inv;
                at[k] = t; us[k] = u; vs[k] = v;
                hits |= (u >= -1.0e-5f && v >= -1.0e-5f && u + v <= 1.00001f && t >= 0.0f && t <= best ? 1u : 0u) << k;
            }
#else
            #define LANES(i) (*(const Lanes*)(q + 8 * (i)))
            const Lanes ex = LANES(3), ey = LANES(4), ez = LANES(5), fx = LANES(6), fy = LANES(7), fz = LANES(8);
            const Lanes hx = dy * fz - dz * fy, hy = dz * fx - dx * fz, hz = dx * fy - dy * fx;
            const Lanes inv = 1.0f / (ex * hx + ey * hy + ez * hz);
            const Lanes sx = ox - LANES(0), sy = oy - LANES(1), sz = oz - LANES(2);
            const Lanes u = (sx * hx + sy * hy + sz * hz) * inv;
            const Lanes gx = sy * ez - sz * ey, gy = sz * ex - sx * ez, gz = sx * ey - sy * ex;
            const Lanes v = (dx * gx + dy * gy + dz * gz) * inv;
            const Lanes t = (fx * gx + fy * gy + fz * gz) * inv;
            const auto inside = (u >= -1.0e-5f) & (v >= -1.0e-5f) & (u + v <= 1.00001f) & (t >= 0.0f) & (t <= best);
            const Mask mask = __builtin_convertvector(inside, Mask);
            unsigned char bits;
            __builtin_memcpy(&bits, &mask, 1);
            hits = bits;
            if (hits) { *(Lanes*)at = t; *(Lanes*)us = u; *(Lanes*)vs = v; }
            #undef LANES
#endif
            while (hits) {
                int k = 0;
#if defined(__CUDA_ARCH__)
                k = __ffs(hits) - 1;
#else
                k = __builtin_ctz(hits);
#endif
                hits &= hits - 1;
                if (at[k] <= best) {
                    best = at[k]; best_u = us[k]; best_v = vs[k];
                    found = 8 * (-1 - current) + k;
                }
            }
            if (any_one && found >= 0)
                break;
        }
        do {
            --depth;
        } while (depth >= 0 && entry[depth] > best);
        if (depth < 0)
            break;
        current = stack[depth];
    }
    float bits_of;
    memcpy(&bits_of, &found, 4);
    return wp::vec4(best, best_u, best_v, bits_of);
""")
def walk_tree(
    node: wp.array[float], leaf: wp.array[float], first_node: int, first_leaf: int, start: wp.vec3, direction: wp.vec3,
    reach: float, any_one: int,
) -> wp.vec4:  # fmt: skip
    """t, u, v and, as bits, where the triangle is: 8 x leaf + place, -1: none. `any_one` 1: any triangle will do."""
    ...


@wp.func_native("""
    int i;
    memcpy(&i, &x, 4);
    return i;
""")
def bits_of(x: float) -> int:
    """The bits of a float32."""
    ...


@wp.struct
class TreeHit:
    """A triangle that a ray meets, in the mesh's own frame."""

    t: float  # in lengths of the direction
    triangle: int  # -1: none
    bary: wp.vec2  # weights of corners 1 and 2
    edge1: wp.vec3  # from corner 0 to corner 1
    edge2: wp.vec3


@wp.func
def tree_ray(mesh: int, start: wp.vec3, direction: wp.vec3, reach: float, any_one: int, trees: Trees) -> TreeHit:
    """The nearest triangle of a mesh along a ray, up to t = reach; with `any_one` the first that is found."""
    found = walk_tree(
        trees.node, trees.leaf, trees.node_start[mesh], trees.leaf_start[mesh], start, direction, reach, any_one
    )  # fmt: skip
    hit = TreeHit()
    hit.triangle = -1
    place = bits_of(found[3])
    if place >= 0:
        hit.t = found[0]
        hit.bary = wp.vec2(found[1], found[2])
        base = 80 * (trees.leaf_start[mesh] + place // 8) + place % 8
        hit.edge1 = wp.vec3(trees.leaf[base + 24], trees.leaf[base + 32], trees.leaf[base + 40])
        hit.edge2 = wp.vec3(trees.leaf[base + 48], trees.leaf[base + 56], trees.leaf[base + 64])
        hit.triangle = bits_of(trees.leaf[base + 72])
    return hit
