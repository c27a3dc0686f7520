"""Copies of worlds: whole rows of any array whose rows belong to worlds, seen as words or bytes."""

import warp as wp

from simwarp.kernels.core.world_range import WorldRange

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.kernel
def choose_source(
    # inputs
    mask: wp.array[wp.bool],
    source: int,
    same: bool,  # it is a world of the same simulation
    # outputs
    source_of: wp.array[int],
    written: wp.array[wp.bool],
):
    """One source for the worlds of a mask; the others keep what they have."""
    world = wp.tid()
    chosen = mask[world] and not (same and world == source)
    source_of[world] = wp.where(chosen, source, -1)
    written[world] = chosen


@wp.kernel
def copy_words(
    # inputs
    worlds: WorldRange,
    threads: int,
    source_of: wp.array[int],  # (W,) world to be copied; -1: none
    source: wp.array2d[int],  # (1 or worlds of the source, words)
    # outputs
    target: wp.array2d[int],  # (W, words)
):
    """Rows of the source become those of the target; `threads` threads share a row."""
    index, thread = wp.tid()
    world = worlds.first + index
    origin = source_of[world]
    if origin >= 0:
        row = wp.min(origin, source.shape[0] - 1)  # of one row that all worlds share
        for word in range(thread, target.shape[1], threads):
            target[world, word] = source[row, word]


@wp.kernel
def copy_bytes(
    # inputs
    worlds: WorldRange,
    threads: int,
    source_of: wp.array[int],
    source: wp.array2d[wp.uint8],
    # outputs
    target: wp.array2d[wp.uint8],
):
    """`copy_words` of rows that are no whole words."""
    index, thread = wp.tid()
    world = worlds.first + index
    origin = source_of[world]
    if origin >= 0:
        row = wp.min(origin, source.shape[0] - 1)
        for place in range(thread, target.shape[1], threads):
            target[world, place] = source[row, place]
