"""The file format's own names: what files say where Python has another name.

Files that exist stay readable. Run folders, checkpoints, dumps and files of sensors give fields by the keys that they
had when they were written; snapshots and dumps name arrays, joints and parts by their first names, and still do.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final

OLD_KEYS: Final[Mapping[str, Mapping[str, str]]] = {
    "CameraConfig": {"reach": "far"},
    "CartPoleConfig": {"quirks": "legacy_compat"},
}
"""Keys that files have for fields of a configuration, by the name of its class or a base: old and new name."""

REWARD_WEIGHTS: Final[Mapping[str, tuple[str, float]]] = {
    "aside_weight": ("aside", -1.0),
    "bonus": ("goal", 1.0),
    "change_weight": ("change", -1.0),
    "failure_weight": ("failure", -1.0),
    "following_weight": ("following", 1.0),
    "goal_weight": ("goal", 1.0),
    "lap_weight": ("lap", 1.0),
    "progress_weight": ("progress", 1.0),
    "speed_weight": ("speed", -1.0),
}
"""Keys that files have for weights of rewards: term among the `rewards` of a task, and the sign that it has there."""

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


def with_reward_weights(plain: Mapping[str, Any], fields: Collection[str]) -> dict[str, Any]:
    """The configuration of a task, of these fields, with its weights of rewards among its `rewards`."""
    if "rewards" not in fields:
        return dict(plain)
    found: dict[str, Any] = {}
    for key in (REWARD_WEIGHTS.keys() & plain.keys()) - set(fields):
        term, sign = REWARD_WEIGHTS[key]
        found[term] = sign * plain[key] if isinstance(plain[key], int | float) else plain[key]
    kept = {key: value for key, value in plain.items() if key not in REWARD_WEIGHTS or key in fields}
    return {**kept, "rewards": found} if found else kept
