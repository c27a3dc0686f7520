"""Distances to round obstacles in a fan of directions: an ideal planar laser scanner."""

from __future__ import annotations

import torch
import warp as wp

from ..framework.recorded_launches import TensorFunction
from .ranging_kernels import measure_ranges


class RangeFan:
    """Rays in a plane, from a vehicle to discs.

    Args:
        rays: their number, at equal angles.
        width: angle from the rightmost to the leftmost one [rad].
        reach: distance at which a ray ends [m].
        device: of the directions.

    Attributes:
        direction: (rays,) vec2, unit vectors: ahead, to the left.
    """

    def __init__(self, rays: int, width: float, reach: float, device: torch.device) -> None:
        wp.init()
        half = 0.5 * width if rays > 1 else 0.0
        angle = torch.linspace(-half, half, rays)
        unit = torch.stack([angle.cos(), angle.sin()], dim=1).numpy()
        self.direction: wp.array = wp.array(unit, dtype=wp.vec2, device=str(device))
        self.reach = reach
        fixed = [reach, self.direction]
        self._ranges = TensorFunction(measure_ranges, fixed, [(torch.float32, ())], device, dimensions=2)

    def __repr__(self) -> str:
        return f"RangeFan: {self.direction.shape[0]} rays of {self.reach:g} m"

    def ranges(self, place: torch.Tensor, radius: torch.Tensor) -> torch.Tensor:
        """Return (W, rays) distances [m] to the first disc on each ray, at most the reach; 0 inside a disc.

        Args:
            place: (W, N, 2) float32, centres in the vehicle's axes [m].
            radius: (W, N) float32 [m]; a disc of negative radius is not there.
        """
        return self._ranges(place, radius, shape=(len(place), self.direction.shape[0]))[0]
