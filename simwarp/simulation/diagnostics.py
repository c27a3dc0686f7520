"""Diagnostics of a step, per world, readable at any time without stopping the run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from simwarp.core.types import WorldStatus
from simwarp.kernels.core.fields import ReportFields, Reports
from simwarp.model.model import Model
from simwarp.simulation.joint_errors import joints_apart

if TYPE_CHECKING:
    from simwarp.simulation.state import Contacts, State

SUSPICIOUS = 100.0
"""Times the solver's tolerance: a residual above is worth a line."""

ROW_SHARE = 1.0e-2
"""Of the fastest speed in a world [m/s or rad/s], 1 at least: an error of its rows above is worth a line. A sound one
is 1e-3 of it, and mostly below 1e-5."""


class Diagnostics(ReportFields):
    """Per-world reports of the last sub-step. Its arrays are declared in `ReportFields`."""

    def __init__(self, model: Model, *, reactions: bool, accelerations: bool) -> None:
        self.arrays = Reports()
        sizes = model.sizes(reactions=reactions, accelerations=accelerations)
        self.allocate(sizes, model.device, "diagnostics", self.arrays)


def explain_worlds(
    model: Model, state: State, contacts: Contacts, diagnostics: Diagnostics, tolerance: float, *,
    findings: Iterable[Mapping[int, str]] = (),
) -> list[str]:  # fmt: skip
    """The lines of `Simulation.problems`.

    Args:
        model: of the worlds.
        state, contacts, diagnostics: of the last sub-step.
        tolerance: of the solver [m/s].
        findings: more lines by world.
    """
    checks = (
        _status_lines(state),
        _overflow_lines(contacts),
        _solver_lines(diagnostics, tolerance),
        _row_lines(state, diagnostics),
        joints_apart(model, state, diagnostics.position_error),
        _report_lines(model, state, diagnostics),
        *findings,
    )
    worlds = sorted({world for lines in checks for world in lines})
    return [
        f"world {world}: " + "; ".join(lines[world] for lines in checks if world in lines) for world in worlds
    ]  # fmt: skip


def _status_lines(state: State) -> dict[int, str]:
    """Worlds that were flagged."""
    texts = {
        WorldStatus.NON_FINITE: "a value overflowed; frozen until Simulation.reset",
        WorldStatus.NOT_ASSEMBLED: "its loops do not close for the coordinates that were set; set others",
    }
    status = state.world_status.numpy()
    return {
        world: "; ".join(f"{flag.name}: {text}" for flag, text in texts.items() if status[world] & flag)
        for world in np.nonzero(status)[0].tolist()
    }


def _overflow_lines(contacts: Contacts) -> dict[int, str]:
    """Worlds in which contacts found no slot."""
    overflow, capacity = contacts.contact_overflow.numpy(), contacts.contact_gap.shape[1]
    return {
        world: f"contact overflow: {overflow[world]} shallow contacts beyond {capacity} left out; "
        f"finalize(contact_capacity={capacity + int(overflow[world])}) holds them"
        for world in np.nonzero(overflow > 0)[0].tolist()
    }


def _solver_lines(diagnostics: Diagnostics, tolerance: float) -> dict[int, str]:
    """Worlds in which the solve of limits, friction, motors and contacts did not converge."""
    residual, iterations = diagnostics.cone_residual.numpy(), diagnostics.iterations.numpy()
    return {
        world: f"not converged: residual {residual[world]:.2g} m/s after {iterations[world]} iterations; raise "
        "SolverOptions.max_iterations, or look for bodies that joints press into each other"
        for world in np.nonzero(~(residual <= SUSPICIOUS * tolerance))[0].tolist()
    }


def _row_lines(state: State, diagnostics: Diagnostics) -> dict[int, str]:
    """Worlds in which rows of loops and couplings are not kept: relative to how fast their bodies are."""
    residual = diagnostics.row_residual.numpy()
    fast = np.nonzero(~(residual <= ROW_SHARE))[0]  # of 1 m/s
    speeds = [np.abs(array.numpy()[fast]).max(axis=(1, 2), initial=1.0) for array in (state.body_v, state.body_omega)]
    fastest = np.maximum(*speeds)
    return {
        world: f"loops and couplings are not kept: rows are off by {residual[world]:.2g} m/s or rad/s, at most "
        f"{ROW_SHARE * speed:.2g} is sound at its speeds; look for rows that contradict each other, make masses more "
        "equal, or raise SolverOptions.refinement"
        for world, speed in zip(fast.tolist(), fastest.tolist(), strict=True)
        if not residual[world] <= ROW_SHARE * speed and state.world_status.numpy()[world] == 0
    }


def _report_lines(model: Model, state: State, diagnostics: Diagnostics) -> dict[int, str]:
    """Worlds with reactions, accelerations or an energy that are no numbers, though the state is one."""
    found: dict[int, str] = {}
    status = state.world_status.numpy()
    for name in ("joint_reaction_force", "joint_reaction_torque", "joint_qdd", "energy"):
        values = getattr(diagnostics, name).numpy()
        rows = np.isfinite(values).reshape(len(values), -1) if values.size else np.ones((0, 1), bool)
        for world in np.nonzero(~rows.all(axis=1) & (status[: len(values)] == 0))[0].tolist():
            found.setdefault(
                world,
                f"{name} must be finite, got {values[world].reshape(-1)[int(np.argmin(rows[world]))]}; look for loads "
                f"beyond float32, and masses (the heaviest body has {model.mass_ratio:.2g} times that of the lightest)",
            )
    return found
