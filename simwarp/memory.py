"""What fits: bytes of a device against bytes that are asked for, before anything is allocated."""

from __future__ import annotations

import os
from typing import Any

from simwarp.types import ModelError


def device_memory(device: Any) -> int:
    """Bytes that a Warp device has in all; of a CPU those of the machine."""
    if device.is_cuda:
        return int(device.total_memory)
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def check_fits(what: str, needed: int, device: Any, remedy: str) -> None:
    """Refuses more bytes than a device has; `what` needs them.

    Raises:
        ModelError: they do not fit.
    """
    there = device_memory(device)
    if needed > there:
        raise ModelError(f"{what} need {needed / 2**30:.3g} GiB, device {device} has {there / 2**30:.3g} GiB; {remedy}")
