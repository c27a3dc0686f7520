"""Copies of worlds on the device: every array whose rows belong to worlds, whatever it holds.

An array of W worlds has W rows, or W times as many (frames of a sensor that wait); one with a single row is shared by
all worlds and stays. That is all that is known of an array here, so that those of new force elements and sensors, which
name them in `memory` and `world_parameters`, are copied like those of the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.array_devices import refuse_elsewhere, refuse_in_capture
from simwarp.core.types import ModelError, formatted
from simwarp.model.checks import whole_number
from simwarp.model.identity import Identity
from simwarp.model.model import Model
from simwarp.model.parameters import PARAMETERS
from simwarp.simulation.attachments import ForceElement, Sensor
from simwarp.simulation.world_copies_kernels import choose_source, copy_bytes, copy_words
from simwarp.simulation.world_launches import WorldLaunch, WorldShares
from simwarp.simulation.world_masks import mask_of_worlds

THREADS: Final = 128
"""Threads that copy one world's row on a GPU."""
SOURCE: Final = 2
"""Place of the source among a launch's inputs."""


class OneSource(NamedTuple):
    """One world that is copied into those of a (W,) bool mask."""

    source: int
    targets: wp.array


CopyPlan: TypeAlias = OneSource | npt.NDArray[np.int64]
"""That, or the world to be copied into each, (W,); -1: none."""


class WorldCopies:
    """Launches that copy worlds into the arrays of a simulation.

    Args:
        shares: of the worlds that are written.
        targets: their arrays, (W, ...) or (W·n, ...); others are left alone.

    Attributes:
        source_of: (W,) int32, the world that each became a copy of; -1: it stayed.
        written: (W,) bool, worlds that the last copies changed.
    """

    def __init__(self, shares: WorldShares, targets: Sequence[wp.array]) -> None:
        self._shares = shares
        self.source_of: wp.array = wp.full(shares.worlds, -1, dtype=int, device=shares.device)
        self.written: wp.array = wp.zeros(shares.worlds, dtype=bool, device=shares.device)
        self._launches = [self._record(target) for target in targets]

    def aim(self, call: str, plan: CopyPlan, *, same: bool) -> None:
        """Says what the next copies copy; worlds that would be copied onto themselves are left out.

        Args:
            call: what the user called.
            plan: from `checked_sources`.
            same: source and targets are worlds of one simulation.

        Raises:
            ModelError: worlds were listed while a graph is captured.
        """
        device = self._shares.device
        if isinstance(plan, OneSource):
            outputs = [self.source_of, self.written]
            inputs = [plan.targets, plan.source, same]
            wp.launch(choose_source, self._shares.worlds, inputs=inputs, outputs=outputs, device=device)
            return
        if device.is_cuda:
            refuse_in_capture(f"{call}: targets must", device, "a list of worlds")
        moved = np.where(plan == np.arange(len(plan)), -1, plan) if same else plan
        self.source_of.assign(moved.astype(np.int32))
        self.written.assign(moved >= 0)

    def run(self, sources: Sequence[wp.array], worlds: int) -> None:
        """Copies.

        Args:
            sources: an array for each target; or for the first ones, where the others stay.
            worlds: of the sources.
        """
        commands = []
        for launch, source in zip(self._launches, sources, strict=False):
            if launch is not None:
                rows = worlds if source.shape[0] % worlds == 0 else 1
                launch.use(SOURCE, _rows(source, rows, launch.kernel is copy_bytes))
                commands.append(launch)
        self._shares.run(commands)

    def _record(self, target: wp.array) -> WorldLaunch | None:
        worlds = self._shares.worlds
        if not target.size or target.shape[0] % worlds:
            return None
        whole = _row_bytes(target, worlds) % 4 == 0
        rows = _rows(target, worlds, not whole)
        threads = min(THREADS, rows.shape[1]) if self._shares.device.is_cuda else 1
        kernel = copy_words if whole else copy_bytes
        return self._shares.record(kernel, threads, inputs=[threads, self.source_of, rows], outputs=[rows])


class Copied(Protocol):
    """Interface of a Simulation whose worlds are copied."""

    model: Model
    elements: tuple[ForceElement, ...]
    sensors: tuple[Sensor, ...]
    identity: Identity

    def _arrays(self) -> list[wp.array]: ...


def parameter_arrays(simulation: Copied) -> list[wp.array]:
    """What worlds may have of their own beside a snapshot: of the model, then of force elements and sensors."""
    parts: tuple[ForceElement | Sensor, ...] = (*simulation.elements, *simulation.sensors)
    own = (array for part in parts for array in part.world_parameters.values())
    return [*(getattr(simulation.model, name) for name in PARAMETERS), *own]


