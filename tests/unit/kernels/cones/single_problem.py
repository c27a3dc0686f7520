"""One cone problem on the device, dense or with its rows over the degrees of freedom, and what kernels make of it."""

# mypy: disable-error-code="index,assignment,attr-defined,arg-type,no-untyped-def"

from typing import Any

import numpy as np
import warp as wp

from simwarp.core.types import BlockKind, ConeSolver, FrictionLaw
from simwarp.kernels.cones.operator import multiply, natural_residual, refresh, set_scales
from simwarp.kernels.cones.problem import AX, OWN, SOLVER_VECTORS, WIDE_VECTORS, ConeConfig, ConeProblem, SolveReport, X
from simwarp.kernels.cones.projection import project_all
from simwarp.kernels.cones.proximal_newton import is_chain, step_proximally
from simwarp.kernels.cones.solve import solve
from simwarp.kernels.cones.sparse_rows import GROUP
from simwarp.kernels.dynamics.world import CPU_FLAGS

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "cpu_compiler_flags": CPU_FLAGS})

KINDS = {"box": BlockKind.BOX, "contact": BlockKind.CONTACT, "rolling": BlockKind.ROLLING}
PROJECT, MULTIPLY, RESIDUAL, SOLVE, STEP, CHAIN = range(6)


@wp.kernel(enable_backward=False)
def run_problem(
    # inputs
    operation: int,
    config: ConeConfig,
    # in and out
    problem: ConeProblem,
    # outputs
    results: wp.array[float],
):
    """Projects gamma, multiplies gamma by S, measures gamma, solves, takes a proximal step (rho: max_iterations), or
    says whether the problem is a long chain.
    """
    report = SolveReport()
    for row in range(problem.row_count):
        problem.vectors[X, row] = problem.gamma[row]
    if operation == 0:
        project_all(problem, problem.gamma)
    elif operation == 1:
        results[0] = multiply(problem, X, AX)
        refresh(problem, X, OWN)
    elif operation == 2:
        set_scales(problem)
        refresh(problem, X, AX)
        results[0] = natural_residual(problem, X, AX, config.friction_law, 0)
    elif operation == 4:
        set_scales(problem)
        rho = float(config.max_iterations)
        results[0] = float(step_proximally(problem, rho, config.tolerance))
        for row in range(problem.row_count):
            problem.gamma[row] = float(problem.wide[2, row])
    elif operation == 5:
        results[0] = wp.where(is_chain(problem), 1.0, 0.0)
    else:
        report = solve(problem, config)
        results[0] = report.residual
        results[1] = float(report.iterations)


class Single:
    """One problem on the device; dense unless `entries` (matrix-free: y, slots of each block, w, compliance).

    Blocks see all loop rows, or those of `block_loops`.
    """

    def __init__(self, n, r, blocks, entries=None, block_loops=None):
        def floats(values):
            return wp.array(np.ascontiguousarray(values, dtype=np.float32), dtype=float, device="cpu")

        def ints(values):
            return wp.array(np.ascontiguousarray(values, dtype=np.int32), dtype=int, device="cpu")

        rows = len(r)
        p: Any = ConeProblem()
        p.row_count, p.block_count, p.dense, p.newton = rows, len(blocks), 1, 1
        p.rolling_count = sum(b.kind == "rolling" for b in blocks)
        p.block_row = ints([*(b.row for b in blocks), rows])
        p.block_kind = ints([KINDS[b.kind] for b in blocks])
        slopes = np.array([(*b.slopes, 0.0, 0.0, 0.0)[:3] for b in blocks])
        p.friction, p.rolling, p.spinning = (floats(slopes[:, k]) for k in range(3))
        p.cohesion = floats([b.cohesion for b in blocks])
        lower, upper = np.zeros(rows), np.zeros(rows)
        for b in blocks:
            lower[b.row], upper[b.row] = b.bounds
        p.lower, p.upper, p.r = floats(lower), floats(upper), floats(r)
        p.diagonal, p.s, p.gamma = floats(np.diag(n)), floats(n), floats(np.zeros(rows))
        p.scale, p.vectors = floats(np.full(rows, np.nan)), floats(np.full((SOLVER_VECTORS, rows), np.nan))
        p.factor, p.factor_end = floats(np.full(n.shape, np.nan)), ints(np.zeros(len(n)))
        p.wide = wp.array(np.full((WIDE_VECTORS, rows), np.nan), dtype=wp.float64, device="cpu")
        if entries is not None:
            y, slots, w, compliance = entries
            table = np.tile([0, w.shape[1], 0, 0], (len(blocks), 1)) if block_loops is None else block_loops
            loops = int((table[:, 0] + table[:, 1]).max(initial=0))
            loops = max(loops, int((table[:, 2] + table[:, 3]).max(initial=0)))
            p.dense, p.tree_dof_count, p.loop_count = 0, int(slots.max()) + 1, loops
            p.y, p.block_tree_dof, p.w, p.compliance = floats(y), ints(slots), floats(w), floats(compliance)
            p.block_entries, p.entry_count = ints(np.full(len(blocks), slots.shape[1])), y.shape[1]
            p.block_loops = ints(table)
            p.tree_dof_sum, p.loop_sum = floats(np.zeros(p.tree_dof_count)), floats(np.zeros(max(loops, 1)))
            p.s, p.factor = floats(np.zeros((1, 1))), floats(np.full((p.tree_dof_count, p.tree_dof_count), np.nan))
            p.factor_end = ints(np.zeros(p.tree_dof_count))
            p.spread = floats(np.full((p.tree_dof_count, GROUP), np.nan))
        self.problem = p

    def run(self, operation, gamma, law=FrictionLaw.EXACT, solver=ConeSolver.APGD, iterations=20000, tolerance=2e-6):
        """Impulses and the two numbers of a run that starts from gamma."""
        config = ConeConfig()
        config.friction_law, config.solver = int(law), int(solver)
        config.max_iterations, config.tolerance = iterations, tolerance
        self.problem.gamma.assign(np.asarray(gamma, dtype=np.float32))
        results = wp.zeros(2, dtype=float, device="cpu")
        wp.launch(run_problem, dim=1, inputs=[operation, config, self.problem, results], device="cpu")
        return self.problem.gamma.numpy().astype(float), results.numpy()


def rows_with_factor(rng, blocks, rows, entries=5, slots=14, loops=2):
    """N and the y, slots, w, compliance that make it."""
    y = rng.normal(size=(rows, entries))
    slot = np.array([rng.choice(slots, entries, replace=False) for _ in blocks])
    full = np.zeros((rows, slots))
    for b, s in zip(blocks, slot, strict=True):
        full[b.rows, s] = y[b.rows]
    # W W^T takes away part of what Y Y^T has: N stays semidefinite.
    w = full @ np.linalg.qr(rng.normal(size=(slots, loops)))[0]
    compliance = rng.uniform(0.0, 0.1, rows)
    return full @ full.T - w @ w.T + np.diag(compliance), (y, slot, w, compliance)
