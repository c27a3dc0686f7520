"""Masks of worlds as users give them."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import warp as wp

from simwarp.core.types import ModelError, shown
from simwarp.model.model import Model


def mask_of_worlds(world_mask: Any, model: Model) -> wp.array:
    """A (W,) mask as a Warp array of bool on the model's device; a Warp array or tensor keeps its memory.

    Args:
        world_mask: a Warp array, a torch tensor or anything NumPy reads.
        model: of the worlds.

    Raises:
        ModelError: it is not of bool, or has another shape.
    """
    shape = (model.world_count,)
    kind = str(getattr(world_mask, "dtype", "")).lower()
    if isinstance(world_mask, wp.array):
        if world_mask.dtype != wp.bool:
            raise ModelError(f"world_mask must be of bool, got a Warp array of {world_mask.dtype.__name__}")
        mask = world_mask
    elif hasattr(world_mask, "data_ptr"):
        if "bool" not in kind:
            raise ModelError(f"world_mask must be of bool, got a tensor of {kind}; compare it first")
        mask = cast(wp.array, wp.from_torch(world_mask.contiguous(), dtype=wp.bool))
    else:
        try:
            values = np.asarray(world_mask)
        except ValueError:
            raise ModelError(f"world_mask must have shape {shape} (worlds), got {shown(world_mask)}") from None
        if values.dtype != np.bool_:
            raise ModelError(f"world_mask must be of bool, got {values.dtype}; it is no list of indices")
        mask = wp.array(values, dtype=wp.bool, device=model.device)
    if tuple(mask.shape) != shape:
        raise ModelError(f"world_mask must have shape {shape} (worlds), got {tuple(mask.shape)}")
    return mask
