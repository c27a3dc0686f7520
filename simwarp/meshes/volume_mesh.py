"""Volumes divided into cells: hexahedra or tetrahedra, shares of them that are material, named nodes, a surface."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Names, Readable, ReadableFields, Row, plural
from simwarp.core.rotation import matrix_of
from simwarp.core.types import FLOAT32_MAX, ModelError, Pose, Vec3, formatted, numbers
from simwarp.core.wording import shortened, suggestion
from simwarp.meshes.mesh_parts import (
    FACES,
    KINDS,
    as_array,
    checked_elements,
    checked_fill,
    checked_points,
    element_volumes,
)

Points: TypeAlias = npt.NDArray[np.float64]
Nodes: TypeAlias = npt.NDArray[np.int32]
Where: TypeAlias = Callable[[Points], npt.NDArray[np.bool_]] | tuple[Vec3, Vec3]
"""A function of points (n, 3) [m] whose values (n,) say which are meant, or two opposite corners of a box [m]."""

NEAR = 1e-9
"""Share of a mesh's size by which a node may lie outside a box and count as inside."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class EmbeddedSurface(ReadableFields):
    """A surface whose vertices are carried by a mesh's cells: what is seen of a lattice.

    Attributes:
        cells: (v,) cell that carries each vertex.
        weights: (v, 4) or (v, 8) share of each node of that cell in a vertex; those of a vertex sum to 1.
        triangles: (t, 3) vertices, counter-clockwise seen from outside.
    """

    cells: Nodes
    weights: Points
    triangles: Nodes


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class VolumeMesh(Readable):
    """A volume divided into cells of one kind: what a flexible solid is made of.

    `box`, `lattice`, `tetrahedra` and `read` make one. Arrays are copies that cannot be written to.

    Attributes:
        points: (n, 3) nodes [m].
        elements: (m, 4) tetrahedra or (m, 8) hexahedra: nodes of each cell. Node 3 of a tetrahedron is above the normal
            of the first three; hexahedra go counter-clockwise around their lower face, then around their upper one.
        fill: (m,) share of each cell's volume that is material, above 0 and up to 1; a single number holds for all.
        sets: nodes by name, to hold or glue them: "base": [0, 1, 2].
        surface: what is seen of it, where that is another surface than its cells' own.
        name: what it is called when it is printed, and in errors.
        volumes: (m,) volume of the material in each cell [m³]; follows from the others.

    Raises:
        ModelError: an array has another shape, a cell is flat, inside out or of nodes that are not there, a node is in
            no cell, or a share, a set or the surface breaks its rule.
    """

    points: Points
    elements: Nodes
    fill: Points = dataclasses.field(default_factory=lambda: np.ones(()))
    sets: Mapping[str, Nodes] = dataclasses.field(default_factory=dict)
    surface: EmbeddedSurface | None = None
    name: str = ""
    volumes: Points = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        label = self._label
        points = checked_points(label, self.points)
        elements = as_array(self.elements)
        if elements.ndim == 2 and elements.shape[1] == 3:
            raise ModelError(
                f"{label}: elements must be tetrahedra or hexahedra, got triangles (m, 3); fill their volume with "
                "sw.flex.lattice or sw.flex.tetrahedra"
            )
        elements = checked_elements(label, points, elements)
        unused = np.setdiff1d(np.arange(len(points)), elements)
        if len(unused):
            raise ModelError(
                f"{label}: every node must be in a cell, got {len(unused)} that are not, the first {unused[0]}; "
                "leave them out"
            )
        fill = checked_fill(label, self.fill, len(elements))
        values = {
            "points": _own(points, np.float64), "elements": _own(elements, np.int32), "fill": _own(fill, np.float64),
            "sets": _checked_sets(label, self.sets, len(points)),
            "surface": None if self.surface is None else _checked_surface(label, self.surface, elements),
            "volumes": _own(fill * element_volumes(points, elements), np.float64),
        }  # fmt: skip
        for field, value in values.items():
            object.__setattr__(self, field, value)

    @property
    def _label(self) -> str:
        return f"volume mesh '{shortened(self.name)}'" if self.name else "volume mesh"

    @property
    def kind(self) -> str:
        """What its cells are: "tetrahedra" or "hexahedra"."""
        return KINDS[self.elements.shape[1]]

    @property
    def volume(self) -> float:
        """Volume of all its material [m³]."""
        return math.fsum(self.volumes.tolist())

    @property
    def bounds(self) -> Points:
        """Least and largest coordinates of its nodes, (2, 3) [m]."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    @property
    def boundary_nodes(self) -> Nodes:
        """Nodes on its cells' outside, (b,), in increasing order."""
        return np.unique(self._outer_faces)

    @property
    def boundary_triangles(self) -> Nodes:
        """Triangles (t, 3) of its cells' outside, counter-clockwise seen from there; faces of four nodes are halved."""
        return _halved(self._outer_faces)

    @functools.cached_property
    def _outer_faces(self) -> Nodes:
        """(f, 3) or (f, 4) faces of one cell alone."""
        return np.asarray(_own(_faces_of(self.elements), np.int32))

    def nodes_where(self, where: Where) -> Nodes:
        """Nodes (k,) in a box or of a property, in increasing order.

        Args:
            where: two opposite corners of a box [m], which may be infinite and are part of it, or a function of the
                nodes (n, 3) [m] that returns True (n,) for those that are meant: `lambda x: x[:, 2] < 0.01`.

        Raises:
            ModelError: it is neither, or there is no such node.
        """
        if callable(where):
            meant = np.asarray(where(self.points))
            if meant.shape != (len(self.points),) or meant.dtype != np.bool_:
                raise ModelError(
                    f"{self._label}: nodes_where must be given a function that returns {len(self.points)} truth "
                    f"values, got {meant.dtype} {meant.shape}; write lambda x: x[:, 2] < 0.01"
                )
        else:
            corners = numbers(where)
            if corners.shape != (2, 3) or np.isnan(corners).any():
                raise ModelError(
                    f"{self._label}: nodes_where must be given a function or two corners of a box, got "
                    f"{formatted(where)}; write ((x, y, z), (x, y, z)) [m]"
                )
            near = NEAR * float(np.ptp(self.points, axis=0).max())
            low, high = corners.min(axis=0) - near, corners.max(axis=0) + near
            meant = ((self.points >= low) & (self.points <= high)).all(axis=1)
        if not meant.any():
            low, high = self.bounds.tolist()
            raise ModelError(
                f"{self._label}: nodes_where must find a node, got none; the mesh goes from {formatted(tuple(low))} to "
                f"{formatted(tuple(high))}"
            )
        return np.flatnonzero(meant).astype(np.int32)

    def nodes_of(self, which: str | npt.ArrayLike) -> Nodes:
        """Nodes (k,) of a named set, or these nodes themselves, in increasing order.

        Raises:
            ModelError: there is no such set, or they are no nodes.
        """
        if not isinstance(which, str):
            return _checked_sets(self._label, {"nodes": which}, len(self.points))["nodes"]
        if which not in self.sets:
            known = suggestion(which, self.sets, f"it has {', '.join(map(repr, self.sets)) or 'none'}")
            raise ModelError(f"{self._label}: a set of nodes must be one of its own, got {formatted(which)}; {known}")
        return self.sets[which]

    def with_sets(self, **sets: npt.ArrayLike) -> VolumeMesh:
        """A mesh with further named sets of nodes, each (k,), or with other nodes in those it has.

        Raises:
            ModelError: a set is empty, or of nodes that are not there.
        """
        return dataclasses.replace(self, sets={**self.sets, **_checked_sets(self._label, sets, len(self.points))})

    def scaled(self, factor: float | Vec3) -> VolumeMesh:
        """The mesh enlarged about the origin, by one factor or by one for each axis.

        Raises:
            ModelError: a factor is not positive.
        """
        factors = numbers(factor)
        if factors.shape not in ((), (3,)) or not ((factors > 0.0) & (factors <= FLOAT32_MAX)).all():
            raise ModelError(
                f"{self._label}: scaled must be given one or three positive factors, got {formatted(factor)}; "
                "0.001 makes metres of millimetres"
            )
        return dataclasses.replace(self, points=self.points * factors)

    def placed(self, pose: Pose) -> VolumeMesh:
        """The mesh turned about the origin, then moved: `mesh.placed(sw.pose((0, 0, 1)))`.

        Raises:
            ModelError: it is no pose.
        """
        if not isinstance(pose, Pose):
            raise ModelError(f"{self._label}: placed must be given a pose, got {formatted(pose)}; write sw.pose(...)")
        return dataclasses.replace(self, points=self.points @ matrix_of(pose.rotation).T + pose.position)

    def surface_vertices(self, points: npt.ArrayLike | None = None) -> Points:
        """Vertices (v, 3) of its embedded surface [m], where the nodes are at `points` (n, 3) [m]; None: at rest.

        Raises:
            ModelError: it has no embedded surface, or not so many nodes.
        """
        if self.surface is None:
            raise ModelError(
                f"{self._label}: surface_vertices must have an embedded surface, got none; use boundary_triangles"
            )
        given = self.points if points is None else numbers(points)
        if given.shape != self.points.shape:
            raise ModelError(
                f"{self._label}: points must be of shape {self.points.shape}, got {given.shape}; give all nodes [m]"
            )
        corners = given[self.elements[self.surface.cells]]
        return np.asarray(np.einsum("vk,vki->vi", self.surface.weights, corners))

    def _readable_title(self) -> str:
        name = f" '{self.name}'" if self.name else ""
        return f"{name}: {plural(len(self.points), 'node')}, {len(self.elements)} {self.kind}"

    def _readable_rows(self) -> Mapping[str, Row]:
        low, high = (tuple(float(f"{value:.4g}") for value in corner) for corner in self.bounds)
        share = self.volume / math.fsum((self.volumes / self.fill).tolist())
        seen = self.surface
        return {
            "extent": f"{low} to {high} m",
            "volume": f"{self.volume:.4g} m³" + (f", {share:.0%} of its cells" if (self.fill < 1.0).any() else ""),
            "sets": Names(len(self.sets), self.sets),
            "surface": "" if seen is None else f"{len(seen.cells)} vertices, {plural(len(seen.triangles), 'triangle')}",
        }


