"""Height scan by rays: of ground that is more than one height field, such as boxes, meshes and bridges."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch

from simwarp.kernels.tasks.locomotion.ground import scan_rays
from simwarp.sensors import Scene
from simwarp.sensors.scene import ALL_GROUPS

from ...framework.launching import TensorFunction
from .ground import ScanConfig

if TYPE_CHECKING:
    from simwarp import Simulation

__all__ = ["RayScan"]

LIFT = 0.5
"""Height above the base from which rays go down [m]: what is farther up is a roof, not ground."""


class RayScan:
    """Heights of the ground below a grid, as :meth:`~simwarp.tasks.locomotion.velocity.ground.FlatGround.scan` tells
    them, by rays straight down from half a metre above the base.

    On one height field use the look-up: it gives the same and costs less (`docs/walking.md`).

    Args:
        scene: things that the rays meet, by their `groups`.
        simulation: whose worlds they are.
        scan: grid of the height scan.
        stand: height of the base over the feet of the robot that stands [m].
        groups: bits of the groups of instances that count as ground (`Appearance.group`): leave the robot's out.
    """

    def __init__(
        self, scene: Scene, simulation: Simulation, scan: ScanConfig, stand: float, *, groups: int = ALL_GROUPS
    ) -> None:  # fmt: skip
        device = torch.device(str(simulation.model.device))
        tables: Any = scene.tables(groups)
        self._place = scene.record_place(simulation, tables)
        points = torch.from_numpy(scan.points()).to(device)
        self._points = len(points)
        fixed = [points, float(stand), float(scan.limit), LIFT, tables, simulation.model.assets]
        self._scan = TensorFunction(scan_rays, fixed, [(torch.float32, ())], device, dimensions=2)

    def __call__(self, position: torch.Tensor, yaw: torch.Tensor) -> torch.Tensor:
        """Return heights (W, N) [m] of what is below the grid, over the feet of a robot that stands, within the limit;
        where a ray meets nothing, the limit downwards.

        Args:
            position: (W, 3) of the bases, world [m].
            yaw: (W,) headings [rad].
        """
        self._place.launch()
        shape = (len(position), self._points)
        return self._scan(position.float().contiguous(), yaw.float().contiguous(), shape=shape)[0]
