"""Collision as several kernels, one after the other: what a GPU runs. The functions are those of `collide_worlds`.

Pairs with a formula are written down at once. Others are listed, searched for a normal, and cut; those of triangles are
then put together, surface by surface. The last kernel goes through the lists of contacts in the order of the pairs, as
the one kernel of a CPU does, so that slots and warm starts are the same. What finds no room in a list counts as
overflow of the contacts.
"""

from typing import Any

import warp as wp

from simwarp.core.types import WorldStatus
from simwarp.kernels.collision.axis import separation_axis
from simwarp.kernels.collision.broad import candidates
from simwarp.kernels.collision.clip import contact_manifold
from simwarp.kernels.collision.contact_slots import ContactProgress, keep_last_contacts, keep_pair, passed_contacts
from simwarp.kernels.collision.narrow import capsule_axis, formula_contacts, has_formula, swapped
from simwarp.kernels.collision.placement import (
    CollisionScratch,
    fill_world_grid,
    may_touch,
    near_distance,
    pack_grid,
    pack_manifold,
    pair_origin,
    pair_reach,
    place_shapes,
    placed,
    reach_time,
)
from simwarp.kernels.collision.search_lists import FoundContacts, Search, Searches
from simwarp.kernels.collision.shape import (
    CAPSULE,
    SPHERE,
    TRIANGLE,
    Assets,
    Manifold,
)
from simwarp.kernels.collision.support import rounding
from simwarp.kernels.collision.surfaces import (
    is_triangle_surface,
)
from simwarp.kernels.core.fields import ContactArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, world_row
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of

MODULE_OPTIONS = {"enable_backward": False, "max_unroll": 0}

wp.set_module_options(MODULE_OPTIONS)

PART: dict[str, Any] = {"enable_backward": False, "module": "unique", "module_options": MODULE_OPTIONS}

NON_FINITE = wp.constant(int(WorldStatus.NON_FINITE))
FORMULA = wp.constant(0)
SEARCHED = wp.constant(1)
GROUND = wp.constant(2)


@wp.func
def way_of(shape0: int, shape1: int, topology: Topology) -> int:
    """How the contacts of a pair are found: by FORMULA, SEARCHED for, or on the triangles of a GROUND."""
    kind0 = topology.shape_type[shape0]
    kind1 = topology.shape_type[shape1]
    if is_triangle_surface(kind0) or is_triangle_surface(kind1):
        return GROUND
    if has_formula(wp.min(kind0, kind1), wp.max(kind0, kind1)):
        return FORMULA
    return SEARCHED


@wp.func
def reach_of(
    world: int, scratch_slot: int, shape0: int, shape1: int, near: float, time: float, parameters: Parameters,
    scratch: CollisionScratch,
) -> float:  # fmt: skip
    """What two shapes may be apart and still touch [m]; negative if they cannot come that near."""
    reach = pair_reach(scratch_slot, shape0, shape1, near, time, scratch)
    w = world_row(world, parameters.shape_enabled.shape[0])
    enabled = parameters.shape_enabled[w, shape0] * parameters.shape_enabled[w, shape1]
    if enabled == 0 or not may_touch(scratch_slot, shape0, shape1, reach, scratch):
        return -1.0
    return reach


@wp.func
def add_found(
    world: int, way: int, shape0: int, shape1: int, contacts: int, manifold: Manifold, found: FoundContacts
):  # fmt: skip
    """Appends the contacts of a pair to the list `way`."""
    for k in range(contacts):
        count = found.count[world, way]
        if count == found.room:
            found.lost[world, way] = found.lost[world, way] + 1
        else:
            place = way * found.room + count
            found.shape0[world, place] = shape0
            found.shape1[world, place] = shape1
            found.normal[world, place] = manifold.normal[k]
            found.point[world, place] = manifold.point[k]
            found.gap[world, place] = manifold.gap[k]
            found.feature[world, place] = manifold.feature[k]
            found.count[world, way] = count + 1


