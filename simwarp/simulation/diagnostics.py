"""What a step tells about itself, per world, readable at any time without stopping the run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from simwarp.core.arrays import FixedAttributes
from simwarp.core.types import ArrayLayout, WorldStatus
from simwarp.kernels.core.tables import Reports
from simwarp.model.model import Model

if TYPE_CHECKING:
    from simwarp.simulation.contacts import Contacts
    from simwarp.simulation.state import State

SUSPICIOUS = 100.0
"""Times the solver's tolerance: a residual above is worth a line."""


class Diagnostics(FixedAttributes):
    """Per-world reports of the last sub-step.

    Attributes:
        row_residual: (W,) largest speed error of the bilateral rows [m/s or rad/s].
        bounded_residual: (W,) natural residual of limits, friction, motors and contacts [m/s or rad/s].
        bounded_count: (W,) int32, rows on coordinates and contacts that took part.
        iterations: (W,) int32, of their solve, those of a rescue by the interior point included.
        position_error: (W,) largest joint violation [m or rad], at the step's start (after it when projected).
        energy: (W,) float64 mechanical energy [J] as of the last `Simulation.measure_energy`.
        joint_reaction_force, joint_reaction_torque: (W, J) vec3, what the joint applies to its second body at
            anchor 1, drives and limits included, world frame [N, N·m]; zeros unless the simulation records them.
    """

    NAMES = (
        "row_residual", "bounded_residual", "bounded_count", "iterations", "position_error", "joint_reaction_force",
        "joint_reaction_torque",
    )  # fmt: skip

    row_residual: wp.array
    bounded_residual: wp.array
    bounded_count: wp.array
    iterations: wp.array
    position_error: wp.array
    energy: wp.array
    joint_reaction_force: wp.array
    joint_reaction_torque: wp.array

    def __init__(self, model: Model, *, reactions: bool) -> None:
        self.arrays = Reports()
        for name, layout in self.layouts(model, reactions).items():
            array = wp.zeros(layout.shape, dtype=layout.dtype, device=model.device)
            setattr(self, name, array)
            if name in self.NAMES:
                setattr(self.arrays, name, array)
        self._fix()

    @classmethod
    def layouts(cls, model: Model, reactions: bool) -> dict[str, ArrayLayout]:
        """The arrays of a model's diagnostics; `reactions`: whether those of joints are recorded."""
        worlds = (model.world_count,)
        joints = (model.world_count if reactions else 0, model.joint_count)
        counts = {name: ArrayLayout(worlds, wp.int32) for name in ("bounded_count", "iterations")}
        forces = {name: ArrayLayout(joints, wp.vec3) for name in cls.NAMES if name.startswith("joint_reaction")}
        known = {**counts, **forces, "energy": ArrayLayout(worlds, wp.float64)}
        return {name: known.get(name, ArrayLayout(worlds, wp.float32)) for name in (*cls.NAMES, "energy")}


def explain_worlds(state: State, contacts: Contacts, diagnostics: Diagnostics, tolerance: float) -> list[str]:
    """See `Simulation.problems`."""
    lines = []
    status = state.world_status.numpy()
    overflow = contacts.contact_overflow.numpy()
    capacity = contacts.contact_gap.shape[1]
    residual = diagnostics.bounded_residual.numpy()
    for world in np.nonzero((status != 0) | (overflow > 0) | ~(residual <= SUSPICIOUS * tolerance))[0]:
        found = []
        if status[world] & WorldStatus.NON_FINITE:
            found.append("NON_FINITE: a value overflowed; frozen until Simulation.reset")
        if status[world] & WorldStatus.NOT_ASSEMBLED:
            found.append("NOT_ASSEMBLED: its loops do not close for the coordinates that were set; set others")
        if overflow[world] > 0:
            found.append(
                f"contact overflow: {overflow[world]} shallow contacts beyond {capacity} left out; "
                f"finalize(contact_capacity={capacity + int(overflow[world])}) holds them"
            )
        if not residual[world] <= SUSPICIOUS * tolerance:
            found.append(
                f"not converged: residual {residual[world]:.2g} m/s after {diagnostics.iterations.numpy()[world]} "
                "iterations; raise SolverOptions.max_iterations, or look for bodies that joints press into each other"
            )
        lines.append(f"world {world}: " + "; ".join(found))
    return lines
