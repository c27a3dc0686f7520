"""Rows of the cone problem in the tree's metric: responses, the loop rows' share, and the Schur
complement S = Y Y^T - W W^T + C of everything bilateral.
"""

import warp as wp

from simwarp.kernels.cones.problem import ConeProblem
from simwarp.kernels.cones.sparse_rows import add_rows, finish_gram, form_gram
from simwarp.kernels.core.tables import Topology, Work
from simwarp.kernels.dynamics.bilateral_rows import apply_group
from simwarp.kernels.dynamics.dense_rows import solve_group_backward, solve_group_forward
from simwarp.kernels.dynamics.elastic_links import has_elastic_code
from simwarp.kernels.dynamics.joints import ELASTIC, FREE
from simwarp.kernels.meshes.mesh_links import NODE, climb_node, has_mesh_code

wp.set_module_options({"enable_backward": False})


@wp.struct
class Wrenches:
    """Up to three rows on one link: row i of `ang` and `lin` is the direction of row i, world axes."""

    ang: wp.mat33
    lin: wp.mat33


@wp.func
def put_columns(row: int, count: int, entry: int, m: wp.mat33, cone: ConeProblem):
    """Three entries of one or three rows."""
    cone.y[row, entry] = m[0, 0]
    cone.y[row, entry + 1] = m[0, 1]
    cone.y[row, entry + 2] = m[0, 2]
    if count == 3:
        cone.y[row + 1, entry] = m[1, 0]
        cone.y[row + 1, entry + 1] = m[1, 1]
        cone.y[row + 1, entry + 2] = m[1, 2]
        cone.y[row + 2, entry] = m[2, 0]
        cone.y[row + 2, entry + 1] = m[2, 1]
        cone.y[row + 2, entry + 2] = m[2, 2]


@wp.func
def walk_elastic_rows(
    block: int, row: int, count: int, entry: int, link: int, ang: wp.mat33, lin: wp.mat33, topology: Topology,
    work: Work, cone: ConeProblem,
) -> Wrenches:  # fmt: skip
    """`walk_rows` over a link with an elastic joint: six entries, and the wrenches on its parent."""
    above = Wrenches()
    if has_elastic_code():
        first = topology.link_tree_dof[link]
        above.ang = ang - lin * wp.skew(work.shift[link])
        above.lin = lin
        for k in range(6):
            value = ang * work.s_ang[first + k] + lin * work.s_lin[first + k]
            cone.block_tree_dof[block, entry + k] = first + k
            cone.y[row, entry + k] = value[0]
            if count == 3:
                cone.y[row + 1, entry + k] = value[1]
                cone.y[row + 2, entry + k] = value[2]
            above.ang -= wp.outer(value, work.u_ang[first + k])
            above.lin -= wp.outer(value, work.u_lin[first + k])
    return above


@wp.func
def walk_node_rows(
    block: int, row: int, count: int, entry: int, link: int, lin: wp.mat33, topology: Topology, work: Work,
    cone: ConeProblem,
) -> Wrenches:  # fmt: skip
    """`walk_rows` over a node of a mesh: three entries, and the wrenches above, where it is the last node."""
    above = Wrenches()
    if has_mesh_code():
        found = climb_node(link, lin, topology, work)
        put_columns(row, count, entry, found.y, cone)
        for k in range(3):
            cone.block_tree_dof[block, entry + k] = topology.link_tree_dof[link] + k
        above.ang = found.ang
        above.lin = found.lin
    return above


