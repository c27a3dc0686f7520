"""Blades of a soil: their tables, the launch of the forces on them, and the one of the soil that they move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import warp as wp

from simwarp.core.arrays import with_zeros
from simwarp.simulation.attachments import StepContext
from simwarp.simulation.step_sizes import scratch_slots_of
from simwarp.soil.blade_cutting_kernels import cut_soil
from simwarp.soil.blade_wedge_kernels import push_blades
from simwarp.soil.bulldozing_kernels import FlowScratch, FlowTables
from simwarp.soil.soil_shapes import SoilBlade, SoilShape
from simwarp.soil.soil_tables_kernels import SoilBlades

CUT_PERIOD: Final = 0.01
"""Between two times that soil is moved ahead of a blade and slides [s]; rounded to steps."""
CUT_ITERATIONS: Final = 40
"""Jacobi steps of sliding each time: a heap that is fed by 0.1 m at 0.5 m/s stands 2 degrees steeper than at rest."""


class Blades:
    """The blades among the shapes of a soil.

    Args:
        shapes: of the soil, at least one of them a blade.
        spacing: of the nodes [m].
        device: of the arrays.
    """

    def __init__(self, shapes: Sequence[SoilShape], spacing: float, device: Any) -> None:
        found = [(row, shape) for row, shape in enumerate(shapes) if isinstance(shape, SoilBlade)]
        self.count = len(found)
        tables: Any = SoilBlades()
        self._tables = tables
        tables.shape = wp.array(np.array([row for row, _ in found], np.int32), dtype=int, device=device)
        reach = [blade.reach + 4.0 * spacing for _, blade in found]
        for name, values in (
            ("width", [blade.width for _, blade in found]),
            ("rake", [blade.rake for _, blade in found]),
            ("friction", [blade.friction_angle for _, blade in found]),
            ("adhesion", [blade.adhesion for _, blade in found]),
            ("repose", [math.tan(blade.repose) for _, blade in found]),
            ("reach", reach),
        ):
            setattr(tables, name, wp.array(np.array(values, np.float32), dtype=float, device=device))
        # the box around a turned rectangle from `reach` behind to `reach` ahead, and a ring that is closed
        across = max(2.0 * math.hypot(r, 0.5 * blade.width + r) for r, (_, blade) in zip(reach, found, strict=True))
        self._nodes = (math.ceil(across / spacing) + 4) ** 2

    def record_forces(
        self, simulation: StepContext, dt: float, placed: Sequence[Any], nodes: Any, reports: Any
    ) -> Any:  # fmt: skip
        """The launch after shapes were pressed in, whose rows of reports it writes for blades.

        Args:
            simulation: that it is part of.
            dt: of a step [s].
            placed: constants of the soil, its shapes, assets and state.
            nodes: of the soil.
            reports: of the soil.
        """
        soil, shapes, assets, state = placed
        inputs = [dt, simulation.model.gravity, soil, shapes, self._tables, assets, state, nodes]
        return simulation.shares.record(push_blades, self.count, inputs=inputs, outputs=[reports])

    def record_cutting(self, simulation: StepContext, dt: float, placed: Sequence[Any], nodes: Any) -> Any:
        """The launch that moves soil ahead of the blades; see `record_forces`."""
        soil, shapes, assets, state = placed
        shares = simulation.shares
        flow: Any = FlowTables()
        flow.every, flow.iterations = max(1, round(CUT_PERIOD / dt)), CUT_ITERATIONS
        slots = scratch_slots_of(shares)
        scratch = with_zeros(FlowScratch(), (slots, self._nodes), shares.device, "top", "moved", "mine")
        with_zeros(scratch, (slots, 2, self._nodes), shares.device, "level")
        inputs = [dt, flow, soil, shapes, self._tables, assets, state]
        return shares.record(cut_soil, inputs=inputs, outputs=[nodes, scratch])
