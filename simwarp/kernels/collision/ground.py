"""Contacts of convex shapes with the triangles of height fields and meshes, as stages of collision (collide.py).

Triangles near a shape are listed; each is searched for a normal and cut; contacts that the surface as a whole does not
have are dropped; the others are thinned out and joined.
"""

import warp as wp

from simwarp.kernels.collision.broad import Grid, candidates
from simwarp.kernels.collision.collide import GROUND, add_found, clip_search, contact_method, contact_reach, find_axes
from simwarp.kernels.collision.contact_lists import (
    FoundContacts,
    ListState,
    Search,
    Searches,
    TriangleContact,
    TriangleContacts,
)
from simwarp.kernels.collision.placement import CollisionScratch, near_distance, pair_origin, placed, reach_time
from simwarp.kernels.collision.shape import HEIGHT_FIELD, SPHERE, Assets, Manifold, triangle_shape
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
    RawContacts,
    SurfaceContact,
    add_penetrating,
    add_raw,
    deepest_vertex,
    drop_internal_edge_contacts,
    facing_triangle,
    surface_contact,
    triangle_sphere,
    write_raw,
)
from simwarp.kernels.core.fields import Parameters
from simwarp.kernels.core.tables import StepConfig, Topology

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


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


@wp.func
def list_triangles(
    world: int, scratch_slot: int, config: StepConfig, topology: Topology, parameters: Parameters, assets: Assets,
    scratch: CollisionScratch, grid: Grid, raw: RawContacts, triangles: Searches,
):  # fmt: skip
    """Lists the triangles that convex shapes may touch, or have sunk below."""
    near = near_distance(world, config, parameters)
    time = reach_time(world, config, topology, parameters)
    triangles.list[0] = ListState()
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if contact_method(shape0, shape1, topology) == GROUND:
                reach = contact_reach(world, scratch_slot, shape0, shape1, near, time, parameters, scratch)
                if reach >= 0.0:
                    g = surface_of(world, scratch_slot, shape0, shape1, reach, topology, parameters, scratch)
                    count = gather(g, 0, raw.triangle, assets)
                    while count > 0:
                        list_batch(
                            world, scratch_slot, shape0, shape1, reach, count, g, raw.triangle, topology, parameters,
                            assets, scratch, triangles,
                        )  # fmt: skip
                        if count == TRIANGLE_BATCH:
                            count = gather(g, raw.triangle[count - 1] + 1, raw.triangle, assets)
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
            place = searches.list[0].count
            if place == searches.search.shape[0]:
                searches.list[0].lost += 1
            else:
                s = Search()
                s.shape0 = shape0
                s.shape1 = shape1
                s.reach = reach
                s.p = b
                s.q = triangle_shape(f.t.p0, f.t.p1, f.t.p2, g.margin)
                s.flip = 1
                s.wanted = f.wanted
                searches.search[place] = s
                searches.facing[place] = f
                searches.list[0].count = place + 1


@wp.func
def add_contact(search: int, sunk: int, c: SurfaceContact, contacts: TriangleContacts):
    """Appends a contact with a triangle."""
    count = contacts.list[0].count
    if count == contacts.contact.shape[0]:
        contacts.list[0].lost += 1
    else:
        added = TriangleContact()
        added.search = search
        added.sunk = sunk
        added.normal = c.normal
        added.point = c.point
        added.gap = c.gap
        added.feature = c.feature
        contacts.contact[count] = added
        contacts.list[0].count = count + 1


@wp.func
def search_triangles(world: int, assets: Assets, triangles: Searches):
    """The normals of shapes and listed triangles."""
    find_axes(assets, triangles)


@wp.func
def clip_triangle(k: int, assets: Assets, triangles: Searches, manifold: Manifold) -> int:
    """Contacts of a convex shape with a triangle, by itself; returns how many."""
    b = triangles.search[k].p
    contacts = int(0)
    if b.kind == SPHERE:
        t = triangles.facing[k].t
        margin = triangles.search[k].q.margin
        contacts = triangle_sphere(t, margin, b, triangles.search[k].reach, manifold)
    else:
        contacts = clip_search(k, 1, assets, triangles, manifold)
    return contacts


