"""Measured roads of OpenCRG files, by `pycrg`: heights over x and y, whatever way their reference line takes."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt

from simwarp.core.files import FileError, check_input
from simwarp.core.types import ModelError
from simwarp.vehicle.roads.random_roads import MOST_NODES
from simwarp.vehicle.roads.road_surface import RoadSurface
from simwarp.vehicle.spec.parts import Array, SpecError

ENDING: Final = ".crg"


def load_crg(path: str | Path) -> RoadSurface:
    """The road of an OpenCRG file over the rectangle around it, with nodes as far apart as the file's finest ones.

    Beside the road's borders and ends the height stays as on them, or is that of the nearest node that has one.

    Args:
        path: of the file.

    Raises:
        ModelError: pycrg is not installed.
        SpecError: the file cannot be read, or its rectangle takes too many nodes.
    """
    file = Path(path)
    try:
        import pycrg
    except ModuleNotFoundError as error:
        raise ModelError(f"OpenCRG: must have module '{error.name}', got none; pip install 'simwarp[crg]'") from None
    try:
        check_input(file)
        logging.getLogger("pycrg").setLevel(logging.CRITICAL)
        with pycrg.RoadSurface.open(file) as road:
            for option in (pycrg.CP_OPTION_BORDER_MODE_U, pycrg.CP_OPTION_BORDER_MODE_V):
                road.option_set_int(option, pycrg.BORDER_MODE_EX_KEEP)
            grid = road.grid()
            u, v = np.meshgrid(grid.u, [float(grid.v[0]), float(grid.v[-1])])
            borders = road.uv_to_xy_many(u.ravel(), v.ravel())
            corners = [(float(np.min(axis)), float(np.max(axis))) for axis in borders]
            step = min(float(np.diff(grid.u).min()), float(np.diff(grid.v).min()))
            x, y = (_nodes(low, high, step) for low, high in corners)
            if len(x) * len(y) > MOST_NODES:
                rule = f"a rectangle of at most {MOST_NODES:.3g} nodes {step:g} m apart"
                raise SpecError(f"{file.name}: must have {rule}, got {len(x)} x {len(y)}; cut the road into pieces")
            places = np.meshgrid(x, y)
            heights = np.asarray(road.xy_to_z_many(places[0].ravel(), places[1].ravel()))
    except (pycrg.OpenCRGError, FileError, OSError) as error:
        reason = error.reason if isinstance(error, FileError) else str(error).partition("\n")[0]
        raise SpecError(f"{file.name}: cannot be read: {reason}") from None
    return RoadSurface(
        heights=_filled(heights.reshape(len(y), len(x))).astype(np.float32), origin=(float(x[0]), float(y[0])),
        size=(float(x[-1] - x[0]), float(y[-1] - y[0])),
    )  # fmt: skip


def _filled(heights: Array) -> Array:
    """Where the file has no height, that of the nearest node that has one."""
    missing = ~np.isfinite(heights)
    if not missing.any() or missing.all():
        return heights
    nearest = distance_transform_edt(missing, return_distances=False, return_indices=True)
    return np.asarray(heights[tuple(nearest)])


def _nodes(low: float, high: float, step: float) -> Array:
    """From the first to the last place, at most a step apart."""
    return np.linspace(low, high, max(1, math.ceil((high - low) / step - 1e-6)) + 1)