def boundary_of(elements: Nodes) -> Nodes:
    """Triangles (t, 3) of the outside of cells (m, 4) or (m, 8), counter-clockwise seen from there."""
    return _halved(_faces_of(elements))


def _faces_of(elements: Nodes) -> Nodes:
    """(f, 3) or (f, 4) faces of one cell alone."""
    corners = FACES[elements.shape[1]]
    faces = elements[:, corners].reshape(-1, len(corners[0]))
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(faces[np.sort(first[count == 1])])


def _halved(faces: Nodes) -> Nodes:
    """Triangles of faces, of which those of four nodes are halved."""
    if faces.shape[1] == 3:
        return faces
    return np.stack([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]], axis=1).reshape(-1, 3)


def _own(values: Any, dtype: Any) -> Any:
    """A copy that cannot be written to."""
    copy = np.array(values, dtype=dtype)
    copy.flags.writeable = False
    return copy


def _checked_sets(label: str, sets: Any, count: int) -> dict[str, Nodes]:
    """Named sets of different nodes in increasing order."""
    if not isinstance(sets, Mapping):
        raise ModelError(f"{label}: sets must map names to nodes, got {formatted(sets)}; write {{'base': [0, 1]}}")
    found = {}
    for name, nodes in sets.items():
        if not isinstance(name, str) or not name.strip():
            raise ModelError(f"{label}: names of sets must be text, got {formatted(name)}; name the nodes")
        given = as_array(nodes)
        if given.ndim != 1 or not len(given) or given.dtype.kind not in "iu":
            raise ModelError(
                f"{label}: set '{shortened(name)}' must be of one node or more, got {formatted(nodes)}; give their "
                "numbers, or leave it out"
            )
        if given.min() < 0 or given.max() >= count:
            wrong = given[(given < 0) | (given >= count)][0]
            raise ModelError(
                f"{label}: nodes of set '{shortened(name)}' must be 0 to {count - 1}, got {formatted(wrong)}; number "
                "them as the points"
            )
        found[name] = _own(np.unique(given), np.int32)
    return found


