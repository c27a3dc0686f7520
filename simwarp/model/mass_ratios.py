"""Masses that are too far apart: a light body that has to pass on the load of a heavy one."""

from __future__ import annotations

from collections import Counter
from typing import Final, NamedTuple

import numpy as np

from simwarp.core.types import WORLD, JointType
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.specifications import Specification

SOUND_RATIO: Final = 1.0e5
"""What float32 holds beside each other: a velocity of 1 m/s to 1e-7 is one of 1 cm/s of what is 1e5 times lighter."""


SOUND_ROD_RATIO: Final = 3.0e5
"""What a rod's node carries, over its mass: at 2e5 a swinging wire keeps its energy, at 4e5 it gains some.
"""


class RodRatio(NamedTuple):
    """A rod whose lightest node is far lighter than what hangs on it."""

    node: str
    mass: float
    load: str
    load_mass: float

    def __str__(self) -> str:
        ratio = self.load_mass / self.mass
        return (
            f"rod node '{self.node}' has {self.mass:.3g} kg and has to carry body '{self.load}' of "
            f"{self.load_mass:.3g} kg, {ratio:.2g} times as much; rods hold up to {SOUND_ROD_RATIO:g}: take fewer "
            "elements, or a thicker rod"
        )


def unsound_rod(builder: Specification) -> RodRatio | None:
    """The worst rod that carries more than `SOUND_ROD_RATIO` of its lightest node; None where there is none.

    A rod carries the second heaviest of what it ties, where the world is the heaviest of all: one that hangs on a heavy
    body with nothing at its other end has nothing to carry.
    """
    rods = _Groups(len(builder.bodies))
    nodes = set()
    for spec in builder.joints:
        if spec.type is JointType.ELASTIC:
            nodes |= {spec.parent, spec.child} - {WORLD}
            if min(spec.parent, spec.child) >= 0:
                rods.join(spec.parent, spec.child)
    masses = [0.0 if body.is_massless else body.mass for body in builder.bodies]
    tied: dict[int, set[int]] = {}
    for spec in builder.joints:
        for one, other in ((spec.parent, spec.child), (spec.child, spec.parent)):
            if one in nodes and other not in nodes:
                tied.setdefault(rods.of(one), set()).add(other)
    worst: tuple[float, int, int] | None = None
    for rod, bodies in tied.items():
        heavy = sorted(bodies, key=lambda body: np.inf if body == WORLD else masses[body])
        light = min((node for node in nodes if rods.of(node) == rod and masses[node] > 0.0), key=masses.__getitem__)
        if len(heavy) > 1 and masses[heavy[-2]] > SOUND_ROD_RATIO * masses[light]:
            ratio = masses[heavy[-2]] / masses[light]
            worst = max(worst or (ratio, light, heavy[-2]), (ratio, light, heavy[-2]))
    if worst is None:
        return None
    _, light, load = worst
    return RodRatio(builder.bodies[light].name, masses[light], builder.bodies[load].name, masses[load])


class MassRatio(NamedTuple):
    """Two bodies of which the light one has joints on both sides or shapes, in a mechanism or a heap with the other."""

    light: str
    mass: float
    heavy: str
    heavy_mass: float

    def __str__(self) -> str:
        ratio = self.heavy_mass / self.mass
        return (
            f"body '{self.light}' has {self.mass:.3g} kg and may have to carry body '{self.heavy}' of "
            f"{self.heavy_mass:.3g} kg, {ratio:.2g} times as much; float32 and steps of milliseconds hold up to "
            f"{SOUND_RATIO:g}: give it more mass, fix it to a neighbour (add_joint_fixed), or use add_massless_body"
        )


def unsound_ratio(builder: Specification, meets: frozenset[int]) -> MassRatio | None:
    """The worst pair of masses whose ratio is above `SOUND_RATIO`; None where there is none.

    Bodies that joints fix to each other count as one. A light body at the end of a mechanism that touches nothing has
    nothing to carry.

    Args:
        builder: of the model.
        meets: bodies with shapes that may touch others.
    """
    rigid, joined = _Groups(len(builder.bodies)), _Groups(len(builder.bodies))
    ends: list[tuple[int, int]] = []
    for spec in builder.joints:
        if not ELEMENTS[spec.type].rows or min(spec.parent, spec.child) < 0:
            ends += [(spec.parent, spec.child)] if ELEMENTS[spec.type].rows else []
            continue
        joined.join(spec.parent, spec.child)
        if spec.type is JointType.FIXED:
            rigid.join(spec.parent, spec.child)
        else:
            ends.append((spec.parent, spec.child))
    joints = Counter(rigid.of(body) for pair in ends for body in pair if body >= 0)
    masses = np.zeros(len(builder.bodies))
    for body, each in enumerate(builder.bodies):
        masses[rigid.of(body)] += 0.0 if each.is_massless else each.mass
    touching = {rigid.of(body) for body in meets}
    groups = [group for group in range(len(masses)) if masses[group] > 0.0]
    heaviest: dict[int | None, int] = {}  # of each mechanism, and of what touches
    for group in sorted(groups, key=lambda each: masses[each]):
        heaviest[joined.of(group)] = group
        if group in touching:
            heaviest[None] = group
    worst: tuple[float, int, int] = (SOUND_RATIO, 0, 0)
    for group in groups:
        if joints[group] < 2 and group not in touching:
            continue
        for key in (joined.of(group), None) if group in touching else (joined.of(group),):
            ratio = float(masses[heaviest[key]] / masses[group])
            worst = (ratio, group, heaviest[key]) if ratio > worst[0] else worst
    ratio, light, heavy = worst
    if ratio <= SOUND_RATIO:
        return None
    names = [body.name for body in builder.bodies]
    return MassRatio(names[light], float(masses[light]), names[heavy], float(masses[heavy]))


class _Groups:
    """Disjoint sets of bodies, each known by its lowest index."""

    def __init__(self, count: int) -> None:
        self._above = list(range(count))

    def of(self, body: int) -> int:
        while self._above[body] != body:
            body = self._above[body]
        return body

    def join(self, one: int, other: int) -> None:
        low, high = sorted((self.of(one), self.of(other)))
        self._above[high] = low
