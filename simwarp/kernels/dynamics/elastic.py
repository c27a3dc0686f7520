"""Elastic joints: six coordinates between two bodies, which springs and dampers act on. They are the elements of rods.

Coordinates are strains, not velocities: with the vector d between the anchors, theta = log(F0^T F1) the rotation
between the frames, and M = F0 exp(theta/2) the frame halfway between them (Sonneville, Cardona & Bruls 2014)

    q = (M^T d - (L, 0, 0), theta),    L: `joint_offset`, the distance of the anchors at rest

is zero where the frames coincide but for L along their x axes, and no rigid motion changes it: springs along q have an
energy, dampers leave spin alone. Per element of a rod (Simo & Vu-Quoc 1986) q is L times shear and stretch, twist and
bending, stiffnesses are EA/L, kGA/L, GJ/L, EI/L.

Columns, the velocity of frame 1 per rate of q with frame 0 at rest, with c = M^T d, t = |theta| and e = theta/t:

    (linear; angular) = M [1, B; 0, T] q',   T = e e^T + sin(t/2)/(t/2) (1 - e e^T),   B = -c^ (1/2 - tan(t/4)/2 e^) T

Seen from frame 1, c, theta and q change their signs.

The joint is eliminated as a whole, Z = S^T A S + G = L L^T with the child's articulated inertia A, columns S and gains
G. What it leaves on the parent is B^T Z^-1 U^T with U = X^T A S and B = G S^-1 X, where X carries the parent's velocity
to the child: equal to X^T A X - U Z^-1 U^T, which cancels to nothing where the joint is soft or the child is heavy.
`s` and `u` then hold S L^-T and U L^-T, the latter about the parent's centre.

A taut element resists its ends' moving across it, which is no function of q' alone: with its tension N, h the step and
w = h^2 (1/2 + zeta) N/|d|, the term w P with P = 1 - d d^T/|d|^2 acts on the change of the anchors' relative velocity,
W V + S_lin q' with W V = omega x d. It joins Z, U and B and leaves -E^T w P W on the parent, E V the velocity of its
anchor.

Shear and bending moments resist as well, as they turn with their element: in lateral-torsional buckling. That is left
explicit, and its tie is between the twist and the motion out of the plane of bending. A step with k + g in the force
and (beta + zeta) k in the matrix is stable, however fast the oscillation, where g < (4 beta + 2 zeta - 1) k. So

    beta = (1 - zeta)^2 / 4         leaves zeta^2 k: what is too fast for the step dies out by (1 - zeta) / (1 + zeta)
    (1 + zeta) / 2 for beta + zeta  of twist leaves k: the tie is below the stiffness as long as the rod does not buckle
    h^2 N |d| a^2 / 8               more of twist, a the angle of bending [rad], where N pulls: the shear force N a / 2

N has no rate in the force, so that w leaves (1 + 4 zeta) N: a tension may double within a step.
"""

import warp as wp

from simwarp.kernels.core.fields import ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import cross_columns, matrix_to_float, to_double, to_float
from simwarp.kernels.dynamics.efforts import applied_effort, exponential_map
from simwarp.kernels.dynamics.elastic_links import (
    CHILD,
    GATHERED,
    LEVER,
    MIDDLE,
    PARENT,
    PULL,
    SPAN,
    has_elastic_code,
)
from simwarp.kernels.dynamics.joints import JointFrames, joint_frames, rotation_vector

wp.set_module_options({"enable_backward": False})


@wp.struct
class ElasticFrame:
    """An elastic joint at its poses: `middle` has the axes of the frame halfway, world, as columns; `span` is the
    vector between the anchors in them [m], `turn` the rotation between the frames [rad], `spread` the matrix T.
    """

    middle: wp.mat33
    span: wp.vec3
    turn: wp.vec3
    spread: wp.mat33


@wp.func
def middle_frame(f0: wp.mat33d, turn: wp.vec3d) -> wp.mat33d:
    """The frame halfway between frame 0 and the one that `turn` [rad, axes of frame 0] leads to."""
    return f0 * wp.quat_to_matrix(exponential_map(wp.float64(0.5) * turn))


@wp.func
def frames_halfway(frames: JointFrames, turn: wp.vec3d, length: wp.float64) -> JointFrames:
    """The frame halfway in the place of frame 0, and what the span has beyond its `length` at rest: along the axes of
    the one, the other has the first three coordinates.
    """
    halfway = JointFrames()
    if not has_elastic_code():
        return halfway
    halfway.f0 = middle_frame(frames.f0, turn)
    halfway.d = frames.d - halfway.f0 * wp.vec3d(length, wp.float64(0.0), wp.float64(0.0))
    return halfway


