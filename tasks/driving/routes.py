"""Paths to drive along: places ahead, and where a vehicle is along them; every world follows one of a few."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
import warp as wp

import simwarp as sw

from ..framework.recorded_launches import TensorFunction, filled
from .routes_kernels import RouteTables, find_route_places, locate_on_routes, measure_route_distances


class Routes:
    """Paths as points at equal steps, all closed or all open.

    Args:
        paths: their middles.
        step: distance of the points, at most [m].
        device: of the tensors.

    Attributes:
        length: (K,) float32 [m].
        tables: the paths, for kernels.
    """

    def __init__(self, paths: Sequence[sw.vehicle.Path], step: float, device: torch.device) -> None:
        wp.init()
        counts = [max(4, math.ceil(path.length / step)) for path in paths]
        points = np.zeros((len(paths), max(counts) + 1, 3), np.float32)
        for row, path, count in zip(points, paths, counts, strict=True):
            arc = np.linspace(0.0, path.length, count + 1)
            tangent = path.tangents()
            heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
            for column, values in enumerate((path.points[:, 0], path.points[:, 1], heading)):
                row[: count + 1, column] = np.interp(arc, path.arc, values)
        lengths = [path.length for path in paths]
        self.length = torch.tensor(lengths, dtype=torch.float32, device=device)
        self.tables = filled(
            RouteTables,
            closed=int(paths[0].closed),
            length=wp.array(lengths, dtype=float, device=str(device)),
            steps=wp.array(counts, dtype=int, device=str(device)),
            points=wp.array(points, dtype=wp.vec3, device=str(device)),
        )
        number, place = (torch.float32, ()), (torch.float32, (3,))
        self._at = TensorFunction(find_route_places, [self.tables], [place], device, dimensions=2)
        self._distance = TensorFunction(measure_route_distances, [self.tables], [number], device)
        self._locate = TensorFunction(locate_on_routes, [self.tables], [number, number], device)

    def __repr__(self) -> str:
        return f"Routes: {self.length.shape[0]} paths, {'closed' if self.tables.closed else 'open'}"

    def at(self, route: torch.Tensor, arc: torch.Tensor) -> torch.Tensor:
        """Return (W, M, 3) x, y [m] and heading [rad] at lengths (W, M) along the routes (W,).

        Closed ones go on with the next lap, the heading without a jump; open ones end straight.
        """
        return self._at(route, arc.float().contiguous())[0]

    def distance(self, route: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
        """Return (W,) the distance of places (W, 2) from the routes (W,), but for a quarter of a step squared [m]."""
        return self._distance(route, place.float())[0]

    def locate(self, route: torch.Tensor, place: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the arc lengths on the routes (W,) of the points nearest to places (W, 2), and the lateral offsets
        of the places, positive to the left; both (W,) [m].
        """
        arc, aside = self._locate(route, place.float())
        return arc, aside
