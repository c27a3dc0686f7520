"""Collision of one world: places its shapes, goes through the pairs, keeps the contacts and their warm starts.

Contacts come in the order of the pairs of shapes, so that slots are deterministic and the cache of the last step is
read in step with them.
"""

import warp as wp

from simwarp.core.types import WorldStatus
from simwarp.kernels.collision.broad import Grid, candidates
from simwarp.kernels.collision.contact_slots import ContactProgress, keep_last_contacts, keep_pair, passed_contacts
from simwarp.kernels.collision.pair import pair_contacts
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
    reach_time,
)
from simwarp.kernels.collision.shape import Assets
from simwarp.kernels.collision.surfaces import TriangleSurface, is_triangle_surface, triangle_surface_of
from simwarp.kernels.core.fields import ContactArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, world_row
from simwarp.kernels.core.world_range import WorldRange

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

NON_FINITE = wp.constant(int(WorldStatus.NON_FINITE))


@wp.func
def collide_pair(
    world: int, scratch_slot: int, shape0: int, shape1: int, reach: float, cached: int, progress: ContactProgress,
    topology: Topology, parameters: Parameters, assets: Assets, state: StateArrays, contacts: ContactArrays,
    scratch: CollisionScratch,
) -> ContactProgress:  # fmt: skip
    """The contacts of one pair of shapes."""
    now = progress
    ground = int(-1)
    convex = int(-1)
    if is_triangle_surface(topology.shape_type[shape0]):
        ground = shape0
        convex = shape1
    elif is_triangle_surface(topology.shape_type[shape1]):
        ground = shape1
        convex = shape0
    origin = pair_origin(scratch_slot, shape0, shape1, topology, scratch)
    a = placed(shape0, world, origin, scratch_slot, topology, parameters, scratch)
    b = placed(shape1, world, origin, scratch_slot, topology, parameters, scratch)
    flip = int(0)
    if ground == shape1:
        swap = a
        a = b
        b = swap
        flip = 1
    g = TriangleSurface()
    g.kind = -1
    if ground >= 0:
        offset = scratch.x[scratch_slot, ground] - origin
        g = triangle_surface_of(
            a, offset, scratch.lower[scratch_slot, convex], scratch.upper[scratch_slot, convex], reach
        )
    found = pair_contacts(
        a, b, g, flip, reach, assets, pack_manifold(scratch, scratch_slot), pack_raw(scratch, scratch_slot)
    )
    if found > 0:
        now.cursor = passed_contacts(scratch_slot, shape0, shape1, now.cursor, cached, scratch)
        now.count = keep_pair(
            world, scratch_slot, shape0, shape1, found, origin, now.count, cached, now.cursor, topology, state,
            contacts, scratch,
        )  # fmt: skip
        for k in range(found):
            now.deepest = wp.max(now.deepest, -scratch.pair_gap[scratch_slot, k])
    return now


@wp.func
def collide_world(
    world: int, scratch_slot: int, config: StepConfig, topology: Topology, parameters: Parameters, assets: Assets,
    state: StateArrays, contacts: ContactArrays, scratch: CollisionScratch, grid: Grid,
):  # fmt: skip
    """The contacts of one world at its present poses, warm-started from the last ones."""
    cached = keep_last_contacts(world, scratch_slot, contacts, scratch)
    place_shapes(world, scratch_slot, topology, parameters, state, assets, scratch)
    contacts.contact_overflow[world] = 0
    near = near_distance(world, config, parameters)
    time = reach_time(world, config, topology, parameters)
    we = world_row(world, parameters.shape_enabled.shape[0])
    if topology.grid_buckets > 0:
        fill_world_grid(scratch_slot, near, time, topology, scratch, grid)
    progress = ContactProgress()
    for shape0 in range(topology.shape_count):
        for index in range(candidates(shape0, topology, grid)):
            shape1 = grid.candidate[index]
            reach = pair_reach(scratch_slot, shape0, shape1, near, time, scratch)
            enabled = parameters.shape_enabled[we, shape0] * parameters.shape_enabled[we, shape1]
            if enabled != 0 and may_touch(scratch_slot, shape0, shape1, reach, scratch):
                progress = collide_pair(
                    world, scratch_slot, shape0, shape1, reach, cached, progress, topology, parameters, assets, state,
                    contacts, scratch,
                )  # fmt: skip
    contacts.contact_count[world] = progress.count
    contacts.penetration[world] = progress.deepest


@wp.kernel(enable_backward=False)
def collide_worlds(
    # inputs
    worlds: WorldRange,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    assets: Assets,
    state: StateArrays,
    scratch: CollisionScratch,
    # in and out
    contacts: ContactArrays,
):
    """Finds the contacts of all worlds that are not frozen, one after the other."""
    grid = pack_grid(scratch, worlds.slot)
    for k in range(worlds.count):
        world = worlds.first + k
        if (state.world_status[world] & NON_FINITE) == 0:
            collide_world(
                world, worlds.slot, config, topology, parameters, assets, state, contacts, scratch, grid
            )  # fmt: skip
