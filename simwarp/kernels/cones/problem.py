"""The cone problem of one world: its arrays, which solvers share.

minimise  1/2 gamma^T S gamma + r^T gamma   over a product of boxes and friction cones (blocks),
with u = S gamma + r the velocities [m/s or rad/s] and gamma the impulses [N·s or N·m·s].
"""

import warp as wp

from simwarp.core.types import BlockKind, FrictionLaw
from simwarp.kernels.cones.sparse_rows import GROUP
from simwarp.kernels.core.scratch import ScratchGroup, scratch_array, scratch_number

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


SOLVER_VECTORS = 12
WIDE_VECTORS = 24


class ConeScratch(ScratchGroup, prefix="cone_"):
    """One world's problem. Arrays are as long as the capacity; only the first `row_count`, `block_count` count.

    S is either dense (`dense` = 1: array `s`) or applied through the degrees of freedom of the tree (`dense` = 0):
    S = Y Y^T - W W^T + diag(compliance), where row i of block b has the entries y[i, e] at the tree
    degrees of freedom block_tree_dof[b, e], e < block_entries[b]. A block sees the loop rows of one group or of two:
    W's columns of its rows are those of the first, then those of the second (`block_loops`).
    """

    row_count = scratch_number(int)
    block_count = scratch_number(int)
    dense = scratch_number(int)
    tree_dof_count = scratch_number(int)
    loop_count = scratch_number(int)
    rolling_count = scratch_number(int)  # ROLLING blocks
    newton = scratch_number(int)  # 1: proximal Newton steps may be tried, where there is room
    chain = scratch_number(int)  # 1: a long chain, to which Newton steps come soon (`is_chain`)
    lanes = scratch_number(int)  # of a warp, which share the problem (core/lanes.py); 0: one thread has it
    entry_count = scratch_number(int)  # most entries that a row of these degrees of freedom can have

    block_row = scratch_array(wp.int32, "block_ends")  # first row of each block, and the total at the end
    block_kind = scratch_array(wp.int32, "block_ends")  # BlockKind
    block_entries = scratch_array(wp.int32, "block_ends")
    friction = scratch_array(wp.float32, "blocks")
    rolling = scratch_array(wp.float32, "blocks")  # [m]
    spinning = scratch_array(wp.float32, "blocks")  # [m]
    cohesion = scratch_array(wp.float32, "blocks")  # the cone's apex is at n = -cohesion [N·s]

    lower = scratch_array(wp.float32, "cone_rows")  # of BOX blocks
    upper = scratch_array(wp.float32, "cone_rows")
    r = scratch_array(wp.float32, "cone_rows")
    diagonal = scratch_array(wp.float32, "cone_rows")  # S_ii, positive
    gamma = scratch_array(wp.float32, "cone_rows")  # warm start in, solution out
    compliance = scratch_array(wp.float32, "cone_rows")
    scale = scratch_array(wp.float32, "cone_rows")

    s = scratch_array(wp.float32, "dense_rows", "dense_rows")  # symmetric, compliance on its diagonal
    y = scratch_array(wp.float32, "cone_rows", "entries")
    block_tree_dof = scratch_array(wp.int32, "blocks", "entries")
    block_loops = scratch_array(wp.int32, "blocks", 4)  # first loop row of a group, how many; the same of another one
    w = scratch_array(wp.float32, "cone_rows", "share_width")

    tree_dof_sum = scratch_array(wp.float32, "tree_dofs")
    loop_sum = scratch_array(wp.float32, "rows")
    spread = scratch_array(wp.float32, "tree_dofs", GROUP)
    vectors = scratch_array(wp.float32, SOLVER_VECTORS, "cone_rows")
    factor = scratch_array(wp.float32, "factor_rows", "factor_rows")  # of solvers that factorise
    factor_end = scratch_array(wp.int32, "factor_rows")  # last column of each of its rows
    wide = scratch_array(wp.float64, "wide_vectors", "wide_rows")  # of the same

    # islands of the world (cones/islands.py), at most one for each unit
    unit_island = scratch_array(wp.int32, "units")  # -1: no block moves the unit
    island_block = scratch_array(wp.int32, "unit_ends")  # CSR over islands
    island_dof = scratch_array(wp.int32, "unit_ends")  # the same, of tree degrees of freedom
    island_loops = scratch_array(wp.int32, "units")  # 1: rows of loops answer it
    island_entries = scratch_array(wp.int32, "units")  # most that a row has
    island_newton = scratch_array(wp.int32, "units")
    island_iterations = scratch_array(wp.int32, "units")
    island_residual = scratch_array(wp.float32, "units")
    newton_steps = scratch_array(wp.int32, "units")  # of the interior point; -1: it does not run
    newton_residual = scratch_array(wp.float32, "units")
    dof_place = scratch_array(wp.int32, "tree_dofs")  # of each, its place among those of its island
    placed_dof = scratch_array(wp.int32, "tree_dofs")  # the tree degrees of freedom, island after island
    block_order = scratch_array(wp.int32, "blocks")
    row_order = scratch_array(wp.int32, "cone_rows")
    island_row = scratch_array(wp.int32, "block_ends")  # `block_row` of the island that is solved


ConeProblem = ConeScratch.struct("ConeProblem", __name__)

OF_LANES = frozenset(f"{ConeScratch.PREFIX}{name}" for name in ("s", "vectors", "factor", "factor_end", "wide"))
"""Arrays of the memory that only solvers use: where lanes share a problem, they read neighbours in one slot of these.
The others are filled by a thread for each world, which finds its neighbours in the other slots."""


# Rows of `vectors`. All solvers keep these and number their own from OWN on.
X = wp.constant(0)  # the iterate
AX = wp.constant(1)  # S x
BEST = wp.constant(2)  # the iterate of the least residual
R_EFF = wp.constant(3)  # r, with De Saxcé's term on the normal rows
WEIGHT = wp.constant(4)  # greatest diagonal of the row's block; 0 where nothing moves
LOW = wp.constant(5)  # part of the returned impulses beyond float32
OWN = wp.constant(6)


@wp.struct
class SolveReport:
    """Iterations done and the residual of the impulses returned [m/s or rad/s]."""

    iterations: int
    residual: float
