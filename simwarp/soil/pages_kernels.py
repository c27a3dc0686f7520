"""Pages of soil nodes of one world: found by their place, taken when a wheel comes there, recycled when all are."""

import warp as wp

from simwarp.soil.soil_columns_kernels import SIDE
from simwarp.soil.soil_tables_kernels import NODE_VALUES, PAGE_NODES, SoilNodes

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.func
def first_entry(x: int, y: int, entries: int) -> int:
    """Where the search for a page begins; `entries` is a power of two."""
    h = wp.uint32(x) * wp.uint32(73856093) ^ wp.uint32(y) * wp.uint32(19349663)
    h = h ^ (h >> wp.uint32(15))
    return int(h & wp.uint32(entries - 1))


@wp.func
def find_page(world: int, x: int, y: int, nodes: SoilNodes) -> int:
    """The page at a place; -1 where nothing was touched."""
    entries = nodes.entry.shape[1]
    at = first_entry(x, y, entries)
    page = nodes.entry[world, at] - 1
    while page >= 0 and (nodes.place_x[world, page] != x or nodes.place_y[world, page] != y):
        at = (at + 1) & (entries - 1)
        page = nodes.entry[world, at] - 1
    return page


@wp.func
def slot_in(page: int, column: int, row: int) -> int:
    """Index of a node of a page among those of the world."""
    return page * PAGE_NODES + (row & (SIDE - 1)) * SIDE + (column & (SIDE - 1))


@wp.func
def forget(world: int, page: int, nodes: SoilNodes):
    """Takes a page out of the directory: later entries of its run move up, so that searches still find them."""
    entries = nodes.entry.shape[1]
    hole = first_entry(nodes.place_x[world, page], nodes.place_y[world, page], entries)
    while nodes.entry[world, hole] != page + 1:
        hole = (hole + 1) & (entries - 1)
    at = (hole + 1) & (entries - 1)
    while nodes.entry[world, at] > 0:
        other = nodes.entry[world, at] - 1
        home = first_entry(nodes.place_x[world, other], nodes.place_y[world, other], entries)
        # it may move up unless its home lies behind the hole
        if ((at - home) & (entries - 1)) >= ((at - hole) & (entries - 1)):
            nodes.entry[world, hole] = other + 1
            hole = at
        at = (at + 1) & (entries - 1)
    nodes.entry[world, hole] = 0


@wp.func
def forgotten_before(world: int, page: int, other: int, nodes: SoilNodes) -> bool:
    """Which of two pages goes first: the one used longer ago, then by its place, whatever the order of wheels was."""
    older = nodes.used_at[world, page] - nodes.used_at[world, other]
    if older == 0:
        older = nodes.place_y[world, page] - nodes.place_y[world, other]
    if older == 0:
        older = nodes.place_x[world, page] - nodes.place_x[world, other]
    return older < 0


@wp.func
def claim_page(world: int, x: int, y: int, step: int, nodes: SoilNodes):
    """Marks the page at a place as used in this step; takes one that is free, or else the one used longest ago.

    Without any that is not used in this step nothing is taken: there nothing bears the wheel. `Soil` asks for as many
    as upright wheels need.
    """
    page = find_page(world, x, y, nodes)
    if page < 0:
        pages = nodes.place_x.shape[1]
        page = nodes.count[world]
        if page < pages:
            nodes.count[world] = page + 1
        else:
            page = int(-1)
            for other in range(pages):
                if nodes.used_at[world, other] < step and (page < 0 or forgotten_before(world, other, page, nodes)):
                    page = other
            nodes.recycled[world] = nodes.recycled[world] + 1
            if page < 0:
                return
            forget(world, page, nodes)
        nodes.place_x[world, page] = x
        nodes.place_y[world, page] = y
        for node in range(PAGE_NODES):
            for value in range(NODE_VALUES):
                nodes.node[world, page * PAGE_NODES + node, value] = 0.0
            if nodes.raised.shape[1] > 0:
                nodes.raised[world, page * PAGE_NODES + node] = 0.0
        entries = nodes.entry.shape[1]
        at = first_entry(x, y, entries)
        while nodes.entry[world, at] > 0:
            at = (at + 1) & (entries - 1)
        nodes.entry[world, at] = page + 1
    nodes.used_at[world, page] = step
