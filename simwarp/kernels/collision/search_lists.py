"""What the kernels of collision hand on where there are several: pairs to search, contacts found, in order of pairs."""

from __future__ import annotations

import dataclasses
from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout
from simwarp.kernels.collision.axis import Axis
from simwarp.kernels.collision.pair import FacingTriangle
from simwarp.kernels.collision.shape import Shape

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class Search:
    """Two placed shapes whose normal is looked for, in the order in which they are searched."""

    shape0: int
    shape1: int
    p: Shape
    q: Shape  # a triangle of the ground, or the pair's other shape
    flip: int  # 1: p is the pair's shape 1
    reach: float  # [m]
    wanted: int  # 0: nothing to search


@wp.struct
class Searches:
    """The searches of every world: first axis the world."""

    count: wp.array[int]
    lost: wp.array[int]  # for which there was no room
    search: wp.array2d[Search]
    axis: wp.array2d[Axis]  # results
    facing: wp.array2d[FacingTriangle]  # of searches on triangles


@wp.struct
class TriangleContacts:
    """Contacts with triangles of the ground, in the order of the searches that they are from."""

    count: wp.array[int]
    lost: wp.array[int]
    owner: wp.array2d[int]  # its search
    sunk: wp.array2d[int]  # 1: no contact, but the shape is below this triangle and may leave along its normal
    normal: wp.array2d[wp.vec3]
    point: wp.array2d[wp.vec3]
    gap: wp.array2d[float]
    feature: wp.array2d[int]


@wp.struct
class FoundContacts:
    """Contacts in lists, one for each way that they are found; within a list in the order of the pairs.

    Points are in the pair's frame.
    """

    room: int  # of a list
    count: wp.array2d[int]  # (worlds, lists)
    passed: wp.array2d[int]
    lost: wp.array2d[int]
    shape0: wp.array2d[int]  # (worlds, lists times room)
    shape1: wp.array2d[int]
    normal: wp.array2d[wp.vec3]
    point: wp.array2d[wp.vec3]
    gap: wp.array2d[float]
    feature: wp.array2d[int]


@dataclasses.dataclass(frozen=True, kw_only=True)
class SearchSizes:
    """Room of one world, 0 where a model needs none.

    Attributes:
        lists: of found contacts.
        found: contacts in each of them.
        pairs: convex pairs that are searched.
        triangles: pairs of a convex shape and a triangle.
    """

    lists: int
    found: int
    pairs: int
    triangles: int


ENTRIES = 4
"""Room for contacts with triangles, for each triangle."""


def found_layouts(worlds: int, sizes: SearchSizes) -> dict[str, ArrayLayout]:
    """The arrays of `FoundContacts`."""
    per_list = dict.fromkeys(("count", "passed", "lost"), ArrayLayout((worlds, sizes.lists), wp.int32))
    return per_list | _contacts(worlds, sizes.lists * sizes.found, ("shape0", "shape1", "feature"))


def search_layouts(worlds: int, room: int, facing: bool) -> dict[str, ArrayLayout]:
    """The arrays of `Searches`."""
    return {
        "facing": ArrayLayout((worlds, room if facing else 1), FacingTriangle),
        "count": ArrayLayout((worlds,), wp.int32), "lost": ArrayLayout((worlds,), wp.int32),
        "search": ArrayLayout((worlds, room), Search), "axis": ArrayLayout((worlds, room), Axis),
    }  # fmt: skip


def triangle_layouts(worlds: int, room: int) -> dict[str, ArrayLayout]:
    """The arrays of `TriangleContacts`."""
    whole = {name: ArrayLayout((worlds,), wp.int32) for name in ("count", "lost")}
    return whole | _contacts(worlds, ENTRIES * room, ("owner", "sunk", "feature"))


def search_list_layouts(worlds: int, sizes: SearchSizes) -> dict[str, ArrayLayout]:
    """All arrays that the model needs."""
    groups = {
        "found": found_layouts(worlds, sizes),
        "pairs": search_layouts(worlds, sizes.pairs, False) if sizes.pairs else {},
        "triangles": search_layouts(worlds, sizes.triangles, True) if sizes.triangles else {},
        "cut": triangle_layouts(worlds, sizes.triangles) if sizes.triangles else {},
        "taken": triangle_layouts(worlds, sizes.triangles) if sizes.triangles else {},
    }
    return {f"{group}.{name}": layout for group, part in groups.items() for name, layout in part.items()}


def make_lists(struct: Any, layouts: dict[str, ArrayLayout], device: Any) -> Any:
    """A struct with arrays of these layouts, zero."""
    lists = struct()
    for name, layout in layouts.items():
        setattr(lists, name, wp.zeros(layout.shape, dtype=layout.dtype, device=device))
    return lists


def _contacts(worlds: int, room: int, whole: tuple[str, ...]) -> dict[str, ArrayLayout]:
    kinds: dict[str, Any] = dict.fromkeys(whole, wp.int32) | {"normal": wp.vec3, "point": wp.vec3, "gap": wp.float32}
    return {name: ArrayLayout((worlds, room), kind) for name, kind in kinds.items()}
