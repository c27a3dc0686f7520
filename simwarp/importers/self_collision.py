"""Whether the parts of an imported robot touch each other: what `self_collision` of the readers means."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable
from typing import Any, Final, Literal, TypeAlias

from simwarp.core.types import WORLD, JointType, ModelError, formatted
from simwarp.core.wording import suggestion
from simwarp.importers.report import ImportReport
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import meeting_pairs
from simwarp.model.shapes import NOT_CONVEX
from simwarp.simulation.state_check import initial_faults

SelfCollision: TypeAlias = bool | Literal["adjacent-off", "overlapping-off"] | None
"""None: as the file says. True: all pairs of parts meet; False: none. "adjacent-off": all but those of bodies that a
joint ties. "overlapping-off": as the file says, but for pairs that overlap as built.
"""
WORDS: Final = ("adjacent-off", "overlapping-off")
UNTIED: Final = (JointType.FREE, JointType.SHAFT, JointType.COMBINATION)
"""Joints that tie no two bodies."""

Pair: TypeAlias = tuple[int, int]


def checked_self_collision(where: str, choice: Any) -> SelfCollision:
    """One of the choices.

    Raises:
        ModelError: it is none of them.
    """
    if choice is None or isinstance(choice, bool) or (isinstance(choice, str) and choice in WORDS):
        return choice  # type: ignore[return-value]
    hint = suggestion(choice, WORDS, "None keeps what the file says")
    raise ModelError(
        f"{where}: self_collision must be True, False, 'adjacent-off' or 'overlapping-off', got "
        f"{formatted(choice)}; {hint}"
    )


def set_self_collision(
    builder: ModelBuilder, choice: SelfCollision, mechanisms: Iterable[Collection[int]], report: ImportReport
) -> None:
    """Makes the pairs of shapes within each mechanism that may meet those of the choice.

    Args:
        builder: with the shapes.
        choice: of the reader's caller.
        mechanisms: indices of the shapes of each; others, as those of the ground, keep their pairs.
        report: gets a line.
    """
    if choice is None:
        return
    own = _own_pairs(builder, mechanisms)
    meeting = meeting_pairs(builder) & own
    if choice == "overlapping-off":
        _part_overlapping(builder, own, report)
        return
    wanted: set[Pair] = own if choice else set()
    if choice == "adjacent-off":
        tied = adjacent_bodies(builder)
        body = [shape.body for shape in builder.shapes]
        wanted = {pair for pair in own if frozenset(body[shape] for shape in pair) not in tied}
    for pair in sorted(wanted - meeting):
        builder.excluded_shapes.discard(pair)
        builder.add_shape_pair(*pair)
    for pair in sorted(meeting - wanted):
        _part(builder, pair)
    report.hold("self collision", "", f"{len(wanted)} pairs of the robot's own shapes may meet ({choice!r})")


def _own_pairs(builder: ModelBuilder, mechanisms: Iterable[Collection[int]]) -> set[Pair]:
    """Pairs of shapes of one mechanism that can move against each other."""
    shapes = builder.shapes
    fixed = _fixed_bodies(builder)
    found = set()
    for mechanism in mechanisms:
        for pair in itertools.combinations(sorted(mechanism), 2):
            one, other = (shapes[shape] for shape in pair)
            moves = one.body != other.body and not {one.body, other.body} <= fixed
            if moves and not {one.type, other.type} <= set(NOT_CONVEX):
                found.add(pair)
    return found


def _fixed_bodies(builder: ModelBuilder) -> set[int]:
    """The world, and what is welded to it."""
    fixed = {WORLD}
    welds = [(joint.parent, joint.child) for joint in builder.joints if joint.type == JointType.FIXED]
    while fresh := {body for weld in welds for body in weld if fixed & set(weld)} - fixed:
        fixed |= fresh
    return fixed


def adjacent_bodies(builder: ModelBuilder) -> set[frozenset[int]]:
    """Pairs of bodies that a joint ties, or joints with nothing but frames without mass between them."""
    beside: dict[int, set[int]] = {}
    for joint in builder.joints:
        if joint.type not in UNTIED:
            beside.setdefault(joint.parent, set()).add(joint.child)
            beside.setdefault(joint.child, set()).add(joint.parent)
    frames = {index for index, body in enumerate(builder.bodies) if body.is_massless}
    found = set()
    for body, first in beside.items():
        front, seen = list(first), {body}
        while front:
            other = front.pop()
            if other not in seen:
                seen.add(other)
                found.add(frozenset((body, other)))
                front += beside[other] if other in frames else ()
    return found


def _part_overlapping(builder: ModelBuilder, own: set[Pair], report: ImportReport) -> None:
    """Parts the pairs that overlap as built, until there are none: slots of contacts keep the deepest."""
    while True:
        overlaps = initial_faults(builder.finalize(1, "cpu")).overlaps if own else ()
        found = {each.shapes: each for each in overlaps if each.shapes in own}
        for pair, overlap in sorted(found.items()):
            _part(builder, pair)
            report.hold("overlapping pair", str(overlap), "the two never meet")
        if not found:
            return


def _part(builder: ModelBuilder, pair: Pair) -> None:
    builder.given_pairs.pop(pair, None)
    builder.exclude_shapes(*pair)
