"""From the name of a device, as a user types it, to one that exists."""

from __future__ import annotations

import torch

from .errors import InputError


def available_devices() -> list[str]:
    """Return the names a user may give: ``cpu`` and every CUDA device torch can see."""
    return ["cpu", *(f"cuda:{index}" for index in range(torch.cuda.device_count()))]


def resolve_device(name: str) -> str:
    """Return the canonical name of a device (``cpu``, ``cuda:0``, ...).

    ``auto`` is the first CUDA device where there is one, else the CPU; ``cuda`` is ``cuda:0``.

    Raises:
        InputError: there is no such device on this machine.
    """
    known = available_devices()
    if name == "auto":
        return known[1] if len(known) > 1 else known[0]
    wanted = "cuda:0" if name == "cuda" else name
    if wanted not in known:
        hint = "" if len(known) > 1 else " (torch sees no CUDA device; see `simwarp doctor`)"
        raise InputError(f"unknown device '{name}'; available: {', '.join(known)}, auto{hint}")
    return wanted
