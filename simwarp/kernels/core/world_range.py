"""The worlds of one launch: kernels that take a `WorldRange` first can have their worlds shared among threads."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class WorldRange:
    """Some worlds in a row, and their places in scratch memory."""

    first: int  # world of the launch's first thread
    count: int  # worlds of the launch
    slot: int  # scratch slot that its worlds take in turn
    own_slots: int  # 1: every world has a slot of its own instead


@wp.func
def scratch_slot_of(world: int, worlds: WorldRange) -> int:
    """Place of a world in scratch memory."""
    return wp.where(worlds.own_slots == 1, world, worlds.slot)