@wp.func
def walk_rows(
    block: int, row: int, count: int, entries: int, link0: int, w0: Wrenches, link1: int, w1: Wrenches,
    topology: Topology, work: Work, cone: ConeProblem,
) -> int:  # fmt: skip
    """Appends the responses of `count` rows from `row` on, and where they act, to a block with `entries` of
    them; returns how many there are then. -1 is the world.

    As `tree.walk_to_root`, for three rows at once: where the two paths meet, the wrenches are added.
    """
    a = link0
    b = link1
    a_ang = w0.ang
    a_lin = w0.lin
    b_ang = w1.ang
    b_lin = w1.lin
    e = int(entries)
    while a >= 0 or b >= 0:
        if a == b:
            a_ang += b_ang
            a_lin += b_lin
            b = -1
        link = wp.max(a, b)
        ang = a_ang
        lin = a_lin
        if b > a:
            ang = b_ang
            lin = b_lin
        first = topology.link_tree_dof[link]
        if topology.link_type[link] == FREE:
            y_lin = lin * wp.transpose(work.mass[link])
            y_ang = (ang - y_lin * work.coupling[link]) * wp.transpose(work.inertia[link])
            for k in range(3):
                cone.block_tree_dof[block, e + k] = first + k
                cone.block_tree_dof[block, e + 3 + k] = first + 3 + k
            put_columns(row, count, e, y_lin, cone)
            put_columns(row, count, e + 3, y_ang, cone)
            e += 6
        elif topology.link_type[link] == ELASTIC:
            above = walk_elastic_rows(block, row, count, e, link, ang, lin, topology, work, cone)
            ang = above.ang
            lin = above.lin
            e += 6
        elif topology.link_type[link] == NODE:
            above = walk_node_rows(block, row, count, e, link, lin, topology, work, cone)
            ang = above.ang
            lin = above.lin
            e += 3
        else:
            end = topology.link_tree_dof[link + 1]
            for index in range(end - first):
                tree_dof = end - 1 - index
                value = (ang * work.s_ang[tree_dof] + lin * work.s_lin[tree_dof]) * work.inv_sqrt_d[tree_dof]
                cone.block_tree_dof[block, e] = tree_dof
                cone.y[row, e] = value[0]
                if count == 3:
                    cone.y[row + 1, e] = value[1]
                    cone.y[row + 2, e] = value[2]
                e += 1
                ang -= wp.outer(value, work.u_ang[tree_dof])
                lin -= wp.outer(value, work.u_lin[tree_dof])
            # ang + shift x lin, row by row: x [shift] of a row vector is shift x of it, up to sign
            ang -= lin * wp.skew(work.shift[link])
        parent = topology.link_parent[link]
        if b > a:
            b = parent
            b_ang = ang
            b_lin = lin
        else:
            a = parent
            a_ang = ang
            a_lin = lin
    return e


@wp.func
def walk_tree_dof(
    block: int, row: int, tree_dof: int, coefficient: float, topology: Topology, work: Work, cone: ConeProblem
):
    """The response of an impulse of size `coefficient` along one tree degree of freedom, as the only row of a block."""
    link = topology.tree_dof_link[tree_dof]
    value = coefficient * work.inv_sqrt_d[tree_dof]
    cone.block_tree_dof[block, 0] = tree_dof
    cone.y[row, 0] = value
    ang = -work.u_ang[tree_dof] * value
    lin = -work.u_lin[tree_dof] * value
    entries = int(1)
    for index in range(tree_dof - topology.link_tree_dof[link]):
        other = tree_dof - 1 - index
        value = (wp.dot(work.s_ang[other], ang) + wp.dot(work.s_lin[other], lin)) * work.inv_sqrt_d[other]
        cone.block_tree_dof[block, entries] = other
        cone.y[row, entries] = value
        entries += 1
        ang -= work.u_ang[other] * value
        lin -= work.u_lin[other] * value
    w = Wrenches()
    w.ang = one_row(ang + wp.cross(work.shift[link], lin))
    w.lin = one_row(lin)
    cone.block_entries[block] = walk_rows(
        block, row, 1, entries, topology.link_parent[link], w, -1, Wrenches(), topology, work, cone
    )


@wp.func
def put_response(
    block: int, row: int, source: int, sign: float, topology: Topology, work: Work, cone: ConeProblem
):  # fmt: skip
    """A response that is known, y[source], as the only row of a block."""
    entries = int(0)
    for index in range(topology.row_path[source], topology.row_path[source + 1]):
        tree_dof = topology.path_tree_dof[index]
        cone.block_tree_dof[block, entries] = tree_dof
        cone.y[row, entries] = sign * work.y[source, topology.path_column[index]]
        entries += 1
    cone.block_entries[block] = entries


