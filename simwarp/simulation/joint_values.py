"""Coordinates and rates of all worlds as users give them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.array_devices import array_from_host, array_on, is_on
from simwarp.core.arrays import on_host
from simwarp.core.types import ModelError, formatted, numbers
from simwarp.model.model import Model
from simwarp.simulation.world_masks import kind_of_tensor


def joint_values(name: str, values: Any, model: Model, mask: wp.array | None) -> wp.array:
    """Coordinates or rates as a Warp array of float32 on the model's device; host values may broadcast.

    Args:
        name: of the argument of `set_joint_state`.
        values: a Warp array, a torch tensor or anything NumPy reads.
        model: of the worlds.
        mask: (W,) bool, worlds whose values count; all when None.

    Raises:
        ModelError: shapes do not fit, or a value that counts is no finite number, or they lie elsewhere while a
            graph is captured. Values on a GPU are not read back.
    """
    thing = f"set_joint_state: {name} must"
    shape = (model.world_count, model.dof_count)
    if isinstance(values, wp.array) and values.dtype == wp.float32 and values.is_contiguous:
        given: Any = values
    elif hasattr(values, "data_ptr"):
        if "complex" in kind_of_tensor(values):
            kind = f"a tensor of {kind_of_tensor(values)} {tuple(values.shape)}"
            raise ModelError(f"{thing} be real numbers of shape {shape} (worlds, dofs), got {kind}; take its real part")
        given = values.detach().float()
    else:
        return _from_host(name, values, model, mask)
    if tuple(given.shape) != shape:
        raise ModelError(
            f"{thing} have shape {shape} (worlds, dofs), got {tuple(given.shape)}; tensors and Warp arrays need one "
            "row for each world"
        )
    array = array_on(thing, given, model.device, wp.float32)
    at_hand = array if is_on("cpu", array) else given
    if is_on("cpu", at_hand):
        _check_finite(name, np.asarray(at_hand), mask)  # not numpy(): nothing waits for a device here
    return array


def _from_host(name: str, values: Any, model: Model, mask: wp.array | None) -> wp.array:
    """What NumPy reads, one row for all worlds or one for each."""
    thing = f"set_joint_state: {name} must"
    shape = (model.world_count, model.dof_count)
    given = numbers(values)
    if given.ndim == 0 and not np.isfinite(given):
        raise ModelError(
            f"{thing} be finite numbers of shape {shape} (worlds, dofs), got {formatted(values)}; pass an array"
        )
    try:
        data = np.broadcast_to(given, shape)
    except ValueError:
        raise ModelError(
            f"{thing} have shape {shape} (worlds, dofs), got {given.shape}; give one row, or one for each world"
        ) from None
    with np.errstate(over="ignore"):  # an error below names it
        single = np.ascontiguousarray(data, dtype=np.float32)
    _check_finite(name, single, mask)
    return array_from_host(thing, single, model.device, wp.float32)


def _check_finite(name: str, values: npt.NDArray[np.float32], mask: wp.array | None) -> None:
    """Raises where a world of the mask would get NaN or infinity; a mask on a GPU is not read back."""
    bad = ~np.isfinite(values).all(axis=1)
    if mask is not None:
        if not on_host(mask):
            return
        bad &= np.asarray(mask)
    if bad.any():
        world = int(np.argmax(bad))
        value = next(value for value in values[world].tolist() if not math.isfinite(value))
        raise ModelError(
            f"set_joint_state: {name} must be finite (float32), got {value!r} for world {world}; leave such worlds "
            "out of the mask"
        )
