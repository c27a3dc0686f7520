"""Contacts of convex shapes with the faces of meshes, as stages of collision (collide.py).

A face is a triangle between nodes, as thick as the spheres of these. Near a shape it is listed, searched and cut as a
triangle of the ground is (ground.py); contacts that the surface as a whole does not have are dropped, and those at its
corners, which the spheres have. What remains lies on an edge, which counts once for both its faces, or inside. Contacts
of these spheres are dropped where their normal leans over an edge: what slides over a flat surface meets no bumps.
"""

import warp as wp

from simwarp.kernels.collision.broad import Grid, candidates
from simwarp.kernels.collision.collide import FACES, FORMULA, SEARCHED, contact_reach
from simwarp.kernels.collision.contact_lists import FoundContact, FoundContacts, ListState, Search, Searches
from simwarp.kernels.collision.ground import clip_triangle
from simwarp.kernels.collision.placement import CollisionScratch, near_distance, pair_origin, placed, reach_time
from simwarp.kernels.collision.shape import (
    MANIFOLD_CONTACTS,
    PLANE,
    SPHERE,
    SPROCKET,
    Assets,
    Manifold,
    triangle_shape,
)
from simwarp.kernels.collision.support import core_radius, inner_point, rounding, safe_direction
from simwarp.kernels.collision.surfaces import is_triangle_surface
from simwarp.kernels.collision.triangles import (
    SurfaceContact,
    Triangle,
    corner_of,
    deepest_vertex,
    edge_contact,
    face_contact,
    feature_id,
    is_along_face,
    is_valid_contact_normal,
    seen_from,
)
from simwarp.kernels.core.face_tables import ACROSS, EDGE, OWNER, TWO_SIDED, face_point
from simwarp.kernels.core.fields import Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology
from simwarp.kernels.core.vector_math import to_float

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

AT_CORNER = wp.constant(1.0e-3)
"""Of a share: contacts this near to a corner are those of its sphere; this near to an edge they are on it."""
SAME_PLACE = wp.constant(1.0e-2)
"""Of an edge: contacts on it that are nearer to each other are one, if the square of the difference of their normals is
less than this too."""
OVER_EDGE = wp.constant(5.0e-2)
"""Sine of the angle by which the normal of a node's contact may lean over an edge that begins there: of a flat surface
it stands upright, and what deforms is never quite flat."""


@wp.func
def touches_faces(kind: int) -> bool:
    """True if a shape touches faces: planes, height fields, meshes that do not deform and what meets spheres only touch
    nodes alone.
    """
    return kind != PLANE and not is_triangle_surface(kind) and kind < SPROCKET


@wp.func
def has_face_pair(shape0: int, shape1: int, topology: Topology) -> bool:
    """True if one of two shapes stands for faces that the other touches."""
    faces0 = topology.face_start[shape0 + 1] - topology.face_start[shape0]
    faces1 = topology.face_start[shape1 + 1] - topology.face_start[shape1]
    return (faces0 > 0 and touches_faces(topology.shape_type[shape1])) or (
        faces1 > 0 and touches_faces(topology.shape_type[shape0])
    )


@wp.func
def face_triangle(
    face: int, flipped: int, world: int, origin: wp.vec3d, topology: Topology, state: StateArrays
) -> Triangle:
    """A face in the pair's frame, seen from its other side where it is `flipped`; its index tells both."""
    t = Triangle()
    t.index = 2 * face + flipped
    t.p0 = to_float(face_point(topology.face[face, 0], world, topology, state) - origin)
    t.p1 = to_float(face_point(topology.face[face, 1 + flipped], world, topology, state) - origin)
    t.p2 = to_float(face_point(topology.face[face, 2 - flipped], world, topology, state) - origin)
    t.normal = safe_direction(wp.cross(t.p1 - t.p0, t.p2 - t.p0), wp.vec3(0.0, 0.0, 1.0))
    return t


