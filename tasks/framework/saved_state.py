"""Saved state, held to the state that it is to replace before any of it is taken over: a file may hold anything."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from simwarp.core.types import formatted

from .config_values import typed
from .errors import InputError


def check_like(like: Any, saved: Any, where: str) -> None:
    """Check saved values against present ones: the same names, types, shapes and dtypes.

    Args:
        like: the present values: tensors, numbers, mappings and lists of them.
        saved: content that was read.
        where: its location: the errors begin with it.

    Raises:
        InputError: something is missing, superfluous or of another kind.
    """
    if isinstance(like, Mapping):
        check_names(like, saved, where)
        for name, item in like.items():
            check_like(item, saved[name], f"{where}.{name}")
    elif isinstance(like, list | tuple):
        if not isinstance(saved, list | tuple) or len(saved) != len(like):
            raise state_mismatch(where, f"a list of {len(like)}", saved)
        for index, (item, other) in enumerate(zip(like, saved, strict=True)):
            check_like(item, other, f"{where}[{index}]")
    elif isinstance(like, torch.Tensor):
        if not _is_dense(saved) or saved.shape != like.shape or saved.dtype != like.dtype:
            raise state_mismatch(where, _words(like), saved)
    elif like is None:
        if saved is not None:
            raise state_mismatch(where, "nothing", saved)
    else:
        typed(type(like), saved, where)


def check_names(like: Mapping[Any, Any], saved: Any, where: str) -> None:
    """Check saved values against the names of present ones; see :func:`check_like`."""
    if not isinstance(saved, Mapping):
        raise state_mismatch(where, "an object of named values", saved)
    for name in like:
        if name not in saved:
            raise InputError(f"{where} has no '{name}': it was made by another version of simwarp, or is damaged")
    for name in saved:
        if name not in like:
            raise InputError(f"{where} has {formatted(name)}, which is nothing here: it is of another configuration")


def _is_dense(value: Any) -> bool:
    return isinstance(value, torch.Tensor) and value.layout == torch.strided and value.device.type != "meta"


def _words(value: Any) -> str:
    if not isinstance(value, torch.Tensor):
        return formatted(value)
    words = f"{tuple(value.shape)} {str(value.dtype).removeprefix('torch.')}"
    if value.layout != torch.strided:
        return f"{words} in {str(value.layout).removeprefix('torch.')} layout"
    return f"{words} without values" if value.device.type == "meta" else words


def state_mismatch(where: str, wanted: str, saved: Any) -> InputError:
    """Return the error that says what should be there and what is."""
    return InputError(f"{where} must be {wanted}, got {_words(saved)}")
