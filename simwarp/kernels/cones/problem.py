"""The cone problem of one world: its arrays, which solvers share.

minimise  1/2 gamma^T S gamma + r^T gamma   over a product of boxes and friction cones (blocks),
with u = S gamma + r the velocities [m/s or rad/s] and gamma the impulses [N·s or N·m·s].
"""

import warp as wp

from simwarp.core.types import BlockKind, FrictionLaw

wp.set_module_options({"enable_backward": False})

BOX = wp.constant(int(BlockKind.BOX))
CONTACT = wp.constant(int(BlockKind.CONTACT))
ROLLING = wp.constant(int(BlockKind.ROLLING))
EXACT = wp.constant(int(FrictionLaw.EXACT))


@wp.struct
class ConeConfig:
    """Numbers of a solve."""

    friction_law: int  # FrictionLaw
    solver: int  # ConeSolver
    max_iterations: int
    tolerance: float  # residual at which a solver stops [m/s or rad/s]


@wp.struct
class ConeProblem:
    """One world's problem. Arrays are as long as the capacity; only the first `row_count`, `block_count` count.

    S is either dense (`dense` = 1: array `s`) or applied through the degrees of freedom of the tree (`dense` = 0):
    S = Y Y^T - W W^T + diag(compliance), where row i of block b has the entries y[i, e] at the tree
    degrees of freedom block_tree_dof[b, e], e < block_entries[b], and W has `loop_count` columns.
    """

    row_count: int
    block_count: int
    dense: int
    tree_dof_count: int
    loop_count: int

    block_row: wp.array[int]  # first row of each block, and the total at the end
    block_kind: wp.array[int]  # BlockKind
    friction: wp.array[float]  # per block
    rolling: wp.array[float]  # per block [m]
    spinning: wp.array[float]  # per block [m]
    cohesion: wp.array[float]  # per block: the cone's apex is at n = -cohesion [N·s]

    lower: wp.array[float]  # per row, of BOX blocks
    upper: wp.array[float]
    r: wp.array[float]  # per row
    diagonal: wp.array[float]  # per row: S_ii, positive
    gamma: wp.array[float]  # per row: warm start in, solution out

    s: wp.array2d[float]  # (rows, rows), symmetric, compliance on its diagonal
    y: wp.array2d[float]  # (rows, entries)
    block_tree_dof: wp.array2d[int]  # (blocks, entries)
    block_entries: wp.array[int]
    w: wp.array2d[float]  # (rows, loop rows)
    compliance: wp.array[float]  # per row

    # scratch
    tree_dof_sum: wp.array[float]  # (tree degrees of freedom,)
    loop_sum: wp.array[float]  # (loop rows,)
    scale: wp.array[float]  # per row
    vectors: wp.array2d[float]  # (SOLVER_VECTORS, rows)
    factor: wp.array2d[float]  # (rows, rows): of solvers that factorise
    wide: wp.array2d[wp.float64]  # (WIDE_VECTORS, rows): of the interior point


# Rows of `vectors`. All solvers keep these and number their own from OWN on.
X = wp.constant(0)  # the iterate
AX = wp.constant(1)  # S x
BEST = wp.constant(2)  # the iterate of the least residual
R_EFF = wp.constant(3)  # r, with De Saxcé's term on the normal rows
WEIGHT = wp.constant(4)  # greatest diagonal of the row's block; 0 where nothing moves
LOW = wp.constant(5)  # part of the returned impulses beyond float32
OWN = wp.constant(6)
SOLVER_VECTORS = 12
WIDE_VECTORS = 24


@wp.struct
class SolveReport:
    """Iterations done and the residual of the impulses returned [m/s or rad/s]."""

    iterations: int
    residual: float
