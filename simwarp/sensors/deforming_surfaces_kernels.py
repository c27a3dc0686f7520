"""Surfaces that deform, as rays meet them: vertices from the nodes of meshes, and the trees of each world refitted.

A tree keeps the topology that its surface at rest gave it; boxes and triangles are written anew for every look.
Vertices are relative to a node of their mesh, which carries the instance: kilometres from the origin they are as sharp.
"""

import warp as wp

from simwarp.kernels.core.fields import StateArrays
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.core.world_range import WorldRange
from simwarp.kernels.meshes.mesh_loads import GlueTables
from simwarp.kernels.rays.wide_tree import Trees

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

WIDTH = wp.constant(8)
NODE = wp.constant(56)
LEAF = wp.constant(80)
ROUNDING = wp.constant(1.0e-6)
"""Of lengths: rays along a side must not slip between a flat box and its rounded distance."""


@wp.struct
class SurfaceTables:
    """Surfaces of all flexible meshes of a scene: vertices, leaves and nodes of their trees one after the other."""

    carrier: wp.array[int]  # per surface: body that its vertices are relative to
    size: wp.array[float]  # greatest extent at rest [m]
    first_tree: int  # number of the first surface's tree in world 0; trees of a surface stand world by world
    worlds: int

    vertex_node: wp.array2d[int]  # (V, k) that carry it, among those of all meshes
    vertex_weight: wp.array2d[wp.float64]
    vertex_surface: wp.array[int]

    leaf_corner: wp.array2d[int]  # (L, 24) vertices of its triangles, corner by corner; -1: an empty place
    leaf_surface: wp.array[int]
    leaf_start: wp.array[int]  # (S + 1,)
    leaf_slot: wp.array[int]  # 8 x node + place that has its box, among the nodes of its tree

    node_start: wp.array[int]  # (S + 1,)
    node_slot: wp.array[int]  # (N,) likewise; -1: the root


@wp.func
def tree_of(surface: int, world: int, s: SurfaceTables) -> int:
    """The number of a surface's tree in a world."""
    return s.first_tree + surface * s.worlds + world


@wp.func
def place_of_node(world: int, node: int, glue: GlueTables, state: StateArrays) -> wp.vec3d:
    """Where a node is, a glued or fixed one too, world [m]."""
    body = glue.body[node]
    x = glue.place[node]
    if body >= 0:
        if glue.is_glued[node] == 1:
            return state.body_x[world, body] + wp.quat_rotate(state.body_rot[world, body], x)
        return state.body_x[world, body]
    return x


@wp.kernel
def place_vertices(
    # inputs
    worlds: WorldRange,
    threads: int,
    due: wp.array[int],
    surfaces: SurfaceTables,
    glue: GlueTables,
    state: StateArrays,
    # outputs
    vertex: wp.array2d[wp.vec3],  # (W, V) from the body that carries the surface, world axes [m]
):
    """The vertices of all surfaces in the worlds that are due; `threads` threads of each world share them."""
    k, thread = wp.tid()
    world = worlds.first + k
    if due[world] == 0:
        return
    for index in range(thread, surfaces.vertex_surface.shape[0], threads):
        origin = state.body_x[world, surfaces.carrier[surfaces.vertex_surface[index]]]
        x = wp.vec3d()
        for part in range(surfaces.vertex_node.shape[1]):
            weight = surfaces.vertex_weight[index, part]
            if weight != wp.float64(0.0):
                x += weight * (place_of_node(world, surfaces.vertex_node[index, part], glue, state) - origin)
        vertex[world, index] = to_float(x)


@wp.func
def write_box(tree: int, slot: int, lower: wp.vec3, upper: wp.vec3, trees: Trees):
    """A child's box in its parent."""
    base = NODE * (trees.node_start[tree] + slot // WIDTH) + slot % WIDTH
    for c in range(3):
        trees.node[base + WIDTH * c] = lower[c]
        trees.node[base + WIDTH * (3 + c)] = upper[c]


@wp.func
def refit_leaf(world: int, leaf: int, surfaces: SurfaceTables, vertex: wp.array2d[wp.vec3], trees: Trees):
    """Triangles of a leaf, and its box."""
    surface = surfaces.leaf_surface[leaf]
    tree = tree_of(surface, world, surfaces)
    base = LEAF * (trees.leaf_start[tree] + leaf - surfaces.leaf_start[surface])
    lower = wp.vec3(3.0e38, 3.0e38, 3.0e38)
    upper = -lower
    for place in range(WIDTH):
        if surfaces.leaf_corner[leaf, place] >= 0:
            a = vertex[world, surfaces.leaf_corner[leaf, place]]
            b = vertex[world, surfaces.leaf_corner[leaf, WIDTH + place]]
            c = vertex[world, surfaces.leaf_corner[leaf, 2 * WIDTH + place]]
            lower = wp.min(lower, wp.min(a, wp.min(b, c)))
            upper = wp.max(upper, wp.max(a, wp.max(b, c)))
            for axis in range(3):
                trees.leaf[base + WIDTH * axis + place] = a[axis]
                trees.leaf[base + WIDTH * (3 + axis) + place] = b[axis] - a[axis]
                trees.leaf[base + WIDTH * (6 + axis) + place] = c[axis] - a[axis]
    reach = wp.max(wp.max(wp.abs(lower)), wp.max(wp.abs(upper)))
    slack = ROUNDING * (reach + surfaces.size[surface])
    room = wp.vec3(slack, slack, slack)
    write_box(tree, surfaces.leaf_slot[leaf], lower - room, upper + room, trees)


@wp.kernel
def refit_leaves(
    # inputs
    worlds: WorldRange,
    threads: int,
    due: wp.array[int],
    surfaces: SurfaceTables,
    vertex: wp.array2d[wp.vec3],
    # outputs
    trees: Trees,
):
    """Triangles of all leaves, and their boxes, likewise."""
    k, thread = wp.tid()
    world = worlds.first + k
    if due[world] == 0:
        return
    for leaf in range(thread, surfaces.leaf_surface.shape[0], threads):
        refit_leaf(world, leaf, surfaces, vertex, trees)


@wp.func
def refit_tree(world: int, surface: int, surfaces: SurfaceTables, trees: Trees):
    """Boxes of all nodes of a tree, children before their parents."""
    tree = tree_of(surface, world, surfaces)
    first = surfaces.node_start[surface]
    count = surfaces.node_start[surface + 1] - first
    for step in range(count):
        node = count - 1 - step
        base = NODE * (trees.node_start[tree] + node)
        lower = wp.vec3(3.0e38, 3.0e38, 3.0e38)
        upper = -lower
        for place in range(WIDTH):
            for c in range(3):
                # those of empty places are turned inside out
                lower[c] = wp.min(lower[c], trees.node[base + WIDTH * c + place])
                upper[c] = wp.max(upper[c], trees.node[base + WIDTH * (3 + c) + place])
        slot = surfaces.node_slot[first + node]
        if slot >= 0:
            write_box(tree, slot, lower, upper, trees)
        else:
            trees.lower[tree] = lower
            trees.upper[tree] = upper


@wp.kernel
def refit_nodes(
    # inputs
    worlds: WorldRange,
    threads: int,
    due: wp.array[int],
    surfaces: SurfaceTables,
    # outputs
    trees: Trees,
):
    """Boxes of the nodes of all trees in the worlds that are due; `threads` threads of each world share the trees."""
    k, thread = wp.tid()
    world = worlds.first + k
    if due[world] == 0:
        return
    for surface in range(thread, surfaces.carrier.shape[0], threads):
        refit_tree(world, surface, surfaces, trees)
