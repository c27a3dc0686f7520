"""Limits of what a task is asked for: whole numbers, and memory for what it keeps, before it is taken."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
import warp as wp

from simwarp import ModelError
from simwarp.core.memory import check_fits
from simwarp.core.types import formatted

from .errors import InputError


def whole(what: str, value: Any, least: int, most: int) -> int:
    """Return an argument as a whole number, or raise an :class:`InputError` that names it."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool):
        raise InputError(f"{what} must be a whole number, got {formatted(value)}")
    if not least <= value <= most:
        rule = f"at least {least}" if value < least else f"at most {most}"
        raise InputError(f"{what} must be {rule}, got {formatted(value)}")
    return int(value)


def check_room(what: str, shape: tuple[int, ...], dtype: torch.dtype, device: torch.device, remedy: str) -> None:
    """Refuse a tensor that does not fit into the free memory of a device; the message says how much there is.

    Raises:
        InputError: it does not fit.
    """
    needed = math.prod(shape) * dtype.itemsize
    try:
        check_fits(what, needed, wp.get_device(str(device)), remedy)
    except ModelError as error:
        raise InputError(str(error)) from None


def checked_level(what: str, level: Any, worlds: int = 0) -> torch.Tensor:
    """Return a level, one number or (W,), as float32.

    Args:
        what: it is called in errors.
        level: as it was given.
        worlds: number that (W,) stands for; 0 where only one number will do.

    Raises:
        InputError: it is no number in [0, 1], or there are too many or too few.
    """
    rule = "a number in [0, 1]" + (f", or {worlds} of them" if worlds else "")
    try:
        values = torch.as_tensor(level).to(torch.float32)
    except (TypeError, ValueError, RuntimeError):
        raise InputError(f"{what} must be {rule}, got {formatted(level)}") from None
    fits = values.dim() == 0 or tuple(values.shape) == (worlds,)
    if not fits or isinstance(level, bool) or not bool(((values >= 0.0) & (values <= 1.0)).all()):
        raise InputError(f"{what} must be {rule}, got {formatted(level)}")
    return values
