"""Which observation groups a kind of network takes, and the check of a task's groups against it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import torch

from simwarp.tasks import InputError
from simwarp.tasks.framework.observation_kinds import ObservationKind, kinds_of_groups

from ..config import NetworkConfig, NetworkKind
from .own_network import network_class

_IMAGE, _VECTOR = ObservationKind.IMAGE, ObservationKind.VECTOR
TAKES: Final[Mapping[NetworkKind, tuple[ObservationKind, ...]]] = {
    NetworkKind.MLP: (_VECTOR,),
    NetworkKind.THESIS_MLP: (_VECTOR,),
    NetworkKind.RECURRENT: (_VECTOR,),
    NetworkKind.MULTI_INPUT: (_IMAGE, ObservationKind.POINTS, ObservationKind.SEQUENCE, _VECTOR),
    NetworkKind.NATURE_CNN: (_IMAGE,),
    NetworkKind.EARLY_FUSION: (_IMAGE, _VECTOR),
    NetworkKind.LATE_FUSION: (_IMAGE, _VECTOR),
}
"""Kinds of groups that networks take. All but multi-input need one of each."""
_WORDS: Final = {
    _IMAGE: "images (H, W, C) of uint8 or float32",
    _VECTOR: "(N,) float32 groups",
    ObservationKind.POINTS: "clouds of points (N, C) of float32",
    ObservationKind.SEQUENCE: "sequences (T, C) of float32",
}


def _missing(kind: NetworkKind, present: set[ObservationKind | None]) -> list[ObservationKind]:
    """Return what a network needs and a task has not."""
    return [] if kind is NetworkKind.MULTI_INPUT else [need for need in TAKES[kind] if need not in present]


def check_groups(
    network: NetworkConfig, task: str, shapes: Mapping[str, tuple[int, ...]], dtypes: Mapping[str, torch.dtype],
    named: Mapping[str, Any],
) -> None:  # fmt: skip
    """Check a task's observation groups against the inputs of a network. One of an author's own takes them all.

    Args:
        network: of the training.
        task: name of the task.
        shapes, dtypes: of its observation groups.
        named: its ``observation_kinds``.

    Raises:
        InputError: a group has the wrong shape or dtype, the network takes no such group, or there is no such network.
    """
    if network.class_ is not None:
        network_class(network.class_)
        return
    kind, kinds = network.kind, kinds_of_groups(shapes, named)
    sound = {name: _is_sound(kinds[name], shapes[name], dtypes[name]) for name in shapes}
    present = set(kinds.values())
    fitting = [one for one in TAKES if present <= {*TAKES[one]} and not _missing(one, present)]
    for name, shape in shapes.items():
        if sound[name] and kinds[name] in TAKES[kind]:
            continue
        hint = f"; try --network.kind {fitting[-1].value}" if sound[name] and fitting else ""
        takes = " and ".join(_WORDS[one] for one in TAKES[kind])
        raise InputError(
            f"observation '{name}' of task '{task}' is {shape} {dtypes[name]}; network '{kind.value}' takes"
            f" {takes}{hint}"
        )
    for need in _missing(kind, present):
        word = "an image" if need is _IMAGE else "a vector"
        raise InputError(f"network '{kind.value}' needs {word} group; task '{task}' has {', '.join(shapes)}")


def _is_sound(kind: ObservationKind | None, shape: tuple[int, ...], dtype: torch.dtype) -> bool:
    """Return True if a network can read such numbers."""
    known = (torch.float32, torch.uint8) if kind is _IMAGE else (torch.float32,)
    return kind is not None and kind.fits(shape) and dtype in known