@wp.func
def one_row(v: wp.vec3) -> wp.mat33:
    """A matrix whose first row is v."""
    return wp.mat33(v[0], v[1], v[2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@wp.func
def find_groups(block: int, topology: Topology, cone: ConeProblem):
    """The loop rows that a block sees: those of the groups of the trees that it moves, one or two, in order."""
    low = int(-1)
    high = int(-1)
    for e in range(cone.block_entries[block]):
        group = topology.link_group[topology.tree_dof_link[cone.block_tree_dof[block, e]]]
        if group >= 0 and topology.group_row[group + 1] > topology.group_row[group]:
            if low < 0:
                low = group
                high = group
            low = wp.min(low, group)
            high = wp.max(high, group)
    for k in range(4):
        cone.block_loops[block, k] = 0
    if low >= 0:
        cone.block_loops[block, 0] = topology.group_row[low]
        cone.block_loops[block, 1] = topology.group_row[low + 1] - topology.group_row[low]
        if high > low:
            cone.block_loops[block, 2] = topology.group_row[high]
            cone.block_loops[block, 3] = topology.group_row[high + 1] - topology.group_row[high]


@wp.func
def share_of_group(
    r: int, before: float, first: int, count: int, column: int, topology: Topology, work: Work, cone: ConeProblem
) -> float:
    """W's columns from `column` on: w = L^-1 Y_l y of the loop rows of one group; y of row r stands in `tree_dof_sum`.
    Returns `before` less their squares.
    """
    for loop_row in range(first, first + count):
        total = float(0.0)
        for entry in range(topology.row_path[loop_row], topology.row_path[loop_row + 1]):
            tree_dof = topology.path_tree_dof[entry]
            total += work.y[loop_row, topology.path_column[entry]] * cone.tree_dof_sum[tree_dof]
        work.row_r[loop_row] = total
    solve_group_forward(topology.row_group[first], topology, work)
    diagonal = float(before)
    for k in range(count):
        share = work.row_r[first + k]
        cone.w[r, column + k] = share
        diagonal -= share * share
    return diagonal


@wp.func
def loop_share(block: int, row: int, count: int, topology: Topology, work: Work, cone: ConeProblem):
    """The loop rows' share w = L^-1 Y_l y of the rows, and their diagonal of S without compliance.

    `tree_dof_sum` is zero before and after.
    """
    find_groups(block, topology, cone)
    entries = cone.block_entries[block]
    near = cone.block_loops[block, 1]
    far = cone.block_loops[block, 3]
    for i in range(count):
        r = row + i
        total = float(0.0)
        for e in range(entries):
            value = cone.y[r, e]
            total += value * value
        if near > 0:
            for e in range(entries):
                cone.tree_dof_sum[cone.block_tree_dof[block, e]] = cone.y[r, e]
            total = share_of_group(r, total, cone.block_loops[block, 0], near, 0, topology, work, cone)
            if far > 0:
                total = share_of_group(r, total, cone.block_loops[block, 2], far, near, topology, work, cone)
            for e in range(entries):
                cone.tree_dof_sum[cone.block_tree_dof[block, e]] = 0.0
        cone.diagonal[r] = total


@wp.func
def assemble_dense(cone: ConeProblem):
    """The dense S = Y Y^T - W W^T + C of a whole problem, or of one island."""
    blocks = cone.block_count
    form_gram(
        blocks, cone.tree_dof_count, cone.block_row, cone.block_entries, cone.block_tree_dof, cone.y, cone.spread,
        cone.s, cone.lanes,
    )  # fmt: skip
    finish_gram(blocks, cone.block_row, cone.block_loops, cone.w, cone.compliance, cone.s, cone.lanes)


@wp.func
def mark_due_groups(cone: ConeProblem, blocks: int, topology: Topology, work: Work):
    """group_due <- 1 where impulses of the blocks act on a group, and row_r of it <- W^T gamma."""
    for group in range(topology.group_count):
        work.group_due[group] = wp.where(topology.unit_count == 1, 1, 0)
    for row in range(topology.row_count):
        work.row_r[row] = 0.0
    for block in range(blocks):
        near = cone.block_loops[block, 1]
        far = cone.block_loops[block, 3]
        first = cone.block_loops[block, 0]
        other = cone.block_loops[block, 2]
        if near > 0:
            work.group_due[topology.row_group[first]] = 1
        if far > 0:
            work.group_due[topology.row_group[other]] = 1
        for r in range(cone.block_row[block], cone.block_row[block + 1]):
            impulse = cone.gamma[r]
            for k in range(near):
                work.row_r[first + k] = work.row_r[first + k] + cone.w[r, k] * impulse
            for k in range(far):
                work.row_r[other + k] = work.row_r[other + k] + cone.w[r, near + k] * impulse


@wp.func
def apply_cones(cone: ConeProblem, blocks: int, topology: Topology, work: Work):
    """Impulses of the blocks and of the bilateral rows that answer them, into `xi` and `row_impulse`."""
    add_rows(blocks, cone.block_row, cone.block_entries, cone.block_tree_dof, cone.y, cone.gamma, work.xi, cone.lanes)
    if topology.row_count > 0:
        mark_due_groups(cone, blocks, topology, work)
        for group in range(topology.group_count):
            if work.group_due[group] == 1:
                solve_group_backward(group, topology, work)
                apply_group(group, topology, work)
