"""The launches of collision: one kernel where worlds take scratch in turn, one per stage where each has its own."""

from __future__ import annotations

import dataclasses
from typing import Any

from simwarp.kernels.collision.collision_stages import STAGES, fused_collision, stage_kernel
from simwarp.kernels.core.stages import StageKernel
from simwarp.model.model import Model
from simwarp.simulation.world_launches import WorldLaunch, WorldShares


@dataclasses.dataclass(frozen=True, kw_only=True)
class CollisionArrays:
    """Everything that collision reads and writes, as kernels take it.

    Attributes:
        config: numbers of the step.
        model: with its topology, parameters and assets.
        state, contacts: of the simulation.
        scratch, lists: for intermediate values.
    """

    config: Any
    model: Model
    state: Any
    contacts: Any
    scratch: Any
    lists: Any


def record_collision(shares: WorldShares, arrays: CollisionArrays) -> list[WorldLaunch]:
    """Record the launches that find the contacts of all worlds."""
    model = arrays.model
    if model.topology.pair_count == 0:
        return []
    given = {
        "config": arrays.config, "topology": model.topology, "parameters": model.parameters, "assets": model.assets,
        "state": arrays.state, "scratch": arrays.scratch, "lists": arrays.lists, "contacts": arrays.contacts,
    }  # fmt: skip

    def record(made: StageKernel, *, in_turn: bool = False) -> WorldLaunch:
        return shares.record(made.kernel, inputs=[given[name] for name in made.arguments], in_turn=in_turn)

    if not shares.own_slots:
        return [record(fused_collision(), in_turn=True)]
    return [record(stage_kernel(stage)) for stage in STAGES if stage.is_due(given)]
