"""Contacts of convex shapes with the triangles of height fields and meshes, in several kernels (collide_parts.py).

Triangles near a shape are listed; each is searched for a normal and cut; the surface takes what it has as a whole; what
it has taken is thinned out and joined.
"""

import warp as wp

from simwarp.kernels.collision.broad import candidates
from simwarp.kernels.collision.collide_parts import (
    GROUND,
    MODULE_OPTIONS,
    NON_FINITE,
    PART,
    add_found,
    cut_search,
    reach_of,
    way_of,
)
from simwarp.kernels.collision.pair import facing_triangle
from simwarp.kernels.collision.placement import (
    CollisionScratch,
    near_distance,
    pack_grid,
    pack_manifold,
    pack_raw,
    pair_origin,
    placed,
    reach_time,
)
from simwarp.kernels.collision.search_lists import FoundContacts, Search, Searches, TriangleContacts
from simwarp.kernels.collision.shape import (
    HEIGHT_FIELD,
    SPHERE,
    Assets,
    triangle_shape,
)
from simwarp.kernels.collision.support import core_radius, inner_point, rounding
from simwarp.kernels.collision.surfaces import (
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
from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of

wp.set_module_options(MODULE_OPTIONS)


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
):
    """Lists the triangles that convex shapes may touch, or have sunk below."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    grid = pack_grid(scratch, scratch_slot)
    listed = pack_raw(scratch, scratch_slot).triangle
    near = near_distance(world, config, parameters)
    time = reach_time(world, config, topology, parameters)
    searches.count[world] = 0
    searches.lost[world] = 0
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if way_of(shape0, shape1, topology) == GROUND:
                reach = reach_of(world, scratch_slot, shape0, shape1, near, time, parameters, scratch)
                if reach >= 0.0:
                    g = surface_of(world, scratch_slot, shape0, shape1, reach, topology, parameters, scratch)
                    count = gather(g, 0, listed, assets)
                    while count > 0:
                        list_batch(
                            world, scratch_slot, shape0, shape1, reach, count, g, listed, topology, parameters, assets,
                            scratch, searches,
                        )  # fmt: skip
                        if count == TRIANGLE_BATCH:
                            count = gather(g, listed[count - 1] + 1, listed, assets)
                        else:
                            count = 0


@wp.func
def list_batch(
    world: int, scratch_slot: int, shape0: int, shape1: int, reach: float, count: int, g: TriangleSurface,
    listed: wp.array[int], topology: Topology, parameters: Parameters, assets: Assets, scratch: CollisionScratch,
    searches: Searches,
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
                searches.facing[world, place] = f
                searches.count[world] = place + 1


@wp.func
def add_entry(world: int, owner: int, sunk: int, c: SurfaceContact, entries: TriangleContacts):
    """Appends a contact with a triangle."""
    count = entries.count[world]
    if count == entries.owner.shape[1]:
        entries.lost[world] = entries.lost[world] + 1
    else:
        entries.owner[world, count] = owner
        entries.sunk[world, count] = sunk
        entries.normal[world, count] = c.normal
        entries.point[world, count] = c.point
        entries.gap[world, count] = c.gap
        entries.feature[world, count] = c.feature
        entries.count[world] = count + 1


@wp.kernel(**PART)
def cut_triangles(
    # inputs
    worlds: WorldRange,
    assets: Assets,
    state: StateArrays,
    searches: Searches,
    scratch: CollisionScratch,
    # outputs
    cut: TriangleContacts,
):
    """Contacts of convex shapes with each triangle."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    manifold = pack_manifold(scratch, scratch_slot_of(world, worlds))
    cut.count[world] = 0
    cut.lost[world] = 0
    for k in range(searches.count[world]):
        wanted = searches.search[world, k].wanted
        contacts = int(0)
        if wanted == 1:
            b = searches.search[world, k].p
            if b.kind == SPHERE:
                t = searches.facing[world, k].t
                margin = searches.search[world, k].q.margin
                contacts = triangle_sphere(t, margin, b, searches.search[world, k].reach, manifold)
            else:
                contacts = cut_search(world, k, 1, assets, searches, manifold)
        sunk = searches.facing[world, k].sunk
        overlap = float(0.0)
        for i in range(contacts):
            overlap = wp.min(overlap, manifold.gap[i])
            if sunk == 0:
                c = SurfaceContact()
                c.normal = manifold.normal[i]
                c.point = manifold.point[i]
                c.gap = manifold.gap[i]
                c.feature = manifold.feature[i]
                add_entry(world, k, 0, c, cut)
        if sunk == 1 and (wanted == 0 or overlap < 0.0):
            add_entry(world, k, 1, SurfaceContact(), cut)


