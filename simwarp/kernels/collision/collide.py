"""Collision of one world as stages: its shapes placed, pairs found and searched, contacts kept with their warm starts.

Pairs with a formula are written down at once. Others are listed, searched for a normal, and cut; those of triangles
(ground.py) are then put together, surface by surface. The last stage goes through the lists of contacts in the order
of the pairs, so that slots are deterministic and the cache of the last step is read in step with them. What finds no
room in a list counts as overflow of the contacts.
"""

import warp as wp

from simwarp.kernels.collision.broad import Grid, candidates
from simwarp.kernels.collision.contact_lists import FoundContact, FoundContacts, ListState, Search, Searches
from simwarp.kernels.collision.contact_slots import ContactProgress, keep_last_contacts, keep_pair, skip_contacts
from simwarp.kernels.collision.narrow import (
    axis_between,
    axis_contacts,
    can_meet,
    formula_contacts,
    has_formula,
    swapped,
)
from simwarp.kernels.collision.placement import (
    CollisionScratch,
    fill_world_grid,
    may_touch,
    near_distance,
    pair_origin,
    pair_reach,
    place_shapes,
    placed,
    reach_time,
    widen_to_faces,
)
from simwarp.kernels.collision.shape import MANIFOLD_CONTACTS, SPHERE, TRIANGLE, Assets, Manifold
from simwarp.kernels.collision.surfaces import is_triangle_surface
from simwarp.kernels.core.face_tables import has_face_code
from simwarp.kernels.core.fields import ContactArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, world_row

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

FORMULA = wp.constant(0)
SEARCHED = wp.constant(1)
GROUND = wp.constant(2)
FACES = wp.constant(3)  # of meshes, beside what the spheres of their nodes have
NEVER = wp.constant(-1)  # kinds of shapes without contacts


@wp.func
def has_formula_pairs(topology: Topology) -> bool:
    """Pairs whose contacts are written down."""
    return topology.formula_pairs > 0


@wp.func
def has_searched_pairs(topology: Topology) -> bool:
    """Convex pairs whose normal is looked for."""
    return topology.searched_pairs > 0


@wp.func
def has_ground_pairs(topology: Topology) -> bool:
    """Pairs of a convex shape and a height field or mesh."""
    return topology.ground_pairs > 0


@wp.func
def contact_method(shape0: int, shape1: int, topology: Topology) -> int:
    """How the contacts of a pair are found: by FORMULA, SEARCHED for, on the triangles of a GROUND, or NEVER."""
    kind0 = topology.shape_type[shape0]
    kind1 = topology.shape_type[shape1]
    if not can_meet(wp.min(kind0, kind1), wp.max(kind0, kind1)):
        return NEVER
    if is_triangle_surface(kind0) or is_triangle_surface(kind1):
        return GROUND
    if has_formula(wp.min(kind0, kind1), wp.max(kind0, kind1)):
        return FORMULA
    return SEARCHED


