"""The kernels that take longest to compile, compiled once for all test workers and by all of them side by side."""

from __future__ import annotations

import importlib
from pathlib import Path

import warp as wp
from filelock import FileLock, Timeout

from simwarp.kernels.collision.collision_stages import fused_collision
from simwarp.kernels.dynamics.step_stages import fused_step, fused_tree_step

LONG = (
    "simwarp.kernels.cones.batch", "simwarp.sensors.cameras.image_kernels",
    "simwarp.vehicle.tires.tires_kernels", "simwarp.sensors.ranging.radar_kernels",
    "simwarp.sensors.ranging.lidar_kernels",
)  # fmt: skip
CPU_BLOCK = 1
"""Threads of a block in launches on a CPU; a unit is compiled anew for every size of blocks."""


def compile_together() -> None:
    """Compile what Warp's cache does not hold: each unit in one worker, while the others take the next ones."""
    wp.init()
    variants = [
        (True, False, False, False), (False, True, False, False), (False, False, True, False),
        (False, False, True, True), (False, False, False, False),
    ]  # fmt: skip
    units = [fused_step(*which).kernel.module for which in variants]
    units += [fused_tree_step().kernel.module]
    units += [fused_collision(faces).kernel.module for faces in (False, True)]
    units += [wp.get_module(importlib.import_module(name).__name__) for name in LONG]
    # First what nobody is at, then what the others have made
    for waits in (False, True):
        for unit in units:
            _load(unit, waits)


def _load(unit: wp.Module, waits: bool) -> None:
    """Load a unit under a lock; without waiting, leave one that another worker has."""
    path = Path(str(wp.config.kernel_cache_dir)) / f"{unit.name[-60:]}.lock"
    try:
        with FileLock(path, blocking=waits):
            unit.load(wp.get_device("cpu"), block_dim=CPU_BLOCK)
    except Timeout:
        return
