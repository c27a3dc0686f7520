"""Device half of obstacles that stand anywhere: what is in a slot, for contact, for cameras and for tasks."""

import warp as wp

from ..framework.randomness_kernels import Draws, episode_key, uniform_at

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "fuse_fp": False})

UNDERGROUND = wp.constant(-100.0)
"""Height of obstacles that do not take part [m]."""


@wp.struct
class SlotArrays:
    """Arrays of a model or of a scene in which slots are neighbours; of no length: there is no scene."""

    first: int
    x: wp.array2d[wp.vec3d]  # (W, N)
    rot: wp.array2d[wp.quat]
    size: wp.array2d[wp.vec3]
    asset: wp.array2d[int]
    enabled: wp.array2d[int]
    assets: wp.array[int]  # (K,) of the kinds


@wp.struct
class Slots:
    """The kinds of things, and what stands in the slots."""

    reach: wp.array[float]  # (K,) radius of the upright cylinder around a kind [m]
    tallness: wp.array[float]  # (K,) [m]
    scale: wp.array[wp.vec2]  # (K,) least and largest
    kinds: wp.array[wp.uint64]  # streams of the draws
    scales: wp.array[wp.uint64]
    place: wp.array2d[wp.vec2]  # (W, slots) feet [m]
    radius: wp.array2d[float]  # (W, slots) -1: empty


@wp.struct
class Thing:
    """What may stand in a slot."""

    kind: int
    scale: float


@wp.func
def drawn_thing(world: int, slot: int, slots: Slots, draws: Draws) -> Thing:
    """The thing in a slot of a world."""
    thing = Thing()
    kinds = float(slots.reach.shape[0])
    thing.kind = int(uniform_at(episode_key(slots.kinds, world, draws), slot, 0.0, kinds))
    bounds = slots.scale[thing.kind]
    share = uniform_at(episode_key(slots.scales, world, draws), slot, 0.0, 1.0)
    thing.scale = bounds[0] + (bounds[1] - bounds[0]) * share
    return thing


@wp.func
def fill_array(
    world: int, slot: int, x: wp.vec3d, rot: wp.quat, thing: Thing, present: bool, arrays: SlotArrays
):  # fmt: skip
    """Write one slot of a model or a scene."""
    if arrays.x.shape[0] == 0:
        return
    at = arrays.first + slot
    arrays.x[world, at] = x
    arrays.rot[world, at] = rot
    arrays.size[world, at] = wp.vec3(thing.scale, thing.scale, thing.scale)
    arrays.asset[world, at] = arrays.assets[thing.kind]
    arrays.enabled[world, at] = int(present)


@wp.func
def fill_slot(
    world: int, slot: int, place: wp.vec2, height: float, heading: float, thing: Thing, present: bool, slots: Slots,
    model: SlotArrays, scene: SlotArrays,
):  # fmt: skip
    """Put a thing into a slot, or nothing."""
    level = UNDERGROUND
    radius = float(-1.0)
    if present:
        level = height
        radius = thing.scale * slots.reach[thing.kind]
    x = wp.vec3d(wp.float64(place[0]), wp.float64(place[1]), wp.float64(level))
    rot = wp.quat(0.0, 0.0, wp.sin(0.5 * heading), wp.cos(0.5 * heading))
    fill_array(world, slot, x, rot, thing, present, model)
    fill_array(world, slot, x, rot, thing, present, scene)
    slots.place[world, slot] = place
    slots.radius[world, slot] = radius


@wp.kernel
def fill_slots(
    mask: wp.array[wp.bool], place: wp.array2d[wp.vec2], height: wp.array2d[float], heading: wp.array2d[float],
    kind: wp.array2d[wp.int64], scale: wp.array2d[float], present: wp.array2d[wp.bool], slots: Slots,
    model: SlotArrays, scene: SlotArrays,
):  # fmt: skip
    """Put things into the slots of some worlds."""
    world, slot = wp.tid()
    if mask[world]:
        thing = Thing()
        thing.kind = int(kind[world, slot])
        thing.scale = scale[world, slot]
        fill_slot(
            world, slot, place[world, slot], height[world, slot], heading[world, slot], thing, present[world, slot],
            slots, model, scene,
        )  # fmt: skip
