"""Elimination of elastic joints in the tree's passes: six coordinates at once (elastic.py has the equations).

The code is large and called from many places, each of which a CPU's compiler copies it into. A kernel for models
without elastic joints is compiled with `WITHOUT_ELASTIC`, which empties it.
"""

import warp as wp

from simwarp.kernels.core.tables import Topology, Work
from simwarp.kernels.core.vector_math import cross_columns, inverse_cholesky

wp.set_module_options({"enable_backward": False})

WITHOUT_ELASTIC = "WITHOUT_ELASTIC_JOINTS"
"""Macro of the kernels of models without elastic joints."""


# places of an elastic joint's matrices
MIDDLE = wp.constant(0)  # axes halfway, with the sign of the link
LEVER = wp.constant(1)  # B (elastic.py)
GATHERED = wp.constant(2)  # T^-1
L11 = wp.constant(3)  # L^-1 of Z = L L^T by blocks
L21 = wp.constant(4)
L22 = wp.constant(5)
# and of its vectors
CHILD = wp.constant(0)  # anchors from the centres of the link and its parent
PARENT = wp.constant(1)
SPAN = wp.constant(2)  # from the parent's anchor to the link's
PULL = wp.constant(3)  # w of the tension in x


@wp.func_native(f"""
#ifdef {WITHOUT_ELASTIC}
    return false;
#else
    return true;
#endif
""")
def has_elastic_code() -> bool:
    """Whether the kernel is one for models with elastic joints."""
    ...


@wp.struct
class Wrench:
    """A row's direction at a link: about and along world axes at the link's centre."""

    ang: wp.vec3
    lin: wp.vec3


@wp.func
def columns_of(first: int, vectors: wp.array[wp.vec3]) -> wp.mat33:
    """Three columns from tree degree of freedom `first` on."""
    a = vectors[first]
    b = vectors[first + 1]
    c = vectors[first + 2]
    return wp.mat33(a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2])


@wp.func
def put_columns(first: int, m: wp.mat33, vectors: wp.array[wp.vec3]):
    """The reverse of `columns_of`."""
    for k in range(3):
        vectors[first + k] = wp.vec3(m[0, k], m[1, k], m[2, k])


@wp.func
def diagonal_of(first: int, numbers: wp.array[float]) -> wp.mat33:
    """Three numbers from tree degree of freedom `first` on."""
    return wp.diag(wp.vec3(numbers[first], numbers[first + 1], numbers[first + 2]))


@wp.func
def across(direction: wp.vec3, m: wp.mat33, factor: float) -> wp.mat33:
    """`factor` times what `m` has across a unit vector."""
    return (m - wp.outer(direction, direction * m)) * factor


@wp.struct
class ElasticForces:
    """U = A S of the columns of the translation (1) and of the rotation (2), about the link's centre, and the tension's
    part w P S_lin of both.
    """

    ang1: wp.mat33
    lin1: wp.mat33
    ang2: wp.mat33
    lin2: wp.mat33
    crossing1: wp.mat33
    crossing2: wp.mat33