@wp.kernel(**PART)
def place_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    scratch: CollisionScratch,
):
    """Places the shapes, and sorts them into the grid of worlds that have one."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    place_shapes(world, scratch_slot, topology, parameters, state, assets, scratch)
    if topology.grid_buckets > 0:
        near = near_distance(world, config, parameters)
        time = reach_time(world, config, topology, parameters)
        fill_world_grid(scratch_slot, near, time, topology, scratch, pack_grid(scratch, scratch_slot))


@wp.kernel(**PART)
def touch_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    scratch: CollisionScratch,
    # outputs
    found: FoundContacts,
):
    """Contacts of the pairs with a formula."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    manifold = pack_manifold(scratch, scratch_slot)
    grid = pack_grid(scratch, scratch_slot)
    near = near_distance(world, config, parameters)
    time = reach_time(world, config, topology, parameters)
    found.count[world, FORMULA] = 0
    found.lost[world, FORMULA] = 0
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if way_of(shape0, shape1, topology) == FORMULA:
                reach = reach_of(world, scratch_slot, shape0, shape1, near, time, parameters, scratch)
                if reach >= 0.0:
                    origin = pair_origin(scratch_slot, shape0, shape1, topology, scratch)
                    p = placed(shape0, world, origin, scratch_slot, topology, parameters, scratch)
                    q = placed(shape1, world, origin, scratch_slot, topology, parameters, scratch)
                    flip = swapped(p, q)
                    if flip == 1:
                        other = p
                        p = q
                        q = other
                    contacts = formula_contacts(p, q, reach, flip, assets, manifold)
                    add_found(world, FORMULA, shape0, shape1, contacts, manifold, found)


@wp.kernel(**PART)
def list_pairs(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    state: StateArrays,
    scratch: CollisionScratch,
    # outputs
    searches: Searches,
):
    """Lists the convex pairs whose normal has to be looked for."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    grid = pack_grid(scratch, scratch_slot)
    near = near_distance(world, config, parameters)
    time = reach_time(world, config, topology, parameters)
    count = int(0)
    lost = int(0)
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if way_of(shape0, shape1, topology) == SEARCHED:
                reach = reach_of(world, scratch_slot, shape0, shape1, near, time, parameters, scratch)
                if reach >= 0.0:
                    if count == searches.search.shape[1]:
                        lost += 1
                    else:
                        origin = pair_origin(scratch_slot, shape0, shape1, topology, scratch)
                        s = Search()
                        s.shape0 = shape0
                        s.shape1 = shape1
                        s.reach = reach
                        s.wanted = 1
                        s.p = placed(shape0, world, origin, scratch_slot, topology, parameters, scratch)
                        s.q = placed(shape1, world, origin, scratch_slot, topology, parameters, scratch)
                        s.flip = swapped(s.p, s.q)
                        if s.flip == 1:
                            other = s.p
                            s.p = s.q
                            s.q = other
                        searches.search[world, count] = s
                        count += 1
    searches.count[world] = count
    searches.lost[world] = lost


@wp.kernel(**PART)
def search_worlds(
    # inputs
    worlds: WorldRange,
    assets: Assets,
    state: StateArrays,
    # in and out
    searches: Searches,
):
    """The normals of all listed pairs."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    for k in range(searches.count[world]):
        p = searches.search[world, k].p
        q = searches.search[world, k].q
        if p.kind == CAPSULE and q.kind == CAPSULE:
            searches.axis[world, k] = capsule_axis(p, q)
        elif searches.search[world, k].wanted == 1 and (p.kind != SPHERE or q.kind != TRIANGLE):
            searches.axis[world, k] = separation_axis(p, q, searches.search[world, k].reach, assets)


@wp.func
def cut_search(
    world: int, k: int, flip: int, assets: Assets, searches: Searches, manifold: Manifold
) -> int:  # fmt: skip
    """Contacts of a pair whose normal is known."""
    s = searches.search[world, k]
    axis = searches.axis[world, k]
    if axis.separation - rounding(s.p) - rounding(s.q) >= s.reach:
        return 0
    return contact_manifold(s.p, s.q, axis, s.reach, flip, assets, manifold)


