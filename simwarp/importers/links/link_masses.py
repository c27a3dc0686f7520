"""Masses from geometry: a density of all parts or of each by name, and the solid of what a link is made of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError, Pose, ShapeType, formatted, number
from simwarp.core.wording import nearest
from simwarp.geometry.assets import MassProperties, convex_hull, hull_mass, shape_mass, solid_mass
from simwarp.importers.links.link_frames import moved_mass, total_mass

Array = npt.NDArray[np.float64]


class Densities:
    """One for all, or one for each name, all of which must be there.

    Args:
        source: the file, for errors.
        given: [kg/m³].
        what: kind of the things that have the names.

    Raises:
        ModelError: a density is no number above 0.
    """

    def __init__(self, source: str, given: Any, what: str) -> None:
        self.source = source
        self._given = given
        self._what = what
        self._asked: set[str] = set()
        values = list(given.values()) if isinstance(given, Mapping) else [given]
        for value in values:
            if not 0.0 < number(value) < np.inf:
                raise ModelError(
                    f"{source}: density must be a number > 0 kg/m³, or one for each {what} by name, got "
                    f"{formatted(given)}; steel has 7850, aluminium 2700"
                )

    def of(self, name: str) -> float:
        """That of a thing, which must have one."""
        found = self.find(name)
        if found is None:
            raise ModelError(
                f"{self.source}: density must have {self._what} '{name}'{nearest(name, self._given)}, got "
                f"{', '.join(map(str, self._given)) or 'none'}; add it"
            )
        return found

    def find(self, name: str) -> float | None:
        """That of a thing, None where there is none for its name."""
        self._asked.add(name)
        given = self._given.get(name) if isinstance(self._given, Mapping) else self._given
        return None if given is None else float(given)

    def check(self) -> None:
        """All names that were given must be those of things that were asked for."""
        for name in self._given if isinstance(self._given, Mapping) else ():
            if name not in self._asked:
                raise ModelError(
                    f"{self.source}: density names '{name}'{nearest(name, self._asked)}, but the {self._what}s are "
                    f"{', '.join(sorted(self._asked)) or 'none'}; correct the name"
                )


def primitive_solid(kind: ShapeType, size: tuple[float, float, float], pose: Pose) -> MassProperties:
    """Of a primitive at density 1, in the frame in which it has that pose."""
    return moved_mass(shape_mass(kind, size, 1.0), pose)


def mesh_solid(vertices: Array, triangles: npt.NDArray[np.int64], pose: Pose) -> tuple[MassProperties, bool]:
    """Of a mesh at density 1, and whether its surface is closed; where it is not, its hull stands for it.

    Raises:
        ModelError: it encloses nothing.
    """
    from simwarp.geometry.mesh_files import closed_surface  # trimesh takes a while to import

    surface = closed_surface(vertices, triangles)
    solid = hull_mass(convex_hull(vertices), 1.0) if surface is None else solid_mass(*surface, 1.0)
    return moved_mass(solid, pose), surface is not None


def missing_mass(given: MassProperties, parts: Iterable[MassProperties], density: float) -> MassProperties:
    """What a link has whose file tells no mass, or a mass without inertia: a mass that is given stays, with its centre.

    Args:
        given: of the file, in the link's frame.
        parts: of its geometry at density 1, in the link's frame.
        density: [kg/m³].
    """
    solid = total_mass(parts)
    if given.mass > 0.0:
        return MassProperties(given.mass, given.centre, solid.inertia * (given.mass / solid.mass))
    return MassProperties(density * solid.mass, solid.centre, density * solid.inertia)
