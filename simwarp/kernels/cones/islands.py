"""Islands: units of a world that blocks of this step join, each with a cone problem of its own.

A unit is a tree, or all trees that bilateral rows tie together (`RowGroups.link_unit`). Blocks that move several of
them, as contacts between two bodies do, join them; what is fixed to the world joins nothing. Each island is solved as
if it were alone: with its own iterations, steps and end, over rows and degrees of freedom that are numbered as they
would be there. So nothing that happens elsewhere in the world changes a bit of it, and it stays cheap.

Blocks are collected as they come and put into the order of their islands in place; within an island they keep theirs.
"""

from typing import Any

import warp as wp

from simwarp.kernels.cones.problem import ROLLING, ConeProblem, SolveReport
from simwarp.kernels.cones.proximal_newton import is_chain
from simwarp.kernels.core.lanes import lane_of, meet, stride_of
from simwarp.kernels.core.native_views import VIEWS
from simwarp.kernels.core.tables import StepConfig, Topology, Work

wp.set_module_options({"enable_backward": False})


@wp.func
def first_unit(unit: int, cone: ConeProblem) -> int:
    """The unit that stands for all those joined to this one."""
    root = int(unit)
    while cone.unit_island[root] != root:
        root = cone.unit_island[root]
    return root


@wp.func
def join_units(blocks: int, topology: Topology, cone: ConeProblem):
    """unit_island <- a unit of lower index in the same island, itself for the lowest, -1 where no block acts;
    block_order <- a unit of each block.
    """
    for unit in range(topology.unit_count):
        cone.unit_island[unit] = -1
    for block in range(blocks):
        joined = int(-1)
        last = int(-1)
        for e in range(cone.block_entries[block]):
            unit = topology.tree_dof_unit[cone.block_tree_dof[block, e]]
            if unit != last:
                last = unit
                if cone.unit_island[unit] < 0:
                    cone.unit_island[unit] = unit
                root = first_unit(unit, cone)
                if joined < 0:
                    joined = root
                elif root != joined:
                    cone.unit_island[wp.max(root, joined)] = wp.min(root, joined)
                    joined = wp.min(root, joined)
        cone.block_order[block] = joined


@wp.func
def number_islands(topology: Topology, cone: ConeProblem) -> int:
    """unit_island <- numbers in the order of the first units; returns how many islands there are."""
    count = int(0)
    for unit in range(topology.unit_count):
        above = cone.unit_island[unit]
        if above == unit:
            cone.unit_island[unit] = count
            count += 1
        elif above >= 0:
            cone.unit_island[unit] = cone.unit_island[above]
    return count


@wp.func
def place_dofs(islands: int, topology: Topology, cone: ConeProblem):
    """Numbers the tree degrees of freedom of each island in their order, and finds what its rows can have."""
    cone.island_dof[0] = 0
    for island in range(islands):
        cone.island_dof[island + 1] = 0
        cone.island_loops[island] = 0
        cone.island_entries[island] = 0
        cone.island_newton[island] = 1
    for unit in range(topology.unit_count):
        island = cone.unit_island[unit]
        if island >= 0:
            cone.island_entries[island] = wp.max(cone.island_entries[island], topology.unit_entries[unit])
            cone.island_newton[island] = wp.min(cone.island_newton[island], topology.unit_newton[unit])
    for tree_dof in range(topology.tree_dof_count):
        island = cone.unit_island[topology.tree_dof_unit[tree_dof]]
        if island >= 0:
            place = cone.island_dof[island + 1]
            cone.dof_place[tree_dof] = place
            cone.island_dof[island + 1] = place + 1
            group = topology.link_group[topology.tree_dof_link[tree_dof]]
            if group >= 0 and topology.group_row[group + 1] > topology.group_row[group]:
                cone.island_loops[island] = 1
    for island in range(islands):
        cone.island_dof[island + 1] = cone.island_dof[island + 1] + cone.island_dof[island]
    for tree_dof in range(topology.tree_dof_count):
        island = cone.unit_island[topology.tree_dof_unit[tree_dof]]
        if island >= 0:
            cone.placed_dof[cone.island_dof[island] + cone.dof_place[tree_dof]] = tree_dof


@wp.func
def exchange(values: wp.array[Any], i: int, j: int):
    """Exchanges two elements."""
    kept = values[i]
    values[i] = values[j]
    values[j] = kept