@wp.func
def chord_over_arc(square: float) -> wp.vec2:
    """Of t^2 = `square`: s = sin(t/2) / (t/2) and (1 - s) / t^2. Series below a tenth of a radian: what they leave out
    is below rounding.
    """
    s = 1.0 - square / 24.0 + square * square / 1920.0
    rest = 1.0 / 24.0 - square / 1920.0
    if square > 0.01:
        half = 0.5 * wp.sqrt(square)
        s = wp.sin(half) / half
        rest = (1.0 - s) / square
    return wp.vec2(s, rest)


@wp.func
def spread_of(turn: wp.vec3) -> wp.mat33:
    """T: angular velocity of frame 1 against frame 0, in axes halfway, per rate of `turn`."""
    s = chord_over_arc(wp.dot(turn, turn))
    return wp.diag(wp.vec3(s[0], s[0], s[0])) + wp.outer(turn, turn) * s[1]


@wp.func
def gathered_of(turn: wp.vec3) -> wp.mat33:
    """The inverse of T."""
    s = chord_over_arc(wp.dot(turn, turn))
    return (wp.identity(3, dtype=float) - wp.outer(turn, turn) * s[1]) * (1.0 / s[0])


@wp.func
def lever_of(frame: ElasticFrame, sign: float) -> wp.mat33:
    """B: velocity of frame 1's anchor, in axes halfway, per rate of the rotation; with `sign` -1 of frame 0's seen from
    frame 1.
    """
    square = wp.dot(frame.turn, frame.turn)
    quarter = 0.125 + square / 384.0  # tan(t/4) / (2 t)
    if square > 0.01:
        t = wp.sqrt(square)
        quarter = wp.tan(0.25 * t) / (2.0 * t)
    halfway = 0.5 * frame.spread - cross_columns(frame.turn, frame.spread) * (sign * quarter)
    return cross_columns(frame.span, halfway) * (-sign)


@wp.func
def elastic_frame(joint: int, world: int, frames: JointFrames, topology: Topology, state: StateArrays) -> ElasticFrame:
    """The joint at the poses of record, whose coordinates are known."""
    first = topology.joint_dof[joint]
    turn = wp.vec3d(state.joint_x[world, first + 3], state.joint_x[world, first + 4], state.joint_x[world, first + 5])
    return frame_halfway(frames, turn)


@wp.func
def frame_halfway(frames: JointFrames, turn: wp.vec3d) -> ElasticFrame:
    """The joint where the rotation between its frames is known [rad]."""
    middle = middle_frame(frames.f0, turn)
    frame = ElasticFrame()
    frame.middle = matrix_to_float(middle)
    frame.span = to_float(frames.d * middle)
    frame.turn = to_float(turn)
    frame.spread = spread_of(frame.turn)
    return frame


@wp.struct
class ElasticRate:
    """Rates of the six coordinates [m/s, rad/s]."""

    lin: wp.vec3
    ang: wp.vec3


@wp.func
def elastic_rate(
    frame: ElasticFrame, frames: JointFrames, v0: wp.vec3d, w0: wp.vec3d, v1: wp.vec3d, w1: wp.vec3d
) -> ElasticRate:
    """Rates for the velocities of both bodies' centres and their angular velocities; differences are formed in float64,
    in which a rigid motion leaves nothing.
    """
    slip = v1 + wp.cross(w1, frames.r1) - v0 - wp.cross(w0, frames.r0 + frames.d)
    rate = ElasticRate()
    rate.ang = gathered_of(frame.turn) * (to_float(w1 - w0) * frame.middle)
    rate.lin = to_float(slip) * frame.middle - lever_of(frame, 1.0) * rate.ang
    return rate


@wp.func
def joint_rate(joint: int, world: int, topology: Topology, parameters: Parameters, work: Work) -> ElasticRate:
    """Rates of an elastic joint from the total velocities and the poses in `work`."""
    frames = joint_frames(joint, world, topology, parameters, work)
    frame = frame_halfway(frames, rotation_vector(frames.f0, frames.f1))
    v0 = wp.vec3d()
    w0 = wp.vec3d()
    v1 = wp.vec3d()
    w1 = wp.vec3d()
    body0 = topology.joint_body0[joint]
    body1 = topology.joint_body1[joint]
    if body0 >= 0:
        v0 = to_double(work.t_lin[topology.body_link[body0]])
        w0 = to_double(work.t_ang[topology.body_link[body0]])
    if body1 >= 0:
        v1 = to_double(work.t_lin[topology.body_link[body1]])
        w1 = to_double(work.t_ang[topology.body_link[body1]])
    return elastic_rate(frame, frames, v0, w0, v1, w1)


