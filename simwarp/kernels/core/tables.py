"""The structs that kernels take beside the arrays of `fields`: constant tables, options, and a world's scratch.

`Topology` is shared by all worlds and never changes.
`Work` packs the local arrays of one world: a kernel of fixed size allocates them and hands them on as a whole.
"""

import warp as wp


@wp.func
def world_row(world: int, copies: int) -> int:
    """Row of a parameter: the world's own, or the only one."""
    return wp.min(world, copies - 1)


@wp.struct
class Topology:
    """Level-ordered tables: links (bodies and shafts) parents first, slots (tree degrees of freedom), rows."""

    link_count: int
    slot_count: int
    dof_count: int
    joint_count: int
    loop_joint_count: int
    row_count: int  # rows of loop joints, then couplings
    joint_row_count: int
    bounded_count: int
    loop_dof_count: int
    slot_line_count: int
    shape_count: int
    pair_count: int
    grid_buckets: int  # 0: pairs come from the list

    link_body: wp.array[int]  # -1: shaft
    link_parent: wp.array[int]  # -1: world
    link_joint: wp.array[int]  # -1: floating without a named joint
    link_type: wp.array[int]  # JointType
    link_sign: wp.array[float]  # -1: the joint is traversed from its child to its parent
    link_alone: wp.array[int]  # 1: no joint touches the body
    link_slot: wp.array[int]  # CSR
    slot_dof: wp.array[int]  # -1: floating without a named joint
    slot_link: wp.array[int]
    body_link: wp.array[int]

    joint_type: wp.array[int]
    joint_body0: wp.array[int]
    joint_body1: wp.array[int]
    joint_dof: wp.array[int]  # CSR

    dof_joint: wp.array[int]
    dof_slot: wp.array[int]  # -1: the joint closes a loop
    dof_kind: wp.array[int]  # RowKind
    dof_axis: wp.array[int]
    dof_drive: wp.array[int]  # DriveMode
    dof_coupled: wp.array[int]  # 1: a coupling divides its error by the step
    dof_table: wp.array2d[int]  # (dofs, 4): spring, damper, motion table, tables of a damper map, -1: none
    table_start: wp.array[int]  # CSR
    table_x: wp.array[wp.float64]
    table_y: wp.array[wp.float64]

    loop_joint: wp.array[int]
    loop_row: wp.array[int]  # CSR over loop joints
    row_kind: wp.array[int]
    row_axis0: wp.array[int]
    row_axis1: wp.array[int]
    row_dof: wp.array[int]  # -1: rigid; else the row carries that degree of freedom's law or prescribed motion
    coupling_dof: wp.array2d[int]  # (couplings, terms), -1: none
    coupling_wrench: wp.array2d[int]  # (couplings, terms): where j0, j1 hold a TURN term's wrenches, -1: a slot
    row_path: wp.array[int]  # CSR over rows: slots that a row can move
    path_slot: wp.array[int]

    slot_line: wp.array2d[
        int
    ]  # (lines, 2): coordinate of a LINE, slot of the joint between its bodies, on which it acts
    loop_dof: wp.array[int]  # coordinates of loop joints without a law: `joint_force` acts on them as it is
    bounded_dof: wp.array[int]
    bounded_kind: wp.array[int]  # BoundedKind

    shape_body: wp.array[int]  # -1: world
    shape_type: wp.array[int]  # ShapeType
    shape_group: wp.array[int]
    shape_mask: wp.array[int]
    pair_start: wp.array[int]  # CSR over shapes: those of higher index that it may touch
    pair_other: wp.array[int]
    excluded_start: wp.array[int]  # CSR over the world, then bodies: bodies of higher index that it never touches
    excluded_body: wp.array[int]


@wp.struct
class StepConfig:
    """Numbers of one step."""

    dt: float
    max_depenetration_velocity: float  # m/s
    max_depenetration_rate: float  # rad/s
    pivot_tolerance: float
    projection_iterations: int
    refinement: int
    max_iterations: int
    tolerance: float
    row_tolerance: float
    reactions: int
    gyroscopic: int
    solver: int  # ConeSolver
    friction_law: int  # FrictionLaw
    contact_model: int  # ContactModel
    restitution_threshold: float  # m/s: slower impacts do not bounce
    contact_margin: float  # m: contacts nearer than this always take part
    dense_rows: int  # most rows of a dense Schur complement


@wp.struct
class Work:
    """Scratch of one world. `ang`, `lin` are about a link's centre of mass, world axes."""

    x: wp.array[wp.vec3d]  # per body
    quat: wp.array[wp.quatd]
    rot: wp.array[wp.mat33d]

    inertia: wp.array[wp.mat33]  # per link: articulated inertia [[inertia, coupling], [coupling^T, mass]]
    coupling: wp.array[wp.mat33]
    mass: wp.array[wp.mat33]
    shift: wp.array[wp.vec3]  # parent's centre to child's, through the joint
    drift_ang: wp.array[wp.vec3]
    drift_lin: wp.array[wp.vec3]
    p_ang: wp.array[wp.vec3]
    p_lin: wp.array[wp.vec3]
    v_ang: wp.array[wp.vec3]  # change of velocity in this step
    v_lin: wp.array[wp.vec3]
    o_ang: wp.array[wp.vec3]  # velocity at its start
    o_lin: wp.array[wp.vec3]
    l_ang: wp.array[wp.vec3]  # what rounding kept back from it so far
    l_lin: wp.array[wp.vec3]
    t_ang: wp.array[wp.vec3]  # their sum
    t_lin: wp.array[wp.vec3]

    f_ang: wp.array[wp.vec3]  # impulse balance of the reactions
    f_lin: wp.array[wp.vec3]

    s_ang: wp.array[wp.vec3]  # per slot
    s_lin: wp.array[wp.vec3]
    u_ang: wp.array[wp.vec3]
    u_lin: wp.array[wp.vec3]
    inv_sqrt_d: wp.array[float]
    gain: wp.array[float]
    effort: wp.array[float]
    rate: wp.array[float]  # prescribed
    xi: wp.array[float]
    qd: wp.array[float]
    k_qd: wp.array[float]  # kept while a correction is computed
    k_effort: wp.array[float]

    j0_ang: wp.array[wp.vec3]  # per row, then per TURN term of a coupling
    j0_lin: wp.array[wp.vec3]
    j1_ang: wp.array[wp.vec3]
    j1_lin: wp.array[wp.vec3]
    row_b: wp.array[float]
    row_compliance: wp.array[float]
    row_impulse: wp.array[float]
    row_r: wp.array[float]
    row_t: wp.array[float]
    row_scale: wp.array[float]
    y: wp.array2d[float]  # (rows, slots)
    y_t: wp.array2d[float]  # (slots, padded rows), zero where a row does not reach
    n: wp.array2d[float]  # (rows, padded rows)
    inv_pivot: wp.array[float]

    active: wp.array[int]  # per block: bounded row, or the number of bounded rows plus the contact
    b_sign: wp.array[float]  # per block
