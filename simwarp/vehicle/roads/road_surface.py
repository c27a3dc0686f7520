"""A road as a surface with its friction and soils, in one frame, and as the ground of a model."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, Material, pose
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import Model
from simwarp.scenery.terrain import height_at
from simwarp.vehicle.roads.random_roads import SPACING, Heights, random_heights
from simwarp.vehicle.roads.road_profiles import RoadClass
from simwarp.vehicle.spec.parts import Array, refuse
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tires.tires import ground_of

SHAPE: Final = "road"
"""Name of the shape."""
HIGHEST: Final = 1.0e4
"""Most height above or below zero [m], in single precision to a millimetre."""
FRICTION: Final = (1.0e-4, 10.0)
"""Least and most of a ground."""


@dataclasses.dataclass(frozen=True, eq=False)
class RoadSurface:
    """Heights of a road, with maps of friction and soil over the same rectangle.

    Attributes:
        heights: (rows along y, columns along x) of nodes [m].
        origin: x and y of the first node, a corner of the rectangle [m].
        size: of the rectangle along x and y [m].
        friction: (rows, columns) coefficients of cells that share the rectangle evenly; None: the ground's own.
        soil: (rows, columns) indices in `soils`, of cells likewise; None: the first everywhere.
        soils: names of soils, below tires that sink in.

    Raises:
        SpecError: an array or a size cannot be used.
    """

    heights: Heights
    origin: tuple[float, float]
    size: tuple[float, float]
    friction: Array | None = None
    soil: npt.NDArray[np.int32] | None = None
    soils: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Hold the arrays to their rules."""
        for name, pair, least in (("origin", self.origin, -np.inf), ("size", self.size, 0.0)):
            if len(pair) != 2 or not all(np.isfinite(value) and value > least for value in pair):
                rule = "two finite numbers" + (" > 0" if name == "size" else "") + " [m]"
                raise refuse(name, rule, pair, "it has one of x and one of y")
        if self.heights.ndim != 2 or min(self.heights.shape) < 2:
            raise refuse("heights", "(rows, columns) numbers, at least 2 x 2", self.heights.shape)
        far = self.heights[~(np.abs(self.heights) <= HIGHEST)]
        if far.size:
            rule = f"from -{HIGHEST:g} to {HIGHEST:g} m"
            raise refuse("heights", rule, float(far[0]), "check the height's scale and offset")
        if self.friction is not None:
            values = self.friction
            wrong = values[~((values >= FRICTION[0]) & (values <= FRICTION[1]))]
            if values.ndim != 2 or not values.size or len(wrong):
                got = float(wrong[0]) if len(wrong) else values.shape
                raise refuse("friction", f"(rows, columns) from {FRICTION[0]:g} to {FRICTION[1]:g}", got)
        if self.soil is not None:
            if not self.soils:
                raise refuse("soils", "names of the soils of the map", self.soils, "name one for every index")
            unknown = self.soil[(self.soil < 0) | (self.soil >= len(self.soils))]
            if self.soil.ndim != 2 or not self.soil.size or len(unknown):
                got = int(unknown[0]) if len(unknown) else self.soil.shape
                raise refuse("soil", f"(rows, columns) indices below {len(self.soils)}", got, "name more soils")

    @property
    def middle(self) -> tuple[float, float]:
        """X and y of the rectangle's centre [m]."""
        return (self.origin[0] + 0.5 * self.size[0], self.origin[1] + 0.5 * self.size[1])

    def height_at(self, points: npt.ArrayLike) -> Array:
        """(n,) heights [m] at points (n, 2), those of the triangles that tires, contacts and rays meet; beyond the
        border the nearest point on it counts.
        """
        at = np.asarray(points, np.float64).reshape(-1, 2) - self.middle
        return height_at(self.heights, self.size, at)

    def highest(self, radius: float) -> float:
        """Greatest height of a node within a square of this half side about the origin [m].

        Raises:
            SpecError: the road does not reach as far.
        """
        parts = []
        for axis, name in enumerate("xy"):
            first, count = self.origin[axis], self.heights.shape[1 - axis]
            if first > -radius or first + self.size[axis] < radius:
                got = f"{first:.4g} to {first + self.size[axis]:.4g} m of {name}"
                raise refuse("road", f"at least {radius:.3g} m to all sides of the origin, where a run begins", got)
            step = self.size[axis] / (count - 1)
            parts.append(slice(int((-radius - first) / step), int(np.ceil((radius - first) / step)) + 1))
        return float(self.heights[parts[1], parts[0]].max())

    def soil_options(self) -> dict[str, Any]:
        """Of `simwarp.soil.soil_under`: the soils and their map; none where the road has no soils."""
        if not self.soils:
            return {}
        if self.soil is None:
            return {"soil": self.soils[:1]}
        return {"soil": self.soils, "soil_map": self.soil, "map_origin": self.origin, "map_cell": self._cell(self.soil)}

    def friction_options(self, friction: float) -> dict[str, Any]:
        """Of `ground` and `ground_of`: factors of a ground's friction; none where the road has no map."""
        if self.friction is None:
            return {}
        cell = self._cell(self.friction)
        return {"friction_map": self.friction / friction, "friction_origin": self.origin, "friction_cell": cell}

    def _cell(self, cells: npt.NDArray[Any]) -> tuple[float, float]:
        return (self.size[0] / cells.shape[1], self.size[1] / cells.shape[0])


def random_road(
    road: RoadClass | str, *, seed: int = 0, x: tuple[float, float] = (-50.0, 450.0),
    y: tuple[float, float] = (-10.0, 10.0),
) -> RoadSurface:  # fmt: skip
    """A random road of a class of ISO 8608: heights are a function of the seed and the place, not of the window.

    Along any line ahead the height has the class's spectral density G_d(n) = G_d(n_0) (n / n_0)^-2 from 0.011 to
    2.83 1/m, and the surface is isotropic: two tracks agree in long waves and not in short ones. It repeats itself
    after 1024 m along and 102.4 m across.

    Args:
        road: A to H.
        seed: of the waves.
        x: first and last of the window [m]; nodes 0.05 m apart.
        y: likewise; nodes 0.1 m apart.

    Raises:
        SpecError: there is no such class, or the seed or the window cannot be used.
    """
    try:
        chosen = RoadClass(road)
    except ValueError:
        raise refuse("road", "a class of ISO 8608, A to H", road) from None
    heights, origin = random_heights(chosen, seed, x, y)
    size = (SPACING[0] * (heights.shape[1] - 1), SPACING[1] * (heights.shape[0] - 1))
    return RoadSurface(heights=heights, origin=origin, size=size)


def add_road(builder: ModelBuilder, road: RoadSurface, *, friction: float = 0.9, below_soil: bool = False) -> int:
    """Adds a road as the shape "road" on WORLD, which bodies, cameras and lidars meet.

    Args:
        builder: of the model.
        road: with its heights.
        friction: of the surface.
        below_soil: True: soil covers it, so that bodies do not meet it.

    Returns:
        The index of the shape.
    """
    return builder.add_shape_height_field(
        WORLD, road.heights, size=road.size, pose=pose((*road.middle, 0.0)), material=Material(friction=friction),
        name=SHAPE, mask=0 if below_soil else 2**31 - 1,
    )  # fmt: skip


def road_ground(model: Model, road: RoadSurface, *, friction: float = 0.9) -> TerrainTables:
    """The road that `add_road` added as the ground of tires and soil, with its map of friction.

    Args:
        model: finished.
        road: the same one.
        friction: `ground_friction` of the tires, of which the map has factors.
    """
    return ground_of(model, SHAPE, **road.friction_options(friction))