@wp.func
def put_columns_of(first: int, ang: wp.mat33, lin: wp.mat33, work: Work):
    """Three motion columns from tree degree of freedom `first` on."""
    for k in range(3):
        work.s_ang[first + k] = wp.vec3(ang[0, k], ang[1, k], ang[2, k])
        work.s_lin[first + k] = wp.vec3(lin[0, k], lin[1, k], lin[2, k])


@wp.func
def place_elastic(link: int, world: int, topology: Topology, parameters: Parameters, work: Work):
    """Columns and shift of a link with an elastic joint at the poses in `work`; its tension counts as zero."""
    frames = joint_frames(topology.link_joint[link], world, topology, parameters, work)
    place_frame(link, frames, frame_halfway(frames, rotation_vector(frames.f0, frames.f1)), topology, work)


@wp.func
def place_frame(link: int, frames: JointFrames, frame: ElasticFrame, topology: Topology, work: Work):
    """`place_elastic` of a joint whose frame halfway is known."""
    index = topology.link_elastic[link]
    sign = topology.link_sign[link]
    child = to_float(frames.r1)
    parent = to_float(frames.r0)
    if sign < 0.0:
        child = to_float(frames.r0)
        parent = to_float(frames.r1)
    if topology.link_parent[link] < 0:
        parent = wp.vec3()
    span = to_float(frames.d) * sign
    work.shift[link] = parent + span - child
    work.stabilisation_ang[link] = wp.vec3()
    work.stabilisation_lin[link] = wp.vec3()
    middle = frame.middle * sign
    lever = lever_of(frame, sign)
    first = topology.link_tree_dof[link]
    ang = middle * frame.spread
    put_columns_of(first, wp.mat33(), middle, work)
    put_columns_of(first + 3, ang, middle * lever + cross_columns(child, ang), work)
    work.elastic_matrices[6 * index + MIDDLE] = middle
    work.elastic_matrices[6 * index + LEVER] = lever
    work.elastic_matrices[6 * index + GATHERED] = gathered_of(frame.turn)
    work.elastic_vectors[4 * index + CHILD] = child
    work.elastic_vectors[4 * index + PARENT] = parent
    work.elastic_vectors[4 * index + SPAN] = span
    work.elastic_vectors[4 * index + PULL] = wp.vec3(0.0, 0.0, 0.0)


@wp.func
def start_velocity(link: int, work: Work) -> wp.vec3d:
    """Of the centre at the step's start, with its rounding error [m/s]."""
    return to_double(work.o_lin[link]) + to_double(work.l_lin[link])


@wp.func
def start_spin(link: int, work: Work) -> wp.vec3d:
    """Likewise [rad/s]."""
    return to_double(work.o_ang[link]) + to_double(work.l_ang[link])


@wp.func
def crossing_speed(frames: JointFrames, v0: wp.vec3d, w0: wp.vec3d, v1: wp.vec3d, w1: wp.vec3d) -> float:
    """Of one anchor against the other, across the line between them [m/s]."""
    slip = to_float(v1 + wp.cross(w1, frames.r1) - v0 - wp.cross(w0, frames.r0))
    span = to_float(frames.d)
    return wp.length(slip - span * (wp.dot(span, slip) / wp.max(wp.dot(span, span), 1.0e-30)))


@wp.func
def tension_over_length(
    spring: float, stiffness: float, damping: float, crossing: float, frame: ElasticFrame, config: StepConfig
) -> float:
    """Tension by the strain, less what a step itself stretches an element by whose ends cross, over the element's
    length [N/m]; not below zero. `spring` is the effort of the strain, negative where it pulls [N].

    The stretch of a step h is (beta + zeta/2 + damping / (stiffness h)) (h w)^2 of the length, w the rate of turning.
    """
    length = wp.length(frame.span)
    if length == 0.0:
        return 0.0
    h = config.dt
    own = stiffness * (config.flexible_average + 0.5 * config.flexible_damping) + damping / h
    return wp.max(-spring - own * h * h * crossing * crossing / length, 0.0) / length


