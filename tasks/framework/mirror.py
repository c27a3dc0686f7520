"""What left-right reflection makes of a task's observations and actions: for training that uses the symmetry."""

from __future__ import annotations

import dataclasses
import fnmatch
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from simwarp.core.types import formatted

from .errors import InputError


@dataclasses.dataclass(frozen=True)
class Reflection:
    """Reflection of a row of numbers: component k of the mirror image is ``signs[k]`` times component ``sources[k]``.

    Attributes:
        sources: index of the component that each one comes from.
        signs: 1 or -1, where it points the other way.
    """

    sources: tuple[int, ...]
    signs: tuple[float, ...]

    def problem(self, size: int) -> str:
        """Return what is wrong with it for rows of ``size`` numbers; empty if nothing is."""
        if len(self.sources) != size or len(self.signs) != size:
            return f"it must have {size} components, got {len(self.sources)}"
        if sorted(self.sources) != list(range(size)) or any(abs(sign) != 1.0 for sign in self.signs):
            return "it must take each component once, with a sign of 1 or -1"
        twice = [(self.sources[source], sign * self.signs[source])
                 for source, sign in zip(self.sources, self.signs, strict=True)]  # fmt: skip
        wrong = next((k for k, pair in enumerate(twice) if pair != (k, 1.0)), None)
        return "" if wrong is None else f"mirrored twice, component {wrong} must be itself again"


@dataclasses.dataclass(frozen=True)
class Mirror:
    """The mirror image of what a task sees and does.

    Attributes:
        observations: reflection of each observation group (rows of numbers); ``critic`` is that of ``privileged``.
        actions: that of the actions.
    """

    observations: Mapping[str, Reflection]
    actions: Reflection


def reflection(
    names: Sequence[str], *, swap: Iterable[tuple[str, str]] = (), flip: Iterable[str] = ()
) -> Reflection:  # fmt: skip
    """Return the reflection of a row whose components have names.

    That of a quadruped's, for example::

        reflection(names, swap=[("FL", "FR"), ("RL", "RR")], flip=["velocity y", "turning [xz]", "*_hip_joint"])

    Args:
        names: of the components, in their order, all different.
        swap: words that change places in names: a component comes from that of the name with the other word.
        flip: names that point the other way; ``*`` stands for letters, ``[xz]`` for one of them.

    Raises:
        InputError: names are not different, a partner is missing, or an entry of ``flip`` matches nothing.
    """
    listed, pairs, patterns = list(names), list(swap), list(flip)
    if not listed or len(set(listed)) < len(listed):
        raise InputError(f"reflection: names must be different, got {formatted(listed)}; number those that are equal")
    for pattern in patterns:
        if not fnmatch.filter(listed, pattern):
            raise InputError(f"reflection: flip has {formatted(pattern)}, which no name matches; leave it out")
    sources, signs = [], []
    for name in listed:
        partner = _swapped(name, pairs)
        if partner not in listed:
            raise InputError(f"reflection: '{name}' must have the partner '{partner}', got none; name both, or no swap")
        sources.append(listed.index(partner))
        signs.append(-1.0 if any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns) else 1.0)
    return Reflection(tuple(sources), tuple(signs))


def _swapped(name: str, pairs: Sequence[tuple[str, str]]) -> str:
    """A name with one word of a pair in the place of the other."""
    for first, second in pairs:
        if first in name:
            return name.replace(first, second)
        if second in name:
            return name.replace(second, first)
    return name


def check_mirror(task: Any, groups: Mapping[str, tuple[int, ...]], option: str) -> Mirror:
    """Return the mirror of a task, held to its observations and actions.

    Args:
        task: the task.
        groups: observation groups that are mirrored, name -> shape without the world axis.
        option: that asks for it: the errors begin with it.

    Raises:
        InputError: the task has none, it lacks a group, or a reflection does not fit.
    """
    mirror = task.mirror()
    if mirror is None:
        raise InputError(f"{option}: task '{task.name}' has no mirror(), which it needs; leave the option away")
    if not isinstance(mirror, Mirror):
        raise InputError(
            f"{option}: mirror() of task '{task.name}' must be a Mirror, got {formatted(mirror)}; return one"
        )
    for name, shape in groups.items():
        thing = f"{option}: mirror() of task '{task.name}'"
        if len(shape) != 1:
            raise InputError(f"{thing}: group '{name}' must be rows of numbers, got {shape}; leave the option away")
        if name not in mirror.observations:
            raise InputError(f"{thing} must have all groups, got none for '{name}'; add its reflection")
        problem = mirror.observations[name].problem(shape[0])
        if problem:
            raise InputError(f"{thing}: reflection of '{name}': {problem}")
    problem = mirror.actions.problem(task.action_size)
    if problem:
        raise InputError(f"{option}: mirror() of task '{task.name}': reflection of actions: {problem}")
    return mirror
