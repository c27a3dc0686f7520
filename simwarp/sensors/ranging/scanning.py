"""Shared by lidar and radar: checks of their numbers, noise per world, beams on a mount."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import WritableArray, writable_from
from simwarp.core.types import FLOAT32_MAX, ModelError, numbers, shown
from simwarp.kernels.sensors.motion.mount_motion import MountArrays
from simwarp.kernels.sensors.ranging.beams import Scan
from simwarp.model.checks import checked_flag, finite_number, positive_number, whole_number
from simwarp.model.model import Model
from simwarp.sensors.clock import FrameBuffer
from simwarp.sensors.ranging.beams import BeamTable
from simwarp.sensors.scene import ALL_GROUPS, Scene

PerWorld: TypeAlias = float | Sequence[float] | npt.NDArray[np.floating]
"""A number for all worlds, or one for each."""


def check_choice(thing: str, field: str, value: Any, known: Sequence[str]) -> None:
    """A ModelError where `value` is none of the names."""
    if not isinstance(value, str) or value not in known:
        raise ModelError(f"{thing}: {field} must be one of {', '.join(known)}, got {shown(value)}")


def check_scan(thing: str, sweep: Any, groups: Any) -> None:
    """A flag and the bits of groups that are seen, or a ModelError."""
    checked_flag(thing, "sweep", sweep)
    whole_number(thing, "groups", groups, 0, ALL_GROUPS, "leave out the higher bits")


def check_reach(thing: str, near: Any, far: Any) -> None:
    """0 <= near < far, or a ModelError."""
    positive_number(thing, "far", far, "m", "give the largest range")
    if not 0.0 <= finite_number(thing, "near", near, "use 0 for none") < float(far):
        raise ModelError(
            f"{thing}: near must be >= 0 m and below far = {shown(far)} m, got {shown(near)}; use 0 for none"
        )


def check_shares(thing: str, field: str, value: Any, limit: float | None) -> None:
    """Numbers >= 0, up to `limit`, or a ModelError."""
    given = numbers(value)
    top = math.inf if limit is None else limit
    rule = ">= 0" if limit is None else f"between 0 and {limit:g}"
    good = given.size > 0 and (given >= 0.0).all() and (given <= min(top, FLOAT32_MAX)).all()
    if not good or given.ndim > 1:
        raise ModelError(
            f"{thing}: {field} must be {rule}, a number or one per world, got {shown(value)}; use 0 for none"
        )


def scene_model(sensor: str, scene: Any) -> Model:
    """The model of what should be a Scene, or a ModelError."""
    if not isinstance(scene, Scene):
        raise ModelError(f"{sensor}: scene must be a Scene, got {shown(scene)}; write visuals.finalize(model)")
    return scene.model


def noise_arrays(sensor: str, noise: Any, model: Model, per_world: set[str]) -> dict[str, WritableArray]:
    """Numbers of a noise by name: (1,), or (W,) where there is one per world or `per_world` asks for it."""
    arrays = {}
    for field in dataclasses.fields(noise):
        numbers = np.atleast_1d(np.asarray(getattr(noise, field.name), dtype=np.float32))
        if len(numbers) not in (1, model.world_count):
            raise ModelError(
                f"{sensor}: {field.name} must be one number or one for each of {model.world_count} worlds, "
                f"got {len(numbers)}"
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