@wp.func
def taut_twist(tension: float, frame: ElasticFrame) -> float:
    """Stiffness of twist that a step takes for a bent element that is pulled [N m/rad], from its tension over its
    length [N/m].
    """
    bend = frame.turn[1] * frame.turn[1] + frame.turn[2] * frame.turn[2]
    return 0.125 * tension * wp.dot(frame.span, frame.span) * bend


@wp.func
def load_elastic(
    link: int, world: int, topology: Topology, parameters: Parameters, state: StateArrays, control: ControlArrays,
    config: StepConfig, work: Work,
):  # fmt: skip
    """Columns, rates, gains, efforts and tension of a link with an elastic joint at the start of a step."""
    joint = topology.link_joint[link]
    frames = joint_frames(joint, world, topology, parameters, work)
    frame = elastic_frame(joint, world, frames, topology, state)
    place_frame(link, frames, frame, topology, work)
    v0 = wp.vec3d()
    w0 = wp.vec3d()
    v1 = wp.vec3d()
    w1 = wp.vec3d()
    if topology.joint_body0[joint] >= 0:
        v0 = start_velocity(topology.body_link[topology.joint_body0[joint]], work)
        w0 = start_spin(topology.body_link[topology.joint_body0[joint]], work)
    if topology.joint_body1[joint] >= 0:
        v1 = start_velocity(topology.body_link[topology.joint_body1[joint]], work)
        w1 = start_spin(topology.body_link[topology.joint_body1[joint]], work)
    rates = elastic_rate(frame, frames, v0, w0, v1, w1)
    h = config.dt
    zeta = config.flexible_damping
    implicit = h * h * (config.flexible_average + zeta)
    first = topology.link_tree_dof[link]
    k_row = world_row(world, parameters.joint_stiffness.shape[0])
    d_row = world_row(world, parameters.joint_damping.shape[0])
    rest_row = world_row(world, parameters.joint_rest.shape[0])
    preload_row = world_row(world, parameters.joint_preload.shape[0])
    tension = float(0.0)
    for local in range(6):
        tree_dof = first + local
        dof = topology.tree_dof_to_dof[tree_dof]
        rate = rates.lin[local % 3]
        if local >= 3:
            rate = rates.ang[local % 3]
        k = parameters.joint_stiffness[k_row, dof]
        d = parameters.joint_damping[d_row, dof]
        stretch = float(state.joint_x[world, dof] - wp.float64(parameters.joint_rest[rest_row, dof]))
        spring = parameters.joint_preload[preload_row, dof] - k * stretch
        force = spring - d * rate + applied_effort(world, dof, control)
        work.rate[tree_dof] = rate
        work.start[tree_dof] = 0.0
        work.gain[tree_dof] = h * (0.5 + 0.5 * zeta) * d + implicit * k
        work.effort[tree_dof] = h * force - h * h * zeta * k * rate
        if local == 0:
            crossing = crossing_speed(frames, v0, w0, v1, w1)
            tension = tension_over_length(spring, k, d, crossing, frame, config)
            work.elastic_vectors[4 * topology.link_elastic[link] + PULL] = wp.vec3(
                h * h * (0.5 + zeta) * tension, 0.0, 0.0
            )
        if local == 3:
            twist = (0.5 + 0.5 * zeta) * k + taut_twist(tension, frame)
            work.gain[tree_dof] = h * (0.5 + 0.5 * zeta) * d + h * h * twist


@wp.func
def gain_stiffness(world: int, topology: Topology, parameters: Parameters, config: StepConfig, work: Work):
    """Gains of all elastic joints that resist a change of their poses, as springs of a step do."""
    weight = config.dt * config.dt * (config.flexible_average + config.flexible_damping)
    row = world_row(world, parameters.joint_stiffness.shape[0])
    for link in range(topology.link_count):
        if topology.link_elastic[link] < 0:
            continue
        for tree_dof in range(topology.link_tree_dof[link], topology.link_tree_dof[link + 1]):
            work.gain[tree_dof] = weight * parameters.joint_stiffness[row, topology.tree_dof_to_dof[tree_dof]]


@wp.func
def has_elastic(topology: Topology) -> bool:
    """Elastic joints."""
    return topology.elastic_count > 0


@wp.func(inline=True)
def load_elastic_joints(
    world: int, config: StepConfig, topology: Topology, parameters: Parameters, control: ControlArrays,
    state: StateArrays, work: Work,
):  # fmt: skip
    """`load_elastic` of all of them."""
    if not has_elastic_code():
        return
    for link in range(topology.link_count):
        if topology.link_elastic[link] >= 0:
            load_elastic(link, world, topology, parameters, state, control, config, work)
