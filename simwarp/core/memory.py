"""Memory checks: compare requested bytes with free bytes before an allocation."""

from __future__ import annotations

import gc
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import warp as wp

from simwarp.core import operating_system
from simwarp.core.object_repr import bytes_text
from simwarp.core.types import ArrayLayout, ModelError, formatted

MOST_ROWS: Final = 2**31 - 1
"""Longest axis of an array, and most bytes behind its first axis: kernels index with 32 bits."""

MEMINFO: Final = Path("/proc/meminfo")
OWN_GROUPS: Final = Path("/proc/self/cgroup")
CGROUPS: Final = Path("/sys/fs/cgroup")
UNLIMITED: Final = 2**60
"""Control groups of the first version write such a number of bytes where there is no limit."""


def device_memory(device: Any) -> int:
    """Total bytes of a Warp device; for a CPU those of the machine."""
    if device.is_cuda:
        return int(device.total_memory)
    return operating_system.total_memory()


def free_memory(device: Any) -> int:
    """Bytes of a Warp device that are free; of a CPU those that this process can have without swapping."""
    if device.is_cuda:
        return int(device.free_memory)
    room = [device_memory(device), *_meminfo(), *_control_groups(), *_process_limit()]
    return max(0, min(room))


def check_fits(what: str, needed: int, device: Any, remedy: str) -> None:
    """Refuses more bytes than are free on a device; `what` needs them.

    Raises:
        ModelError: they do not fit.
    """
    if needed <= free_memory(device):
        return
    gc.collect()  # simulations that nobody holds any more, and what the device has yet to give back
    if device.is_cuda:
        wp.synchronize_device(device)
    free = free_memory(device)
    if needed > free:
        raise ModelError(
            f"{what} need {bytes_text(needed)}, device {device} has {bytes_text(device_memory(device))}, "
            f"of which {bytes_text(free)} are free; {remedy}"
        )


def check_layouts(what: str, layouts: Mapping[str, ArrayLayout], device: Any, remedy: str, more: int = 0) -> None:
    """Refuses arrays that are still to be made where they do not fit, or where kernels could not index them.

    Args:
        what: needs them.
        layouts: of the arrays, by the names that errors use.
        device: device on which they will be.
        remedy: advice for the user.
        more: bytes beside them.

    Raises:
        ModelError: an axis or a row is too long, or they need more bytes than are free.
    """
    for name, layout in layouts.items():
        row = math.prod(layout.shape[1:]) * item_bytes(layout.dtype)
        if max((*layout.shape, row)) > MOST_ROWS:
            raise ModelError(
                f"{what} need an array '{name}' of shape {formatted(layout.shape)}, whose rows of {bytes_text(row)} or "
                f"whose length is beyond 32 bits; {remedy}"
            )
    passing = max(layout_bytes([layout]) for layout in layouts.values())  # on the host, on its way into an array
    check_fits(what, layout_bytes(layouts.values()) + passing + more, device, remedy)


def layout_bytes(layouts: Iterable[ArrayLayout]) -> int:
    """Bytes of arrays that are still to be made."""
    return sum(math.prod(layout.shape) * item_bytes(layout.dtype) for layout in layouts)


def item_bytes(dtype: Any) -> int:
    """Bytes of one element of a Warp array."""
    return int(wp.types.type_size_in_bytes(dtype))


def _meminfo() -> list[int]:
    """Available memory: what is free, and caches that the system can drop."""
    try:
        lines = MEMINFO.read_text(encoding="ascii").splitlines()
    except OSError:
        available = operating_system.available_memory()
        return [] if available is None else [available]
    return [1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]


def _control_groups() -> list[int]:
    """Memory left by the control groups of this process: containers and batch systems limit it below the machine's."""
    try:
        lines = OWN_GROUPS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    room = []
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers == "":
            root, limit, usage, cache = CGROUPS, "memory.max", "memory.current", "inactive_file"
        elif "memory" in controllers.split(","):
            root, limit, usage = CGROUPS / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes"
            cache = "total_inactive_file"
        else:
            continue
        group = root / path.lstrip("/")
        for folder in (group, *group.parents):
            if folder == root.parent:
                break
            most = _first_number(folder / limit)
            if most is not None and most < UNLIMITED:
                used = _first_number(folder / usage) or 0
                room.append(most - used + _statistic(folder / "memory.stat", cache))
    return room


def _process_limit() -> list[int]:
    """Memory left by the limit of this process's address space (`ulimit -v`)."""
    limit = operating_system.address_space_limit()
    if limit is None:
        return []
    pages = _first_number(Path("/proc/self/statm")) or 0
    return [limit - pages * os.sysconf("SC_PAGE_SIZE")]


def _first_number(path: Path) -> int | None:
    """The number that a file begins with; None where it has none ("max") or cannot be read."""
    try:
        words = path.read_text(encoding="ascii").split()
    except (OSError, UnicodeDecodeError):
        return None
    return int(words[0]) if words and words[0].isdigit() else None


def _statistic(path: Path, name: str) -> int:
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith(f"{name} ")), 0)
