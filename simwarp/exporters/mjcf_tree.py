"""The spanning tree of a model as MJCF has it: bodies in bodies, each with the joints between it and its parent.

Poses are those where all coordinates are zero. A massless frame between joints is no body there: its joints are those
of the body behind it.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of
from simwarp.core.types import WORLD, JointType, ModelError
from simwarp.model.joint_types import X, Y, Z
from simwarp.model.model import Model

Array = npt.NDArray[np.float64]


class Place(NamedTuple):
    """A frame: origin [m] and axes as columns."""

    x: Array
    axes: Array

    def of(self, other: Place) -> Place:
        """The other frame, which is given in this one, in the frame that this one is given in."""
        return Place(self.x + self.axes @ other.x, self.axes @ other.axes)

    def inverse(self) -> Place:
        """This frame's own reference, seen from it."""
        return Place(-self.axes.T @ self.x, self.axes.T)


class Motion(NamedTuple):
    """One joint of MJCF that is part of one of ours: its kind and the axis of the joint's frames that it has."""

    kind: str
    axis: int


MOTIONS: Final[dict[JointType, tuple[Motion, ...]]] = {
    JointType.FIXED: (),
    JointType.REVOLUTE: (Motion("hinge", Z),),
    JointType.PRISMATIC: (Motion("slide", Z),),
    JointType.SPHERICAL: (Motion("ball", Z),),
    JointType.CYLINDRICAL: (Motion("slide", Z), Motion("hinge", Z)),
    JointType.UNIVERSAL: (Motion("hinge", X), Motion("hinge", Y)),
    JointType.PLANAR: (Motion("slide", X), Motion("slide", Y), Motion("hinge", Z)),
}
"""Joints of MJCF that make up one of ours, in the order of its coordinates, which is that from parent to child."""


@dataclasses.dataclass(frozen=True)
class PlacedMotion:
    """A motion between a body and its parent.

    Attributes:
        joint: of ours.
        local: first of the joint's coordinates that it has.
        kind: "hinge", "slide" or "ball".
        anchor: in the world, at zero [m].
        axis: in the world, at zero; a unit vector.
    """

    joint: int
    local: int
    kind: str
    anchor: Array
    axis: Array


@dataclasses.dataclass(frozen=True)
class Node:
    """A body in the tree.

    Attributes:
        body: index.
        parent: body that carries it, or WORLD.
        place: of its centre of mass and axes in the world, at zero.
        origin: of its frame in the file from its centre of mass, body axes [m].
        motions: from its parent to itself.
        floats: it has six coordinates of its own.
        free_joint: the joint that names them; -1: none does.
    """

    body: int
    parent: int
    place: Place
    origin: Array
    motions: tuple[PlacedMotion, ...]
    floats: bool
    free_joint: int = -1

    @property
    def frame(self) -> Place:
        """The body's frame in the file, in the world."""
        return Place(self.place.x + self.place.axes @ self.origin, self.place.axes)


def row_of(model: Model, name: str, world: int) -> npt.NDArray[Any]:
    """A parameter of one world."""
    values: npt.NDArray[Any] = getattr(model, name).numpy()
    return values[world if values.shape[0] > 1 else 0]


def nodes_of(model: Model, world: int) -> list[Node]:
    """The bodies with mass, parents before children.

    Raises:
        ModelError: the model is no tree, or has a joint that MJCF has not.
    """
    _check_tree(model)
    builder, links = model.builder, model.tables.links
    frames = _joint_frames(model, world)
    places: dict[int, Place] = {WORLD: Place(np.zeros(3), np.eye(3))}
    waiting: dict[int, tuple[int, tuple[PlacedMotion, ...]]] = {}  # of massless bodies: parent and motions so far
    nodes = []
    for link in links:
        spec = builder.bodies[link.body]
        built = Place(np.array(spec.pose.position), matrix_of(spec.pose.rotation))
        if link.type is JointType.FREE:
            places[link.body] = built
            origin = np.zeros(3) if link.joint < 0 else frames[link.joint][1].x
            nodes.append(Node(link.body, WORLD, built, origin, (), True, link.joint))
            continue
        parent = WORLD if link.parent < 0 else links[link.parent].body
        near, far = frames[link.joint] if link.sign > 0.0 else frames[link.joint][::-1]
        start = places[parent].of(near)
        places[link.body] = start.of(far.inverse())
        carrier, motions = waiting.pop(parent, (parent, ())) if _is_massless(model, parent) else (parent, ())
        motions += _motions(model, link.joint, link.sign, start)
        if spec.is_massless:
            waiting[link.body] = (carrier, motions)
        else:
            nodes.append(Node(link.body, carrier, places[link.body], np.zeros(3), motions, False))
    return nodes


def _is_massless(model: Model, body: int) -> bool:
    return body != WORLD and not bool(model.has_mass[body])


def _joint_frames(model: Model, world: int) -> list[tuple[Place, Place]]:
    """Frames of every joint on its parent and on its child."""
    names = ("joint_anchor0", "joint_frame0", "joint_anchor1", "joint_frame1")
    x0, axes0, x1, axes1 = (row_of(model, name, world).astype(np.float64) for name in names)
    return [
        (Place(x0[joint], axes0[joint]), Place(x1[joint], axes1[joint])) for joint in range(model.joint_count)
    ]  # fmt: skip


def _motions(model: Model, joint: int, sign: float, start: Place) -> tuple[PlacedMotion, ...]:
    """The motions of a joint from the body nearer to the root on; where that is the joint's child, in turned order."""
    spec = model.builder.joints[joint]
    if spec.type is JointType.SPHERICAL and sign < 0.0:
        raise ModelError(
            f"MJCF: joint '{spec.name}': a ball must lead from the body nearer to the root, got its child there; "
            "exchange parent and child"
        )
    found = [
        PlacedMotion(joint, local, motion.kind, start.x, sign * start.axes[:, motion.axis])
        for local, motion in enumerate(MOTIONS[spec.type])
    ]
    return tuple(found if sign > 0.0 else found[::-1])


def _check_tree(model: Model) -> None:
    """Refuse what closes loops or has no counterpart."""
    builder = model.builder
    if builder.couplings:
        raise ModelError(f"MJCF: couplings are not written, got '{builder.couplings[0].name}'; leave them out")
    in_tree = {link.joint for link in model.tables.links}
    for index, joint in enumerate(builder.joints):
        thing = f"MJCF: joint '{joint.name}'"
        if joint.type is not JointType.FREE and joint.type not in MOTIONS:
            raise ModelError(
                f"{thing}: its type must be one that bodies of a tree have, got {joint.type.name}; drop it"
            )
        if index not in in_tree:
            raise ModelError(f"{thing}: the model must be a tree, but it closes a loop; leave it out")
    children: dict[int, int] = {}
    for link in model.tables.links:
        above = WORLD if link.parent < 0 else model.tables.links[link.parent].body
        children[above] = children.get(above, 0) + 1
    for body, count in children.items():
        if _is_massless(model, body) and count > 1:
            name = model.body_names[body]
            raise ModelError(f"MJCF: massless body '{name}' must carry one body, got {count}; give it mass")