@wp.func_native(
    VIEWS
    + """
    const Floats a = row(rows, i), b = row(rows, j);
    for (int k = 0; k < rows.shape[1]; ++k) {
        const float kept = a[k];
        a[k] = b[k];
        b[k] = kept;
    }
"""
)
def exchange_rows(rows: wp.array2d[float], i: int, j: int):
    """Exchanges two different rows."""
    ...


@wp.func
def exchange_cone_rows(i: int, j: int, topology: Topology, cone: ConeProblem):
    """Exchanges two rows of the cone problem."""
    exchange(cone.lower, i, j)
    exchange(cone.upper, i, j)
    exchange(cone.r, i, j)
    exchange(cone.diagonal, i, j)
    exchange(cone.gamma, i, j)
    exchange(cone.compliance, i, j)
    exchange_rows(cone.y, i, j)
    if topology.row_count > 0:
        exchange_rows(cone.w, i, j)


@wp.func
def exchange_blocks(i: int, j: int, topology: Topology, work: Work, cone: ConeProblem):
    """Exchanges all that two blocks have but their rows."""
    exchange(work.active, i, j)
    exchange(work.b_sign, i, j)
    exchange(work.recovery, i, j)
    exchange(cone.block_kind, i, j)
    exchange(cone.friction, i, j)
    exchange(cone.rolling, i, j)
    exchange(cone.spinning, i, j)
    exchange(cone.cohesion, i, j)
    for e in range(wp.max(cone.block_entries[i], cone.block_entries[j])):
        kept = cone.block_tree_dof[i, e]
        cone.block_tree_dof[i, e] = cone.block_tree_dof[j, e]
        cone.block_tree_dof[j, e] = kept
    exchange(cone.block_entries, i, j)
    if topology.row_count > 0:
        for k in range(4):
            kept = cone.block_loops[i, k]
            cone.block_loops[i, k] = cone.block_loops[j, k]
            cone.block_loops[j, k] = kept


@wp.func
def rearrange(blocks: int, topology: Topology, work: Work, cone: ConeProblem):
    """Puts blocks and rows into the places of `block_order` and `row_order`, which say who comes to each place."""
    for first in range(cone.block_row[blocks]):
        place = int(first)
        source = cone.row_order[place]
        while source != first:
            exchange_cone_rows(place, source, topology, cone)
            cone.row_order[place] = place
            place = source
            source = cone.row_order[place]
        cone.row_order[place] = place
    for first in range(blocks):
        place = int(first)
        source = cone.block_order[place]
        while source != first:
            exchange_blocks(place, source, topology, work, cone)
            cone.block_order[place] = place
            place = source
            source = cone.block_order[place]
        cone.block_order[place] = place


@wp.func
def sort_blocks(blocks: int, islands: int, topology: Topology, work: Work, cone: ConeProblem):
    """Puts the blocks into the order of their islands; island_block tells where each begins."""
    in_order = int(1)
    last = int(0)
    for island in range(islands + 1):
        cone.island_block[island] = 0
    for block in range(blocks):
        island = cone.unit_island[cone.block_order[block]]
        cone.island_row[block] = island
        cone.island_block[island + 1] = cone.island_block[island + 1] + 1
        if island < last:
            in_order = 0
        last = island
    for island in range(islands):
        cone.island_iterations[island] = cone.island_block[island]  # the next free place
        cone.island_block[island + 1] = cone.island_block[island + 1] + cone.island_block[island]
    if in_order == 1:
        return
    for block in range(blocks):
        island = cone.island_row[block]
        place = cone.island_iterations[island]
        cone.block_order[place] = block
        cone.island_iterations[island] = place + 1
    row = int(0)
    for place in range(blocks):
        cone.island_row[place] = row
        source = cone.block_order[place]
        for source_row in range(cone.block_row[source], cone.block_row[source + 1]):
            cone.row_order[row] = source_row
            row += 1
    rearrange(blocks, topology, work, cone)
    for place in range(blocks):
        cone.block_row[place] = cone.island_row[place]


@wp.func
def enter_islands(blocks: int, topology: Topology, work: Work, cone: ConeProblem) -> int:
    """Sorts the blocks by islands and numbers the degrees of freedom of each from zero; returns how many there are.

    0: there is one that moves everything, and all stays as it is.
    """
    join_units(blocks, topology, cone)
    islands = number_islands(topology, cone)
    place_dofs(islands, topology, cone)
    if islands == 1 and cone.island_dof[1] == topology.tree_dof_count:
        return 0
    sort_blocks(blocks, islands, topology, work, cone)
    for block in range(blocks):
        for e in range(cone.block_entries[block]):
            cone.block_tree_dof[block, e] = cone.dof_place[cone.block_tree_dof[block, e]]
    return islands


