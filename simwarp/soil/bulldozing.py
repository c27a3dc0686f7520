"""Bulldozing: options of how soil that a shape presses down rises beside it, and the launch that moves it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Final

from simwarp.core.arrays import with_zeros
from simwarp.core.readable import ReadableFields
from simwarp.core.types import ModelError, formatted
from simwarp.model.checks import whole_number
from simwarp.simulation.attachments import StepContext
from simwarp.simulation.step_sizes import scratch_slots_of
from simwarp.soil.bulldozing_kernels import FlowScratch, FlowTables, push_soil_aside
from simwarp.soil.soil_shapes import SoilShape, greatest_reach

STEP_LIMIT: Final = 100
"""Of erosion, and nodes that take part around a patch."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bulldozing(ReadableFields):
    """Soil that a shape presses down rises beside it, and slides where that gets too steep (Chrono's SCM).

    Attributes:
        angle: that heaps slide down to [rad].
        flow: share of what is pressed down that rises; the rest is compacted.
        iterations: Jacobi steps of erosion in each flow.
        propagation: nodes beyond those beside a patch that erosion reaches.
        period: between flows [s]; rounded to steps.

    Raises:
        ModelError: a value breaks its rule.
    """

    angle: float = math.radians(55.0)
    flow: float = 1.0
    iterations: int = 5
    propagation: int = 6
    period: float = 0.01

    def __post_init__(self) -> None:
        _check("angle", self.angle, 0.0, math.radians(80.0), "above 0 and at most 1.396 rad (80 degrees)", "in radians")
        _check("flow", self.flow, 0.0, 1.0, "above 0 and at most 1", "without any, leave bulldozing out")
        _check("period", self.period, 0.0, 1.0, "above 0 and at most 1 s", "0.01 is usual")
        for name in ("iterations", "propagation"):
            whole_number("bulldozing", name, getattr(self, name), 1, STEP_LIMIT, "5 to 10 are usual")

    def description(self) -> str:
        """Flow, period and angle in one line."""
        return f"{100.0 * self.flow:g} % every {1e3 * self.period:g} ms, heaps up to {math.degrees(self.angle):g} deg"


def _check(name: str, value: Any, above: float, limit: float, rule: str, remedy: str) -> None:
    number = isinstance(value, int | float) and math.isfinite(value)
    if not (number and above < value <= limit):
        raise ModelError(f"bulldozing: {name} must be {rule}, got {formatted(value)}; {remedy}")


class SoilFlow:
    """The launch that lets soil flow.

    Args:
        bulldozing: its constants.
        shapes: that sink in.
        spacing: of the nodes [m].
    """

    def __init__(self, bulldozing: Bulldozing, shapes: Sequence[SoilShape], spacing: float) -> None:
        self.bulldozing, self.spacing = bulldozing, spacing
        margin = bulldozing.propagation + 1
        # nodes across the widest footprint, those around, and a ring that is closed
        side = int(2.0 * (greatest_reach(shapes) / spacing + 1.0)) + 1 + 2 * (margin + 1)
        self._nodes = side * side

    def record(self, simulation: StepContext, dt: float, placed: Sequence[Any], nodes: Any) -> Any:
        """The launch after shapes were pressed in.

        Args:
            simulation: that it is part of.
            dt: of a step [s].
            placed: constants of the soil, its shapes, assets and state.
            nodes: of the soil.
        """
        b, shares = self.bulldozing, simulation.shares
        flow: Any = FlowTables()
        flow.every = max(1, round(b.period / dt))
        flow.steepest = self.spacing * math.tan(b.angle)
        flow.iterations, flow.margin = b.iterations, b.propagation + 1
        slots = scratch_slots_of(shares)
        scratch = with_zeros(FlowScratch(), (slots, self._nodes), shares.device, "top", "moved", "mine")
        with_zeros(scratch, (slots, 2, self._nodes), shares.device, "level")
        return shares.record(push_soil_aside, inputs=[flow, *placed], outputs=[nodes, scratch])
