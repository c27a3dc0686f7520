"""Lists between the stages of collision: pairs to search and found contacts, in the order of the pairs."""

from __future__ import annotations

import dataclasses
from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout
from simwarp.kernels.collision.axis import Axis
from simwarp.kernels.collision.shape import Shape
from simwarp.kernels.collision.triangles import FacingTriangle
from simwarp.kernels.core.scratch import (
    ScratchGroup,
    make_memory,
    memory_layouts,
    memory_struct,
    scratch_array,
    slot_function,
)

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
class ListState:
    """How far a list is filled."""

    count: int
    passed: int  # of those, that the last stage has kept
    lost: int  # for which there was no room


@wp.struct
class TriangleContact:
    """A contact with a triangle of the ground."""

    search: int  # that it is from
    sunk: int  # 1: no contact, but the shape may leave along this triangle's normal
    normal: wp.vec3
    point: wp.vec3
    gap: float
    feature: int


@wp.struct
class FoundContact:
    """A contact of a pair; its point is in the pair's frame."""

    shape0: int
    shape1: int
    normal: wp.vec3
    point: wp.vec3
    gap: float
    feature: int


class PairScratch(ScratchGroup, packed=False, prefix="pairs_"):
    """Convex pairs to search."""

    list = scratch_array(ListState, 1)
    search = scratch_array(Search, "pairs")
    axis = scratch_array(Axis, "pairs")  # results
    facing = scratch_array(FacingTriangle, "none")  # of searches on triangles


class TriangleScratch(ScratchGroup, packed=False, prefix="triangles_"):
    """Shapes and triangles of the ground to search."""

    list = scratch_array(ListState, 1)
    search = scratch_array(Search, "triangles")
    axis = scratch_array(Axis, "triangles")
    facing = scratch_array(FacingTriangle, "triangles")


class ClippedScratch(ScratchGroup, packed=False, prefix="clipped_"):
    """Contacts with triangles of the ground, in the order of the searches that they are from."""

    list = scratch_array(ListState, 1)
    contact = scratch_array(TriangleContact, "entries")


class ValidScratch(ScratchGroup, packed=False, prefix="valid_"):
    """Those of them that the surface as a whole has."""

    list = scratch_array(ListState, 1)
    contact = scratch_array(TriangleContact, "entries")


class FoundScratch(ScratchGroup, packed=False, prefix="found_"):
    """Contacts in lists, one for each way that they are found; within a list in the order of the pairs."""

    list = scratch_array(ListState, "lists")
    contact = scratch_array(FoundContact, "lists", "found")
    face = scratch_array(wp.int32, "on_faces")  # of those on faces of meshes: the face,
    edge = scratch_array(wp.int32, "on_faces")  # its edge (-1: they are inside)
    weights = scratch_array(wp.vec3, "on_faces")  # and the shares of its corners


Searches = PairScratch.struct("Searches", __name__)
TriangleContacts = ClippedScratch.struct("TriangleContacts", __name__)
FoundContacts = FoundScratch.struct("FoundContacts", __name__)

GROUPS = (PairScratch, TriangleScratch, ClippedScratch, ValidScratch, FoundScratch)
ContactLists = memory_struct("ContactLists", __name__, GROUPS)
pack_pairs = slot_function("pack_pairs", __name__, PairScratch, Searches, ContactLists)
pack_triangles = slot_function("pack_triangles", __name__, TriangleScratch, Searches, ContactLists)
pack_clipped = slot_function("pack_clipped", __name__, ClippedScratch, TriangleContacts, ContactLists)
pack_valid = slot_function("pack_valid", __name__, ValidScratch, TriangleContacts, ContactLists)
pack_found = slot_function("pack_found", __name__, FoundScratch, FoundContacts, ContactLists)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ListSizes:
    """Room of one world, 0 where a model needs none.

    Attributes:
        lists: of found contacts.
        found: contacts in each of them.
        pairs: convex pairs that are searched.
        triangles: pairs of a convex shape and a triangle.
        on_faces: contacts with faces of meshes.
    """

    lists: int
    found: int
    pairs: int
    triangles: int
    on_faces: int
    none: int = 0

    @property
    def entries(self) -> int:
        """Room for contacts with triangles."""
        return ENTRIES * self.triangles


ENTRIES = 4
"""Room for contacts with triangles, for each triangle."""


def list_layouts(slots: int, sizes: ListSizes) -> dict[str, ArrayLayout]:
    """The arrays of the lists."""
    return memory_layouts(GROUPS, slots, sizes)


def make_lists(device: wp.Device, slots: int, sizes: ListSizes) -> Any:
    """Allocates the lists."""
    return make_memory(ContactLists, list_layouts(slots, sizes), device)
