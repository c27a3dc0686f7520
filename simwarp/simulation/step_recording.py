"""The launches of a step: one kernel where worlds take scratch in turn, several where each has its own."""

from __future__ import annotations

import dataclasses
from typing import Any

import warp as wp

from simwarp.core.types import ConeSolver
from simwarp.kernels.cones.solve import FALLBACK
from simwarp.kernels.core.tables import StepConfig
from simwarp.kernels.dynamics.solve_parts import (
    newton_worlds_kernel,
    proximal_worlds_kernel,
    refine_worlds_kernel,
    solve_worlds_kernel,
)
from simwarp.kernels.dynamics.step_parts import (
    StepState,
    accelerate_worlds,
    answer_worlds,
    bias_worlds,
    change_worlds,
    collect_worlds,
    finish_worlds,
    form_worlds,
    hold_worlds,
    load_worlds,
    meet_worlds,
    move_worlds,
    part_worlds,
    project_worlds,
    publish_worlds,
    push_worlds,
    respond_worlds,
    settle_worlds,
    step_state_layouts,
    weigh_worlds,
)
from simwarp.kernels.dynamics.world import step_worlds_kernel
from simwarp.simulation.world_launches import WorldLaunch, WorldShares


@dataclasses.dataclass(frozen=True, kw_only=True)
class StepArrays:
    """Everything that a step reads and writes, as kernels take it.

    Attributes:
        config: numbers of the step.
        topology, parameters: of the model.
        control, state, contacts, reports: of the simulation.
        scratch: for intermediate values.
        all_solvers: other solvers than accelerated gradient descent may run.
        newton: proximal Newton steps may follow it: there is room for what they factorise.
    """

    config: Any
    topology: Any
    parameters: Any
    control: Any
    state: Any
    contacts: Any
    reports: Any
    scratch: Any
    all_solvers: bool
    newton: bool


def record_step(shares: WorldShares, arrays: StepArrays) -> list[WorldLaunch]:
    """Record the launches of a step of all worlds."""
    if shares.own_slots:
        return _record_parts(shares, arrays)
    inputs = [arrays.config, arrays.topology, arrays.parameters, arrays.control, arrays.scratch, arrays.state]
    kernel = step_worlds_kernel(arrays.all_solvers)
    return [shares.record(kernel, inputs=[*inputs, arrays.contacts], outputs=[arrays.reports], in_turn=True)]


def _stand_in(config: Any) -> Any:
    """Numbers for accelerated gradient descent where the solver that was chosen cannot work."""
    struct: Any = StepConfig
    other = struct()
    for name in struct.vars:
        setattr(other, name, getattr(config, name))
    if config.solver == ConeSolver.INTERIOR_POINT:
        other.max_iterations = int(FALLBACK) * config.max_iterations
    return other


def _solves(arrays: StepArrays) -> list[tuple[Any, ...]]:
    """Kernels of the cone problem that may be needed, with their first inputs."""
    model = (arrays.config, arrays.topology)
    solver = ConeSolver(arrays.config.solver)
    several = arrays.topology.unit_count > 1
    newton, refine = newton_worlds_kernel(several=several), refine_worlds_kernel(several=several)
    commands: list[tuple[Any, ...]] = []
    if solver in (ConeSolver.PADMM, ConeSolver.INTERIOR_POINT):  # which cannot solve all
        stand_in = (_stand_in(arrays.config), arrays.topology)
        commands.append((solve_worlds_kernel(solver, True, several=several), *stand_in))
        if arrays.newton:
            commands += [
                (proximal_worlds_kernel(solver, True, rest, several=several), *stand_in) for rest in (False, True)
            ]
    if solver == ConeSolver.INTERIOR_POINT:
        commands += [(newton, *model, 0), (refine, *model, 0)]
    else:
        commands.append((solve_worlds_kernel(solver, several=several), *model))
        if solver == ConeSolver.APGD and arrays.newton:
            commands += [
                (proximal_worlds_kernel(solver, False, rest, several=several), *model) for rest in (False, True)
            ]
    if arrays.all_solvers:
        commands += [(newton, *model, 1), (refine, *model, 1)]
    return commands


def _record_parts(shares: WorldShares, arrays: StepArrays) -> list[WorldLaunch]:
    """The kernels that this model needs, in turn."""
    step: Any = StepState()
    for name, layout in step_state_layouts(shares.worlds).items():
        setattr(step, name, wp.zeros(layout.shape, dtype=layout.dtype, device=shares.device))
    config, topology, parameters, scratch = arrays.config, arrays.topology, arrays.parameters, arrays.scratch
    control, state, contacts = arrays.control, arrays.state, arrays.contacts
    model = [config, topology, parameters]

    def part(kernel: wp.Kernel, *parameters: Any) -> WorldLaunch:
        return shares.record(kernel, inputs=parameters)

    commands = [
        part(load_worlds, *model, control, scratch, state, contacts, step),
        part(move_worlds, *model, scratch, state),
    ]
    if topology.row_count > 0:
        commands += [
            part(form_worlds, *model, scratch, state, step),
            part(bias_worlds, *model, control, scratch, state),
            part(answer_worlds, *model, scratch, state),
            part(hold_worlds, *model, scratch, state, step),
        ]
    if topology.box_count > 0 or topology.pair_count > 0:
        commands.append(part(collect_worlds, *model, control, scratch, state, step))
        if topology.pair_count > 0:
            commands += [
                part(meet_worlds, *model, scratch, state, contacts, step),
                part(respond_worlds, config, topology, scratch, state, contacts, step),
                part(settle_worlds, config, topology, scratch, state, step),
            ]
        if topology.unit_count > 1:
            commands.append(part(part_worlds, topology, scratch, state, step))
        commands += [
            *(part(kernel, *inputs, scratch, state, step) for kernel, *inputs in _solves(arrays)),
            part(push_worlds, *model, scratch, state, contacts, step),
        ]
    if config.accelerations == 1:
        commands.append(part(change_worlds, *model, scratch, state, arrays.reports))
    if config.projection_iterations > 0:
        commands.append(part(project_worlds, *model, scratch, state, step, arrays.reports))
    if config.accelerations == 1:
        commands.append(part(accelerate_worlds, *model, scratch, state, arrays.reports))
    if config.reactions == 1:
        commands.append(part(weigh_worlds, *model, control, scratch, step, state, contacts, arrays.reports))
    return [
        *commands,
        part(publish_worlds, *model, scratch, step, state, arrays.reports),
        part(finish_worlds, *model, scratch, state),
    ]