@wp.func
def contact_reach(
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
def add_found(way: int, shape0: int, shape1: int, contacts: int, manifold: Manifold, found: FoundContacts):
    """Appends the contacts of a pair to the list `way`."""
    for k in range(contacts):
        place = found.list[way].count
        if place == found.contact.shape[1]:
            found.list[way].lost += 1
        else:
            c = FoundContact()
            c.shape0 = shape0
            c.shape1 = shape1
            c.normal = manifold.normal[k]
            c.point = manifold.point[k]
            c.gap = manifold.gap[k]
            c.feature = manifold.feature[k]
            found.contact[way, place] = c
            found.list[way].count = place + 1


@wp.func
def place_world(
    world: int, scratch_slot: int, config: StepConfig, topology: Topology, parameters: Parameters, assets: Assets,
    state: StateArrays, scratch: CollisionScratch, grid: Grid, found: FoundContacts,
):  # fmt: skip
    """Places the shapes, and sorts them into the grid of worlds that have one; empties the lists of contacts."""
    place_shapes(world, scratch_slot, topology, parameters, state, assets, scratch)
    if has_face_code():
        if topology.face_count > 0:
            widen_to_faces(world, scratch_slot, topology, parameters, state, scratch)
    if topology.grid_buckets > 0:
        near = near_distance(world, config, parameters)
        time = reach_time(world, config, topology, parameters)
        fill_world_grid(scratch_slot, near, time, topology, scratch, grid)
    for way in range(found.list.shape[0]):
        found.list[way] = ListState()


@wp.func
def collide_simple_pairs(
    world: int, scratch_slot: int, config: StepConfig, topology: Topology, parameters: Parameters, assets: Assets,
    scratch: CollisionScratch, grid: Grid, manifold: Manifold, found: FoundContacts,
):  # fmt: skip
    """Contacts of the pairs with a formula."""
    near = near_distance(world, config, parameters)
    time = reach_time(world, config, topology, parameters)
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if contact_method(shape0, shape1, topology) == FORMULA:
                reach = contact_reach(world, scratch_slot, shape0, shape1, near, time, parameters, scratch)
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
                    add_found(FORMULA, shape0, shape1, contacts, manifold, found)


@wp.func
def list_pairs(
    world: int, scratch_slot: int, config: StepConfig, topology: Topology, parameters: Parameters,
    scratch: CollisionScratch, grid: Grid, pairs: Searches,
):  # fmt: skip
    """Lists the convex pairs whose normal has to be looked for."""
    near = near_distance(world, config, parameters)
    time = reach_time(world, config, topology, parameters)
    count = int(0)
    lost = int(0)
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            if contact_method(shape0, shape1, topology) == SEARCHED:
                reach = contact_reach(world, scratch_slot, shape0, shape1, near, time, parameters, scratch)
                if reach >= 0.0:
                    if count == pairs.search.shape[0]:
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
                        pairs.search[count] = s
                        count += 1
    pairs.list[0].count = count
    pairs.list[0].lost = lost


@wp.func
def find_axes(assets: Assets, searches: Searches):
    """The normals of all listed pairs; spheres and triangles have a formula."""
    for k in range(searches.list[0].count):
        p = searches.search[k].p
        q = searches.search[k].q
        if searches.search[k].wanted == 1 and (p.kind != SPHERE or q.kind != TRIANGLE):
            searches.axis[k] = axis_between(p, q, searches.search[k].reach, assets)


@wp.func
def search_pairs(world: int, assets: Assets, pairs: Searches):
    """The normals of the listed convex pairs."""
    find_axes(assets, pairs)


@wp.func
def clip_search(k: int, flip: int, assets: Assets, searches: Searches, manifold: Manifold) -> int:
    """Contacts of a pair whose normal is known."""
    s = searches.search[k]
    return axis_contacts(s.p, s.q, searches.axis[k], s.reach, flip, assets, manifold)


@wp.func
def clip_pairs(world: int, assets: Assets, pairs: Searches, manifold: Manifold, found: FoundContacts):
    """Contacts of the pairs that were searched."""
    found.list[SEARCHED].lost = pairs.list[0].lost
    for k in range(pairs.list[0].count):
        contacts = clip_search(k, pairs.search[k].flip, assets, pairs, manifold)
        add_found(SEARCHED, pairs.search[k].shape0, pairs.search[k].shape1, contacts, manifold, found)


@wp.func
def first_list(found: FoundContacts) -> int:
    """The list whose next contact belongs to the earliest pair; -1 at the end of all."""
    best = int(-1)
    shape0 = int(0)
    shape1 = int(0)
    for way in range(found.list.shape[0]):
        passed = found.list[way].passed
        if passed < found.list[way].count:
            a = found.contact[way, passed].shape0
            b = found.contact[way, passed].shape1
            if best < 0 or a < shape0 or (a == shape0 and b < shape1):
                best = way
                shape0 = a
                shape1 = b
    return best


@wp.func
def next_face(way: int, found: FoundContacts) -> int:
    """The face of a mesh that a list's next contact is on, -1: on none."""
    face = int(-1)
    if has_face_code():
        if way == FACES:
            face = found.face[found.list[way].passed]
    return face


@wp.func
def next_face_contacts(face: int, manifold: Manifold, found: FoundContacts) -> int:
    """`next_pair` of the contacts on one face."""
    first = found.list[FACES].passed
    shape0 = found.contact[FACES, first].shape0
    shape1 = found.contact[FACES, first].shape1
    contacts = int(0)
    same = bool(True)
    while same:
        c = found.contact[FACES, first + contacts]
        manifold.normal[contacts] = c.normal
        manifold.point[contacts] = c.point
        manifold.gap[contacts] = c.gap
        manifold.feature[contacts] = c.feature
        manifold.weights[contacts] = found.weights[first + contacts]
        contacts += 1
        same = contacts < MANIFOLD_CONTACTS and first + contacts < found.list[FACES].count
        if same:
            c = found.contact[FACES, first + contacts]
            same = c.shape0 == shape0 and c.shape1 == shape1 and found.face[first + contacts] == face
    found.list[FACES].passed = first + contacts
    return contacts


@wp.func
def next_pair(way: int, manifold: Manifold, found: FoundContacts) -> int:
    """Moves the contacts of a list's next pair to `manifold`; returns how many."""
    first = found.list[way].passed
    end = found.list[way].count
    shape0 = found.contact[way, first].shape0
    shape1 = found.contact[way, first].shape1
    contacts = int(0)
    while (
        first + contacts < end
        and found.contact[way, first + contacts].shape0 == shape0
        and found.contact[way, first + contacts].shape1 == shape1
    ):
        manifold.normal[contacts] = found.contact[way, first + contacts].normal
        manifold.point[contacts] = found.contact[way, first + contacts].point
        manifold.gap[contacts] = found.contact[way, first + contacts].gap
        manifold.feature[contacts] = found.contact[way, first + contacts].feature
        contacts += 1
    found.list[way].passed = first + contacts
    return contacts


@wp.func
def keep_contacts(
    world: int, scratch_slot: int, topology: Topology, state: StateArrays, contacts: ContactArrays,
    scratch: CollisionScratch, manifold: Manifold, found: FoundContacts,
):  # fmt: skip
    """The contacts of all pairs, in their order, warm-started from the last ones."""
    cached = keep_last_contacts(world, scratch_slot, topology, contacts, scratch)
    lost = int(0)
    for way in range(found.list.shape[0]):
        lost += found.list[way].lost
    contacts.contact_overflow[world] = lost
    progress = ContactProgress()
    way = first_list(found)
    while way >= 0:
        shape0 = found.contact[way, found.list[way].passed].shape0
        shape1 = found.contact[way, found.list[way].passed].shape1
        face = next_face(way, found)
        count = int(0)
        if face >= 0:
            count = next_face_contacts(face, manifold, found)
        else:
            count = next_pair(way, manifold, found)
        progress.cursor = skip_contacts(scratch_slot, shape0, shape1, progress.cursor, cached, scratch)
        origin = pair_origin(scratch_slot, shape0, shape1, topology, scratch)
        progress.count = keep_pair(
            world, scratch_slot, shape0, shape1, face, count, origin, progress.count, cached, progress.cursor,
            topology, state, contacts, scratch,
        )  # fmt: skip
        for k in range(count):
            progress.deepest = wp.max(progress.deepest, -manifold.gap[k])
        way = first_list(found)
    contacts.contact_count[world] = progress.count
    contacts.penetration[world] = progress.deepest
