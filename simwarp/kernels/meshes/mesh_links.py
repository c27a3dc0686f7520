"""Nodes of meshes in the tree's passes: links of three coordinates that the factor of their mesh eliminates together.

A mesh's matrix is factored before the tree (mesh_loads.py). Its columns are the nodes that move by themselves, in the
order of elimination, and after them, for a mesh that is glued to a body, two for that body: its velocity and its
angular velocity. These two are not eliminated: what is left of them is added to the body's articulated inertia. The
links of nodes stand in the reverse order, so that each comes after those that its column updates, its parent the first
of them: the elimination tree is a part of the kinematic tree, and rows walk up both alike.

The code is empty in a kernel that is compiled with `WITHOUT_MESHES`.
"""

import warp as wp

from simwarp.kernels.core.tables import Topology, Work
from simwarp.kernels.meshes.block_factor import (
    substitute_backward,
    substitute_backward_double,
    substitute_forward,
    substitute_forward_double,
)

wp.set_module_options({"enable_backward": False})

WITHOUT_MESHES = "WITHOUT_MESHES"
"""Macro of the kernels of models without meshes."""

NODE = wp.constant(100)
"""Type of a link that is a node, beside the types of joints."""


@wp.func_native(f"""
#ifdef {WITHOUT_MESHES}
    return false;
#else
    return true;
#endif
""")
def has_mesh_code() -> bool:
    """Whether the kernel is one for models with meshes."""
    ...


@wp.func
def node_column(link: int, topology: Topology) -> int:
    """The column of a node's link."""
    return topology.mesh_link0 + topology.mesh_nodes - 1 - link


@wp.func
def mesh_block(index: int, topology: Topology, work: Work) -> wp.mat33:
    """A block of the factor (block_factor.py)."""
    m = wp.mat33()
    first = 12 * index
    for j in range(3):
        for i in range(3):
            if topology.mesh_double == 1:
                m[i, j] = float(work.mesh_factor_double[first + 4 * j + i])
            else:
                m[i, j] = work.mesh_factor[first + 4 * j + i]
    return m


@wp.func
def mesh_vector(column: int, topology: Topology, work: Work) -> wp.vec3:
    """A column's part of the vector."""
    if topology.mesh_double == 1:
        return wp.vec3(
            float(work.mesh_vector_double[4 * column]), float(work.mesh_vector_double[4 * column + 1]),
            float(work.mesh_vector_double[4 * column + 2]),
        )  # fmt: skip
    return wp.vec3(
        work.mesh_vector[4 * column], work.mesh_vector[4 * column + 1], work.mesh_vector[4 * column + 2]
    )  # fmt: skip


@wp.func
def set_mesh_vector(column: int, v: wp.vec3, topology: Topology, work: Work):
    """The reverse of `mesh_vector`."""
    for k in range(3):
        if topology.mesh_double == 1:
            work.mesh_vector_double[4 * column + k] = wp.float64(v[k])
        else:
            work.mesh_vector[4 * column + k] = v[k]


@wp.func
def load_loose_nodes(topology: Topology, work: Work):
    """The factor of nodes that no element ties: where a state is assembled, nodes are masses alone."""
    if not has_mesh_code():
        return
    blocks = topology.mesh_columns + topology.mesh_column_start[topology.mesh_columns]
    for index in range(12 * blocks):
        if topology.mesh_double == 1:
            work.mesh_factor_double[index] = wp.float64(0.0)
        else:
            work.mesh_factor[index] = 0.0
    for column in range(topology.mesh_nodes):
        link = topology.mesh_link0 + topology.mesh_nodes - 1 - column
        inverse = 1.0 / wp.sqrt(work.mass[link][0, 0])
        for k in range(3):
            if topology.mesh_double == 1:
                work.mesh_factor_double[12 * column + 5 * k] = wp.float64(inverse)
            else:
                work.mesh_factor[12 * column + 5 * k] = inverse


