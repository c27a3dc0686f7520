"""One mesh's factor on the CPU, of a matrix given as dense blocks."""

# mypy: disable-error-code="index,no-untyped-def,valid-type"

from typing import Any

import numpy as np
import warp as wp

from simwarp.flex.mesh_factor import FactorPlan, make_factor_tables
from simwarp.flex.mesh_factor_kernels import FactorTables, factor_mesh, solve_mesh

wp.set_module_options({"enable_backward": False})


@wp.kernel(enable_backward=False)
def factor_and_solve(
    # inputs
    repetitions: int,
    tables: FactorTables,
    values: wp.array2d[Any],
    # outputs
    panels: wp.array2d[Any],
    updates: wp.array2d[Any],
    inverse_pivots: wp.array2d[Any],
    x: wp.array2d[Any],
    work: wp.array2d[Any],
):
    """Factors as often as it is said, and solves once."""
    world = wp.tid()
    for _ in range(repetitions):
        factor_mesh(tables, values[world], panels[world], updates[world], inverse_pivots[world], work[world])
    solve_mesh(tables, panels[world], inverse_pivots[world], x[world], work[world])


def solved(plan: FactorPlan, matrices, right, dtype, *, repetitions: int = 1):
    """(W, 3 N) solutions of (W, 3 N, 3 N) matrices; only the blocks of the plan are read."""
    count = plan.node_count
    places = (3 * plan.order[:, None] + np.arange(3)).ravel()
    blocks = matrices.reshape(-1, count, 3, count, 3)[:, plan.order][:, :, :, plan.order]
    values = blocks[:, plan.blocks[:, 0], :, plan.blocks[:, 1]].transpose(1, 0, 3, 2).reshape(len(matrices), -1)
    lengths = plan.panel_size, max(plan.update_size, 1), 3 * count
    given = [values, *(np.zeros((len(matrices), length)) for length in lengths), right[:, places],
             np.zeros((len(matrices), plan.work_size))]  # fmt: skip
    arrays: list[Any] = [wp.array(np.ascontiguousarray(each, dtype=dtype), device="cpu") for each in given]
    wp.launch(
        factor_and_solve, len(matrices), inputs=[repetitions, make_factor_tables(plan, "cpu"), *arrays], device="cpu"
    )
    out = np.empty(right.shape)
    out[:, places] = arrays[4].numpy()
    return out