@wp.func
def edge_of(edge: int, flipped: int) -> int:
    """The face's own number of an edge of its triangle."""
    return wp.where(flipped == 1, 2 - edge, edge)


@wp.func
def normals_across(
    t: Triangle, world: int, origin: wp.vec3d, topology: Topology, state: StateArrays
) -> wp.mat33:  # fmt: skip
    """Normals across the three edges of a face, as columns; zero at a border."""
    face = t.index // 2
    flipped = t.index % 2
    others = wp.mat33()
    for k in range(3):
        point = topology.face[face, ACROSS + edge_of(k, flipped)]
        if point >= 0:
            beyond = to_float(face_point(point, world, topology, state) - origin)
            a = corner_of(t, (k + 1) % 3)
            n = safe_direction(wp.cross(corner_of(t, k) - a, beyond - a), wp.vec3())
            for i in range(3):
                others[i, k] = n[i]
    return others


@wp.func
def list_faces(
    world: int, scratch_slot: int, config: StepConfig, topology: Topology, parameters: Parameters, assets: Assets,
    state: StateArrays, scratch: CollisionScratch, grid: Grid, triangles: Searches,
):  # fmt: skip
    """Lists the faces that convex shapes may touch."""
    near = near_distance(world, config, parameters)
    time = reach_time(world, config, topology, parameters)
    triangles.list[0] = ListState()
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if has_face_pair(shape0, shape1, topology):
                reach = contact_reach(world, scratch_slot, shape0, shape1, near, time, parameters, scratch)
                if reach >= 0.0:
                    for side in range(2):
                        owner = wp.where(side == 0, shape0, shape1)
                        if touches_faces(topology.shape_type[shape0 + shape1 - owner]):
                            list_owned_faces(
                                world, scratch_slot, shape0, shape1, owner, reach, topology, parameters, assets,
                                state, scratch, triangles,
                            )  # fmt: skip


@wp.func
def list_owned_faces(
    world: int, scratch_slot: int, shape0: int, shape1: int, owner: int, reach: float, topology: Topology,
    parameters: Parameters, assets: Assets, state: StateArrays, scratch: CollisionScratch, searches: Searches,
):  # fmt: skip
    """Appends the faces of one sphere that the other shape of its pair may touch."""
    convex = shape0 + shape1 - owner
    origin = pair_origin(scratch_slot, shape0, shape1, topology, scratch)
    b = placed(convex, world, origin, scratch_slot, topology, parameters, scratch)
    margin = rounding(placed(owner, world, origin, scratch_slot, topology, parameters, scratch))
    lower = b.x + scratch.lower[scratch_slot, convex]
    upper = b.x + scratch.upper[scratch_slot, convex]
    middle = inner_point(b, assets)
    for face in range(topology.face_start[owner], topology.face_start[owner + 1]):
        t = face_triangle(face, 0, world, origin, topology, state)
        low = wp.min(t.p0, wp.min(t.p1, t.p2))
        high = wp.max(t.p0, wp.max(t.p1, t.p2))
        if wp.max(wp.max(low - upper), wp.max(lower - high)) < reach + margin:
            if topology.face[face, TWO_SIDED] == 1 and wp.dot(t.normal, middle - t.p0) < 0.0:
                t = face_triangle(face, 1, world, origin, topology, state)
            f = seen_from(t, t.normal, margin, b, middle, reach, assets)
            if f.wanted == 1:
                place = searches.list[0].count
                if place == searches.search.shape[0]:
                    searches.list[0].lost += 1
                else:
                    s = Search()
                    s.shape0 = shape0
                    s.shape1 = shape1
                    s.reach = reach
                    s.p = b
                    s.q = triangle_shape(t.p0, t.p1, t.p2, margin)
                    s.flip = 1
                    s.wanted = 1
                    searches.search[place] = s
                    searches.facing[place] = f
                    searches.list[0].count = place + 1


