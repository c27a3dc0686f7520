"""The spanning tree in articulated form: factorisation leaf to root, impulses up, velocities down, rows up.

Featherstone (2008), chapter 7, with one change: every spatial quantity is about the centre of mass of its own link
and oriented as the world, so that nothing is lost to long lever arms in float32, and the two anchors of a joint enter
through `shift`. A joint of several degrees of freedom is eliminated one column at a time.
"""

import warp as wp

from simwarp.kernels.core.tables import Topology, Work
from simwarp.kernels.core.vector_math import cross_columns, inverse_cholesky
from simwarp.kernels.dynamics.elastic_links import (
    Wrench,
    elastic_backward,
    elastic_forward,
    factor_elastic,
    walk_elastic,
)
from simwarp.kernels.dynamics.joints import ELASTIC, FREE, SHAFT
from simwarp.kernels.meshes.mesh_links import (
    NODE,
    add_meshes_to_owners,
    climb_node,
    has_mesh_code,
    meshes_backward,
    meshes_forward,
)

wp.set_module_options({"enable_backward": False})

LEAST_PIVOT = wp.constant(1.0e-6)
"""Of a massless link's inertia along a coordinate, relative to the largest: some ten times the rounding of float32.
Two hinges are that near to being parallel at an angle of 1e-3 rad."""


@wp.func
def factor_free(link: int, work: Work):
    """6x6 Cholesky of a floating root by blocks: mass <- Lm^-1, coupling <- Lm^-1 H^T, inertia <- La^-1."""
    inv_lm = inverse_cholesky(work.mass[link])
    g = inv_lm * wp.transpose(work.coupling[link])
    work.inertia[link] = inverse_cholesky(work.inertia[link] - wp.transpose(g) * g)
    work.coupling[link] = g
    work.mass[link] = inv_lm


@wp.func
def eliminate_columns(link: int, topology: Topology, work: Work):
    """A <- A - U U^T / D for each column of the link's joint, last first."""
    first = topology.link_tree_dof[link]
    end = topology.link_tree_dof[link + 1]
    inertia = work.inertia[link]
    coupling = work.coupling[link]
    mass = work.mass[link]
    for index in range(end - first):
        tree_dof = end - 1 - index
        a = work.s_ang[tree_dof]
        v = work.s_lin[tree_dof]
        u_ang = inertia * a + coupling * v
        u_lin = a * coupling + mass * v
        d = wp.dot(a, u_ang) + wp.dot(v, u_lin) + work.gain[tree_dof]
        inv_sqrt_d = float(0.0)
        if work.gain[tree_dof] >= 0.0:  # a negative gain marks a prescribed rate: nothing to eliminate
            inv_sqrt_d = 1.0 / wp.sqrt(d)
            if topology.link_massless[link] == 1:
                most = wp.trace(inertia) * wp.dot(a, a) + wp.trace(mass) * wp.dot(v, v)
                if not d > LEAST_PIVOT * most:
                    inv_sqrt_d = 0.0
        u_ang *= inv_sqrt_d
        u_lin *= inv_sqrt_d
        work.inv_sqrt_d[tree_dof] = inv_sqrt_d
        work.u_ang[tree_dof] = u_ang  # stored as U / sqrt(D)
        work.u_lin[tree_dof] = u_lin
        inertia -= wp.outer(u_ang, u_ang)
        coupling -= wp.outer(u_ang, u_lin)
        mass -= wp.outer(u_lin, u_lin)
    work.inertia[link] = inertia
    work.coupling[link] = coupling
    work.mass[link] = mass


@wp.func
def has_held_rate(topology: Topology, work: Work) -> bool:
    """True where a joint without mass behind it could not be eliminated."""
    held = bool(False)
    for tree_dof in range(topology.tree_dof_count):
        if topology.link_massless[topology.tree_dof_link[tree_dof]] == 1:
            held = held or (work.inv_sqrt_d[tree_dof] == 0.0 and work.gain[tree_dof] >= 0.0)
    return held


