"""Diagnostics of a step, per world, readable at any time without stopping the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from simwarp.core.renames import renamed_fields
from simwarp.core.types import WorldStatus
from simwarp.kernels.core.fields import ReportFields, Reports
from simwarp.model.model import Model

if TYPE_CHECKING:
    from simwarp.simulation.contacts import Contacts
    from simwarp.simulation.state import State

SUSPICIOUS = 100.0
"""Times the solver's tolerance: a residual above is worth a line."""


@renamed_fields(bounded_residual="cone_residual", bounded_count="constraint_count")
class Diagnostics(ReportFields):
    """Per-world reports of the last sub-step. Its arrays are declared in `ReportFields`."""

    def __init__(self, model: Model, *, reactions: bool, accelerations: bool) -> None:
        self.arrays = Reports()
        sizes = model.sizes(reactions=reactions, accelerations=accelerations)
        self.allocate(sizes, model.device, "diagnostics", self.arrays)


def explain_worlds(
    state: State, contacts: Contacts, diagnostics: Diagnostics, tolerance: float, *,
    elements: Sequence[Any] = (), parameters: Mapping[int, str],
) -> list[str]:  # fmt: skip
    """See `Simulation.problems`; `parameters`: a line by world about values that were written."""
    lines = []
    told = [parameters, *(part.world_problems() for part in elements if hasattr(part, "world_problems"))]
    own = np.zeros(state.world_status.shape, dtype=bool)
    own[[world for each in told for world in each]] = True
    status = state.world_status.numpy()
    overflow = contacts.contact_overflow.numpy()
    capacity = contacts.contact_gap.shape[1]
    residual = diagnostics.cone_residual.numpy()
    for world in np.nonzero((status != 0) | (overflow > 0) | ~(residual <= SUSPICIOUS * tolerance) | own)[0]:
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
        found += [each[world] for each in told if world in each]
        lines.append(f"world {world}: " + "; ".join(found))
    return lines
