"""Paths to drive along: places ahead, and where a vehicle is along them; every world follows one of a few."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch

if TYPE_CHECKING:
    from simwarp.vehicle import Path


class Routes:
    """Paths as points at equal steps, all closed or all open.

    Args:
        paths: their middles.
        step: distance of the points, at most [m].
        device: of the tensors.

    Attributes:
        length: (K,) float32 [m].
    """

    def __init__(self, paths: Sequence[Path], step: float, device: torch.device) -> None:
        self.closed = paths[0].closed
        counts = [max(4, math.ceil(path.length / step)) for path in paths]
        points = np.zeros((len(paths), max(counts) + 1, 3))
        for row, path, count in zip(points, paths, counts, strict=True):
            arc = np.linspace(0.0, path.length, count + 1)
            tangent = path.tangents()
            heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
            for column, values in enumerate((path.points[:, 0], path.points[:, 1], heading)):
                row[: count + 1, column] = np.interp(arc, path.arc, values)
            row[count + 1 :] = row[count]
        self.length = torch.tensor([path.length for path in paths], dtype=torch.float32, device=device)
        self._points = torch.tensor(points, dtype=torch.float32, device=device)
        self._steps = torch.tensor(counts, device=device)
        # points beyond a path's end are never the nearest ones
        index = torch.arange(points.shape[1], device=device)
        self._beyond = torch.where(index > self._steps.unsqueeze(1), 1e9, 0.0)

    def at(self, route: torch.Tensor, arc: torch.Tensor) -> torch.Tensor:
        """Return (W, M, 3) x, y [m] and heading [rad] at lengths (W, M) along the routes (W,).

        Closed ones go on with the next lap, the heading without a jump; open ones end straight.
        """
        length, steps = self.length[route].unsqueeze(1), self._steps[route].unsqueeze(1)
        laps = torch.floor(arc / length) if self.closed else torch.zeros_like(arc)
        inside = (arc - laps * length).clamp(min=0.0)
        u = (inside / length).clamp(max=1.0) * steps
        low = torch.minimum(u.long(), steps - 1)
        share = (u - low).unsqueeze(2)
        row = route.unsqueeze(1)
        first, second = self._points[row, low], self._points[row, low + 1]
        place = first + share * (second - first)
        if self.closed:
            turn = self._points[route, self._steps[route], 2] - self._points[route, 0, 2]
            place[..., 2] += laps * turn.unsqueeze(1)
        else:
            over = arc - torch.minimum(inside, length)
            place[..., 0] += over * place[..., 2].cos()
            place[..., 1] += over * place[..., 2].sin()
        return place

    def distance(self, route: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
        """Return (W,) the distance of places (W, 2) from the routes (W,), but for a quarter of a step squared [m]."""
        away = place.float().unsqueeze(1) - self._points[route][..., :2]
        return ((away * away).sum(dim=2) + self._beyond[route]).amin(dim=1).sqrt()

    def locate(self, route: torch.Tensor, place: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the arc lengths on the routes (W,) of the points nearest to places (W, 2), and the lateral offsets
        of the places, positive to the left; both (W,) [m].
        """
        points = self._points[route]
        away = place.float().unsqueeze(1) - points[..., :2]
        nearest = ((away * away).sum(dim=2) + self._beyond[route]).argmin(dim=1)
        world = torch.arange(len(route), device=place.device)
        here, offset = points[world, nearest], away[world, nearest]
        cosine, sine = here[:, 2].cos(), here[:, 2].sin()
        ahead = cosine * offset[:, 0] + sine * offset[:, 1]
        aside = cosine * offset[:, 1] - sine * offset[:, 0]
        step = self.length[route] / self._steps[route]
        return nearest * step + ahead, aside