def refuse_other(
    thing: str, simulation: Copied, identity: Identity, arrays: Sequence[wp.array], worlds: int, *, same: bool = False
) -> None:
    """Raises a ModelError where worlds of another simulation cannot become worlds of this one.

    Args:
        thing: the call and what it was given: the error begins with it.
        simulation: that is written.
        identity: of the other.
        arrays: of the other, as they are copied.
        worlds: of the other.
        same: the number of worlds has to be the same too.
    """
    mine, theirs = simulation.identity, identity
    if not same:
        mine, theirs = mine.of_each_world(), theirs.of_each_world()
    present = [*simulation._arrays(), *parameter_arrays(simulation)][: len(arrays)]
    difference = mine.difference(theirs) or row_difference(present, simulation.model.world_count, arrays, worlds)
    if difference:
        raise ModelError(
            f"{thing} must be of a Simulation with the same model, force elements and sensors, but they differ "
            f"({difference}); make both of the same ModelBuilder"
        )
    refuse_elsewhere(f"{thing} must", arrays[0], simulation.model.device)


def row_difference(
    targets: Sequence[wp.array], worlds: int, sources: Sequence[wp.array], source_worlds: int
) -> str:  # fmt: skip
    """How the arrays of two simulations differ apart from their worlds; empty for those that can be copied."""
    if len(targets) != len(sources):
        return f"arrays: here {len(targets)}, there {len(sources)}"
    for target, source in zip(targets, sources, strict=True):
        here, there = _of_one(target, worlds), _of_one(source, source_worlds)
        if here != there:
            return f"an array: here {here}, there {there}"
    return ""


def checked_sources(
    call: str, source: Any, targets: Any, model: Model, source_worlds: int, *, same: bool = False, name: str = "targets"
) -> CopyPlan:
    """What goes where.

    Args:
        call: what the user called: errors begin with it.
        source: a world, or one for each target.
        targets: worlds, or a (W,) bool mask; None: all.
        model: whose worlds are written.
        source_worlds: how many the source has.
        same: source and targets are worlds of one simulation.
        name: of the targets.

    Raises:
        ModelError: a world is out of range, named twice, or is written while others are copied from it.
    """
    worlds = model.world_count
    if isinstance(source, (int, np.integer)) and not isinstance(source, bool):
        origin = whole_number(call, "source", source, 0, source_worlds - 1, "count from 0")
        if targets is None or _is_mask(targets):
            mask = np.full(worlds, True) if targets is None else targets
            return OneSource(origin, mask_of_worlds(call, mask, model, name=name))
        origins = [origin] * len(chosen := _listed(call, name, targets, worlds))
    else:
        origins = _listed(call, "source", source, source_worlds)
        chosen = list(range(worlds)) if targets is None else _listed(call, name, targets, worlds)
    if len(origins) != len(chosen):
        raise ModelError(
            f"{call}: source must be one world, or one for each of {len(chosen)} targets, got {len(origins)}; "
            "name as many"
        )
    twice = [world for k, world in enumerate(chosen) if world in chosen[:k]]
    if twice:
        raise ModelError(f"{call}: {name} must be different worlds, got {twice[0]} twice; name each once")
    moved = {world for world, origin in zip(chosen, origins, strict=True) if world != origin}
    written = sorted(moved & set(origins)) if same else []
    if written:
        raise ModelError(
            f"{call}: a source must stay as it is, got world {written[0]} as source and as target of another; "
            "copy in two calls, by way of a snapshot"
        )
    source_of = np.full(worlds, -1, np.int64)
    source_of[chosen] = origins
    return source_of


def worlds_of(call: str, worlds: Any, model: Model) -> list[int]:
    """Worlds given as indices or as a mask, which is read."""
    if not _is_mask(worlds):
        return _listed(call, "worlds", worlds, model.world_count)
    return [int(world) for world in np.flatnonzero(mask_of_worlds(call, worlds, model, name="worlds").numpy())]


def _is_mask(targets: Any) -> bool:
    """True for arrays of a device, which must be masks, and for sequences of bool."""
    if isinstance(targets, wp.array) or hasattr(targets, "data_ptr"):
        return True
    try:
        return np.asarray(targets).dtype == np.bool_
    except ValueError:
        return False


def _listed(call: str, name: str, given: Any, worlds: int) -> list[int]:
    """Indices of worlds as a list."""
    try:
        values = np.asarray(given)
    except (ValueError, TypeError):
        values = np.asarray(None)
    if values.ndim != 1 or values.dtype.kind not in "iu":
        if values.ndim == 1 and not values.size:
            return []
        raise ModelError(f"{call}: {name} must be indices of worlds, got {formatted(given)}; list them, or give a mask")
    for world in values:
        whole_number(call, f"each of {name}", int(world), 0, worlds - 1, "count from 0")
    return [int(world) for world in values]


def _of_one(array: wp.array, worlds: int) -> str:
    """What an array holds of one world."""
    count = array.shape[0] // worlds if array.shape[0] % worlds == 0 else array.shape[0]
    return f"{array.dtype.__name__}{formatted((count, *array.shape[1:]))}"


def _row_bytes(array: wp.array, worlds: int) -> int:
    return int(array.size * wp.types.type_size_in_bytes(array.dtype) // worlds)


def _rows(array: wp.array, worlds: int, as_bytes: bool) -> wp.array:
    """The memory of an array as (worlds, n) words or bytes."""
    size = _row_bytes(array, worlds)
    return wp.array(
        ptr=array.ptr, dtype=wp.uint8 if as_bytes else wp.int32, shape=(worlds, size if as_bytes else size // 4),
        device=array.device, copy=False,
    )  # fmt: skip