@wp.func
def leave_on_parent(link: int, parent: int, u: ElasticForces, topology: Topology, work: Work):
    """Moves U to the parent's centre, stores U L^-T, and adds B^T Z^-1 U^T - E^T w P W to the parent (elastic.py)."""
    if not has_elastic_code():
        return
    index = topology.link_elastic[link]
    first = topology.link_tree_dof[link]
    shift = work.shift[link]
    l11 = work.elastic_matrices[6 * index + L11]
    l21 = work.elastic_matrices[6 * index + L21]
    l22 = work.elastic_matrices[6 * index + L22]
    middle = work.elastic_matrices[6 * index + MIDDLE]
    span = work.elastic_vectors[4 * index + SPAN]
    near = work.elastic_vectors[4 * index + PARENT]
    pull = work.elastic_vectors[4 * index + PULL][0]
    gain1 = diagonal_of(first, work.gain)
    u_ang1 = u.ang1 + cross_columns(shift, u.lin1)
    u_ang2 = u.ang2 + cross_columns(shift, u.lin2)
    # B by blocks: rows of the coordinates, columns of the parent's angular and linear velocity
    turning = work.elastic_matrices[6 * index + GATHERED] * wp.transpose(middle)
    b_lin1 = gain1 * wp.transpose(middle)
    # row by row: (a m^T) (w x r) = (r x a)^T w
    b_ang1 = wp.transpose(cross_columns(near + span, wp.transpose(b_lin1)))
    b_ang1 -= gain1 * work.elastic_matrices[6 * index + LEVER] * turning
    b_ang2 = diagonal_of(first + 3, work.gain) * turning
    b_lin2 = wp.mat33()
    if pull > 0.0:
        u_ang1 += cross_columns(span, u.crossing1)
        u_ang2 += cross_columns(span, u.crossing2)
        b_lin1 += wp.transpose(u.crossing1)
        b_lin2 += wp.transpose(u.crossing2)
        b_ang1 += wp.transpose(cross_columns(near, u.crossing1))
        b_ang2 += wp.transpose(cross_columns(near, u.crossing2))
    v_ang1 = u_ang1 * wp.transpose(l11)
    v_lin1 = u.lin1 * wp.transpose(l11)
    v_ang2 = u_ang1 * wp.transpose(l21) + u_ang2 * wp.transpose(l22)
    v_lin2 = u.lin1 * wp.transpose(l21) + u.lin2 * wp.transpose(l22)
    put_columns(first, v_ang1, work.u_ang)
    put_columns(first, v_lin1, work.u_lin)
    put_columns(first + 3, v_ang2, work.u_ang)
    put_columns(first + 3, v_lin2, work.u_lin)
    b_ang2 = l21 * b_ang1 + l22 * b_ang2
    b_lin2 = l21 * b_lin1 + l22 * b_lin2
    b_ang1 = l11 * b_ang1
    b_lin1 = l11 * b_lin1
    a_ang = v_ang1 * b_ang1 + v_ang2 * b_ang2
    a_coupling = v_ang1 * b_lin1 + v_ang2 * b_lin2
    b_coupling = v_lin1 * b_ang1 + v_lin2 * b_ang2
    a_lin = v_lin1 * b_lin1 + v_lin2 * b_lin2
    if pull > 0.0:
        # E^T w P W, with W V = w x span and E V = v + w x near
        drag = across(wp.normalize(span), wp.skew(span), -pull)
        b_coupling -= drag
        a_ang -= cross_columns(near, drag)
    work.inertia[parent] = work.inertia[parent] + (a_ang + wp.transpose(a_ang)) * 0.5
    work.coupling[parent] = work.coupling[parent] + (a_coupling + wp.transpose(b_coupling)) * 0.5
    work.mass[parent] = work.mass[parent] + (a_lin + wp.transpose(a_lin)) * 0.5


@wp.func
def factor_elastic(link: int, topology: Topology, work: Work):
    """Eliminates the six coordinates of an elastic joint at once, and adds what is left to the parent (elastic.py).

    Blocks 1 are those of the translation, 2 those of the rotation.
    """
    if not has_elastic_code():
        return
    index = topology.link_elastic[link]
    first = topology.link_tree_dof[link]
    inertia = work.inertia[link]
    coupling = work.coupling[link]
    mass = work.mass[link]
    lin1 = columns_of(first, work.s_lin)
    ang2 = columns_of(first + 3, work.s_ang)
    lin2 = columns_of(first + 3, work.s_lin)
    u = ElasticForces()
    u.lin1 = mass * lin1
    u.ang1 = coupling * lin1
    u.lin2 = mass * lin2 + wp.transpose(coupling) * ang2
    u.ang2 = coupling * lin2 + inertia * ang2
    z11 = wp.transpose(lin1) * u.lin1 + diagonal_of(first, work.gain)
    z21 = wp.transpose(lin2) * u.lin1 + wp.transpose(ang2) * u.ang1
    z22 = wp.transpose(lin2) * u.lin2 + wp.transpose(ang2) * u.ang2 + diagonal_of(first + 3, work.gain)
    pull = work.elastic_vectors[4 * index + PULL][0]
    middle = work.elastic_matrices[6 * index + MIDDLE]
    if pull > 0.0:
        along = wp.normalize(work.elastic_vectors[4 * index + SPAN])
        tip = middle * work.elastic_matrices[6 * index + LEVER]
        u.crossing1 = across(along, middle, pull)
        u.crossing2 = across(along, tip, pull)
        z11 += wp.transpose(middle) * u.crossing1
        z21 += wp.transpose(tip) * u.crossing1
        z22 += wp.transpose(tip) * u.crossing2
    l11 = inverse_cholesky(z11)
    k = z21 * wp.transpose(l11)
    l22 = inverse_cholesky(z22 - k * wp.transpose(k))
    l21 = l22 * k * l11 * (-1.0)
    work.elastic_matrices[6 * index + L11] = l11
    work.elastic_matrices[6 * index + L21] = l21
    work.elastic_matrices[6 * index + L22] = l22
    put_columns(first, lin1 * wp.transpose(l11), work.s_lin)
    put_columns(first + 3, lin1 * wp.transpose(l21) + lin2 * wp.transpose(l22), work.s_lin)
    put_columns(first + 3, ang2 * wp.transpose(l22), work.s_ang)
    parent = topology.link_parent[link]
    if parent >= 0:
        leave_on_parent(link, parent, u, topology, work)
    else:
        for tree_dof in range(first, first + 6):
            work.u_ang[tree_dof] = wp.vec3()
            work.u_lin[tree_dof] = wp.vec3()