def _checked_surface(label: str, surface: Any, elements: Nodes) -> EmbeddedSurface:
    """A surface whose vertices are in cells that are there."""
    if not isinstance(surface, EmbeddedSurface):
        raise ModelError(f"{label}: surface must be an EmbeddedSurface, got {formatted(surface)}; leave it out")
    cells, triangles, weights = as_array(surface.cells), as_array(surface.triangles), numbers(surface.weights)
    count = len(elements)
    if cells.ndim != 1 or cells.dtype.kind not in "iu" or ((cells < 0) | (cells >= count)).any():
        raise ModelError(f"{label}: cells of its surface must be 0 to {count - 1}, got others; give one per vertex")
    shape = (len(cells), elements.shape[1])
    if weights.shape != shape or not (np.abs(weights.sum(axis=1) - 1.0) < 1e-6).all():
        raise ModelError(
            f"{label}: weights of its surface must be of shape {shape} and sum to 1 for each vertex, got "
            f"{formatted(surface.weights)}; give the share of each node of the vertex's cell"
        )
    wrong = triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu"
    if wrong or ((triangles < 0) | (triangles >= len(cells))).any():
        raise ModelError(
            f"{label}: triangles of its surface must be of vertices 0 to {len(cells) - 1}, got "
            f"{formatted(surface.triangles)}; give three vertices for each"
        )
    return EmbeddedSurface(
        cells=_own(cells, np.int32), weights=_own(weights, np.float64), triangles=_own(triangles, np.int32)
    )
