"""Forces and tangents of solid elements as the kernels measure them, one world on the CPU."""

# mypy: disable-error-code="attr-defined,arg-type"

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import warp as wp

from simwarp.flex.materials import Elastic, Rubber
from simwarp.flex.mesh_factor import FactorPlan, plan_factor
from simwarp.flex.solid_elements import SolidElements, gather_lists, make_solid_tables, solid_elements
from simwarp.flex.solid_elements_kernels import SolidStep, measure_solids


@dataclasses.dataclass
class Measured:
    """A mesh whose elements kernels measure."""

    solid: SolidElements
    plan: FactorPlan
    tables: Any

    @classmethod
    def of(cls, vertices, elements, material: Elastic | Rubber) -> Measured:
        solid = solid_elements(vertices, elements, material)
        plan = plan_factor(elements, len(vertices))
        held = np.zeros(len(vertices), dtype=np.int32)
        lists = gather_lists(solid.elements, plan)
        return cls(solid, plan, make_solid_tables(solid, lists, plan, held, material, "cpu"))

    def measure(self, x, v=None, *, dt=1.0, damping=0.0, average=1.0):
        """(N, 3) forces, and (3 N, 3 N) of h d + h² (β + ζ) K; with the defaults K and no damping."""
        count, corners = self.solid.elements.shape
        step: Any = SolidStep()
        step.dt, step.numerical_damping, step.average = dt, damping, average
        forces = wp.zeros((1, count * corners), dtype=wp.vec3, device="cpu")
        blocks = wp.zeros((1, count * corners * (corners + 1) // 2), dtype=wp.mat33, device="cpu")
        x, v = (np.ascontiguousarray(each)[None] for each in (x, np.zeros_like(x) if v is None else v))
        wp.launch(
            measure_solids, (1, count),
            inputs=[self.tables, step, *(wp.array(each, dtype=wp.vec3d, device="cpu") for each in (x, v))],
            outputs=[forces, blocks], device="cpu",
        )  # fmt: skip
        total = np.zeros(x.shape[1:])
        np.add.at(total, self.solid.elements.ravel(), forces.numpy()[0].astype(np.float64))
        first, second = np.tril_indices(corners)
        each = blocks.numpy()[0].reshape(count, len(first), 3, 3).astype(np.float64)
        tangent = np.zeros((len(total), 3, len(total), 3))
        rows, columns = self.solid.elements[:, first], self.solid.elements[:, second]
        np.add.at(tangent, (rows, slice(None), columns), each)
        off = first != second
        np.add.at(tangent, (columns[:, off], slice(None), rows[:, off]), each[:, off].transpose(0, 1, 3, 2))
        return total, tangent.reshape(3 * len(total), -1)
