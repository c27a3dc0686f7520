"""Names of topics and of coordinate frames, and the tree of frames (REP 103 and 105)."""

from __future__ import annotations

import re
from typing import Final

MAP: Final = "map"
"""The world: x east or as its origin says, z up."""
ODOM: Final = "odom"
"""Where poses of bodies are: the world again, for a simulation knows where they are."""
BASE: Final = "base_link"
"""Frame of the body that the others go along with."""
OPTICAL: Final = (-0.5, 0.5, -0.5, 0.5)
"""Rotation xyzw of a camera's optical frame in the camera's: z ahead, x to the right, y down (REP 103)."""


def topic_word(name: str) -> str:
    """A name as a part of a topic: letters, digits and underscores, with no digit in front."""
    word = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9_]", "_", name)).strip("_") or "unnamed"
    return f"n{word}" if word[0].isdigit() else word


class Names:
    """Hands out names that differ."""

    def __init__(self, *taken: str) -> None:
        self._taken = set(taken)

    def __call__(self, name: str) -> str:
        """The name, with a number behind it where it is taken."""
        found, number = name, 1
        while found in self._taken:
            number += 1
            found = f"{name}_{number}"
        self._taken.add(found)
        return found