@wp.func
def elastic_backward(link: int, p_ang: wp.vec3, p_lin: wp.vec3, topology: Topology, work: Work):
    """`backward_pass` of a link with an elastic joint."""
    if not has_elastic_code():
        return
    index = topology.link_elastic[link]
    first = topology.link_tree_dof[link]
    parent = topology.link_parent[link]
    effort1 = wp.vec3(work.effort[first], work.effort[first + 1], work.effort[first + 2])
    effort2 = wp.vec3(work.effort[first + 3], work.effort[first + 4], work.effort[first + 5])
    own1 = work.elastic_matrices[6 * index + L11] * effort1
    own2 = work.elastic_matrices[6 * index + L21] * effort1 + work.elastic_matrices[6 * index + L22] * effort2
    ang = p_ang + wp.cross(work.shift[link], p_lin)
    lin = p_lin
    for k in range(6):
        own = own1[k % 3]
        if k >= 3:
            own = own2[k % 3]
        xi = wp.dot(work.s_ang[first + k], p_ang) + wp.dot(work.s_lin[first + k], p_lin) + own
        work.xi[first + k] = xi
        ang -= work.u_ang[first + k] * xi
        lin -= work.u_lin[first + k] * xi
    if parent >= 0:
        work.p_ang[parent] = work.p_ang[parent] + ang
        work.p_lin[parent] = work.p_lin[parent] + lin


@wp.func
def elastic_forward(link: int, topology: Topology, work: Work):
    """`forward_pass` of a link with an elastic joint."""
    if not has_elastic_code():
        return
    index = topology.link_elastic[link]
    first = topology.link_tree_dof[link]
    parent = topology.link_parent[link]
    carrier_ang = wp.vec3()
    carrier_lin = wp.vec3()
    if parent >= 0:
        carrier_ang = work.v_ang[parent]
        carrier_lin = work.v_lin[parent]
    v_ang = carrier_ang
    v_lin = carrier_lin + wp.cross(carrier_ang, work.shift[link])
    part1 = wp.vec3()
    part2 = wp.vec3()
    for k in range(6):
        value = (
            work.xi[first + k] - wp.dot(work.u_ang[first + k], carrier_ang) - wp.dot(work.u_lin[first + k], carrier_lin)
        )
        v_ang += work.s_ang[first + k] * value
        v_lin += work.s_lin[first + k] * value
        if k < 3:
            part1[k] = value
        else:
            part2[k - 3] = value
    change1 = part1 * work.elastic_matrices[6 * index + L11] + part2 * work.elastic_matrices[6 * index + L21]
    change2 = part2 * work.elastic_matrices[6 * index + L22]
    for k in range(3):
        work.change[first + k] = change1[k]
        work.change[first + 3 + k] = change2[k]
        work.qd[first + k] = change1[k] + work.rate[first + k]
        work.qd[first + 3 + k] = change2[k] + work.rate[first + 3 + k]
    work.v_ang[link] = v_ang
    work.v_lin[link] = v_lin


@wp.func
def resist_crossing(link: int, topology: Topology, work: Work):
    """Takes the tension's share off the momentum balance in `p`: what it answers to the changes of velocity (see
    elastic.py).
    """
    if not has_elastic_code():
        return
    index = topology.link_elastic[link]
    if index < 0:
        return
    pull = work.elastic_vectors[4 * index + PULL][0]
    if pull > 0.0:
        parent = topology.link_parent[link]
        child_arm = work.elastic_vectors[4 * index + CHILD]
        parent_arm = work.elastic_vectors[4 * index + PARENT]
        speed = work.v_lin[link] + wp.cross(work.v_ang[link], child_arm)
        if parent >= 0:
            speed -= work.v_lin[parent] + wp.cross(work.v_ang[parent], parent_arm)
        along = wp.normalize(work.elastic_vectors[4 * index + SPAN])
        impulse = (speed - along * wp.dot(along, speed)) * pull
        work.p_lin[link] = work.p_lin[link] - impulse
        work.p_ang[link] = work.p_ang[link] - wp.cross(child_arm, impulse)
        if parent >= 0:
            work.p_lin[parent] = work.p_lin[parent] + impulse
            work.p_ang[parent] = work.p_ang[parent] + wp.cross(parent_arm, impulse)


@wp.func
def walk_elastic(
    row: int, link: int, ang: wp.vec3, lin: wp.vec3, topology: Topology, work: Work, y: wp.array2d[float]
) -> Wrench:
    """`walk_to_root` over a link with an elastic joint: the wrench on its parent."""
    above = Wrench()
    if has_elastic_code():
        first = topology.link_tree_dof[link]
        before = topology.link_column[link]
        above.ang = ang + wp.cross(work.shift[link], lin)
        above.lin = lin
        for k in range(first, first + 6):
            value = wp.dot(work.s_ang[k], ang) + wp.dot(work.s_lin[k], lin)
            y[row, k - before] = y[row, k - before] + value
            above.ang -= work.u_ang[k] * value
            above.lin -= work.u_lin[k] * value
    return above
