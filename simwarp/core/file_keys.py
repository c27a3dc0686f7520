"""The file format's own names: what files say where Python has another name.

Files that exist stay readable. Run folders, checkpoints, dumps and files of sensors give fields by the keys that they
had when they were written; snapshots and dumps name arrays, joints and parts by their first names, and still do.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

OLD_KEYS: Final[Mapping[str, Mapping[str, str]]] = {
    "CameraConfig": {"reach": "far"},
    "CartPoleConfig": {"quirks": "legacy_compat"},
}
"""Keys that files have for fields of a configuration, by the name of its class or a base: old and new name."""

ARRAYS: Final[Mapping[str, str]] = {"box_impulse": "bounded_impulse"}
"""Arrays in snapshots and dumps: name in Python and in the file."""

JOINT_TYPES: Final[Mapping[str, str]] = {"distance": "line", "relative_rotation": "turn"}
"""Joints in the identity of a snapshot: name of the type in lower case, and in the file."""

PARTS: Final[Mapping[str, str]] = {"PathTracker": "PathFollower"}
"""Force elements and sensors in the identity of a snapshot: name of the class, and in the file."""


def old_keys(kind: type) -> Mapping[str, str]:
    """The old keys of a class of configurations and the new ones; none for most."""
    return {old: new for base in kind.__mro__ for old, new in OLD_KEYS.get(base.__name__, {}).items()}


def with_current_keys(plain: Mapping[str, Any], keys: Mapping[str, str]) -> dict[str, Any]:
    """The object of a file with the keys that its fields have now.

    An old key beside its new one stays, and is unknown to the reader.
    """
    return {keys[key] if key in keys and keys[key] not in plain else key: value for key, value in plain.items()}


def with_current_threads(plain: Mapping[str, Any]) -> Mapping[str, Any]:
    """The training configuration of a file. `threads` were those of torch where there are no `torch_threads`.

    Such a run learnt in one thread, and goes on in one, bit by bit.
    """
    if "threads" not in plain or "torch_threads" in plain:
        return plain
    return {**plain, "threads": 1, "torch_threads": plain["threads"]}