@wp.kernel(**PART)
def cut_pairs(
    # inputs
    worlds: WorldRange,
    assets: Assets,
    state: StateArrays,
    searches: Searches,
    scratch: CollisionScratch,
    # outputs
    found: FoundContacts,
):
    """Contacts of the convex pairs."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    manifold = pack_manifold(scratch, scratch_slot_of(world, worlds))
    found.count[world, SEARCHED] = 0
    found.lost[world, SEARCHED] = searches.lost[world]
    for k in range(searches.count[world]):
        contacts = cut_search(world, k, searches.search[world, k].flip, assets, searches, manifold)
        shape0 = searches.search[world, k].shape0
        shape1 = searches.search[world, k].shape1
        add_found(world, SEARCHED, shape0, shape1, contacts, manifold, found)


@wp.func
def first_list(world: int, found: FoundContacts) -> int:
    """The list whose next contact belongs to the earliest pair; -1 at the end of all."""
    best = int(-1)
    shape0 = int(0)
    shape1 = int(0)
    for way in range(found.count.shape[1]):
        passed = found.passed[world, way]
        if passed < found.count[world, way]:
            a = found.shape0[world, way * found.room + passed]
            b = found.shape1[world, way * found.room + passed]
            if best < 0 or a < shape0 or (a == shape0 and b < shape1):
                best = way
                shape0 = a
                shape1 = b
    return best


@wp.func
def take_pair(world: int, way: int, manifold: Manifold, found: FoundContacts) -> int:
    """Moves the contacts of a list's next pair to `manifold`; returns how many."""
    first = way * found.room + found.passed[world, way]
    end = way * found.room + found.count[world, way]
    contacts = int(0)
    while (
        first + contacts < end
        and found.shape0[world, first + contacts] == found.shape0[world, first]
        and found.shape1[world, first + contacts] == found.shape1[world, first]
    ):
        manifold.normal[contacts] = found.normal[world, first + contacts]
        manifold.point[contacts] = found.point[world, first + contacts]
        manifold.gap[contacts] = found.gap[world, first + contacts]
        manifold.feature[contacts] = found.feature[world, first + contacts]
        contacts += 1
    found.passed[world, way] = found.passed[world, way] + contacts
    return contacts


@wp.kernel(**PART)
def keep_worlds(
    # inputs
    worlds: WorldRange,
    topology: Topology,
    state: StateArrays,
    scratch: CollisionScratch,
    found: FoundContacts,
    # in and out
    contacts: ContactArrays,
):
    """The contacts of all pairs, in their order, warm-started from the last ones."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    manifold = pack_manifold(scratch, scratch_slot)
    cached = keep_last_contacts(world, scratch_slot, contacts, scratch)
    lost = int(0)
    for way in range(found.count.shape[1]):
        found.passed[world, way] = 0
        lost += found.lost[world, way]
    contacts.contact_overflow[world] = lost
    progress = ContactProgress()
    way = first_list(world, found)
    while way >= 0:
        place = way * found.room + found.passed[world, way]
        shape0 = found.shape0[world, place]
        shape1 = found.shape1[world, place]
        count = take_pair(world, way, manifold, found)
        progress.cursor = passed_contacts(scratch_slot, shape0, shape1, progress.cursor, cached, scratch)
        origin = pair_origin(scratch_slot, shape0, shape1, topology, scratch)
        progress.count = keep_pair(
            world, scratch_slot, shape0, shape1, count, origin, progress.count, cached, progress.cursor, topology,
            state, contacts, scratch,
        )  # fmt: skip
        for k in range(count):
            progress.deepest = wp.max(progress.deepest, -manifold.gap[k])
        way = first_list(world, found)
    contacts.contact_count[world] = progress.count
    contacts.penetration[world] = progress.deepest


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """All parts but those of triangles."""
    return [place_worlds, touch_worlds, list_pairs, search_worlds, cut_pairs, keep_worlds]
