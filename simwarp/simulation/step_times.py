"""Times and numbers of steps as users give them."""

from __future__ import annotations

from typing import Any, Final

from simwarp.core.types import FLOAT32_MAX, ModelError, formatted, number
from simwarp.model.checks import whole_number

SHORTEST_STEP: Final = 1.0e-9
"""Of a sub-step [s]: kernels divide by it in float32."""
LONGEST_STEP: Final = 1.0e6
SUBSTEP_LIMIT: Final = 1_000_000
COUNT_LIMIT: Final = 2**31 - 1
"""Of sub-steps: clocks of sensors count them in 32 bits."""


def checked_dt(dt: Any, substeps: int) -> float:
    """Time of a step [s], or a ModelError where float32 cannot divide by its sub-steps."""
    given = number(dt)
    if not 0.0 < given <= FLOAT32_MAX:
        finite = "" if given <= 0.0 else " and finite"
        raise ModelError(f"Simulation: dt must be > 0 s{finite}, got {formatted(dt)}; give the time of a step")
    if not SHORTEST_STEP <= given / substeps <= LONGEST_STEP:
        raise ModelError(
            f"Simulation: dt / substeps must be in {SHORTEST_STEP:g}..{LONGEST_STEP:g} s, got {given:g} / {substeps}; "
            "take a time that float32 resolves"
        )
    return given


def checked_read_every(read_every: Any, substeps: int) -> int:
    """Steps between two reads of the sensors' data, or a ModelError."""
    return whole_number("Simulation", "read_every", read_every, 1, COUNT_LIMIT // substeps, "1 is the default")


def checked_steps(steps: Any, substeps: int) -> int:
    """Steps to run at once, or a ModelError."""
    return whole_number("step", "steps", steps, 0, COUNT_LIMIT // substeps, "give the number of steps")
