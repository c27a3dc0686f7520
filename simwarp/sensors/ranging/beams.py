"""Beams of scanning sensors: the table of their directions, and the cross-section that one beam has."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Ge, Le, Meaning, MinLen, Read
from simwarp.core.object_repr import ReadableFields
from simwarp.core.types import FLOAT32_MAX, ModelError, formatted, numbers
from simwarp.model.rules import RULES
from simwarp.sensors.interface import Configuration

Array: TypeAlias = npt.NDArray[np.float64]
Angles: TypeAlias = Sequence[float] | npt.NDArray[np.floating]

BeamNumber: TypeAlias = Annotated[int, Ge(1), Meaning("the number of beams")]
FULL_TURN = 2.0 * math.pi
MAX_RADIUS = 5
"""Rings of rays within one beam: (2 · 5 - 1)² = 81 rays."""
MOST_BEAMS = 2**24
"""Of one scan."""
ROUNDED = 1.0e-4
"""By so much a turn or a right angle may be rounded, as 6.28319 or 1.5708 [rad]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class BeamTable(ReadableFields):
    """Directions of the beams of one scan, by row (from the top) and column (in the order of firing).

    Sensor axes: x ahead, y left, z up. Azimuth is positive to the left, elevation upwards:
    d = (cos e cos a, cos e sin a, sin e). A column fires at once; columns are evenly spread over the window.

    Attributes:
        azimuth: (columns,) or (rows, columns) [rad].
        elevation: (rows,) or (rows, columns) [rad], within ±pi/2.

    Raises:
        ModelError: a table is empty, not finite, does not fit the other one, or an elevation is beyond ±pi/2.
    """

    azimuth: Angles | Array
    elevation: Angles | Array

    def __post_init__(self) -> None:
        azimuth, elevation = _angles("azimuth", self.azimuth), _angles("elevation", self.elevation)
        if np.abs(elevation).max() > 0.5 * math.pi + ROUNDED:
            worst = float(elevation.flat[np.abs(elevation).argmax()])
            raise ModelError(f"BeamTable: elevation must lie within ±pi/2 rad, got {worst:.6g}; angles are in radians")
        object.__setattr__(self, "azimuth", azimuth)
        elevation = np.clip(elevation, -0.5 * math.pi, 0.5 * math.pi)
        elevation.setflags(write=False)
        object.__setattr__(self, "elevation", elevation)
        try:
            rows, columns = self.shape
        except ValueError as error:
            raise ModelError(
                f"BeamTable: azimuth and elevation must fit together, got shapes {azimuth.shape} and "
                f"{elevation.shape}; pass (columns,) and (rows,), or (rows, columns) of either"
            ) from error
        check_beam_count("BeamTable", columns, rows)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of beams: (rows, columns)."""
        rows, columns = self.angles()[0].shape
        return rows, columns

    def angles(self) -> tuple[Array, Array]:
        """Azimuth and elevation of every beam, (rows, columns) float64 [rad]."""
        elevation = np.asarray(self.elevation)
        elevation = elevation[:, None] if elevation.ndim == 1 else elevation
        azimuth, elevation = np.broadcast_arrays(np.atleast_2d(self.azimuth), elevation)
        return azimuth, elevation

    def directions(self) -> Array:
        """Unit directions in sensor axes, (rows, columns, 3) float64."""
        azimuth, elevation = self.angles()
        flat = np.cos(elevation)
        return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)


def check_beam_count(thing: str, columns: int, rows: int) -> None:
    """Refuses more beams than `MOST_BEAMS`, before they are made."""
    if int(columns) * int(rows) > MOST_BEAMS:
        raise ModelError(
            f"{thing}: columns x rows must be at most {MOST_BEAMS} beams, got {formatted(columns)} x "
            f"{formatted(rows)}; use fewer"
        )


@RULES.arguments("beam_grid")
def beam_grid(
    columns: BeamNumber,
    rows: BeamNumber,
    *,
    azimuth: tuple[float, float] = (math.pi, -math.pi),
    elevation: tuple[float, float] = (0.2, -0.2),
) -> BeamTable:
    """A regular grid. The default turns clockwise seen from above, so that the range image has left on its left.

    Args:
        columns: >= 1.
        rows: >= 1.
        azimuth: of the first and the last column [rad]. Over a full turn the last column is one step short of the
            first, not the same one again. One column lies in the middle.
        elevation: of the first and the last row [rad]; one row lies in the middle.

    Raises:
        ModelError: a count is no positive integer, there are too many beams, or the azimuths span more than a turn.
    """
    check_beam_count("beam_grid", columns, rows)
    ends = _angles("azimuth", azimuth)
    heights = _angles("elevation", elevation)
    if ends.shape != (2,) or heights.shape != (2,):
        raise ModelError(
            f"beam_grid: azimuth and elevation must be (first, last), got {formatted(azimuth)}, "
            f"{formatted(elevation)}; pass two angles each"
        )
    span = float(ends[1] - ends[0])
    if abs(span) > FULL_TURN + 2.0 * ROUNDED:
        raise ModelError(f"beam_grid: azimuth must span at most 2 pi rad, got {abs(span):.6g}; angles are in radians")
    if abs(span) > FULL_TURN - 2.0 * ROUNDED:
        turn = ends[0] + math.copysign(FULL_TURN, span) * np.arange(columns) / columns
        return BeamTable(azimuth=turn, elevation=_even(heights, rows))
    return BeamTable(azimuth=_even(ends, columns), elevation=_even(heights, rows))


Row: TypeAlias = Annotated[tuple[float, ...], MinLen(1)]
BeamCount: TypeAlias = Annotated[int, Ge(1)]


@dataclasses.dataclass(frozen=True, kw_only=True)
class BeamLayout(Configuration):
    """Beams as a file has them: a grid of `columns` and `rows`, or tables of both angles.

    Attributes:
        columns, rows: of a grid.
        azimuth: of a grid's first and last column, or a table [rad].
        elevation: of a grid's first and last row or of all its rows, or a table [rad].
    """

    columns: BeamCount | None = None
    rows: BeamCount | None = None
    azimuth: Row | tuple[Row, ...] | None = None
    elevation: Row | tuple[Row, ...]

    def table(self) -> BeamTable:
        """The beams.

        Raises:
            ModelError: they do not fit together.
        """
        if self.columns is None and self.rows is None:
            if self.azimuth is None:
                raise ModelError("needs columns, rows and elevation (a grid), or tables of azimuth and elevation")
            return BeamTable(azimuth=np.array(self.azimuth), elevation=np.array(self.elevation))
        for key in ("columns", "rows"):
            if getattr(self, key) is None:
                raise ModelError(f"needs {key} too; a grid has columns, rows, azimuth, elevation")
        columns, rows, heights = cast(int, self.columns), cast(int, self.rows), np.array(self.elevation)
        if len(heights) not in (2, rows):
            rule = f"the first and the last row's, or {rows} angles [rad]"
            raise ModelError(f"elevation must be {rule}, got {len(heights)}")
        ends: dict[str, Any] = {} if self.azimuth is None else {"azimuth": self.azimuth}
        grid = beam_grid(columns, rows, elevation=(heights[0], heights[-1]), **ends)
        return grid if len(heights) == 2 else BeamTable(azimuth=grid.azimuth, elevation=heights)


Beams: TypeAlias = Annotated[BeamTable, Read(BeamLayout, BeamLayout.table, BeamTable)]
"""A table of beams; in a file a `BeamLayout`."""

Spread: TypeAlias = Annotated[float, Ge(0.0), Le(0.5 * math.pi), Meaning("radians, 0 for one ray")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Beam(Configuration):
    """Cross-section of a beam, sampled by rays of equal energy.

    Attributes:
        divergence: full angle of the cone, or (horizontal, vertical) [rad]; 0 is a single ray.
        radius: rings of rays, the central one included: (2 radius - 1)² rays.
        shape: "elliptic" (ring k has 8 k rays on an ellipse) or "rectangular" (a square grid).

    Raises:
        ModelError: a divergence is negative or above pi/2, a radius outside 1 to 5, an unknown shape.
    """

    divergence: Spread | tuple[Spread, Spread] = 0.0
    radius: Annotated[int, Ge(1), Le(MAX_RADIUS), Meaning("rings of rays, of which (2 radius - 1)² are cast")] = 1
    shape: Literal["elliptic", "rectangular"] = "elliptic"

    def offsets(self) -> Array:
        """Angles of the rays from the beam's axis, to the left and upwards, (rays, 2) float64 [rad]; the first is 0."""
        half = 0.5 * np.broadcast_to(np.asarray(self.divergence, dtype=np.float64), (2,))
        if self.radius == 1 or not half.any():
            return np.zeros((1, 2))
        places = [(0.0, 0.0)]
        for ring in range(1, self.radius):
            places += _ellipse(ring) if self.shape == "elliptic" else _square(ring)
        return np.array(places) / (self.radius - 1) * half


