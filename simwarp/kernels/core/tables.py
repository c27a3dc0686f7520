"""The structs that kernels take: constant tables, parameters, state, control, and a world's scratch.

`Topology` is shared by all worlds and never changes; `Parameters` have leading dimension 1 (shared) or W.
`Work` packs the local arrays of one world: a kernel of fixed size allocates them and hands them on as a whole.
"""

import warp as wp


@wp.func
def own(world: int, copies: int) -> int:
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
class Parameters:
    """Everything that may differ per world: leading dimension 1 or W. Units in `Model`."""

    gravity: wp.array[wp.vec3]
    body_mass: wp.array2d[float]
    body_inertia_b: wp.array2d[wp.mat33]
    joint_anchor0: wp.array2d[wp.vec3d]
    joint_anchor1: wp.array2d[wp.vec3d]
    joint_frame0: wp.array2d[wp.mat33d]
    joint_frame1: wp.array2d[wp.mat33d]
    joint_offset: wp.array2d[wp.float64]
    joint_armature: wp.array2d[float]
    joint_stiffness: wp.array2d[float]
    joint_rest: wp.array2d[float]
    joint_damping: wp.array2d[float]
    joint_preload: wp.array2d[float]
    joint_friction: wp.array2d[float]
    joint_limit_lower: wp.array2d[float]
    joint_limit_upper: wp.array2d[float]
    drive_stiffness: wp.array2d[float]
    drive_damping: wp.array2d[float]
    drive_effort_limit: wp.array2d[float]
    coupling_coefficient: wp.array3d[float]
    coupling_offset: wp.array2d[wp.float64]
    coupling_damping: wp.array2d[float]
    shape_x: wp.array2d[wp.vec3d]
    shape_rot: wp.array2d[wp.quat]
    shape_size: wp.array2d[wp.vec3]
    shape_margin: wp.array2d[float]
    shape_asset: wp.array2d[int]
    shape_enabled: wp.array2d[int]
    shape_friction: wp.array2d[float]
    shape_rolling_friction: wp.array2d[float]
    shape_spinning_friction: wp.array2d[float]
    shape_restitution: wp.array2d[float]
    shape_cohesion: wp.array2d[float]
    shape_compliance: wp.array2d[float]
    shape_damping: wp.array2d[float]
    shape_young_modulus: wp.array2d[float]
    shape_poisson_ratio: wp.array2d[float]


@wp.struct
class StateArrays:
    """The state of all worlds; shapes and units in `State`."""

    body_x: wp.array2d[wp.vec3d]
    body_rot: wp.array2d[wp.quatd]
    body_q: wp.array2d[wp.transform]
    body_v: wp.array2d[wp.vec3]
    body_omega: wp.array2d[wp.vec3]
    body_omega_last: wp.array2d[wp.vec3]
    body_v_low: wp.array2d[wp.vec3]
    body_omega_low: wp.array2d[wp.vec3]
    joint_x: wp.array2d[wp.float64]
    joint_q: wp.array2d[float]
    joint_qd: wp.array2d[float]
    bounded_impulse: wp.array2d[float]
    world_time: wp.array[wp.float64]
    world_status: wp.array[int]


@wp.struct
class ContactArrays:
    """The contacts of all worlds; shapes and units in `Contacts`."""

    contact_count: wp.array[int]
    contact_overflow: wp.array[int]
    contact_shape0: wp.array2d[int]
    contact_shape1: wp.array2d[int]
    contact_feature: wp.array2d[int]
    contact_normal_w: wp.array2d[wp.vec3]
    contact_gap: wp.array2d[float]
    contact_arm0: wp.array2d[wp.vec3]
    contact_arm1: wp.array2d[wp.vec3]
    contact_impulse: wp.array2d[wp.vec3]
    contact_moment: wp.array2d[wp.vec3]
    contact_force_w: wp.array2d[wp.vec3]
    shape_contact_force: wp.array2d[wp.vec3]
    body_contact_force: wp.array2d[wp.vec3]
    penetration: wp.array[float]


@wp.struct
class ControlArrays:
    """Inputs of a step; shapes and units in `Control`."""

    joint_force: wp.array2d[float]
    joint_target_q: wp.array2d[float]
    joint_target_qd: wp.array2d[float]
    body_force: wp.array2d[wp.vec3]
    body_torque: wp.array2d[wp.vec3]
    body_force_b: wp.array2d[wp.vec3]
    body_torque_b: wp.array2d[wp.vec3]
    element_force: wp.array2d[wp.vec3]  # (1 or W, B): what force elements of the model apply, such as tires
    element_torque: wp.array2d[wp.vec3]
    element_joint_force: wp.array2d[float]  # (1 or W, dofs)


@wp.struct
class Reports:
    """What a step tells about itself, per world; shapes and units in `Diagnostics`."""

    row_residual: wp.array[float]
    bounded_residual: wp.array[float]
    bounded_count: wp.array[int]
    iterations: wp.array[int]
    position_error: wp.array[float]
    joint_reaction_force: wp.array2d[wp.vec3]
    joint_reaction_torque: wp.array2d[wp.vec3]


@wp.struct
class StepConfig:
    """Numbers of one step."""

    dt: float
    recovery_speed: float  # m/s
    recovery_rate: float  # rad/s
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
    bounce_speed: float  # m/s: slower impacts do not bounce
    contact_envelope: float  # m: contacts nearer than this always take part
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