@wp.func
def factor_tree(topology: Topology, work: Work):
    """Articulated inertias, leaf to root; on entry `inertia`, `coupling`, `mass` hold the rigid bodies' own."""
    add_meshes_to_owners(topology, work)
    for index in range(topology.link_count):
        link = topology.link_count - 1 - index
        kind = topology.link_type[link]
        parent = topology.link_parent[link]
        if kind == NODE:
            continue
        if kind == FREE:
            factor_free(link, work)
        elif kind == ELASTIC:
            factor_elastic(link, topology, work)
        elif kind == SHAFT:
            tree_dof = topology.link_tree_dof[link]
            work.u_ang[tree_dof] = wp.vec3()
            work.u_lin[tree_dof] = wp.vec3()
            work.shift[link] = wp.vec3()
            work.inv_sqrt_d[tree_dof] = 0.0
            if work.gain[tree_dof] >= 0.0:
                work.inv_sqrt_d[tree_dof] = 1.0 / wp.sqrt(work.gain[tree_dof])
        else:
            eliminate_columns(link, topology, work)
            if parent >= 0:
                d = work.shift[link]
                mass = work.mass[link]
                coupling = work.coupling[link]
                dm = cross_columns(d, mass)
                dh = cross_columns(d, wp.transpose(coupling))
                # [d] M [d]^T = -[d] M [d] = ([d] ([d] M)^T)^T, and [d] M is known
                work.inertia[parent] = (
                    work.inertia[parent]
                    + work.inertia[link]
                    + dh
                    + wp.transpose(dh)
                    + cross_columns(d, wp.transpose(dm))
                )
                work.coupling[parent] = work.coupling[parent] + coupling + dm
                work.mass[parent] = work.mass[parent] + mass


@wp.func
def backward_pass(stabilisation: float, topology: Topology, work: Work):
    """`xi` (scaled impulses) from the links' impulses `p` and `stabilisation` times the stabilisation; consumes `p`."""
    meshes_backward(topology, work)
    for index in range(topology.link_count):
        link = topology.link_count - 1 - index
        kind = topology.link_type[link]
        if kind == NODE:
            continue
        first = topology.link_tree_dof[link]
        end = topology.link_tree_dof[link + 1]
        p_ang = work.p_ang[link]
        p_lin = work.p_lin[link]
        if kind == FREE:
            y_lin = work.mass[link] * p_lin
            y_ang = work.inertia[link] * (p_ang - y_lin * work.coupling[link])
            for k in range(3):
                work.xi[first + k] = y_lin[k]
                work.xi[first + 3 + k] = y_ang[k]
        elif kind == ELASTIC:
            elastic_backward(link, p_ang, p_lin, topology, work)
        elif kind == SHAFT:
            work.xi[first] = work.effort[first] * work.inv_sqrt_d[first]
        else:
            for index_tree_dof in range(end - first):
                tree_dof = end - 1 - index_tree_dof
                xi = (
                    wp.dot(work.s_ang[tree_dof], p_ang) + wp.dot(work.s_lin[tree_dof], p_lin) + work.effort[tree_dof]
                ) * work.inv_sqrt_d[tree_dof]
                work.xi[tree_dof] = xi
                p_ang -= work.u_ang[tree_dof] * xi
                p_lin -= work.u_lin[tree_dof] * xi
            parent = topology.link_parent[link]
            if parent >= 0:
                # the columns see it through the velocity on the way down; the parent has to carry it here
                w_ang = work.stabilisation_ang[link] * stabilisation
                w_lin = work.stabilisation_lin[link] * stabilisation
                p_ang -= work.inertia[link] * w_ang + work.coupling[link] * w_lin
                p_lin -= w_ang * work.coupling[link] + work.mass[link] * w_lin
                work.p_ang[parent] = work.p_ang[parent] + p_ang + wp.cross(work.shift[link], p_lin)
                work.p_lin[parent] = work.p_lin[parent] + p_lin


@wp.func
def forward_pass(topology: Topology, work: Work):
    """Link velocities and rates from `xi`, root to leaf. Joint rows hold to rounding by construction."""
    for link in range(topology.link_count):
        kind = topology.link_type[link]
        if kind == NODE:
            continue
        first = topology.link_tree_dof[link]
        end = topology.link_tree_dof[link + 1]
        v_ang = wp.vec3()
        v_lin = wp.vec3()
        if kind == FREE:
            v_ang = wp.vec3(work.xi[first + 3], work.xi[first + 4], work.xi[first + 5]) * work.inertia[link]
            x_lin = wp.vec3(work.xi[first], work.xi[first + 1], work.xi[first + 2])
            v_lin = (x_lin - work.coupling[link] * v_ang) * work.mass[link]
        elif kind == SHAFT:
            work.change[first] = work.xi[first] * work.inv_sqrt_d[first]
            work.qd[first] = work.change[first] + work.rate[first]
        elif kind != ELASTIC:
            parent = topology.link_parent[link]
            if parent >= 0:
                v_ang = work.v_ang[parent]
                v_lin = work.v_lin[parent] + wp.cross(v_ang, work.shift[link])
            v_ang += work.stabilisation_ang[link]
            v_lin += work.stabilisation_lin[link]
            for tree_dof in range(first, end):
                qd = work.inv_sqrt_d[tree_dof] * (
                    work.xi[tree_dof] - wp.dot(work.u_ang[tree_dof], v_ang) - wp.dot(work.u_lin[tree_dof], v_lin)
                )
                v_ang += work.s_ang[tree_dof] * qd
                v_lin += work.s_lin[tree_dof] * qd
                work.change[tree_dof] = qd
                work.qd[tree_dof] = qd + work.rate[tree_dof]
        if kind == ELASTIC:
            elastic_forward(link, topology, work)
        else:
            work.v_ang[link] = v_ang
            work.v_lin[link] = v_lin
    meshes_forward(topology, work)


