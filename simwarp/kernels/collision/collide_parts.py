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
from simwarp.kernels.collision.pair import facing_triangle
from simwarp.kernels.collision.placement import (
    CollisionScratch,
    fill_world_grid,
    may_touch,
    near_distance,
    pack_grid,
    pack_manifold,
    pack_raw,
    pair_origin,
    pair_reach,
    place_shapes,
    placed,
)
from simwarp.kernels.collision.search_lists import FoundContacts, GroundSearches, Search, Searches
from simwarp.kernels.collision.shape import (
    CAPSULE,
    HEIGHT_FIELD,
    SPHERE,
    TRIANGLE,
    Assets,
    Manifold,
    triangle_shape,
)
from simwarp.kernels.collision.support import core_radius, inner_point, rounding
from simwarp.kernels.collision.surfaces import (
    NEVER,
    TRIANGLE_BATCH,
    TriangleSurface,
    gather,
    is_triangle_surface,
    triangle_surface_of,
)
from simwarp.kernels.collision.triangles import (
    ContactAccumulator,
    SurfaceContact,
    add_penetrating,
    add_raw,
    deepest_vertex,
    drop_internal_edge_contacts,
    surface_contact,
    triangle_sphere,
    write_raw,
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
    world: int, scratch_slot: int, shape0: int, shape1: int, near: float, dt: float, parameters: Parameters,
    scratch: CollisionScratch,
) -> float:  # fmt: skip
    """What two shapes may be apart and still touch [m]; negative if they cannot come that near."""
    reach = pair_reach(scratch_slot, shape0, shape1, near, dt, scratch)
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


@wp.func
def ground_of(shape0: int, shape1: int, topology: Topology) -> int:
    """The one of a pair that consists of triangles."""
    return wp.where(is_triangle_surface(topology.shape_type[shape0]), shape0, shape1)


