"""Height scan: the ground below a grid of points about a robot, looked up in a height field or found by rays."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
import torch
import warp as wp

import simwarp as sw
from simwarp.tasks import Ge, Le, Positive

from ...framework.config_values import Settings
from ...framework.recorded_launches import TensorLaunch
from ..walking_ground_kernels import scan_rays

__all__ = ["GridScan", "RayScan", "ScanConfig"]

LIFT = 0.5
"""Height above the base from which rays go down [m]: what is farther up is a roof, not ground."""


@dataclasses.dataclass(frozen=True)
class ScanConfig(Settings):
    """Grid of the height scan, in the axes of the robot's heading, centred below its base.

    Attributes:
        ahead, across: number of points along and across the heading.
        spacing: of the points [m].
        limit: heights beyond this, above or below the feet of a standing robot, are cut off [m].
    """

    NAMED: ClassVar[bool] = True
    ahead: Annotated[int, Ge(1), Le(101)] = 11
    across: Annotated[int, Ge(1), Le(101)] = 7
    spacing: Positive = 0.1
    limit: Positive = 0.5

    @property
    def count(self) -> int:
        """Number N of points."""
        return self.ahead * self.across

    def points(self) -> np.ndarray[Any, np.dtype[np.float32]]:
        """(N, 2) points ahead and to the left [m]: row by row from behind, each from right to left."""
        x, y = ((np.arange(count) - 0.5 * (count - 1)) * self.spacing for count in (self.ahead, self.across))
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2).astype(np.float32)

    def names(self) -> list[str]:
        """Names of the N points, for ``observation_names``."""
        return [f"ground {x:+.2f} ahead {y:+.2f} left" for x, y in self.points().tolist()]


class GridScan:
    """A kernel that writes the heights below the grid, as a function of the poses of the bases.

    Args:
        kernel: takes positions, directions of the headings, threads of a world, the grid, height of the standing base,
            limit, what is `fixed`, and the scan.
        scan: grid.
        stand: height of the base over the feet of the robot that stands [m].
        worlds: number of worlds.
        device: of the scan.
        fixed: further arguments of the kernel.
    """

    def __init__(
        self, kernel: wp.Kernel, scan: ScanConfig, stand: float, worlds: int, device: torch.device,
        fixed: Sequence[Any] = (),
    ) -> None:  # fmt: skip
        # a thread on a CPU copies all arguments: one for all points of a world
        threads = scan.count if device.type == "cuda" else 1
        place, heading = torch.zeros(worlds, 3, device=device), torch.zeros(worlds, 2, device=device)
        self._found = torch.zeros(worlds, scan.count, device=device)
        grid = torch.from_numpy(scan.points()).to(device)
        arguments = [place, heading, threads, grid, float(stand), float(scan.limit), *fixed, self._found]
        self._launch = TensorLaunch(kernel, (worlds, threads), arguments, device)

    def __call__(self, position: torch.Tensor, yaw: torch.Tensor) -> torch.Tensor:
        """Return heights (W, N) [m], in memory of their own.

        Args:
            position: (W, 3) of the bases, world [m].
            yaw: (W,) headings [rad].
        """
        angle = yaw.float()
        self._launch.on(position.float().contiguous(), torch.stack([angle.cos(), angle.sin()], dim=1))
        return self._found.clone()


class RayScan:
    """Heights of the ground below a grid, as :meth:`~simwarp.tasks.locomotion.velocity.FlatGround.scan` tells
    them, by rays straight down from half a metre above the base: of ground that is more than one height field, such as
    boxes, meshes and bridges.

    On one height field use the look-up: it gives the same and costs less.

    Args:
        scene: things that the rays meet, by their `groups`.
        simulation: whose worlds they are.
        scan: grid of the height scan.
        stand: height of the base over the feet of the robot that stands [m].
        groups: bits of the groups of instances that count as ground (`Appearance.group`): leave the robot's out.
    """

    def __init__(
        self,
        scene: sw.sensors.Scene,
        simulation: sw.Simulation,
        scan: ScanConfig,
        stand: float,
        *,
        groups: int = 0x7FFFFFFF,
    ) -> None:
        model = simulation.model
        tables = scene.tables(groups)
        self._place = scene.record_place(simulation, tables)
        fixed = [LIFT, tables, model.assets]
        self._scan = GridScan(scan_rays, scan, stand, model.world_count, torch.device(str(model.device)), fixed)

    def __call__(self, position: torch.Tensor, yaw: torch.Tensor) -> torch.Tensor:
        """Return heights (W, N) [m] of what is below the grid, over the feet of a robot that stands, within the limit;
        where a ray meets nothing, the limit downwards.

        Args:
            position: (W, 3) of the bases, world [m].
            yaw: (W,) headings [rad].
        """
        for launch in self._place:
            launch.launch()
        return self._scan(position, yaw)
