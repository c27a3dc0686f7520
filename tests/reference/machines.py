"""Machines that stand in one world and share no joint, and who belongs to whom, found by walking from body to body.

A machine is a floating base with a planar four-bar on it, a shaft that is geared to its crank, a sprung sum of two
angles and a sum with friction alone: it has every kind of bilateral row, and bounded impulses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from simwarp.core.types import WORLD, JointType, Material, Vec3, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.joint_types import ELEMENTS

PARTS = 4
"""Bodies of a machine."""

JOINTS = 7
"""Joints of a machine, of one coordinate each."""

CENTRES = np.array([(0.0, 0.0, 0.0), (-0.3, 0.0, 0.2), (0.0, 0.0, 0.45), (0.3, 0.0, 0.25)])
"""Of the base, the crank, the coupler and the rocker [m]."""

PINS = {"crank": (-0.3, 0.0, 0.0), "pin": (-0.3, 0.0, 0.4), "rocker": (0.3, 0.0, 0.0), "loop": (0.3, 0.0, 0.5)}
"""Points of the four hinges [m]."""


def machines(
    places: Sequence[Vec3], *, speeds: Sequence[float] = (3.0, 2.4, 1.8), approach: float = 0.0, shapes: bool = False
) -> ModelBuilder:
    """Machines whose bodies and joints are added in turn, so that their rows stand side by side.

    Args:
        places: of the machines [m].
        speeds: of their cranks in turn [rad/s]; not consistent with the loop.
        approach: of every second machine, along -Y [m/s].
        shapes: whether every base is a ball of 0.3 m.
    """
    builder = ModelBuilder()
    at = np.array(places, float)
    for part in range(PARTS):
        for index, place in enumerate(at):
            builder.add_body(
                f"body{part}_{index}", mass=4.0 - 0.7 * part, inertia=(0.05, 0.06 + 0.01 * part, 0.04),
                pose=pose(place + CENTRES[part]), velocity=(0.0, -approach * (index % 2), 0.0),
                omega=(0.0, speeds[index % len(speeds)] * (part == 1), 0.0),
            )  # fmt: skip
    hinges = [("crank", 0, 1), ("pin", 1, 2), ("rocker", 0, 3), ("loop", 2, 3)]
    for name, parent, child in hinges:
        for index, place in enumerate(at):
            builder.add_joint_revolute(
                f"{name}_{index}", parent * len(at) + index, child * len(at) + index, axis=(0.0, 1.0, 0.0),
                anchor=tuple(place + PINS[name]),
            )  # fmt: skip
    shafts = [builder.add_shaft(f"shaft_{index}", inertia=0.02, speed=2.0) for index in range(len(at))]
    for index in range(len(at)):
        builder.add_coupling(f"gear_{index}", [(shafts[index], 1.0), (index, -2.5)])
    for index in range(len(at)):
        both = [(index, 1.0), (len(at) + index, 0.5)]
        builder.add_combination(f"spring_{index}", both, stiffness=20.0, damping=0.3)
    for index in range(len(at)):
        builder.add_combination(f"rub_{index}", [(index, 1.0), (2 * len(at) + index, -1.0)], friction=0.4)
    for index in range(len(at)):
        if shapes:
            builder.add_shape_sphere(index, radius=0.3, material=Material(friction=0.5))
    return builder


def of_machine(index: int, count: int, each: int) -> list[int]:
    """Places of one machine's things, of which it has `each`, among those of `count` machines added in turn."""
    return [thing * count + index for thing in range(each)]


def connected(builder: ModelBuilder) -> list[set[tuple[str, int]]]:
    """Bodies ("body", index) and shafts ("shaft", joint) that joints or sums of coordinates tie together."""
    neighbours: dict[tuple[str, int], set[tuple[str, int]]] = {("body", b): set() for b in range(len(builder.bodies))}
    ends = []
    for joint, spec in enumerate(builder.joints):
        if spec.type == JointType.SHAFT:
            ends.append([("shaft", joint)])
            neighbours["shaft", joint] = set()
        else:
            ends.append([("body", body) for body in (spec.parent, spec.child) if body != WORLD])
    owner = [joint for joint, spec in enumerate(builder.joints) for _ in ELEMENTS[spec.type].dofs]
    sums = [[end for dof, _ in each.terms for end in ends[owner[dof]]] for each in builder.couplings]
    sums += [
        [end for dof, _ in spec.terms for end in ends[owner[dof]]]
        for spec in builder.joints
        if spec.type == JointType.COMBINATION
    ]
    for tied in [*ends, *sums]:
        for node in tied:
            neighbours[node] |= set(tied)
    found: list[set[tuple[str, int]]] = []
    left = set(neighbours)
    while left:
        reached, frontier = set(), {min(left)}
        while frontier:
            reached |= frontier
            frontier = set().union(*(neighbours[node] for node in frontier)) - reached
        found.append(reached)
        left -= reached
    return found
