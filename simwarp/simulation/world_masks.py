"""Masks of worlds as users give them."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import warp as wp

from simwarp.core.array_devices import array_from_host, array_on
from simwarp.core.types import ModelError, formatted
from simwarp.model.model import Model

REMEDY: Final = "give one bool for each world"


def mask_of_worlds(call: str, world_mask: Any, model: Model, *, name: str = "world_mask") -> wp.array:
    """A (W,) mask as a Warp array of bool on the model's device; a Warp array or tensor there keeps its memory.

    Args:
        call: what the user called: errors begin with it.
        world_mask: a Warp array, a torch tensor or anything NumPy reads.
        model: of the worlds.
        name: of the argument.

    Raises:
        ModelError: it is not of bool, has another shape, or lies elsewhere while a graph is captured.
    """
    shape = (model.world_count,)
    thing = f"{call}: {name} must"
    if isinstance(world_mask, wp.array):
        if world_mask.dtype != wp.bool:
            given = f"a Warp array of {world_mask.dtype.__name__} {world_mask.shape}"
            raise ModelError(f"{thing} be of bool, got {given}; make it with dtype=wp.bool")
        values: Any = world_mask
    elif hasattr(world_mask, "data_ptr"):
        kind = kind_of_tensor(world_mask)
        if kind != "bool":
            given = f"a tensor of {kind} {tuple(world_mask.shape)}"
            raise ModelError(f"{thing} be of bool, got {given}; compare it, as in `mask > 0`")
        values = world_mask
    else:
        try:
            values = np.asarray(world_mask)
        except ValueError:
            raise ModelError(f"{thing} have shape {shape} (worlds), got {formatted(world_mask)}; {REMEDY}") from None
        if values.dtype != np.bool_:
            are_numbers = values.dtype.kind in "iuf"
            given = f"{values.dtype.name} {values.shape}" if are_numbers else formatted(world_mask)
            advice = f"{REMEDY}, not indices of worlds" if are_numbers else REMEDY
            raise ModelError(f"{thing} be of bool, got {given}; {advice}")
    if tuple(values.shape) != shape:
        raise ModelError(f"{thing} have shape {shape} (worlds), got {tuple(values.shape)}; {REMEDY}")
    if isinstance(values, np.ndarray):
        return array_from_host(thing, values, model.device, wp.bool)
    return array_on(thing, values, model.device, wp.bool)


def kind_of_tensor(tensor: Any) -> str:
    """The name of a tensor's dtype without its module; torch itself is not needed."""
    return str(tensor.dtype).rpartition(".")[2].lower()