@wp.kernel(**PART)
def take_triangles(
    # inputs
    worlds: WorldRange,
    topology: Topology,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    searches: Searches,
    cut: TriangleContacts,
    scratch: CollisionScratch,
    # outputs
    taken: TriangleContacts,
):
    """Those of them that the surface as a whole has (`add_contacts`)."""
    world = worlds.first + wp.tid()
    if (state.world_status[world] & NON_FINITE) != 0:
        return
    scratch_slot = scratch_slot_of(world, worlds)
    taken.count[world] = 0
    taken.lost[world] = cut.lost[world]
    entry = int(0)
    while entry < cut.count[world]:
        k = cut.owner[world, entry]
        if cut.sunk[world, entry] == 1:
            add_entry(world, k, 1, SurfaceContact(), taken)
            entry += 1
        else:
            entry = take_triangle(
                world, scratch_slot, k, entry, topology, parameters, assets, searches, cut, scratch, taken
            )


@wp.func
def take_triangle(
    world: int, scratch_slot: int, k: int, first: int, topology: Topology, parameters: Parameters, assets: Assets,
    searches: Searches, cut: TriangleContacts, scratch: CollisionScratch, taken: TriangleContacts,
) -> int:  # fmt: skip
    """Takes the contacts with one triangle, from `first` on; returns where those with the next begin."""
    manifold = pack_manifold(scratch, scratch_slot)
    s = searches.search[world, k]
    g = surface_of(world, scratch_slot, s.shape0, s.shape1, s.reach, topology, parameters, scratch)
    t = searches.facing[world, k].t
    b = s.p
    size = core_radius(b, assets) + rounding(b)
    dropped = float(0.0)
    entry = int(first)
    while entry < cut.count[world] and cut.owner[world, entry] == k:
        manifold.normal[0] = cut.normal[world, entry]
        manifold.point[0] = cut.point[world, entry]
        manifold.gap[0] = cut.gap[world, entry]
        manifold.feature[0] = cut.feature[world, entry]
        c = surface_contact(0, g, t, size, assets, manifold)
        if c.taken == 1:
            add_entry(world, k, 0, c, taken)
        else:
            dropped = wp.max(dropped, -manifold.gap[0])
        entry += 1
    if dropped > 0.0 and searches.facing[world, k].height >= 0.0 and b.kind != SPHERE:
        for corner in range(4):
            c = deepest_vertex(corner, dropped, g, t, b, assets)
            if c.taken == 1:
                add_entry(world, k, 0, c, taken)
    return entry


@wp.kernel(**PART)
def join_triangles(
    # inputs
    worlds: WorldRange,
    topology: Topology,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    searches: Searches,
    taken: TriangleContacts,
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
    found.lost[world, GROUND] = searches.lost[world] + taken.lost[world]
    entry = int(0)
    while entry < taken.count[world]:
        k = taken.owner[world, entry]
        shape0 = searches.search[world, k].shape0
        shape1 = searches.search[world, k].shape1
        reach = searches.search[world, k].reach
        b = searches.search[world, k].p
        size = core_radius(b, assets) + rounding(b)
        joined = ContactAccumulator()
        same = bool(True)
        while same:
            if taken.sunk[world, entry] == 1:
                f = searches.facing[world, k]
                joined = add_penetrating(joined, f.t, f.low, f.gap)
            else:
                joined.count = add_raw(
                    joined.count, taken.normal[world, entry], taken.point[world, entry], taken.gap[world, entry],
                    taken.feature[world, entry], size, raw,
                )  # fmt: skip
            entry += 1
            same = entry < taken.count[world]
            if same:
                k = taken.owner[world, entry]
                same = searches.search[world, k].shape0 == shape0 and searches.search[world, k].shape1 == shape1
        g = surface_of(world, scratch_slot, shape0, shape1, reach, topology, parameters, scratch)
        joined.count = drop_internal_edge_contacts(joined.count, g, size, assets, raw)
        flip = wp.where(ground_of(shape0, shape1, topology) == shape1, 1, 0)
        contacts = write_raw(joined, flip, size, raw, manifold)
        add_found(world, GROUND, shape0, shape1, contacts, manifold, found)


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """All parts of collision that only triangles need."""
    return [list_triangles, cut_triangles, take_triangles, join_triangles]
