"""The launches of a step: one kernel where worlds take scratch in turn, one per stage where each has its own."""

from __future__ import annotations

import dataclasses
from typing import Any

from simwarp.core.types import ConeSolver
from simwarp.kernels.core.stages import StageKernel
from simwarp.kernels.dynamics.solve_stages import solver_stages
from simwarp.kernels.dynamics.step_stages import fused_step, stage_kernel, step_stages
from simwarp.simulation.world_launches import WorldLaunch, WorldShares


@dataclasses.dataclass(frozen=True, kw_only=True)
class StepArrays:
    """Everything that a step reads and writes, as kernels take it.

    Attributes:
        config: numbers of the step.
        topology, parameters: of the model.
        control, state, contacts, reports: of the simulation.
        scratch, progress: for intermediate values.
    """

    config: Any
    topology: Any
    parameters: Any
    control: Any
    state: Any
    contacts: Any
    reports: Any
    scratch: Any
    progress: Any


def record_step(shares: WorldShares, arrays: StepArrays, *, all_solvers: bool, newton: bool) -> list[WorldLaunch]:
    """Record the launches of a step of all worlds.

    Args:
        shares: of the worlds.
        arrays: of the step.
        all_solvers: other solvers than accelerated gradient descent may run.
        newton: proximal Newton steps may follow it: there is room for what they factorise.
    """
    given = vars(arrays)

    def record(made: StageKernel, *, in_turn: bool = False) -> WorldLaunch:
        return shares.record(made.kernel, inputs=[given[name] for name in made.arguments], in_turn=in_turn)

    if not shares.own_slots:
        return [record(fused_step(all_solvers), in_turn=True)]
    several = arrays.topology.unit_count > 1
    solve = solver_stages(ConeSolver(arrays.config.solver), several=several, newton=newton, follows=all_solvers)
    return [record(stage_kernel(stage)) for stage in step_stages(solve) if stage.is_due(given)]