@wp.func
def clip_triangles(world: int, assets: Assets, triangles: Searches, manifold: Manifold, clipped: TriangleContacts):
    """Contacts of convex shapes with each triangle."""
    clipped.list[0] = ListState()
    for k in range(triangles.list[0].count):
        wanted = triangles.search[k].wanted
        contacts = int(0)
        if wanted == 1:
            contacts = clip_triangle(k, assets, triangles, manifold)
        sunk = triangles.facing[k].sunk
        overlap = float(0.0)
        for i in range(contacts):
            overlap = wp.min(overlap, manifold.gap[i])
            if sunk == 0:
                c = SurfaceContact()
                c.normal = manifold.normal[i]
                c.point = manifold.point[i]
                c.gap = manifold.gap[i]
                c.feature = manifold.feature[i]
                add_contact(k, 0, c, clipped)
        if sunk == 1 and (wanted == 0 or overlap < 0.0):
            add_contact(k, 1, SurfaceContact(), clipped)


@wp.func
def drop_invalid(
    world: int, scratch_slot: int, topology: Topology, parameters: Parameters, assets: Assets,
    scratch: CollisionScratch, triangles: Searches, manifold: Manifold, clipped: TriangleContacts,
    valid: TriangleContacts,
):  # fmt: skip
    """Those of them that the surface as a whole has (`surface_contact`)."""
    valid.list[0] = ListState()
    valid.list[0].lost = clipped.list[0].lost
    entry = int(0)
    while entry < clipped.list[0].count:
        k = clipped.contact[entry].search
        if clipped.contact[entry].sunk == 1:
            add_contact(k, 1, SurfaceContact(), valid)
            entry += 1
        else:
            entry = keep_valid(
                world, scratch_slot, k, entry, topology, parameters, assets, triangles, clipped, scratch, manifold,
                valid,
            )  # fmt: skip


@wp.func
def keep_valid(
    world: int, scratch_slot: int, k: int, first: int, topology: Topology, parameters: Parameters, assets: Assets,
    searches: Searches, clipped: TriangleContacts, scratch: CollisionScratch, manifold: Manifold,
    valid: TriangleContacts,
) -> int:  # fmt: skip
    """Those of the contacts with one triangle, from `first` on; returns where those with the next begin."""
    s = searches.search[k]
    g = surface_of(world, scratch_slot, s.shape0, s.shape1, s.reach, topology, parameters, scratch)
    t = searches.facing[k].t
    b = s.p
    size = core_radius(b, assets) + rounding(b)
    dropped = float(0.0)
    entry = int(first)
    while entry < clipped.list[0].count and clipped.contact[entry].search == k:
        manifold.normal[0] = clipped.contact[entry].normal
        manifold.point[0] = clipped.contact[entry].point
        manifold.gap[0] = clipped.contact[entry].gap
        manifold.feature[0] = clipped.contact[entry].feature
        c = surface_contact(0, g, t, size, assets, manifold)
        if c.kept == 1:
            add_contact(k, 0, c, valid)
        else:
            dropped = wp.max(dropped, -manifold.gap[0])
        entry += 1
    if dropped > 0.0 and searches.facing[k].height >= 0.0 and b.kind != SPHERE:
        for corner in range(4):
            c = deepest_vertex(corner, dropped, g.margin, t, b, assets)
            if c.kept == 1:
                add_contact(k, 0, c, valid)
    return entry


@wp.func
def join_triangles(
    world: int, scratch_slot: int, topology: Topology, parameters: Parameters, assets: Assets,
    scratch: CollisionScratch, triangles: Searches, manifold: Manifold, raw: RawContacts, valid: TriangleContacts,
    found: FoundContacts,
):  # fmt: skip
    """Contacts with whole surfaces from those with their triangles."""
    found.list[GROUND].lost = triangles.list[0].lost + valid.list[0].lost
    entry = int(0)
    while entry < valid.list[0].count:
        k = valid.contact[entry].search
        shape0 = triangles.search[k].shape0
        shape1 = triangles.search[k].shape1
        reach = triangles.search[k].reach
        b = triangles.search[k].p
        size = core_radius(b, assets) + rounding(b)
        joined = ContactAccumulator()
        same = bool(True)
        while same:
            c = valid.contact[entry]
            if c.sunk == 1:
                f = triangles.facing[k]
                joined = add_penetrating(joined, f.t, f.low, f.gap)
            else:
                joined.count = add_raw(joined.count, c.normal, c.point, c.gap, c.feature, size, raw)
            entry += 1
            same = entry < valid.list[0].count
            if same:
                k = valid.contact[entry].search
                same = triangles.search[k].shape0 == shape0 and triangles.search[k].shape1 == shape1
        g = surface_of(world, scratch_slot, shape0, shape1, reach, topology, parameters, scratch)
        joined.count = drop_internal_edge_contacts(joined.count, g, size, assets, raw)
        flip = wp.where(ground_of(shape0, shape1, topology) == shape1, 1, 0)
        contacts = write_raw(joined, flip, size, raw, manifold)
        add_found(GROUND, shape0, shape1, contacts, manifold, found)