@wp.func
def add_meshes_to_owners(topology: Topology, work: Work):
    """Adds to the inertia of each body that a mesh is glued to what the elimination of its nodes leaves."""
    if not has_mesh_code():
        return
    for pair in range((topology.mesh_columns - topology.mesh_nodes) // 2):
        owner = topology.mesh_owner[pair]
        column = topology.mesh_nodes + 2 * pair
        mass = mesh_block(column, topology, work)
        inertia = mesh_block(column + 1, topology, work)
        work.mass[owner] = work.mass[owner] + (mass + wp.transpose(mass)) * 0.5
        work.inertia[owner] = work.inertia[owner] + (inertia + wp.transpose(inertia)) * 0.5
        coupling = mesh_block(topology.mesh_columns + topology.mesh_column_start[column], topology, work)
        work.coupling[owner] = work.coupling[owner] + coupling


@wp.func
def resist_glue(topology: Topology, work: Work):
    """Makes of the momentum balance in `p` the load of another backward pass: nodes, whose elimination is exact, bring
    all of theirs once more, and what is left of them answers the change of their body's velocity.
    """
    if not has_mesh_code():
        return
    for column in range(topology.mesh_nodes):
        link = topology.mesh_link0 + column
        work.p_lin[link] = work.f_lin[link]
    for pair in range((topology.mesh_columns - topology.mesh_nodes) // 2):
        owner = topology.mesh_owner[pair]
        column = topology.mesh_nodes + 2 * pair
        coupling = mesh_block(topology.mesh_columns + topology.mesh_column_start[column], topology, work)
        v = work.v_lin[owner]
        omega = work.v_ang[owner]
        lin = mesh_block(column, topology, work) * v + wp.transpose(coupling) * omega
        ang = coupling * v + mesh_block(column + 1, topology, work) * omega
        work.p_lin[owner] = work.p_lin[owner] - lin
        work.p_ang[owner] = work.p_ang[owner] - ang


@wp.func
def meshes_backward(topology: Topology, work: Work):
    """`backward_pass` of all nodes, before that of the other links."""
    if not has_mesh_code():
        return
    n = topology.mesh_nodes
    total = topology.mesh_columns
    if n == 0:
        return
    for column in range(total):
        impulse = wp.vec3()
        if column < n:
            impulse = work.p_lin[topology.mesh_link0 + n - 1 - column]
        set_mesh_vector(column, impulse, topology, work)
    if topology.mesh_double == 1:
        substitute_forward_double(
            n, total, topology.mesh_column_start, topology.mesh_block_row, work.mesh_factor_double,
            work.mesh_vector_double, 1,
        )  # fmt: skip
    else:
        substitute_forward(
            n, total, topology.mesh_column_start, topology.mesh_block_row, work.mesh_factor, work.mesh_vector, 1
        )
    for column in range(n):
        xi = mesh_vector(column, topology, work)
        first = topology.link_tree_dof[topology.mesh_link0 + n - 1 - column]
        for k in range(3):
            work.xi[first + k] = xi[k]
    for pair in range((total - n) // 2):
        owner = topology.mesh_owner[pair]
        work.p_lin[owner] = work.p_lin[owner] + mesh_vector(n + 2 * pair, topology, work)
        work.p_ang[owner] = work.p_ang[owner] + mesh_vector(n + 2 * pair + 1, topology, work)


@wp.func
def meshes_forward(topology: Topology, work: Work):
    """`forward_pass` of all nodes, after that of the other links."""
    if not has_mesh_code():
        return
    n = topology.mesh_nodes
    total = topology.mesh_columns
    if n == 0:
        return
    for column in range(n):
        first = topology.link_tree_dof[topology.mesh_link0 + n - 1 - column]
        set_mesh_vector(column, wp.vec3(work.xi[first], work.xi[first + 1], work.xi[first + 2]), topology, work)
    for pair in range((total - n) // 2):
        owner = topology.mesh_owner[pair]
        set_mesh_vector(n + 2 * pair, work.v_lin[owner], topology, work)
        set_mesh_vector(n + 2 * pair + 1, work.v_ang[owner], topology, work)
    if topology.mesh_double == 1:
        substitute_backward_double(
            n, total, topology.mesh_column_start, topology.mesh_block_row, work.mesh_factor_double,
            work.mesh_vector_double, 1,
        )  # fmt: skip
    else:
        substitute_backward(
            n, total, topology.mesh_column_start, topology.mesh_block_row, work.mesh_factor, work.mesh_vector, 1
        )
    for column in range(n):
        link = topology.mesh_link0 + n - 1 - column
        v = mesh_vector(column, topology, work)
        work.v_lin[link] = v
        work.v_ang[link] = wp.vec3()
        first = topology.link_tree_dof[link]
        for k in range(3):
            work.change[first + k] = v[k]
            work.qd[first + k] = v[k]


@wp.struct
class NodeRows:
    """What a node's link makes of the rows of wrenches that act on it: their responses there, and the wrenches on its
    parent; rows of matrices are those of the cone problem.
    """

    y: wp.mat33
    ang: wp.mat33
    lin: wp.mat33


@wp.func
def climb_node(link: int, lin: wp.mat33, topology: Topology, work: Work) -> NodeRows:
    """One step up the elimination tree. Forces on columns further up wait in `mesh_waiting`, which is zero before the
    first step and after the last.
    """
    found = NodeRows()
    if has_mesh_code():
        column = node_column(link, topology)
        force = lin + work.mesh_waiting[column]
        work.mesh_waiting[column] = wp.mat33()
        found.y = force * wp.transpose(mesh_block(column, topology, work))
        first = topology.mesh_column_start[column]
        end = topology.mesh_column_start[column + 1]
        for k in range(first, end):
            row = topology.mesh_block_row[k]
            below = mesh_block(topology.mesh_columns + k, topology, work)
            work.mesh_waiting[row] = work.mesh_waiting[row] - found.y * wp.transpose(below)
        if end > first:
            above = topology.mesh_block_row[first]
            if above >= topology.mesh_nodes:
                found.lin = work.mesh_waiting[above]
                found.ang = work.mesh_waiting[above + 1]
                work.mesh_waiting[above] = wp.mat33()
                work.mesh_waiting[above + 1] = wp.mat33()
    return found
