"""Meshes as a user gives them: points, and parts of one kind of element and one material."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.types import FLOAT32_LEAST, FLOAT32_MAX, ModelError, formatted, host_values, number, numbers
from simwarp.meshes.materials import Elastic, Rubber
from simwarp.meshes.solid_elements import CORNERS, hexahedra_volumes, natural_slopes

KINDS = {3: "triangles", 4: "tetrahedra", 8: "hexahedra"}
"""Elements by their number of nodes."""
FACES = {
    4: ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
    8: ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
"""Faces of an element by its number of nodes, counter-clockwise seen from outside."""
FLAT = 1e-9
"""Area or volume of an element, over that of a regular one of its size, below which it is flat."""
MOST_POISSON = 0.45
"""Of tetrahedra: above, they lock, as each must keep its volume."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeshPart:
    """Elements of one kind and one material.

    Attributes:
        elements: (e, 3) triangles, (e, 4) tetrahedra or (e, 8) hexahedra: nodes of each. Triangles go counter-clockwise
            about their normal, tetrahedra have node 3 above the normal of the first three, hexahedra go
            counter-clockwise around their lower face, then around their upper one.
        material: what it is made of.
        thickness: of triangles [m].
        pressure: that pushes triangles along their normals [Pa].
        fill: (e,) share of each solid element's volume that is material, above 0 and up to 1: mass and stiffness are
            those of the element times it. None: 1.
    """

    elements: npt.NDArray[np.int32]
    material: Elastic | Rubber
    thickness: float | None = None
    pressure: float = 0.0
    fill: npt.NDArray[np.float64] | None = None

    @property
    def kind(self) -> str:
        """Name of its elements."""
        return KINDS[self.elements.shape[1]]


def as_array(values: Any) -> npt.NDArray[Any]:
    """Values as an array: a single NaN where they are none, as rows of different lengths."""
    try:
        return np.asarray(host_values(values))
    except (TypeError, ValueError, RuntimeError):
        return np.full((), np.nan)


def checked_points(label: str, points: Any) -> npt.NDArray[np.float64]:
    """Points of a mesh, (n, 3), finite.

    Raises:
        ModelError: they are not.
    """
    given = numbers(points)
    if given.ndim != 2 or given.shape[1] != 3 or not len(given):
        raise ModelError(f"{label}: points must be of shape (n, 3), got {given.shape}; give x, y, z of each node [m]")
    bad = np.flatnonzero(~(np.abs(given) <= FLOAT32_MAX).all(axis=1))
    if len(bad):
        raise ModelError(
            f"{label}: points must be finite, got {formatted(given[bad[0]].tolist())} for node {bad[0]}; "
            "replace or leave out such values"
        )
    return given


def checked_elements(label: str, points: npt.NDArray[np.float64], elements: Any) -> npt.NDArray[np.int32]:
    """Elements (e, 3), (e, 4) or (e, 8) between points that are neither flat nor inside out.

    Raises:
        ModelError: an element is of no known kind, flat, inside out or of nodes that are not there.
    """
    elements = as_array(elements)
    if elements.ndim != 2 or elements.shape[1] not in KINDS or not len(elements) or elements.dtype.kind not in "iu":
        raise ModelError(
            f"{label}: elements must be integers of shape (e, 3), (e, 4) or (e, 8), got {elements.dtype} "
            f"{elements.shape}; give the nodes of triangles, tetrahedra or hexahedra"
        )
    wrong = np.flatnonzero(((elements < 0) | (elements >= len(points))).any(axis=1))
    if len(wrong):
        raise ModelError(
            f"{label}: nodes of an element must be 0 to {len(points) - 1}, got {elements[wrong[0]].tolist()} for "
            f"element {wrong[0]}; number nodes as the points"
        )
    kind = KINDS[elements.shape[1]]
    shape = _shapes(points, elements)
    if (shape < FLAT).any():
        worst = int(np.argmin(shape))
        what = "inside out" if shape[worst] < -FLAT else "flat"
        raise ModelError(
            f"{label}: {kind} must have a positive {'area' if kind == 'triangles' else 'volume'}, got element {worst} "
            f"of nodes {elements[worst].tolist()}, which is {what}; reorder its nodes or repair the mesh"
        )
    return elements.astype(np.int32)


def checked_fill(label: str, fill: Any, count: int) -> npt.NDArray[np.float64]:
    """(e,) shares of elements' volumes, of one share for all or of one for each.

    Raises:
        ModelError: there are more or fewer, or one is not above 0 and at most 1.
    """
    given = numbers(fill)
    if given.shape not in ((), (count,)):
        raise ModelError(f"{label}: fill must be one share, or {count}, got {formatted(fill)}; give one per element")
    wrong = np.flatnonzero(~((given > 0.0) & (given <= 1.0)))
    if len(wrong):
        raise ModelError(
            f"{label}: fill must be above 0 and at most 1, got {formatted(given.reshape(-1)[wrong[0]])} for element "
            f"{wrong[0]}; it is a share of a volume, leave empty elements out"
        )
    return np.broadcast_to(given, count).copy()


