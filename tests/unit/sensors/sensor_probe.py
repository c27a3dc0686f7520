"""A sensor that measures what its clock does, and small models to put sensors on."""

# The kernel is Warp's language, as those in simwarp/kernels.
# mypy: disable-error-code="index, operator, assignment"

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import warp as wp

import simwarp as sw
from simwarp.sensors.clock import Field
from simwarp.sensors.clock_kernels import BEGIN, SampleEvents
from simwarp.sensors.frame_sensor import FrameSensor
from simwarp.sensors.interface import Schedule

NUMBER, COUNT, SUBSTEPS, SPAN, GAPS, MODE = range(6)
"""Columns of the probe's data: the frame, the sum of its sub-steps' counts, how many they are, the sum of their shares,
how often a share did not begin where the last one ended, and the mode in which it was completed."""


@wp.struct
class Notes:
    """What the probe keeps."""

    count: wp.array[int]
    taken: wp.array[int]
    sums: wp.array2d[float]


@wp.kernel(enable_backward=False)
def probe(tick: SampleEvents, notes: Notes, ring: wp.array2d[float]):
    """Adds up what the clock says."""
    world = wp.tid()
    if tick.mode[world] == BEGIN:
        notes.count[world] = 0
    elif tick.mode[world] > 0:
        notes.count[world] += 1
    if tick.collecting[world] == 1:
        if tick.first[world] == 1:
            for k in range(6):
                notes.sums[world, k] = 0.0
        notes.sums[world, 1] += float(notes.count[world])
        if wp.abs(tick.fraction_from[world] - notes.sums[world, 3]) > 1.0e-5:
            notes.sums[world, 4] += 1.0
        notes.sums[world, 2] += 1.0
        notes.sums[world, 3] += tick.fraction_to[world] - tick.fraction_from[world]
        notes.sums[world, 5] = float(tick.mode[world])
        if tick.complete[world] == 1:
            notes.taken[world] += 1
            notes.sums[world, 0] = float(tick.frame[world])
            for k in range(6):
                ring[tick.row[world], k] = notes.sums[world, k]


class Probe(FrameSensor):
    """Its data are (W, 6), see above; `taken` counts the frames that were not skipped."""

    def __init__(
        self, model: sw.Model, schedule: Schedule, *, name: str = "probe", seed: int = 0, gradual: bool = False
    ):
        super().__init__(name, schedule, model, {"data": Field((6,), wp.float32)}, seed=seed, gradual=gradual)
        self.notes = Notes()
        self.notes.count = wp.zeros(model.world_count, dtype=int, device=model.device)
        self.notes.taken = wp.zeros(model.world_count, dtype=int, device=model.device)
        self.notes.sums = wp.zeros((model.world_count, 6), dtype=float, device=model.device)

    @property
    def taken(self) -> wp.array:
        return self.notes.taken

    @property
    def data(self) -> wp.array:
        return self.frames.data["data"]

    @property
    def memory(self) -> Mapping[str, wp.array]:
        return {**super().memory, **{name: getattr(self.notes, name) for name in ("count", "taken", "sums")}}

    def _sample(self, simulation: sw.StepContext) -> Sequence[Any]:
        return [
            wp.launch(
                probe, dim=simulation.model.world_count, device=simulation.model.device, record_cmd=True,
                inputs=[self.frames.tick], outputs=[self.notes, self.frames.ring["data"]],
            )
        ]  # fmt: skip


def ball(world_count: int, *, gravity: Sequence[float] = (0.0, 0.0, -9.81), per_world: Sequence[str] = ()) -> sw.Model:
    """One free body."""
    builder = sw.ModelBuilder(gravity=gravity)
    builder.add_body("ball", mass=1.0, inertia=(1.0, 1.0, 1.0))
    return builder.finalize(world_count, "cpu", per_world=per_world)
