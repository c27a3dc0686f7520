"""Which shapes of a model can meet, how their contacts are found, and how many there can be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError, PairRule, ShapeType
from simwarp.kernels.collision.narrow import has_formula
from simwarp.kernels.collision.surfaces import is_triangle_surface
from simwarp.meshes.mesh_faces import face_count
from simwarp.model.shapes import NOT_CONVEX, kinds_meet, on_host
from simwarp.model.specifications import Specification

ONE_POINT: Final = (ShapeType.SPHERE, ShapeType.ELLIPSOID)
NARROW: Final = (ShapeType.SPROCKET, ShapeType.GROOVE)
"""Shapes that spheres must fit into."""
MANIFOLD_CONTACTS: Final = 8
"""Contacts that one pair of shapes can have (kernels/collision/narrow.py)."""
CONTACTS_PER_BODY: Final = 12
"""Default contact slots per body: a brick in a wall has eight to twelve; a node of a mesh has one."""


def contact_limit(a: ShapeType, b: ShapeType) -> int:
    """Most contacts that a pair of shape types can have."""
    if a in ONE_POINT or b in ONE_POINT:
        return MANIFOLD_CONTACTS if {a, b} & {ShapeType.MESH, ShapeType.HEIGHT_FIELD} else 1
    if ShapeType.CAPSULE in (a, b) and not {a, b} & {ShapeType.MESH, ShapeType.HEIGHT_FIELD}:
        return 2
    return MANIFOLD_CONTACTS


def default_capacity(builder: Specification, pairs: npt.NDArray[np.int32]) -> int:
    """Contact slots of a world: all that its pairs can have, at most `CONTACTS_PER_BODY` per body and 24 at least."""
    shapes = builder.shapes
    total = sum(contact_limit(shapes[a].type, shapes[b].type) for a, b in pairs)
    nodes = sum(len(mesh.nodes) for mesh in builder.flexible_meshes)
    most = max(24, CONTACTS_PER_BODY * (len(builder.bodies) - nodes) + nodes)
    return min(total, most) + face_count(builder.flexible_meshes) // 2  # a face's, half of which its neighbours have


def check_room(builder: Specification, pairs: npt.NDArray[np.int32]) -> None:
    """That spheres are smaller than the arcs of sprockets and the grooves that they can meet.

    Raises:
        ModelError: one is not.
    """
    shapes = builder.shapes
    for pair in pairs.tolist() if any(shape.type in NARROW for shape in shapes) else ():
        ball, around = sorted((shapes[index] for index in pair), key=lambda shape: shape.type)
        if around.type in NARROW:
            room = float(around.size[1])
            if around.type == ShapeType.SPROCKET:
                room = float(around.size[0]) * builder.sprocket_profiles[around.asset].arc_radius
            if not ball.size[0] + ball.margin < room - around.margin:
                raise ModelError(
                    f"shape '{around.name}': spheres that it can meet must be smaller than its {room:.4g} m, got "
                    f"'{ball.name}' of {ball.size[0]:.4g} m; part them by group and mask"
                )


def shape_pairs(builder: Specification, apart: set[tuple[int, int]]) -> npt.NDArray[np.int32]:
    """(pairs, 2) indices of shapes that can meet, in lexicographic order; `apart` are pairs of bodies that do not."""
    shapes = builder.shapes
    count = len(shapes)
    if count < 2:
        return np.zeros((0, 2), np.int32)
    body = np.array([shape.body for shape in shapes])
    group = np.array([shape.group for shape in shapes])
    mask = np.array([shape.mask for shape in shapes])
    flat = np.array([shape.type in NOT_CONVEX for shape in shapes])
    first, second = np.triu_indices(count, 1)
    kind = np.array([int(shape.type) for shape in shapes])
    met_kinds = np.array([[kinds_meet(a, b) for b in ShapeType] for a in ShapeType])
    keep = (body[first] != body[second]) & ~(flat[first] & flat[second]) & met_kinds[kind[first], kind[second]]
    meets, met = (group[first] & mask[second]) != 0, (group[second] & mask[first]) != 0
    keep &= (meets | met) if builder.pair_rule == PairRule.EITHER else (meets & met)
    first, second = first[keep], second[keep]
    if apart:
        low, high = np.minimum(body[first], body[second]), np.maximum(body[first], body[second])
        codes = {(a + 1) * (body.max() + 2) + b + 1 for a, b in apart}
        together = np.isin((low + 1) * (body.max() + 2) + high + 1, list(codes))
        first, second = first[~together], second[~together]
    if builder.excluded_shapes or builder.given_pairs:
        excluded, given = (
            [a * count + b for a, b in pairs] for pairs in (builder.excluded_shapes, builder.given_pairs)
        )
        left = first * count + second
        first, second = np.divmod(np.union1d(left[~np.isin(left, excluded)], given).astype(np.int64), count)
    return np.stack([first, second], axis=1).astype(np.int32)


def pair_ways(types: Sequence[ShapeType], pairs: npt.NDArray[np.int32]) -> tuple[int, int, int]:
    """Count pairs with a formula, other convex pairs, and pairs with a height field or mesh."""
    counts = [0, 0, 0]
    on_triangles, by_formula = on_host(is_triangle_surface), on_host(has_formula)
    kinds, numbers = np.unique(np.sort(np.array(types, int)[pairs], axis=1), axis=0, return_counts=True)
    for (low, high), number in zip(kinds.tolist(), numbers.tolist(), strict=True):
        counts[2 if on_triangles(high) else 0 if by_formula(low, high) else 1] += number
    return counts[0], counts[1], counts[2]
