"""The launches of collision and step: one kernel where worlds share scratch, one per stage where each has its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from simwarp.core.array_devices import refuse_strided_arguments
from simwarp.core.types import ConeSolver
from simwarp.kernels.collision import collision_stages
from simwarp.kernels.core.stages import Stage, StageKernel
from simwarp.kernels.dynamics import step_stages
from simwarp.kernels.dynamics.solve_stages import solver_stages
from simwarp.model.model import Model
from simwarp.simulation.world_launches import WorldLaunch, WorldShares


def record_collision(
    shares: WorldShares, model: Model, *, config: Any, state: Any, contacts: Any, scratch: Any, lists: Any
) -> list[WorldLaunch]:
    """Record the launches that find the contacts of all worlds.

    Args:
        shares: of the worlds.
        model: with its topology, parameters and assets.
        config: numbers of the step.
        state, contacts: of the simulation, as kernels have them.
        scratch, lists: for intermediate values.
    """
    if model.topology.pair_count == 0:
        return []
    given = {
        "config": config, "topology": model.topology, "parameters": model.parameters, "assets": model.assets,
        "state": state, "scratch": scratch, "lists": lists, "contacts": contacts,
    }  # fmt: skip
    stages = collision_stages
    faces = model.topology.face_count > 0
    return _record(shares, lambda: stages.fused_collision(faces), stages.STAGES, stages.stage_kernel, given)


def record_step(
    shares: WorldShares, model: Model, *, rows: int, all_solvers: bool, newton: bool, **arrays: Any
) -> list[WorldLaunch]:
    """Record the launches of a step of all worlds.

    Args:
        shares: of the worlds.
        model: with its topology and parameters.
        rows: of a world's cone problem, at most.
        all_solvers: other solvers than accelerated gradient descent may run.
        newton: proximal Newton steps may follow it: there is room for what they factorise.
        arrays: `config` (numbers of the step), `control`, `state`, `contacts`, `reports` of the simulation, `scratch`
            and `progress` for intermediate values, as kernels have them.
    """
    solve = solver_stages(
        ConeSolver(arrays["config"].solver),
        rows=rows,
        several=model.topology.unit_count > 1,
        newton=newton,
        follows=all_solvers,
    )
    given = {
        "topology": model.topology, "parameters": model.parameters, "flexible": model.mesh_tables, **arrays
    }  # fmt: skip
    stages = step_stages
    topology = model.topology
    parts = topology.elastic_count > 0, topology.mesh_nodes > 0, topology.face_count > 0
    table = stages.step_stages(solve)
    trees = not all_solvers and not any(stage.is_due(given) for stage in table if stage.when in stages.NOT_OF_TREES)

    def fused() -> StageKernel:
        return stages.fused_tree_step() if trees else stages.fused_step(all_solvers, *parts)

    return _record(shares, fused, table, stages.stage_kernel, given)


def _record(
    shares: WorldShares, fused: Callable[[], StageKernel], stages: Sequence[Stage],
    separate: Callable[[Stage], StageKernel], given: Mapping[str, Any],
) -> list[WorldLaunch]:  # fmt: skip
    """The launches of all stages together, or of each that the model has."""
    together = not shares.own_slots
    made = [fused()] if together else [separate(stage) for stage in stages if stage.is_due(given)]
    if together:
        refuse_strided_arguments(made[0].kernel, [None, *(given[name] for name in made[0].arguments)])
    return [
        shares.record(
            each.kernel, _lanes(each, shares), inputs=[given[name] for name in each.arguments], in_turn=together
        )
        for each in made
    ]


def _lanes(kernel: StageKernel, shares: WorldShares) -> int | None:
    """Threads of a world, as a second axis of the launch: on a CPU there is one."""
    if kernel.lanes == 1:
        return None
    return kernel.lanes if shares.device.is_cuda else 1
