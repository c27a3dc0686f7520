"""Arguments of Warp's native library, as ctypes passes them."""

from __future__ import annotations

import ctypes
from typing import Any

CURRENT_STREAM = 0xFFFFFFFFFFFFFFFF
"""Handle that stands for Warp's current stream."""


def number(value: Any) -> int:
    """An address or handle."""
    if value is None:
        return 0
    if isinstance(value, int):
        return value
    if isinstance(value, (ctypes.c_void_p, ctypes.c_uint64, ctypes.c_size_t)):
        return int(value.value or 0)
    if hasattr(value, "_obj"):
        return ctypes.addressof(value._obj)
    if isinstance(value, (bytes, ctypes.c_char_p)) or hasattr(value, "contents"):
        return ctypes.cast(value, ctypes.c_void_p).value or 0
    return ctypes.addressof(value)
