"""The launches of collision: one kernel where worlds take scratch in turn, several where each has its own."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from simwarp.core.types import ArrayLayout, ShapeType
from simwarp.kernels.collision.collide import collide_worlds
from simwarp.kernels.collision.collide_parts import (
    cut_pairs,
    keep_worlds,
    list_pairs,
    place_worlds,
    search_worlds,
    touch_worlds,
)
from simwarp.kernels.collision.search_lists import (
    FoundContacts,
    Searches,
    SearchSizes,
    TriangleContacts,
    make_lists,
    search_list_layouts,
)
from simwarp.kernels.collision.triangle_parts import cut_triangles, join_triangles, list_triangles, take_triangles
from simwarp.model.model import Model
from simwarp.simulation.world_launches import WorldLaunch, WorldShares

SURFACES = (ShapeType.HEIGHT_FIELD, ShapeType.MESH)
LEAST_PAIRS = 64
LEAST_TRIANGLES = 256
PER_SLOT = 4
"""Pairs and triangles that there is room for, per contact slot: bounds of boxes cross more often than shapes touch."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CollisionArrays:
    """Everything that collision reads and writes, as kernels take it.

    Attributes:
        config: numbers of the step.
        model: with its topology, parameters and assets.
        state, contacts: of the simulation.
        scratch: for intermediate values.
    """

    config: Any
    model: Model
    state: Any
    contacts: Any
    scratch: Any


def has_formula(a: ShapeType, b: ShapeType) -> bool:
    """Whether the contacts of two convex shapes are written down, as in the kernels (narrow.py)."""
    low, high = min(a, b), max(a, b)
    return low == ShapeType.PLANE or (low == ShapeType.SPHERE and (high <= ShapeType.CAPSULE or high == ShapeType.BOX))


def pair_counts(model: Model) -> tuple[int, int, int]:
    """Pairs with a formula, pairs to search, and pairs with a height field or mesh; at most so many in a grid."""
    start, other = model.topology.pair_start.numpy(), model.topology.pair_other.numpy()
    if model.topology.grid_buckets:
        first, second = np.triu_indices(model.shape_count, 1)
    else:
        first, second = np.repeat(np.arange(model.shape_count), np.diff(start)), other
    kinds = np.array(model.shape_types, int)
    found, numbers = np.unique(np.sort([kinds[first], kinds[second]], axis=0), axis=1, return_counts=True)
    counts = [0, 0, 0]
    for a, b, number in zip(*found.tolist(), numbers.tolist(), strict=True):
        if b not in SURFACES:
            counts[0 if has_formula(ShapeType(a), ShapeType(b)) else 1] += number
        elif a not in (*SURFACES, ShapeType.PLANE):
            counts[2] += number
    return counts[0], counts[1], counts[2]


def search_sizes(model: Model) -> SearchSizes:
    """Room for the lists that kernels of collision hand on."""
    _, searched, ground = pair_counts(model)
    slots = model.contact_capacity
    return SearchSizes(
        lists=3 if ground else 2 if searched else 1, found=2 * slots,
        pairs=min(searched, max(LEAST_PAIRS, PER_SLOT * slots)),
        triangles=max(LEAST_TRIANGLES, PER_SLOT * slots) if ground else 0,
    )  # fmt: skip


def parts_layouts(model: Model) -> dict[str, ArrayLayout]:
    """What the parts take beside the scratch of the one kernel."""
    if model.topology.pair_count == 0:
        return {}
    return search_list_layouts(model.world_count, search_sizes(model))


def record_collision(shares: WorldShares, arrays: CollisionArrays) -> list[WorldLaunch]:
    """Record the launches that find the contacts of all worlds."""
    model = arrays.model
    if model.topology.pair_count == 0:
        return []
    if shares.own_slots:
        return _record_parts(shares, arrays)
    inputs = [arrays.config, model.topology, model.parameters, model.assets, arrays.state, arrays.scratch]
    return [shares.record(collide_worlds, inputs=inputs, outputs=[arrays.contacts], in_turn=True)]


def _record_parts(shares: WorldShares, arrays: CollisionArrays) -> list[WorldLaunch]:
    """The kernels that this model needs, in turn."""
    topology, parameters, assets = arrays.model.topology, arrays.model.parameters, arrays.model.assets
    state, scratch = arrays.state, arrays.scratch
    posed = [arrays.config, topology, parameters, assets, state, scratch]
    layouts = parts_layouts(arrays.model)
    formula, searched, ground = pair_counts(arrays.model)

    def lists(struct: Any, group: str) -> Any:
        part = {name.partition(".")[2]: each for name, each in layouts.items() if name.startswith(group + ".")}
        return make_lists(struct, part, shares.device)

    found = lists(FoundContacts, "found")
    found.room = search_sizes(arrays.model).found
    commands = [shares.record(place_worlds, inputs=posed)]
    if formula:
        commands.append(shares.record(touch_worlds, inputs=posed, outputs=[found]))
    if searched:
        pairs = lists(Searches, "pairs")
        commands += [
            shares.record(
                list_pairs, inputs=[arrays.config, topology, parameters, state, scratch], outputs=[pairs]
            ),
            shares.record(search_worlds, inputs=[assets, state, pairs]),
            shares.record(cut_pairs, inputs=[assets, state, pairs, scratch], outputs=[found]),
        ]  # fmt: skip
    if ground:
        triangles = lists(Searches, "triangles")
        cut, taken = lists(TriangleContacts, "cut"), lists(TriangleContacts, "taken")
        commands += [
            shares.record(list_triangles, inputs=posed, outputs=[triangles]),
            shares.record(search_worlds, inputs=[assets, state, triangles]),
            shares.record(cut_triangles, inputs=[assets, state, triangles, scratch], outputs=[cut]),
            shares.record(
                take_triangles, inputs=[topology, parameters, assets, state, triangles, cut, scratch], outputs=[taken]
            ),
            shares.record(
                join_triangles, inputs=[topology, parameters, assets, state, triangles, taken, scratch],
                outputs=[found],
            ),
        ]  # fmt: skip
    return [
        *commands,
        shares.record(keep_worlds, inputs=[topology, state, scratch, found], outputs=[arrays.contacts]),
    ]
