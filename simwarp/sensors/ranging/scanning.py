"""Shared by lidar and radar: checks of their numbers, noise per world, beams on a mount."""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Any, TypeAlias

import numpy as np
import warp as wp

from simwarp.core.arrays import WritableArray, writable_from
from simwarp.core.constraints import Fraction, MinLen, NotNegative
from simwarp.core.types import ModelError, formatted
from simwarp.model.model import Model
from simwarp.model.rules import RULES, instance_of
from simwarp.sensors.clock import FrameBuffer
from simwarp.sensors.motion.mount_motion_kernels import MountArrays
from simwarp.sensors.ranging.beams import BeamTable
from simwarp.sensors.ranging.beams_kernels import Scan
from simwarp.sensors.scene import Scene

PerWorld: TypeAlias = NotNegative | Annotated[tuple[NotNegative, ...], MinLen(1)]
"""A number for all worlds, or one for each."""
Share: TypeAlias = Fraction | Annotated[tuple[Fraction, ...], MinLen(1)]
"""A probability for all worlds, or one for each."""


def check_reach(thing: str, near: float, far: float) -> None:
    """A ModelError unless near is below far."""
    if not near < far:
        raise ModelError(f"{thing}: near must be below far = {formatted(far)} m, got {formatted(near)}; use 0 for none")


@RULES.arguments("{sensor}")
def scene_model(sensor: str, scene: Annotated[Scene, instance_of(Scene, "write visuals.finalize(model)")]) -> Model:
    """The model of what should be a Scene, or a ModelError."""
    return scene.model


def noise_arrays(sensor: str, noise: Any, model: Model, per_world: set[str]) -> dict[str, WritableArray]:
    """Numbers of a noise by name: (1,), or (W,) where there is one per world or `per_world` asks for it."""
    arrays = {}
    for field in dataclasses.fields(noise):
        numbers = np.atleast_1d(np.asarray(getattr(noise, field.name), dtype=np.float32))
        if len(numbers) not in (1, model.world_count):
            raise ModelError(
                f"{sensor}: {field.name} must be one number or one for each of {model.world_count} worlds, "
                f"got {len(numbers)}; give one for all, or one per world"
            )
        copies = model.world_count if field.name in per_world and len(numbers) == 1 else 1
        arrays[field.name] = writable_from(np.tile(numbers, copies), wp.float32, model.device)
    return arrays


def scan_tables(mount: MountArrays, beams: BeamTable, near: float, far: float, device: Any) -> Scan:
    """Mount and beams as kernels read them."""
    scan: Any = Scan()
    scan.mount = mount
    scan.near, scan.far = near, far
    scan.direction = wp.array(beams.directions(), dtype=wp.vec3, device=device)
    return scan


def set_sweep(scan: Scan, frames: FrameBuffer, sweep: bool) -> None:
    """The time over which columns fire, once the clock has its sub-steps."""
    scan.span = frames.steps.window * frames.dt if sweep else 0.0


def thread_count(beams: BeamTable, frames: FrameBuffer, device: Any) -> int:
    """Threads of one world: a beam each on a GPU, in sub-steps that take part of a sweep; one on a CPU."""
    rows, columns = beams.shape
    return rows * math.ceil(columns / max(frames.steps.window, 1)) if device.is_cuda else 1


def rows_of(ring: wp.array) -> wp.array:
    """(W·slots, rows, columns, channels) as (W·slots, values)."""
    return ring.reshape((ring.shape[0], ring.size // ring.shape[0]))