def checked_part(label: str, points: npt.NDArray[np.float64], part: MeshPart) -> MeshPart:
    """A part whose elements are what they should be.

    Raises:
        ModelError: an element is of no known kind, flat, inside out or of nodes that are not there, or a number of the
            part breaks its rule.
    """
    if not isinstance(part.material, (Elastic, Rubber)):
        raise ModelError(
            f"{label}: material must be an Elastic or Rubber, got {formatted(part.material)}; "
            "write sw.flex.Rubber(young=1e6, density=1000.0)"
        )
    elements = checked_elements(label, points, part.elements)
    kind = KINDS[elements.shape[1]]
    if kind == "tetrahedra" and part.material.poisson > MOST_POISSON:
        raise ModelError(
            f"{label}: poisson of tetrahedra must be at most {MOST_POISSON}, got {part.material.poisson!r}: they would "
            "be far too stiff; use hexahedra, or lower it"
        )
    if kind == "triangles":
        part = _checked_sheet(label, elements, part)
    else:
        _check_faces(label, elements)
        if part.thickness is not None or part.pressure != 0.0:
            raise ModelError(
                f"{label}: thickness and pressure must be left out for {kind}, got {part.thickness!r} and "
                f"{part.pressure!r}; they are of triangles"
            )
    fill = None if part.fill is None else checked_fill(label, part.fill, len(elements))
    return dataclasses.replace(part, elements=elements, fill=fill)


def _shapes(points: npt.NDArray[np.float64], elements: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Area or volume of each element, over that of the cube or square of its longest side; of hexahedra the least."""
    x = points[elements]
    size = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).max(axis=1) + np.finfo(float).tiny
    if elements.shape[1] == 3:
        return np.asarray(np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / size**2)
    if elements.shape[1] == 4:
        return np.asarray(np.linalg.det(x[:, 1:] - x[:, :1]) / size**3)
    least = np.full(len(x), np.inf)
    for corner in CORNERS:
        least = np.minimum(least, 8.0 * np.linalg.det(natural_slopes(corner) @ x))
    return least / size**3


def _checked_sheet(label: str, elements: npt.NDArray[Any], part: MeshPart) -> MeshPart:
    """Rules of triangles: a thickness, and sides that two of them at most share, each in its own direction."""
    thickness, pressure = number(part.thickness), number(part.pressure)
    if not FLOAT32_LEAST <= thickness <= FLOAT32_MAX:
        raise ModelError(f"{label}: thickness must be positive, got {formatted(part.thickness)}; give metres")
    if not abs(pressure) <= FLOAT32_MAX:
        raise ModelError(f"{label}: pressure must be finite, got {formatted(part.pressure)}; give pascals")
    if part.fill is not None:
        raise ModelError(
            f"{label}: fill must be left out for triangles, got {formatted(part.fill)}; give a smaller thickness"
        )
    sides = np.concatenate([elements[:, [0, 1]], elements[:, [1, 2]], elements[:, [2, 0]]])
    found, count = np.unique(sides, axis=0, return_counts=True)
    if (count > 1).any():
        side = found[np.argmax(count)].tolist()
        raise ModelError(
            f"{label}: triangles at a side must be two, which pass it in opposite directions, got more, or alike ones, "
            f"at nodes {side}; orient them alike, or split the mesh there"
        )
    return dataclasses.replace(part, thickness=thickness, pressure=pressure)


def _check_faces(label: str, elements: npt.NDArray[Any]) -> None:
    """A face is one element's, or that of two on either side of it: elements that cross have one from the same side."""
    corners = FACES[elements.shape[1]]
    faces = elements[:, corners].reshape(-1, len(corners[0]))
    # from their lowest node on, round as seen from outside
    first = np.argmin(faces, axis=1)[:, None]
    faces = np.take_along_axis(faces, (first + np.arange(faces.shape[1])) % faces.shape[1], axis=1)
    found, place, count = np.unique(faces, axis=0, return_inverse=True, return_counts=True)
    if (count > 1).any():
        face = int(np.argmax(count))
        both = np.flatnonzero(place.reshape(-1) == face)[:2] // len(corners)
        raise ModelError(
            f"{label}: elements must not cross, got elements {both[0]} and {both[1]} on the same side of their face of "
            f"nodes {found[face].tolist()}; leave one out, or repair the mesh"
        )


def element_volumes(points: npt.NDArray[np.float64], elements: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """(e,) volumes of tetrahedra or hexahedra [m³]."""
    x = points[elements]
    return np.asarray(np.linalg.det(x[:, 1:] - x[:, :1]) / 6.0) if elements.shape[1] == 4 else hexahedra_volumes(x)


def lumped_masses(points: npt.NDArray[np.float64], parts: Sequence[MeshPart]) -> npt.NDArray[np.float64]:
    """(n,) mass of each node: equal shares of its elements' [kg]."""
    masses = np.zeros(len(points))
    for part in parts:
        if part.kind == "triangles":
            x = points[part.elements]
            area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 2.0
            size = area * (part.thickness or 0.0)
        else:
            size = element_volumes(points, part.elements) * (1.0 if part.fill is None else part.fill)
        share = np.repeat(part.material.density * size / part.elements.shape[1], part.elements.shape[1])
        np.add.at(masses, part.elements.reshape(-1), share)
    return masses