@wp.func
def corner_shares(t: Triangle, p: wp.vec3) -> wp.vec3:
    """Shares of a triangle's corners that a point of it has; of the nearest along an edge where it is outside."""
    e = t.p1 - t.p0
    f = t.p2 - t.p0
    d = p - t.p0
    n = wp.cross(e, f)
    size = wp.max(wp.length_sq(n), 1.0e-30)
    b = wp.max(wp.dot(wp.cross(d, f), n) / size, 0.0)
    c = wp.max(wp.dot(wp.cross(e, d), n) / size, 0.0)
    a = wp.max(1.0 - b - c, 0.0)
    return wp.vec3(a, b, c) / (a + b + c)


@wp.func
def share_of(point: int, face: int, shares: wp.vec3, topology: Topology) -> float:
    """The share of one point of a face."""
    share = float(0.0)
    for k in range(3):
        if topology.face[face, k] == point:
            share = shares[k]
    return share


@wp.func
def has_same(
    shape: int, face: int, edge: int, shares: wp.vec3, normal: wp.vec3, topology: Topology, found: FoundContacts
) -> bool:
    """True if the list has a contact of a shape at a place on an edge of a face already, as one of the face across."""
    number = topology.face[face, EDGE + edge]
    end = topology.face[face, edge]
    at = share_of(end, face, shares, topology)
    for back in range(found.list[FACES].count):
        place = found.list[FACES].count - 1 - back
        if found.edge[place] == number:
            other = found.contact[FACES, place]
            if other.shape0 == shape or other.shape1 == shape:
                n = other.normal
                if wp.dot(n, normal) < 0.0:
                    n = -n
                apart = wp.abs(share_of(end, found.face[place], found.weights[place], topology) - at)
                if apart < SAME_PLACE and wp.length_sq(n - normal) < SAME_PLACE:
                    return True
    return False


@wp.func
def add_on_face(
    k: int, c: SurfaceContact, kept: int, topology: Topology, searches: Searches, found: FoundContacts
) -> int:  # fmt: skip
    """Appends a contact with a face unless a sphere or another face has it; returns how many the face has then."""
    s = searches.search[k]
    t = searches.facing[k].t
    face = t.index // 2
    flipped = t.index % 2
    owner = topology.face[face, OWNER]
    shares = corner_shares(t, c.point - s.q.margin * c.normal)
    edge = int(-1)
    for corner in range(3):
        if shares[corner] < AT_CORNER:
            edge = edge_of((corner + 1) % 3, flipped)
    if flipped == 1:
        shares = wp.vec3(shares[0], shares[2], shares[1])
    for corner in range(3):
        if shares[corner] > 1.0 - AT_CORNER and topology.face_point[topology.face[face, corner], 1] >= 0:
            return kept
    if edge >= 0:
        if has_same(s.shape0 + s.shape1 - owner, face, edge, shares, c.normal, topology, found):
            return kept
        edge = topology.face[face, EDGE + edge]
    place = found.list[FACES].count
    if place == found.face.shape[0]:
        found.list[FACES].lost += 1
        return kept
    added = FoundContact()
    added.shape0 = s.shape0
    added.shape1 = s.shape1
    added.normal = c.normal
    added.point = c.point
    if s.shape0 != owner:
        added.normal = -c.normal
        added.point = c.point + c.gap * c.normal
    added.gap = c.gap
    added.feature = c.feature
    found.contact[FACES, place] = added
    found.face[place] = face
    found.edge[place] = edge
    found.weights[place] = shares
    found.list[FACES].count = place + 1
    return kept + 1


