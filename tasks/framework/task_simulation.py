"""Access of the task layer to a simulation: torch views made once, stepping, and snapshots as plain tensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import torch
import warp as wp

import simwarp as sw
from simwarp.core.fields import FieldGroup

from ..randomisation.randomising import check_ranges, drawn_parameters
from .config import TaskConfig
from .errors import InputError

_NON_FINITE_BIT = 1

_GROUPS = ("state", "control", "contacts", "memory")
"""Parts of a snapshot whose numbers are kept."""


@dataclasses.dataclass(frozen=True)
class PhysicsViews:
    """Zero-copy torch views of a simulation's state and control. ``W`` worlds, ``B`` bodies.

    Attributes:
        joint_q: (W, dofs) joint positions [m or rad].
        joint_qd: (W, dofs) joint velocities.
        joint_force: (W, dofs) control: joint forces [N or N m].
        body_force: (W, B, 3) control: forces at the centres of mass [N], world frame.
        body_torque: (W, B, 3) control: torques [N m], world frame.
        body_q: (W, B, 7) poses of the centres of mass: x y z, quaternion x y z w.
        body_v: (W, B, 3) linear velocities [m/s], world frame.
        body_omega: (W, B, 3) angular velocities [rad/s], world frame.
        world_status: (W,) int32 bit flags; bit 0 marks a world that went non-finite and is frozen.
    """

    joint_q: torch.Tensor
    joint_qd: torch.Tensor
    joint_force: torch.Tensor
    body_force: torch.Tensor
    body_torque: torch.Tensor
    body_q: torch.Tensor
    body_v: torch.Tensor
    body_omega: torch.Tensor
    world_status: torch.Tensor

    def broken(self) -> torch.Tensor:
        """Return (W,) bool: worlds whose state went non-finite."""
        return (self.world_status & _NON_FINITE_BIT) != 0


@dataclasses.dataclass(frozen=True)
class Attachments:
    """Elements of every physics step beside the bodies: force elements, and sensors, whose frames a policy sees once
    per control step.
    """

    elements: Sequence[Any] = ()
    sensors: Sequence[Any] = ()


def no_attachments(model: Any) -> Attachments:
    """Bodies alone."""
    return Attachments()


def build_physics(
    build: Callable[[sw.ModelBuilder], sw.ModelBuilder | None],
    config: TaskConfig,
    num_worlds: int,
    device: str,
    *,
    per_world: Iterable[str] = (),
    solver: sw.SolverOptions | None = None,
    flex: sw.flex.Options | None = None,
    attach: Callable[[Any], Attachments] = no_attachments,
    elements: Callable[[Any], Sequence[Any]] | None = None,
) -> tuple[Any, PhysicsViews, sw.ModelBuilder]:
    """Build model and simulation from a task's ``build`` and its configuration; also returns the builder.

    Args:
        build: fills the builder it gets, or returns one of its own, which then gets the configured gravity.
        config: dt, sub-steps and, if it has that field, gravity.
        num_worlds: number of worlds W.
        device: device name.
        per_world: names of model parameters that get a copy per world.
        solver: numbers of the solver.
        flex: numbers of flexible parts.
        attach: force elements and sensors for the finished model.
        elements: further force elements for it, which come last: of whoever looks on, not of the task.
    """
    builder = sw.ModelBuilder(gravity=(0.0, 0.0, -getattr(config, "gravity", 9.81)))
    made = build(builder)
    if made is not None:
        made.gravity = builder.gravity
        builder = made
    model = builder.finalize(world_count=num_worlds, device=device, per_world=per_world)
    attachments = attach(model)
    simulation = sw.Simulation(
        model, dt=config.dt, substeps=config.substeps, solver=solver, flex=flex,
        elements=[*attachments.elements, *(elements(model) if elements else ())], sensors=attachments.sensors,
        read_every=config.decimation, check_start=False,
    )  # fmt: skip
    simulation.read_interval.asked_before_replay = True  # `at_start`, by whoever captures a control step
    state, control = simulation.state, simulation.control
    views = PhysicsViews(
        joint_q=sw.to_torch(state.joint_q),
        joint_qd=sw.to_torch(state.joint_qd),
        joint_force=sw.to_torch(control.joint_force),
        body_force=sw.to_torch(control.body_force),
        body_torque=sw.to_torch(control.body_torque),
        body_q=sw.to_torch(state.body_q),
        body_v=sw.to_torch(state.body_v),
        body_omega=sw.to_torch(state.body_omega),
        world_status=sw.to_torch(state.world_status),
    )
    return simulation, views, builder


def physics_of(task: Any, device: str) -> tuple[Any, PhysicsViews | None, sw.ModelBuilder | None]:
    """Build what a task asks for; nothing where it has no physics.

    Raises:
        InputError: ``randomise`` names a parameter that the task writes itself, or there is nothing to randomise.
    """
    config, ranges = task.config, task.config.uncertainty.randomise
    check_ranges(ranges)
    if not task.physics:
        if ranges:
            raise InputError(f"randomise: task '{task.name}' has no physics whose parameters could differ")
        return None, None, None
    drawn = drawn_parameters(ranges)
    own = sorted(task.own_parameters & drawn)
    if own:
        follows = "give body_mass inertia=False" if own[0] == "body_inertia_b" else "it follows body_com_x, y and z"
        hint = "leave it away" if own[0] in ranges else follows
        raise InputError(f"randomise '{own[0]}': task '{task.name}' writes it itself; {hint}")
    return build_physics(
        task.build, config, task.num_worlds, device, per_world=drawn | task.own_parameters,
        solver=task.solver_options(), flex=task.flex_options(), attach=task.attach, elements=task.further_elements,
    )  # fmt: skip


def _rooms(snapshot: Any) -> list[tuple[str, Any]]:
    """Return the parts of a snapshot, or of a group of its arrays, by the names that files have for them."""
    if isinstance(snapshot, tuple):
        return [(str(index), part) for index, part in enumerate(snapshot)]
    if isinstance(snapshot, FieldGroup):
        return list(snapshot.in_files().items())
    return [(name, getattr(snapshot, name)) for name in _GROUPS]


def pack_snapshot(snapshot: Any) -> dict[str, Any]:
    """Return a simulation snapshot as named CPU tensors, which a checkpoint can hold without pickled classes."""
    return {
        name: torch.from_numpy(part.numpy().copy()) if isinstance(part, wp.array) else pack_snapshot(part)
        for name, part in _rooms(snapshot)
    }


def unpack_snapshot(saved: Mapping[str, Any], snapshot: Any) -> Any:
    """Write saved numbers into a snapshot of the same simulation and return it.

    Raises:
        InputError: a part is missing, or has another shape: the simulation is not the one that was saved.
    """
    for name, part in _rooms(snapshot):
        if name not in saved:
            raise InputError(f"saved simulation state has no '{name}': it was made by another version of simwarp")
        if not isinstance(part, wp.array):
            unpack_snapshot(saved[name], part)
            continue
        values = saved[name].cpu().numpy()
        if values.shape != part.numpy().shape:
            raise InputError(
                f"saved simulation state: '{name}' has shape {values.shape}, this simulation {part.numpy().shape}"
            )
        part.assign(values)
    return snapshot


def arrays_of(owner: Any) -> list[wp.array]:
    """Return the arrays of a simulation that a snapshot keeps, or those of a snapshot, in the same order."""
    return [array for group in _GROUPS for _, array in _rooms(getattr(owner, group))]