@wp.func
def surface_of(
    world: int, scratch_slot: int, shape0: int, shape1: int, reach: float, topology: Topology, parameters: Parameters,
    scratch: CollisionScratch,
) -> TriangleSurface:  # fmt: skip
    """The ground of a pair as its other shape sees it."""
    ground = ground_of(shape0, shape1, topology)
    convex = shape0 + shape1 - ground
    origin = pair_origin(scratch_slot, shape0, shape1, topology, scratch)
    a = placed(ground, world, origin, scratch_slot, topology, parameters, scratch)
    return triangle_surface_of(
        a, scratch.x[scratch_slot, ground] - origin, scratch.lower[scratch_slot, convex],
        scratch.upper[scratch_slot, convex], reach,
    )  # fmt: skip


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
        fill_world_grid(scratch_slot, near, config, topology, scratch, pack_grid(scratch, scratch_slot))


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
    found.count[world, FORMULA] = 0
    found.lost[world, FORMULA] = 0
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if way_of(shape0, shape1, topology) == FORMULA:
                reach = reach_of(world, scratch_slot, shape0, shape1, near, config.dt, parameters, scratch)
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
    count = int(0)
    lost = int(0)
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if way_of(shape0, shape1, topology) == SEARCHED:
                reach = reach_of(world, scratch_slot, shape0, shape1, near, config.dt, parameters, scratch)
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
def list_triangles(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    scratch: CollisionScratch,
    # outputs
    searches: Searches,
    ground: GroundSearches,
):
    """Lists the triangles that convex shapes may touch, or have sunk below."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    grid = pack_grid(scratch, scratch_slot)
    listed = pack_raw(scratch, scratch_slot).triangle
    near = near_distance(world, config, parameters)
    searches.count[world] = 0
    searches.lost[world] = 0
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if way_of(shape0, shape1, topology) == GROUND:
                reach = reach_of(world, scratch_slot, shape0, shape1, near, config.dt, parameters, scratch)
                if reach >= 0.0:
                    g = surface_of(world, scratch_slot, shape0, shape1, reach, topology, parameters, scratch)
                    count = gather(g, 0, listed, assets)
                    while count > 0:
                        list_batch(
                            world, scratch_slot, shape0, shape1, reach, count, g, listed, topology, parameters, assets,
                            scratch, searches, ground,
                        )  # fmt: skip
                        if count == TRIANGLE_BATCH:
                            count = gather(g, listed[count - 1] + 1, listed, assets)
                        else:
                            count = 0


@wp.func
def list_batch(
    world: int, scratch_slot: int, shape0: int, shape1: int, reach: float, count: int, g: TriangleSurface,
    listed: wp.array[int], topology: Topology, parameters: Parameters, assets: Assets, scratch: CollisionScratch,
    searches: Searches, ground: GroundSearches,
):  # fmt: skip
    """Appends those of the triangles of a batch that matter."""
    convex = shape0 + shape1 - ground_of(shape0, shape1, topology)
    origin = pair_origin(scratch_slot, shape0, shape1, topology, scratch)
    b = placed(convex, world, origin, scratch_slot, topology, parameters, scratch)
    middle = inner_point(b, assets)
    up = wp.vec3(g.rot[0, 2], g.rot[1, 2], g.rot[2, 2])
    for k in range(count):
        f = facing_triangle(g, listed[k], b, middle, up, reach, assets)
        through = f.sunk == 1 and g.kind == HEIGHT_FIELD  # it leaves along this normal, whatever it touches
        if through:
            f.wanted = 0
        if through or f.wanted == 1:
            place = searches.count[world]
            if place == searches.search.shape[1]:
                searches.lost[world] = searches.lost[world] + 1
            else:
                s = Search()
                s.shape0 = shape0
                s.shape1 = shape1
                s.reach = reach
                s.p = b
                s.q = triangle_shape(f.t.p0, f.t.p1, f.t.p2, g.margin)
                s.flip = 1
                s.wanted = f.wanted
                searches.search[world, place] = s
                ground.facing[world, place] = f
                searches.count[world] = place + 1


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
def add_entry(world: int, owner: int, sunk: int, c: SurfaceContact, ground: GroundSearches):
    """Appends what a surface takes from one triangle."""
    count = ground.count[world]
    if count == ground.owner.shape[1]:
        ground.lost[world] = ground.lost[world] + 1
    else:
        ground.owner[world, count] = owner
        ground.sunk[world, count] = sunk
        ground.normal[world, count] = c.normal
        ground.point[world, count] = c.point
        ground.gap[world, count] = c.gap
        ground.feature[world, count] = c.feature
        ground.count[world] = count + 1


@wp.kernel(**PART)
def cut_triangles(
    # inputs
    worlds: WorldRange,
    topology: Topology,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    searches: Searches,
    scratch: CollisionScratch,
    # in and out
    ground: GroundSearches,
):
    """Contacts with each triangle that the surface as a whole has (`take_contacts`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    manifold = pack_manifold(scratch, scratch_slot)
    ground.count[world] = 0
    ground.lost[world] = 0
    for k in range(searches.count[world]):
        contacts = int(0)
        if searches.search[world, k].wanted == 1:
            b = searches.search[world, k].p
            if b.kind == SPHERE:
                t = ground.facing[world, k].t
                margin = searches.search[world, k].q.margin
                contacts = triangle_sphere(t, margin, b, searches.search[world, k].reach, manifold)
            else:
                contacts = cut_search(world, k, 1, assets, searches, manifold)
        if ground.facing[world, k].sunk == 1:
            overlap = float(NEVER)
            for i in range(contacts):
                overlap = wp.min(overlap, manifold.gap[i])
            if overlap < 0.0 or searches.search[world, k].wanted == 0:
                add_entry(world, k, 1, SurfaceContact(), ground)
        else:
            take_triangle(
                world, scratch_slot, k, contacts, topology, parameters, assets, searches, scratch, manifold, ground
            )


@wp.func
def take_triangle(
    world: int, scratch_slot: int, k: int, contacts: int, topology: Topology, parameters: Parameters, assets: Assets,
    searches: Searches, scratch: CollisionScratch, manifold: Manifold, ground: GroundSearches,
):  # fmt: skip
    """What the surface takes of the contacts with a triangle (`add_contacts`)."""
    s = searches.search[world, k]
    g = surface_of(world, scratch_slot, s.shape0, s.shape1, s.reach, topology, parameters, scratch)
    t = ground.facing[world, k].t
    b = s.p
    size = core_radius(b, assets) + rounding(b)
    dropped = float(0.0)
    for i in range(contacts):
        c = surface_contact(i, g, t, size, assets, manifold)
        if c.taken == 1:
            add_entry(world, k, 0, c, ground)
        else:
            dropped = wp.max(dropped, -manifold.gap[i])
    if dropped > 0.0 and ground.facing[world, k].height >= 0.0 and b.kind != SPHERE:
        for corner in range(4):
            c = deepest_vertex(corner, dropped, g, t, b, assets)
            if c.taken == 1:
                add_entry(world, k, 0, c, ground)


@wp.kernel(**PART)
def join_triangles(
    # inputs
    worlds: WorldRange,
    topology: Topology,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    searches: Searches,
    ground: GroundSearches,
    scratch: CollisionScratch,
    # outputs
    found: FoundContacts,
):
    """Contacts with whole surfaces from those with their triangles."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    manifold = pack_manifold(scratch, scratch_slot)
    raw = pack_raw(scratch, scratch_slot)
    found.count[world, GROUND] = 0
    found.lost[world, GROUND] = searches.lost[world] + ground.lost[world]
    entry = int(0)
    while entry < ground.count[world]:
        k = ground.owner[world, entry]
        shape0 = searches.search[world, k].shape0
        shape1 = searches.search[world, k].shape1
        reach = searches.search[world, k].reach
        b = searches.search[world, k].p
        size = core_radius(b, assets) + rounding(b)
        joined = ContactAccumulator()
        same = bool(True)
        while same:
            if ground.sunk[world, entry] == 1:
                f = ground.facing[world, k]
                joined = add_penetrating(joined, f.t, f.low, f.gap)
            else:
                joined.count = add_raw(
                    joined.count, ground.normal[world, entry], ground.point[world, entry], ground.gap[world, entry],
                    ground.feature[world, entry], size, raw,
                )  # fmt: skip
            entry += 1
            same = entry < ground.count[world]
            if same:
                k = ground.owner[world, entry]
                same = searches.search[world, k].shape0 == shape0 and searches.search[world, k].shape1 == shape1
        g = surface_of(world, scratch_slot, shape0, shape1, reach, topology, parameters, scratch)
        joined.count = drop_internal_edge_contacts(joined.count, g, size, assets, raw)
        flip = wp.where(ground_of(shape0, shape1, topology) == shape1, 1, 0)
        contacts = write_raw(joined, flip, size, raw, manifold)
        add_found(world, GROUND, shape0, shape1, contacts, manifold, found)


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
    """All parts."""
    return [
        place_worlds, touch_worlds, list_pairs, list_triangles, search_worlds, cut_pairs, cut_triangles,
        join_triangles, keep_worlds,
    ]  # fmt: skip
