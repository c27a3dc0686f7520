"""Distances to round obstacles in a fan of directions: an ideal planar laser scanner."""

from __future__ import annotations

import torch


class RangeFan:
    """Rays in a plane, from a vehicle to discs.

    Args:
        rays: their number, at equal angles.
        width: angle from the rightmost to the leftmost one [rad].
        reach: distance at which a ray ends [m].
        device: of the directions.
    """

    def __init__(self, rays: int, width: float, reach: float, device: torch.device) -> None:
        half = 0.5 * width if rays > 1 else 0.0
        angle = torch.linspace(-half, half, rays, device=device)
        self.direction = torch.stack([angle.cos(), angle.sin()], dim=1)
        """(rays, 2) unit vectors: ahead, to the left."""
        self.reach = reach

    def ranges(self, place: torch.Tensor, radius: torch.Tensor) -> torch.Tensor:
        """Return (W, rays) distances [m] to the first disc on each ray, at most the reach; 0 inside a disc.

        Args:
            place: (W, N, 2) centres in the vehicle's axes [m].
            radius: (W, N) [m]; a disc of negative radius is not there.
        """
        ahead = place @ self.direction.T
        square = (place * place).sum(dim=2, keepdim=True)
        radius = radius.unsqueeze(2)
        # half a chord, squared: negative where the ray passes the disc
        chord = radius * radius - (square - ahead * ahead)
        entry = ahead - chord.clamp(min=0.0).sqrt()
        inside = square < radius * radius
        met = (radius >= 0.0) & (chord > 0.0) & ((ahead > 0.0) | inside)
        distance = torch.where(met, entry.clamp(min=0.0), self.reach)
        return distance.amin(dim=1).clamp(max=self.reach)