def _ellipse(ring: int) -> list[tuple[float, float]]:
    """8 k points on a circle of radius k."""
    turns = FULL_TURN * np.arange(8 * ring) / (8 * ring)
    return [(ring * math.cos(turn), ring * math.sin(turn)) for turn in turns]


def _square(ring: int) -> list[tuple[float, float]]:
    """8 k points of the integer grid at Chebyshev distance k."""
    span = range(-ring, ring + 1)
    return [(float(x), float(y)) for y in span for x in span if max(abs(x), abs(y)) == ring]


def _even(ends: Array, count: int) -> Array:
    """`count` angles from the first to the last; the middle of one."""
    return np.linspace(ends[0], ends[1], count) if count > 1 else np.array([0.5 * (ends[0] + ends[1])])


def _angles(name: str, values: Any) -> Array:
    """A table of angles as float64, or a ModelError."""
    table = numbers(values)
    if table.ndim == 0 and not np.isfinite(table):
        raise ModelError(f"BeamTable: {name} must be a table of angles [rad], got {formatted(values)}; pass numbers")
    if table.ndim not in (1, 2) or table.size == 0:
        raise ModelError(
            f"BeamTable: {name} must hold at least one angle in one or two dimensions, got shape {table.shape}; "
            "pass (columns,) azimuths and (rows,) elevations"
        )
    if not np.isfinite(table).all() or np.abs(table).max() > FLOAT32_MAX:
        raise ModelError(f"BeamTable: {name} must be finite [rad], got {formatted(values)}; check the angles")
    table.setflags(write=False)
    return table


VLP_16_ELEVATION: Array = np.radians(np.arange(15.0, -16.0, -2.0))
"""Elevations of Velodyne's VLP-16, from the top (user manual 63-9243, table of channels)."""

HDL_32E_ELEVATION: Array = np.radians(
    [
        10.67, 9.33, 8.00, 6.67, 5.33, 4.00, 2.67, 1.33, 0.00, -1.33, -2.67, -4.00, -5.33, -6.66, -8.00, -9.33,
        -10.67, -12.00, -13.33, -14.67, -16.00, -17.33, -18.67, -20.00, -21.33, -22.67, -24.00, -25.33, -26.66,
        -28.00, -29.33, -30.67,
    ]
)  # fmt: skip
"""Elevations of Velodyne's HDL-32E, from the top (user manual 63-9113, table of lasers)."""