@wp.func
def leans_over_edge(c: FoundContact, k: int, topology: Topology, searches: Searches) -> bool:
    """True if a contact of a node's sphere leans over an edge of a listed face that begins at the node."""
    s = searches.search[k]
    t = searches.facing[k].t
    face = t.index // 2
    flipped = t.index % 2
    convex = s.shape0 + s.shape1 - topology.face[face, OWNER]
    sphere = c.shape0
    n = c.normal
    if convex == c.shape0:
        sphere = c.shape1
        n = -n
    elif convex != c.shape1:
        return False
    for corner in range(3):
        own = corner
        if flipped == 1 and corner > 0:
            own = 3 - corner
        if topology.face_point[topology.face[face, own], 1] == sphere:
            a = corner_of(t, corner)
            for side in range(2):
                e = corner_of(t, (corner + 1 + side) % 3) - a
                if wp.dot(n, e) > OVER_EDGE * wp.length(e):
                    return True
    return False


@wp.func
def drop_leaning(way: int, topology: Topology, searches: Searches, found: FoundContacts):
    """Takes those contacts of nodes out of a list that the surface as a whole does not have: its normals at a node lean
    away from all edges there.
    """
    kept = int(0)
    for place in range(found.list[way].count):
        c = found.contact[way, place]
        leans = bool(False)
        for k in range(searches.list[0].count):
            if leans_over_edge(c, k, topology, searches):
                leans = True
        if not leans:
            if kept < place:
                found.contact[way, kept] = c
            kept += 1
    found.list[way].count = kept


@wp.func
def clip_faces(
    world: int, scratch_slot: int, topology: Topology, assets: Assets, state: StateArrays, scratch: CollisionScratch,
    triangles: Searches, manifold: Manifold, found: FoundContacts,
):  # fmt: skip
    """Contacts of convex shapes with faces."""
    found.list[FACES].lost = triangles.list[0].lost
    for k in range(triangles.list[0].count):
        contacts = clip_triangle(k, assets, triangles, manifold)
        if contacts > 0:
            keep_on_face(world, scratch_slot, k, contacts, topology, assets, state, scratch, triangles, manifold, found)
    for way in range(2):
        drop_leaning(wp.where(way == 0, FORMULA, SEARCHED), topology, triangles, found)


@wp.func
def keep_on_face(
    world: int, scratch_slot: int, k: int, contacts: int, topology: Topology, assets: Assets, state: StateArrays,
    scratch: CollisionScratch, searches: Searches, manifold: Manifold, found: FoundContacts,
):  # fmt: skip
    """Those of the contacts with one face that the surface has; of a shape that has sunk, that by which it leaves."""
    s = searches.search[k]
    f = searches.facing[k]
    b = s.p
    margin = s.q.margin
    size = core_radius(b, assets) + rounding(b)
    origin = pair_origin(scratch_slot, s.shape0, s.shape1, topology, scratch)
    others = normals_across(f.t, world, origin, topology, state)
    kept = int(0)
    dropped = float(0.0)
    overlap = float(0.0)
    for i in range(contacts):
        overlap = wp.min(overlap, manifold.gap[i])
        if f.sunk == 0:
            c = SurfaceContact()
            n = manifold.normal[i]
            if is_along_face(i, f.t, manifold):
                c = face_contact(i, margin, f.t, manifold)
            elif is_valid_contact_normal(f.t, others, n, manifold.point[i] - margin * n, size):
                c = edge_contact(i, f.t, manifold)
            if c.kept == 1:
                kept = add_on_face(k, c, kept, topology, searches, found)
            else:
                dropped = wp.max(dropped, -manifold.gap[i])
    if f.sunk == 1 and overlap < 0.0:
        c = SurfaceContact()
        c.normal = f.t.normal
        c.point = f.low - f.gap * f.t.normal
        c.gap = f.gap
        c.feature = feature_id(f.t.index, 8191)
        kept = add_on_face(k, c, kept, topology, searches, found)
    if dropped > 0.0 and f.height >= 0.0 and b.kind != SPHERE:
        for corner in range(4):
            c = deepest_vertex(corner, dropped, margin, f.t, b, assets)
            if c.kept == 1 and kept < MANIFOLD_CONTACTS:
                kept = add_on_face(k, c, kept, topology, searches, found)
