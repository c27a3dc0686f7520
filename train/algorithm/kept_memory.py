"""Memory that torch frees and asks for again stays with the process.

Learning from images takes and frees tensors of some megabytes for every operation. The C library would hand each back
to the system, which fills it with zeros, page by page, when it is next touched: up to a fourth of the time of learning
by camera. Told to keep them, it hands the same pages out again; no number that is computed changes.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from typing import Final

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3
"""Parameters of glibc's ``mallopt``."""
_LARGEST_KEPT: Final = 32 * 2**20
"""Bytes of a piece of memory that is kept, at most: what glibc's heaps of threads can hold. Larger ones, such as a
rollout, go back to the system."""
_KEPT: Final = 2**30
"""Unused bytes at the end of a heap, at most."""
_HEAP: Final = 64 * 2**20
"""Bytes of a heap of a thread; with as much to spare the library takes none of them down."""


@functools.cache
def keep_freed_memory() -> bool:
    """Tell the C library to keep what is freed; return whether it did. Other systems than Linux with glibc do not."""
    if not sys.platform.startswith("linux"):
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    settings = ((_MMAP_THRESHOLD, _LARGEST_KEPT), (_TRIM_THRESHOLD, _KEPT), (_TOP_PAD, _HEAP))
    done = [mallopt(name, size) == 1 for name, size in settings]
    return all(done)
