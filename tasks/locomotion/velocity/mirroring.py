"""The mirror image of a robot on legs that follows commanded velocities: left becomes right."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from typing import Final

from ...framework.errors import InputError
from ...framework.mirror import Mirror, reflection

SEEN_FLIPS: Final = ("velocity y", "turning [xz]", "down y", "command left", "command turn", "clock")
"""Components that point the other way in a mirror, by the names that tasks give them."""


def mirror_of(
    observation_names: Mapping[str, Sequence[str]], joints: Sequence[str], *, sides: Sequence[tuple[str, str]],
    turned: Sequence[str],
) -> Mirror:  # fmt: skip
    """Return the mirror image of observations and actions.

    Args:
        observation_names: of the groups, as the tasks of this package name them; a name may go on after a component.
        joints: that the actions move.
        sides: words of names of joints that change places.
        turned: joints whose angles change their sign; * stands for letters.

    Raises:
        InputError: no joint has a word of a pair of sides.
    """
    for one, other in sides:
        if not any(one in joint or other in joint for joint in joints):
            raise InputError(
                f"sides: no joint has '{one}' or '{other}' in its name, such as '{joints[0]}'; "
                "name the sides of this robot, or set `sides = ()` and train with `--ppo.symmetry none`"
            )
    groups = {}
    for group, names in observation_names.items():
        heights = sorted({_across(name) for name in names if name.startswith("ground ")})
        pairs = [(f"ahead {-y:+.2f} left", f"ahead {y:+.2f} left") for y in heights if y > 0.0]
        patterns = [f"{flip}*" for flip in SEEN_FLIPS] + [f"* {joint}*" for joint in turned]
        there = [pattern for pattern in patterns if _matches(names, pattern)]
        groups[group] = reflection(names, swap=[*sides, *pairs], flip=there)
    return Mirror(groups, reflection(joints, swap=sides, flip=turned))


def _across(name: str) -> float:
    """How far to the left a height of the ground is of."""
    return float(name.split()[-2])


def _matches(names: Sequence[str], pattern: str) -> bool:
    return bool(fnmatch.filter(names, pattern))