@wp.func
def walk_node(row: int, link: int, lin: wp.vec3, topology: Topology, work: Work, y: wp.array2d[float]) -> Wrench:
    """`walk_to_root` over a node of a mesh: the wrench on what it is glued to, where it is the last before that."""
    above = Wrench()
    if has_mesh_code():
        one = wp.mat33(lin[0], lin[1], lin[2], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        found = climb_node(link, one, topology, work)
        column = topology.link_tree_dof[link] - topology.link_column[link]
        for k in range(3):
            y[row, column + k] = y[row, column + k] + found.y[0, k]
        above.ang = found.ang[0]
        above.lin = found.lin[0]
    return above


@wp.func
def walk_to_root(
    row: int, link0: int, w0: Wrench, link1: int, w1: Wrench, topology: Topology, work: Work, y: wp.array2d[float]
):
    """Adds to y[row] what between two links and the root the wrenches `w0` on link0 and `w1` on link1 move.

    Links are numbered parents first, so the deeper of the two is always the larger; where the paths meet, the
    wrenches are added before they go on, which keeps the cancellation of a relative row exact. -1 is the world.
    Columns of y are counted in the row's group.
    """
    a = link0
    b = link1
    a_ang = w0.ang
    a_lin = w0.lin
    b_ang = w1.ang
    b_lin = w1.lin
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
        before = topology.link_column[link]
        parent = topology.link_parent[link]
        if topology.link_type[link] == FREE:
            y_lin = work.mass[link] * lin
            y_ang = work.inertia[link] * (ang - y_lin * work.coupling[link])
            column = first - before
            for k in range(3):
                y[row, column + k] = y[row, column + k] + y_lin[k]
                y[row, column + 3 + k] = y[row, column + 3 + k] + y_ang[k]
        elif topology.link_type[link] == ELASTIC:
            above = walk_elastic(row, link, ang, lin, topology, work, y)
            ang = above.ang
            lin = above.lin
        elif topology.link_type[link] == NODE:
            above = walk_node(row, link, lin, topology, work, y)
            ang = above.ang
            lin = above.lin
        else:
            end = topology.link_tree_dof[link + 1]
            for index in range(end - first):
                tree_dof = end - 1 - index
                value = (wp.dot(work.s_ang[tree_dof], ang) + wp.dot(work.s_lin[tree_dof], lin)) * work.inv_sqrt_d[
                    tree_dof
                ]
                y[row, tree_dof - before] = y[row, tree_dof - before] + value
                ang -= work.u_ang[tree_dof] * value
                lin -= work.u_lin[tree_dof] * value
            ang += wp.cross(work.shift[link], lin)
        if b > a:
            b = parent
            b_ang = ang
            b_lin = lin
        else:
            a = parent
            a_ang = ang
            a_lin = lin


@wp.func
def project_tree_dof(row: int, tree_dof: int, coefficient: float, topology: Topology, work: Work, y: wp.array2d[float]):
    """Adds to y[row] the response of a generalised impulse of size `coefficient` on one tree degree of freedom."""
    link = topology.tree_dof_link[tree_dof]
    before = topology.link_column[link]
    value = coefficient * work.inv_sqrt_d[tree_dof]
    y[row, tree_dof - before] = y[row, tree_dof - before] + value
    ang = -work.u_ang[tree_dof] * value
    lin = -work.u_lin[tree_dof] * value
    for index in range(tree_dof - topology.link_tree_dof[link]):
        other = tree_dof - 1 - index
        value = (wp.dot(work.s_ang[other], ang) + wp.dot(work.s_lin[other], lin)) * work.inv_sqrt_d[other]
        y[row, other - before] = y[row, other - before] + value
        ang -= work.u_ang[other] * value
        lin -= work.u_lin[other] * value
    w = Wrench()
    w.ang = ang + wp.cross(work.shift[link], lin)
    w.lin = lin
    walk_to_root(row, topology.link_parent[link], w, -1, Wrench(), topology, work, y)
