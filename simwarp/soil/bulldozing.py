"""Bulldozing: options of how soil that a shape presses down rises beside it, and the launch that moves it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Annotated, Any, Final, TypeAlias

from simwarp.core.arrays import with_zeros
from simwarp.core.constraints import Angle, Ge, Gt, Le, Meaning, Positive
from simwarp.model.rules import Configuration
from simwarp.simulation.attachments import StepContext
from simwarp.simulation.step_sizes import scratch_slots_of
from simwarp.soil.bulldozing_kernels import FlowScratch, FlowTables, push_soil_aside
from simwarp.soil.soil_shapes import SoilShape, greatest_reach

USUAL_ANGLE: Final = math.radians(55.0)
STEP_LIMIT: Final = 100
"""Of erosion, and nodes that take part around a patch."""
Steps: TypeAlias = Annotated[int, Ge(1), Le(STEP_LIMIT), Meaning("5 to 10, as usual")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bulldozing(Configuration):
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

    angle: Annotated[Positive, Angle(math.radians(80.0)), Meaning("radians")] = USUAL_ANGLE
    flow: Annotated[float, Gt(0.0), Le(1.0), Meaning("a share; without any, leave bulldozing out")] = 1.0
    iterations: Steps = 5
    propagation: Steps = 6
    period: Annotated[float, Gt(0.0), Le(1.0), Meaning("seconds, 0.01 is usual")] = 0.01

    def description(self) -> str:
        """Flow, period and angle in one line."""
        return f"{100.0 * self.flow:g} % every {1e3 * self.period:g} ms, heaps up to {math.degrees(self.angle):g} deg"


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
