"""Checks of a soil's pages, of the ground that it lies on, and of its map of soils."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.constraints import Parsed, RuleError
from simwarp.core.types import ModelError, formatted, numbers
from simwarp.kernels.collision.shape import HEIGHT_FIELD, PLANE
from simwarp.model.checks import whole_number
from simwarp.model.model import Model
from simwarp.soil.soil_tables_kernels import SIDE
from simwarp.vehicle.tires.ground_kernels import TerrainTables

MOST_PAGES: Final = 1 << 20
STEEPEST: Final = math.radians(45.0)
"""Of a plane: nodes lie in columns seen from above, fewer and fewer on what leans more."""


def checked_pages(pages: Any, spacing: float, least: int) -> int:
    """Pages of a world: at least those below all shapes at once.

    Args:
        pages: as given.
        spacing: of the nodes [m].
        least: pages that all shapes may lie on together (`pages_at_a_time`).

    Raises:
        ModelError: they are too few or no whole number.
    """
    if least > MOST_PAGES:
        most = f"at most {MOST_PAGES} pages may lie below the shapes"
        raise ModelError(f"soil: spacing must be so wide that {most}, got {spacing:.4g} m, {least}; 0.05 suits cars")
    remedy = f"so many of {spacing * SIDE:.3g} m may lie below the shapes; raise it, or the spacing"
    return whole_number("soil", "pages", pages, least, MOST_PAGES, remedy)


def _tables(ground: Any) -> Any:
    if getattr(ground, "_cls", None) is not TerrainTables:
        raise RuleError("of simwarp.vehicle.tires.ground", "make it by that")
    return ground


GROUND: Final = Parsed(_tables)
"""A ground that `simwarp.vehicle.tires.ground` made."""


def check_ground(ground: Any) -> None:
    """Refuses a plane that leans by more than 45 degrees."""
    if ground.kind != PLANE:
        return
    upright = float(ground.rot.numpy()[:, 2, 2].min())
    if not upright >= math.cos(STEEPEST) - 1e-6:
        lean = math.degrees(math.acos(max(-1.0, min(1.0, upright))))
        raise ModelError(f"soil: ground must lean by at most 45 degrees, got {lean:.4g}; turn it, or gravity")


def checked_map(soil_map: Any, soils: int, worlds: int) -> npt.NDArray[np.int32]:
    """Indices of soils, (1 or W, rows, columns); without cells where there is no map.

    Raises:
        ModelError: it has another shape, or holds anything but indices of soils.
    """
    if soil_map is None:
        return np.zeros((1, 0, 0), np.int32)
    values = numbers(soil_map)
    values = values[None] if values.ndim == 2 else values
    if values.ndim != 3 or values.shape[0] not in (1, worlds) or not values.size:
        got = values.shape if values.ndim else formatted(soil_map)
        raise ModelError(
            f"soil: soil_map must be (rows, columns) or ({worlds}, rows, columns), got {got}; it has numbers of soils"
        )
    wrong = values[~((values >= 0.0) & (values < soils) & (values == np.floor(values)))]
    if len(wrong):
        raise ModelError(f"soil: soil_map must hold indices below {soils}, got {wrong[0]:g}; name more soils")
    return values.astype(np.int32)


def check_map(
    shape: tuple[int, ...], origin: tuple[float, float], cell: tuple[float, float], ground: TerrainTables, model: Model
) -> None:
    """Refuses cells without a size, and a map that leaves a part of a height field out.

    Args:
        shape: of the map, (..., rows, columns); without cells it is none.
        origin: corner of the first cell [m].
        cell: size of the cells [m].
        ground: below the soil.
        model: with the height fields.
    """
    for name, pair, least in (("map_origin", origin, -math.inf), ("map_cell", cell, 0.0)):
        given = numbers(pair)
        if given.shape != (2,) or not (np.isfinite(given) & (given > least)).all():
            rule = "finite" if least < 0.0 else "finite and > 0 m"
            raise ModelError(
                f"soil: {name} must be two numbers, {rule}, got {formatted(pair)}; it has one of x and one of y"
            )
    if shape[-1] == 0 or ground.kind != HEIGHT_FIELD:
        return
    low, high = _field_bounds(ground, model)
    last = np.array(origin) + np.array(cell) * (shape[-1], shape[-2])
    if (low < np.array(origin) - 1e-6).any() or (high > last + 1e-6).any():
        extents = [f"x {a[0]:.4g} to {b[0]:.4g}, y {a[1]:.4g} to {b[1]:.4g}" for a, b in ((low, high), (origin, last))]
        remedy = "set map_origin and map_cell"
        raise ModelError(f"soil: soil_map must cover the ground, {extents[0]} m, got {extents[1]}; {remedy}")


def _field_bounds(ground: TerrainTables, model: Model) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Least and greatest x and y of the height fields of all worlds [m]."""
    nodes, spacing = model.assets.field_nodes.numpy(), model.assets.field_spacing.numpy()
    tables = [ground.asset.numpy(), ground.x.numpy(), ground.rot.numpy(), ground.scale.numpy()]
    corners = []
    for world in range(max(len(table) for table in tables)):
        asset, x, rot, scale = (table[world % len(table)] for table in tables)
        half = 0.5 * (nodes[asset] - 1) * spacing[asset] * scale[:2]
        corners += [x[:2] + rot[:2, :2] @ (half * sign) for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    return np.min(corners, axis=0), np.max(corners, axis=0)
