"""A mesh of a builder: rest shape, elements, and what its nodes hang on."""

from __future__ import annotations

import dataclasses
import enum
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import ReadableFields
from simwarp.core.types import WORLD
from simwarp.meshes.mesh_parts import MeshPart
from simwarp.meshes.mesh_surfaces import MeshSurface

Array: TypeAlias = npt.NDArray[np.float64]


class MeshContact(enum.IntEnum):
    """Where a mesh touches other shapes."""

    NODES = 0
    """At the nodes of its surface, by a sphere on each."""
    FACES = 1
    """There, and between them on the edges and insides of its surface's triangles, which are as thick."""


@dataclasses.dataclass(frozen=True, eq=False)
class FlexibleMesh(ReadableFields):
    """A mesh of a builder and of its models.

    Attributes:
        name: of it; nodes that move by themselves are bodies `name_0` and on, with the number of the node.
        points: (n, 3) nodes of the rest shape [m].
        parts: its elements.
        bodies: (n,) of each node: its own, or that which it is glued to; WORLD: it is fixed.
        glued: (n,) whether a node is glued to that body.
        places: (n, 3) nodes as built, world frame [m].
        double: whether its matrix is factored in double precision.
        shapes: spheres of nodes that touch others.
        surface: what is seen of it.
        contact: where it touches other shapes.
    """

    name: str
    points: Array
    parts: tuple[MeshPart, ...]
    bodies: tuple[int, ...]
    glued: tuple[bool, ...]
    places: Array
    double: bool
    shapes: tuple[int, ...]
    surface: MeshSurface
    contact: MeshContact = MeshContact.NODES

    @property
    def nodes(self) -> tuple[int, ...]:
        """Nodes that move by themselves, in ascending order."""
        return tuple(
            node for node, (body, glued) in enumerate(zip(self.bodies, self.glued, strict=True))
            if body != WORLD and not glued
        )  # fmt: skip

    @property
    def owner(self) -> int:
        """The body that it is glued to; WORLD: it is not."""
        return next((body for body, glued in zip(self.bodies, self.glued, strict=True) if glued), WORLD)
