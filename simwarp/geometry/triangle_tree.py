"""Bounding volume trees of triangles with eight children a node, for rays (kernels/rays/wide_tree.py): the builder.

A node's eight boxes, and eight triangles of a leaf, are tested together (Wald, Benthin and Boulos 2008). Splits follow
the surface area heuristic over bins of centroids (Wald 2007), all nodes of a level at once.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.kernels.rays.wide_tree import Trees

WIDTH: Final = 8
"""Children of a node, triangles of a leaf."""
BINS: Final = 16
LARGEST_EXPONENT: Final = 60
"""Of two: products of two lengths up to it are far from the largest float32."""
NODE_WORDS: Final = 7 * WIDTH
"""float32 words of a node: lower x, y, z, upper x, y, z of its children, then their indices."""
LEAF_WORDS: Final = 10 * WIDTH
"""Of a leaf: first corner, edge 1 and edge 2 (x, y, z each) of its triangles, then their indices."""

Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class WideTree:
    """A tree; node 0 is its root.

    Attributes:
        nodes: (N, 56) float32. A child's index, as bits: a node, or minus one minus a leaf. Empty children have bounds
            that no ray meets.
        leaves: (L, 80) float32; empty places repeat no triangle: their edges are zero.
        lower, upper: (3,) bounds.
    """

    nodes: Floats
    leaves: Floats
    lower: Floats
    upper: Floats


def build_tree(vertices: npt.ArrayLike, triangles: npt.ArrayLike) -> WideTree:
    """The tree of (T >= 1, 3) triangles over (V, 3) vertices."""
    corners = np.asarray(vertices, np.float32)[np.asarray(triangles, np.int64)]
    box = np.concatenate([corners.min(axis=1), -corners.max(axis=1)], axis=1)  # minima of both halves
    # areas of boxes beyond 1e18 m are beyond float32: they are compared in another unit, by a power of two
    unit = max(int(np.frexp(np.abs(box).max())[1]) - LARGEST_EXPONENT, 0)
    box = np.ldexp(box, -unit)
    order = np.arange(len(corners))
    start, end = np.array([0]), np.array([len(corners)])
    nodes: list[Floats] = []
    leaf_start: list[Ints] = []
    leaf_end: list[Ints] = []
    node_count, leaf_count = 1, 0
    while len(start):
        owner, first, last, bounds = _children(box, order, start, end)
        bounds = np.ldexp(bounds, unit)
        rank = np.arange(len(owner)) - np.searchsorted(owner, owner)
        inner = last - first > WIDTH
        child = np.where(inner, node_count + np.cumsum(inner) - 1, -leaf_count - np.cumsum(~inner))
        level = np.full((len(start), 7, WIDTH), np.inf, np.float32)
        level[:, 3:6] = -np.inf
        level[:, 6] = 0.0
        level[owner, :3, rank] = bounds[:, :3]
        level[owner, 3:6, rank] = -bounds[:, 3:]
        level[owner, 6, rank] = child.astype(np.int32).view(np.float32)
        nodes.append(level.reshape(-1, NODE_WORDS))
        leaf_start.append(first[~inner])
        leaf_end.append(last[~inner])
        node_count += int(inner.sum())
        leaf_count += int((~inner).sum())
        start, end = first[inner], last[inner]
    table = np.concatenate(nodes)
    lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    # rays along a side must not slip between a flat box and its rounded distance
    slack = np.float32(1e-6) * np.maximum(np.abs(lower), np.abs(upper)).max()
    table[:, : 3 * WIDTH] -= slack
    table[:, 3 * WIDTH : 6 * WIDTH] += slack
    return WideTree(table, _leaves(corners, order, np.concatenate(leaf_start), np.concatenate(leaf_end)), lower, upper)


def tree_tables(meshes: Iterable[tuple[npt.ArrayLike, npt.ArrayLike]], device: wp.DeviceLike) -> Trees:
    """The trees of meshes (vertices, triangles), on a device; their order gives the numbers."""
    trees = [build_tree(vertices, triangles) for vertices, triangles in meshes]
    tables = Trees()

    def floats(blocks: list[npt.NDArray[np.float32]], width: int) -> wp.array:
        rows = np.concatenate([np.zeros((0, width), np.float32), *blocks])
        return wp.array(rows.reshape(-1), dtype=wp.float32, device=device)

    def starts(counts: list[int]) -> wp.array:
        return wp.array(np.cumsum([0, *counts]).astype(np.int32), dtype=wp.int32, device=device)

    tables.node, tables.leaf = (
        floats([t.nodes for t in trees], NODE_WORDS),
        floats([t.leaves for t in trees], LEAF_WORDS),
    )
    tables.node_start, tables.leaf_start = starts([len(t.nodes) for t in trees]), starts([len(t.leaves) for t in trees])
    for name in ("lower", "upper"):
        rows = np.array([getattr(tree, name) for tree in trees], np.float32).reshape(-1, 3)
        setattr(tables, name, wp.array(rows, dtype=wp.vec3, device=device))
    return tables


def _leaves(corners: Floats, order: Ints, start: Ints, end: Ints) -> Floats:
    """(L, 80) leaves of the triangles order[start:end]."""
    place = start[:, None] + np.arange(WIDTH)
    used = place < end[:, None]
    index = order[np.where(used, place, start[:, None])]
    found = corners[index]
    leaves = np.zeros((len(start), 10, WIDTH), np.float32)
    leaves[:, 0:3] = found[:, :, 0].transpose(0, 2, 1)
    for edge in (1, 2):
        side = np.where(used[:, :, None], found[:, :, edge] - found[:, :, 0], np.float32(0.0))
        leaves[:, 3 * edge : 3 * edge + 3] = side.transpose(0, 2, 1)
    leaves[:, 9] = index.astype(np.int32).view(np.float32)
    return leaves.reshape(-1, LEAF_WORDS)


def _children(box: Floats, order: Ints, start: Ints, end: Ints) -> tuple[Ints, Ints, Ints, Floats]:
    """Splits every range until it has eight parts, or parts that fit in leaves; the largest part first.

    Returns, sorted by range: its number, first and last place of each part in `order` (which is sorted along), bounds.
    """
    owner, first, last = np.arange(len(start)), start, end
    bounds = _bounds(box[order[_places(first, last)[0]]], first, last)
    for _ in range(WIDTH - 1):
        size = bounds[:, 3:] + bounds[:, :3]  # minus the extent
        area = size[:, 0] * size[:, 1] + size[:, 1] * size[:, 2] + size[:, 2] * size[:, 0]
        area = np.where(last - first > WIDTH, area, -1.0)
        by_owner = np.lexsort((-area, owner))
        chosen = by_owner[np.searchsorted(owner[by_owner], np.unique(owner))]
        chosen = np.sort(chosen[area[chosen] >= 0.0])
        if not len(chosen):
            break
        middle = _split(box, order, first[chosen], last[chosen])
        owner = np.concatenate([owner, owner[chosen]])
        first, last = np.concatenate([first, middle]), np.concatenate([last, last[chosen]])
        last[chosen] = middle
        fresh = np.concatenate([chosen, np.arange(len(last) - len(middle), len(last))])
        bounds = np.concatenate([bounds, bounds[chosen]])
        bounds[fresh] = _bounds(box[order[_places(first[fresh], last[fresh])[0]]], first[fresh], last[fresh])
    by_owner = np.lexsort((first, owner))
    return owner[by_owner], first[by_owner], last[by_owner], bounds[by_owner]


def _places(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """Every place of the ranges, one range after the other, and the range that it is of."""
    count = last - first
    part = np.repeat(np.arange(len(first)), count)
    begin = np.cumsum(count) - count
    return np.arange(int(count.sum())) - begin[part] + first[part], part


def _bounds(boxes: Floats, first: Ints, last: Ints) -> Floats:
    """(P, 6) lower bounds and minus upper bounds of consecutive groups of boxes, as long as the ranges."""
    count = last - first
    return np.minimum.reduceat(boxes, np.cumsum(count) - count, axis=0)


def _split(box: Floats, order: Ints, first: Ints, last: Ints) -> Ints:
    """Divides each range in two where the surface area heuristic says; sorts `order` and returns the middles."""
    place, part = _places(first, last)
    member = order[place]
    boxes, count = box[member], last - first
    centre = boxes[:, :3] - boxes[:, 3:]
    begin = np.cumsum(count) - count
    low, high = np.minimum.reduceat(centre, begin, axis=0), np.maximum.reduceat(centre, begin, axis=0)
    scale = (BINS * (1.0 - 1e-6)) / np.maximum(high - low, 1e-30)
    index = np.minimum(((centre - low[part]) * scale[part]).astype(np.int64), BINS - 1)
    best_cost = np.full(len(first), np.inf)
    best_axis, best_bin = np.zeros(len(first), np.int64), np.zeros(len(first), np.int64)
    for axis in range(3):
        cost = _plane_costs(boxes, part * BINS + index[:, axis], len(first))
        cost[high[:, axis] <= low[:, axis]] = np.inf
        plane = cost.argmin(axis=1)
        least = cost[np.arange(len(first)), plane]
        better = least < best_cost
        best_cost[better], best_axis[better], best_bin[better] = least[better], axis, plane[better]
    right = index[np.arange(len(part)), best_axis[part]] > best_bin[part]
    flat = ~np.isfinite(best_cost)  # all centroids coincide: in halves
    if flat.any():
        half = np.arange(len(part)) - begin[part] >= (count // 2)[part]
        right = np.where(flat[part], half, right)
    order[place] = member[np.lexsort((right, part))]
    return last - np.bincount(part, weights=right, minlength=len(first)).astype(np.int64)


def _plane_costs(boxes: Floats, key: Ints, parts: int) -> Any:
    """(P, BINS - 1) areas times counts of both sides of each plane between bins; infinite where a side is empty."""
    by_key = np.argsort(key, kind="stable")
    keys, begin = np.unique(key[by_key], return_index=True)
    flat = np.full((parts * BINS, 6), np.inf, np.float32)
    flat[keys] = np.minimum.reduceat(boxes[by_key], begin, axis=0)
    bounds = flat.reshape(parts, BINS, 6)
    count = np.bincount(key, minlength=parts * BINS).reshape(parts, BINS)
    below = np.minimum.accumulate(bounds, axis=1)[:, :-1]
    above = np.minimum.accumulate(bounds[:, ::-1], axis=1)[:, ::-1][:, 1:]
    under = np.cumsum(count, axis=1)[:, :-1]
    over = count.sum(axis=1, keepdims=True) - under
    total = np.zeros(under.shape)
    for side, number in ((below, under), (above, over)):
        size = -np.where(number[..., None] > 0, side[..., 3:] + side[..., :3], 0.0).astype(np.float64)
        area = size[..., 0] * size[..., 1] + size[..., 1] * size[..., 2] + size[..., 2] * size[..., 0]
        # leaves are tested eight triangles at a time
        total += np.where(number > 0, area * np.ceil(number / WIDTH), np.inf)
    return total
