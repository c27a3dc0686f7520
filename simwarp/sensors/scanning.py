"""What lidar and radar share: checks of their numbers, noise per world, beams on a mount."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.arrays import WritableArray, writable_from
from simwarp.checks import finite_number, positive_number
from simwarp.kernels.sensors.beams import Scan
from simwarp.model import Model
from simwarp.sensors.beams import BeamTable
from simwarp.sensors.clock import Frames, mount_arrays
from simwarp.sensors.contract import Mount
from simwarp.sensors.scene import Scene
from simwarp.types import ModelError

PerWorld: TypeAlias = float | Sequence[float] | npt.NDArray[np.floating]
"""A number for all worlds, or one for each."""


def check_choice(thing: str, field: str, value: Any, known: Sequence[str]) -> None:
    """A ModelError where `value` is none of the names."""
    if value not in known:
        raise ModelError(f"{thing}: {field} must be one of {', '.join(known)}, got {value!r}")


def check_reach(thing: str, near: Any, far: Any) -> None:
    """0 <= near < far, or a ModelError."""
    positive_number(thing, "far", far, "m", "give the largest range")
    if not 0.0 <= finite_number(thing, "near", near, "use 0 for none") < float(far):
        raise ModelError(f"{thing}: near must be >= 0 m and below far = {far!r} m, got {near!r}; use 0 for none")


def check_shares(thing: str, field: str, value: Any, limit: float | None) -> None:
    """Numbers >= 0, up to `limit`, or a ModelError."""
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ModelError(f"{thing}: {field} must be a number or one per world, got {value!r}") from error
    top = math.inf if limit is None else limit
    rule = ">= 0" if limit is None else f"between 0 and {limit:g}"
    good = numbers.size > 0 and np.isfinite(numbers).all() and (numbers >= 0.0).all() and (numbers <= top).all()
    if not good or numbers.ndim > 1:
        raise ModelError(f"{thing}: {field} must be {rule}, a number or one per world, got {value!r}; use 0 for none")


def check_scene(sensor: str, scene: Any, model: Model) -> None:
    """A Scene of this model, or a ModelError."""
    if not isinstance(scene, Scene) or scene.model is not model:
        raise ModelError(
            f"sensor '{sensor}': scene must be a Scene of the sensor's model, got {scene!r}; "
            "write visuals.finalize(model)"
        )


def noise_array(sensor: str, field: str, value: PerWorld, model: Model, per_world: bool) -> WritableArray:
    """(1,) or, for one number per world or where `per_world` asks for it, (W,)."""
    numbers = np.atleast_1d(np.asarray(value, dtype=np.float32))
    if len(numbers) not in (1, model.world_count):
        raise ModelError(
            f"sensor '{sensor}': {field} must be one number or one for each of {model.world_count} worlds, "
            f"got {len(numbers)}"
        )
    copies = model.world_count if per_world and len(numbers) == 1 else 1
    return writable_from(np.tile(numbers, copies), wp.float32, model.device)


def scan_tables(sensor: str, mount: Mount, model: Model, beams: BeamTable, near: float, far: float) -> Scan:
    """Mount and beams as kernels read them."""
    scan = Scan()
    scan.mount = mount_arrays(sensor, mount, model)
    scan.near, scan.far = near, far
    scan.direction = wp.array(beams.directions(), dtype=wp.vec3, device=model.device)
    return scan


def set_sweep(scan: Scan, frames: Frames, sweep: bool) -> None:
    """The time over which columns fire, once the clock knows its sub-steps."""
    scan.span = frames.steps.window * frames.dt if sweep else 0.0


def lane_count(beams: BeamTable, frames: Frames, device: Any) -> int:
    """Threads of one world: a beam each on a GPU, in sub-steps that take part of a sweep; one on a CPU."""
    rows, columns = beams.shape
    return rows * math.ceil(columns / max(frames.steps.window, 1)) if device.is_cuda else 1


def rows_of(ring: wp.array) -> wp.array:
    """(W·slots, rows, columns, channels) as (W·slots, values)."""
    return ring.reshape((ring.shape[0], ring.size // ring.shape[0]))