@wp.func
def leave_islands(islands: int, cone: ConeProblem):
    """Gives the degrees of freedom back their numbers in the world."""
    for island in range(islands):
        first = cone.island_dof[island]
        for block in range(cone.island_block[island], cone.island_block[island + 1]):
            for e in range(cone.block_entries[block]):
                cone.block_tree_dof[block, e] = cone.placed_dof[first + cone.block_tree_dof[block, e]]


@wp.func
def island_start(island: int, islands: int, cone: ConeProblem) -> int:
    """First row of an island."""
    if islands == 0:
        return 0
    return cone.block_row[cone.island_block[island]]


@wp.func
def counted(problem: ConeProblem, config: StepConfig) -> ConeProblem:
    """The problem with what follows from its blocks; without its Schur complement."""
    found = problem
    found.row_count = problem.block_row[problem.block_count]
    found.rolling_count = 0
    for block in range(problem.block_count):
        if problem.block_kind[block] == ROLLING:
            found.rolling_count = found.rolling_count + 1
    found.dense = 0
    found.chain = 0
    if is_chain(found):
        found.chain = 1  # few gradient steps do not pay for S
    elif found.row_count <= config.dense_rows:
        found.dense = 1
    return found


@wp.func
def whole_problem(
    island: int, islands: int, blocks: int, topology: Topology, config: StepConfig, cone: ConeProblem
) -> ConeProblem:
    """The problem of a world of one unit, without its Schur complement; `island` and `islands` are 0."""
    problem = cone
    problem.block_count = blocks
    problem.tree_dof_count = topology.tree_dof_count
    problem.loop_count = topology.row_count
    problem.entry_count = cone.y.shape[1]
    problem.newton = 1
    return counted(problem, config)


@wp.func
def island_problem(
    island: int, islands: int, blocks: int, topology: Topology, config: StepConfig, cone: ConeProblem
) -> ConeProblem:
    """The problem of one island, without its Schur complement; that of the world where `islands` is 0.

    It is made of views: its solution stands in `cone.gamma`. Room for S, its factors, and sums serves one at a time.
    """
    problem = whole_problem(island, islands, blocks, topology, config, cone)
    if islands > 0:
        first = cone.island_block[island]
        end = cone.island_block[island + 1]
        row = cone.block_row[first]
        last = cone.block_row[end]
        for block in range(first + lane_of(cone.lanes), end + 1, stride_of(cone.lanes)):
            cone.island_row[block - first] = cone.block_row[block] - row
        meet(cone.lanes)
        problem.block_count = end - first
        problem.tree_dof_count = cone.island_dof[island + 1] - cone.island_dof[island]
        problem.loop_count = topology.row_count * cone.island_loops[island]
        problem.entry_count = cone.island_entries[island]
        problem.newton = cone.island_newton[island]
        problem.block_row = cone.island_row
        problem.block_kind = cone.block_kind[first:end]
        problem.block_entries = cone.block_entries[first:end]
        problem.friction = cone.friction[first:end]
        problem.rolling = cone.rolling[first:end]
        problem.spinning = cone.spinning[first:end]
        problem.cohesion = cone.cohesion[first:end]
        problem.block_tree_dof = cone.block_tree_dof[first:end]
        problem.block_loops = cone.block_loops[first:end]
        problem.lower = cone.lower[row:last]
        problem.upper = cone.upper[row:last]
        problem.r = cone.r[row:last]
        problem.diagonal = cone.diagonal[row:last]
        problem.gamma = cone.gamma[row:last]
        problem.compliance = cone.compliance[row:last]
        problem.scale = cone.scale[row:last]
        problem.y = cone.y[row:last]
        problem.w = cone.w[row:last]
        problem.vectors = cone.vectors[:, row:last]
        problem = counted(problem, config)
    return problem


@wp.func
def worst_report(a: SolveReport, b: SolveReport) -> SolveReport:
    """Of two islands, the more iterations and the greater residual; one that is not a number stays."""
    report = SolveReport()
    report.iterations = wp.max(a.iterations, b.iterations)
    report.residual = a.residual
    if b.residual > a.residual or wp.isnan(b.residual):
        report.residual = b.residual
    return report


@wp.func
def world_report(islands: int, cone: ConeProblem) -> SolveReport:
    """What users read of the solves of all islands."""
    report = SolveReport()
    for island in range(wp.max(islands, 1)):
        each = SolveReport()
        each.iterations = cone.island_iterations[island]
        each.residual = cone.island_residual[island]
        report = worst_report(report, each)
    return report
