"""What is seen of a flexible mesh: triangles whose vertices go with its nodes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import ReadableFields
from simwarp.core.types import ModelError
from simwarp.meshes.mesh_parts import MeshPart
from simwarp.meshes.volume_mesh import EmbeddedSurface, boundary_of

Array: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int32]


@dataclasses.dataclass(frozen=True, eq=False)
class MeshSurface(ReadableFields):
    """Triangles over the nodes of a mesh.

    Attributes:
        nodes: (v, k) nodes that carry each vertex.
        weights: (v, k) share of each of them; those of a vertex sum to 1.
        triangles: (t, 3) vertices; of solids counter-clockwise seen from outside, of sheets about their normal.
    """

    nodes: Ints
    weights: Array
    triangles: Ints

    @property
    def is_embedded(self) -> bool:
        """Whether several nodes carry a vertex."""
        return self.nodes.shape[1] > 1

    def vertices(self, places: npt.ArrayLike) -> Array:
        """Vertices (..., v, 3), where the nodes are at `places` (..., n, 3) [m]."""
        carried = np.asarray(places, np.float64)[..., self.nodes, :]
        return np.asarray(np.einsum("vk,...vki->...vi", self.weights, carried))


def surface_of(parts: Sequence[MeshPart], embedded: EmbeddedSurface | None = None) -> MeshSurface:
    """The surface of a mesh.

    Args:
        parts: its elements: of sheets all triangles, of solids the faces that one element alone has.
        embedded: what is seen in place of the solids' faces; its cells are the elements of the first part.
    """
    if embedded is not None:
        return MeshSurface(parts[0].elements[embedded.cells], embedded.weights, embedded.triangles)
    nodes, triangles = np.unique(outer_triangles(parts), return_inverse=True)
    return MeshSurface(
        nodes[:, None].astype(np.int32), np.ones((len(nodes), 1)), triangles.reshape(-1, 3).astype(np.int32)
    )


def outer_triangles(parts: Sequence[MeshPart]) -> Ints:
    """(t, 3) nodes of a mesh's triangles: of sheets all, of solids the faces that one element alone has."""
    faces = [part.elements for part in parts if part.kind == "triangles"]
    for kind in ("tetrahedra", "hexahedra"):
        solids = [part.elements for part in parts if part.kind == kind]
        if solids:
            faces.append(boundary_of(np.concatenate(solids)))
    return np.concatenate(faces)


def checked_surface(label: str, count: int, nodes: Any, weights: Any, triangles: Any) -> MeshSurface:
    """A surface over `count` nodes, of arrays that were read from a file.

    Raises:
        ModelError: a node or a vertex is not there, or weights do not sum to 1.
    """
    if nodes.ndim != 2 or weights.shape != nodes.shape or ((nodes < 0) | (nodes >= count)).any():
        raise ModelError(f"{label}: vertices of the surface must be carried by nodes 0 to {count - 1}, with weights")
    if not (np.abs(weights.sum(axis=1) - 1.0) < 1e-6).all():
        raise ModelError(f"{label}: weights of the surface must sum to 1 for each vertex")
    if ((triangles < 0) | (triangles >= len(nodes))).any():
        raise ModelError(f"{label}: triangles of the surface must be of vertices 0 to {len(nodes) - 1}")
    return MeshSurface(nodes, weights, triangles)
