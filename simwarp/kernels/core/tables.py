"""The structs that kernels take beside the arrays of `fields`: constant tables, options, and a world's scratch.

`Topology` is shared by all worlds and never changes.
`Work` has the local arrays of one world, which lie in a slot of the scratch (scratch.py).
"""

from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout
from simwarp.kernels.core.scratch import ScratchGroup, scratch_array


@wp.func
def world_row(world: int, copies: int) -> int:
    """Row of a parameter: the world's own, or the only one."""
    return wp.min(world, copies - 1)


@wp.struct
class Topology:
    """Level-ordered tables: links (bodies and shafts) parents first, tree degrees of freedom, rows."""

    link_count: int
    tree_dof_count: int
    dof_count: int
    joint_count: int
    loop_joint_count: int
    loop_rotation_count: int  # of them, with efforts on their rotation
    row_count: int  # group by group: rows of loop joints, then couplings, then combinations with a law
    response_count: int  # the same, then combinations without one
    joint_row_count: int  # rows of loop joints, in all groups
    group_count: int  # trees that rows tie together, directly or by way of others
    unit_count: int  # groups of which a part moves, and trees that no row reaches
    box_count: int
    loop_dof_count: int
    distance_count: int
    massless_count: int
    elastic_count: int
    mesh_nodes: int  # of meshes, that move by themselves
    mesh_columns: int  # of their matrix: nodes in the order of elimination, then two for each body they are glued to
    mesh_link0: int  # links of nodes begin here, in the reverse of that order
    mesh_double: int  # 1: the matrix is factored in double precision
    face_count: int  # triangles of meshes that touch others (face_tables.py)
    shape_count: int
    pair_count: int
    formula_pairs: int  # of convex shapes whose contacts are written down
    searched_pairs: int  # of other convex shapes
    ground_pairs: int  # of a convex shape and a height field or mesh
    grid_buckets: int  # 0: pairs come from the list
    given_count: int
    pair_rule: int  # PairRule
    friction_rule: int  # FrictionRule

    link_body: wp.array[int]  # -1: shaft
    link_parent: wp.array[int]  # -1: world
    link_joint: wp.array[int]  # -1: floating without a named joint
    link_type: wp.array[int]  # JointType
    link_sign: wp.array[float]  # -1: the joint is traversed from its child to its parent
    link_alone: wp.array[int]  # 1: no joint touches the body
    link_massless: wp.array[int]  # 1: a frame between joints
    link_sprung: wp.array[int]  # 1: rows carry the efforts of its joint, which is a ball
    link_elastic: wp.array[int]  # number of its elastic joint, -1: it has another
    link_tree_dof: wp.array[int]  # CSR
    tree_dof_to_dof: wp.array[int]  # -1: floating without a named joint
    tree_dof_link: wp.array[int]
    tree_dof_unit: wp.array[int]
    unit_entries: wp.array[int]  # most entries of a row of the cone problem that moves a unit and its like
    unit_newton: wp.array[int]  # 1: no row ties it and shapes of it may touch others
    body_link: wp.array[int]
    mesh_column_start: wp.array[int]  # CSR over columns of the meshes' matrix, of blocks below the diagonal
    mesh_block_row: wp.array[int]
    mesh_owner: wp.array[int]  # link of each body that a mesh is glued to
    face_start: wp.array[int]  # CSR over shapes: faces that come with the sphere of a node
    face: wp.array2d[int]  # (faces, 11): points of the corners, and what face_tables.py names
    face_point: wp.array2d[int]  # (points, 2): body (-1: world), and shape of the node's sphere (-1: none)
    face_place: wp.array[wp.vec3d]  # of points that no body is of their own: on their body [m]

    joint_type: wp.array[int]
    joint_body0: wp.array[int]
    joint_body1: wp.array[int]
    joint_dof: wp.array[int]  # CSR

    dof_joint: wp.array[int]
    dof_to_tree_dof: wp.array[int]  # -1: the joint closes a loop
    dof_kind: wp.array[int]  # RowKind
    dof_axis: wp.array[int]
    dof_drive: wp.array[int]  # DriveMode
    dof_coupled: wp.array[int]  # 1: a coupling divides its error by the step
    dof_sum: wp.array[int]  # of a combination: its place among couplings; -1: another coordinate
    dof_table: wp.array2d[int]  # (dofs, 4): spring, damper, motion table, tables of a damper map, -1: none
    table_start: wp.array[int]  # CSR
    table_x: wp.array[wp.float64]
    table_y: wp.array[wp.float64]

    loop_joint: wp.array[int]
    loop_row: wp.array2d[int]  # (loop joints, 3): first row, first of those of a rotation's efforts, end
    row_kind: wp.array[int]  # of rows of loop joints, as the next three
    row_axis0: wp.array[int]
    row_axis1: wp.array[int]
    row_dof: wp.array[int]  # -1: rigid; else the row carries that degree of freedom's law or prescribed motion
    row_group: wp.array[int]
    coupling_dof: wp.array2d[int]  # (couplings and combinations, terms), -1: none
    coupling_law: wp.array[int]  # the combination whose law it has; -1: a coupling
    coupling_row: wp.array[int]  # response of each
    coupling_wrench: wp.array2d[
        int
    ]  # (couplings, terms): where j0, j1 hold a RELATIVE_ROTATION term's wrenches, -1: a tree degree of freedom
    row_path: wp.array[int]  # CSR over responses: tree degrees of freedom that a row can move
    path_tree_dof: wp.array[int]
    path_column: wp.array[int]  # the same, counted among those of the row's group: places in `Work.y`
    group_row: wp.array[int]  # CSR over groups
    group_factor: wp.array[int]  # CSR over groups: places in `Work.n`
    group_columns: wp.array[int]  # tree degrees of freedom of each group
    link_group: wp.array[int]  # -1: no row reaches the link
    link_column: wp.array[int]  # a tree degree of freedom of the link, less this, is its column

    distance_dof: wp.array2d[
        int
    ]  # (lines, 2): coordinate of a distance, and the tree degree of freedom that it acts on
    loop_dof: wp.array[int]  # coordinates of loop joints without a law: `joint_force` acts on them as it is
    box_dof: wp.array[int]
    box_kind: wp.array[int]  # BoxKind

    shape_body: wp.array[int]  # -1: world
    shape_type: wp.array[int]  # ShapeType
    shape_group: wp.array[int]
    shape_mask: wp.array[int]
    pair_start: wp.array[int]  # CSR over shapes: those of higher index that it may touch
    pair_other: wp.array[int]
    excluded_start: wp.array[int]  # CSR over the world, then bodies: bodies of higher index that it never touches
    excluded_body: wp.array[int]
    apart_start: wp.array[int]  # CSR over shapes: shapes of higher index that it never touches
    apart_shape: wp.array[int]
    given_start: wp.array[int]  # CSR over shapes: shapes of higher index that it may touch whatever else says
    given_shape: wp.array[int]
    given_surface: wp.array2d[float]  # (given pairs, 7): entries of `ContactParameters`, -1 first: made of the shapes'
    shape_priority: wp.array[int]


@wp.func
def given_pair(shape0: int, shape1: int, topology: Topology) -> int:
    """Index of a pair of shapes (the smaller index first) among those that were given, -1: it is none of them."""
    for index in range(topology.given_start[shape0], topology.given_start[shape0 + 1]):
        if topology.given_shape[index] == shape1:
            return index
    return -1


@wp.struct
class StepConfig:
    """Numbers of one step."""

    dt: float
    numerical_damping: float  # zeta of the rule for springs and dampers (efforts.py)
    spring_average: float  # beta of that rule
    flexible_damping: float  # zeta of elastic joints
    flexible_average: float  # beta of elastic joints
    max_depenetration_velocity: float  # m/s
    max_depenetration_rate: float  # rad/s
    curvature_share: float  # of a step's own error of the joints, that is removed beforehand
    pivot_tolerance: float
    projection_iterations: int
    refinement: int
    max_iterations: int
    tolerance: float
    row_tolerance: float
    reactions: int
    accelerations: int
    gyroscopic: int
    solver: int  # ConeSolver
    friction_law: int  # FrictionLaw
    contact_model: int  # ContactModel
    restitution_threshold: float  # m/s: slower impacts do not bounce
    contact_margin: float  # m: contacts nearer than this always take part
    dense_rows: int  # most rows of a dense Schur complement


@wp.struct
class StepProgress:
    """(W,) numbers that one stage of a step passes to the next."""

    limits: wp.array[int]  # blocks on coordinates, in front until islands are formed
    blocks: wp.array[int]  # all of the cone problem
    islands: wp.array[int]  # of it; 0: one that moves everything
    recovers: wp.array[int]  # 1: overlaps and passed limits recover by moving alone
    row_residual: wp.array[float]  # of the bilateral rows [m/s or rad/s]
    position_error: wp.array[float]  # of the joints [m or rad]


def progress_layouts(worlds: int) -> dict[str, ArrayLayout]:
    """Return the arrays of a `StepProgress`."""
    return {name: ArrayLayout((worlds,), member.type.dtype) for name, member in StepProgress.vars.items()}


def make_progress(device: wp.Device, worlds: int) -> Any:
    """Allocate a `StepProgress`, zero."""
    progress = StepProgress()
    for name, layout in progress_layouts(worlds).items():
        setattr(progress, name, wp.zeros(layout.shape, dtype=layout.dtype, device=device))
    return progress


class WorkScratch(ScratchGroup):
    """Scratch of a step of one world. `ang`, `lin` are about a link's centre of mass, world axes."""

    x = scratch_array(wp.vec3d, "links")  # per body
    quat = scratch_array(wp.quatd, "links")
    rot = scratch_array(wp.mat33d, "links")

    inertia = scratch_array(
        wp.mat33, "links"
    )  # per link: articulated inertia [[inertia, coupling], [coupling^T, mass]]
    coupling = scratch_array(wp.mat33, "links")
    mass = scratch_array(wp.mat33, "links")
    shift = scratch_array(wp.vec3, "links")  # parent's centre to child's, through the joint
    stabilisation_ang = scratch_array(wp.vec3, "links")
    stabilisation_lin = scratch_array(wp.vec3, "links")
    p_ang = scratch_array(wp.vec3, "links")
    p_lin = scratch_array(wp.vec3, "links")
    v_ang = scratch_array(wp.vec3, "links")  # change of velocity in this step
    v_lin = scratch_array(wp.vec3, "links")
    o_ang = scratch_array(wp.vec3, "links")  # velocity at its start
    o_lin = scratch_array(wp.vec3, "links")
    l_ang = scratch_array(wp.vec3, "links")  # accumulated rounding error of it
    l_lin = scratch_array(wp.vec3, "links")
    t_ang = scratch_array(wp.vec3, "links")  # their sum
    t_lin = scratch_array(wp.vec3, "links")

    f_ang = scratch_array(wp.vec3, "links")  # impulse balance of the reactions
    f_lin = scratch_array(wp.vec3, "links")

    s_ang = scratch_array(wp.vec3, "tree_dofs")  # per tree degree of freedom
    s_lin = scratch_array(wp.vec3, "tree_dofs")
    u_ang = scratch_array(wp.vec3, "tree_dofs")
    u_lin = scratch_array(wp.vec3, "tree_dofs")
    inv_sqrt_d = scratch_array(wp.float32, "tree_dofs")
    gain = scratch_array(wp.float32, "tree_dofs")
    effort = scratch_array(wp.float32, "tree_dofs")
    rate = scratch_array(wp.float32, "tree_dofs")  # prescribed
    start = scratch_array(wp.float32, "tree_dofs")  # `ImplicitEffort.start`
    xi = scratch_array(wp.float32, "tree_dofs")
    qd = scratch_array(wp.float32, "tree_dofs")
    change = scratch_array(wp.float32, "tree_dofs")  # of the rate in this step, not rounded to the rate's digits
    k_qd = scratch_array(wp.float32, "tree_dofs")  # kept while a correction is computed
    k_effort = scratch_array(wp.float32, "tree_dofs")

    # two arrays for all: each one more costs every model's step a percent of its compilation
    elastic_matrices = scratch_array(wp.mat33, "elastic_matrices")  # of each elastic joint (elastic_links.py)
    elastic_vectors = scratch_array(wp.vec3, "elastic_vectors")

    mesh_factor = scratch_array(wp.float32, "mesh_factor")  # of the meshes' matrix (block_factor.py)
    mesh_vector = scratch_array(wp.float32, "mesh_vector")
    mesh_factor_double = scratch_array(wp.float64, "mesh_factor_double")
    mesh_vector_double = scratch_array(wp.float64, "mesh_vector_double")
    mesh_waiting = scratch_array(wp.mat33, "mesh_columns")  # forces of rows on columns further up; zero between rows

    j0_ang = scratch_array(wp.vec3, "wrench_rows")  # per row, then per relative rotation of a coupling
    j0_lin = scratch_array(wp.vec3, "wrench_rows")
    j1_ang = scratch_array(wp.vec3, "wrench_rows")
    j1_lin = scratch_array(wp.vec3, "wrench_rows")
    row_b = scratch_array(wp.float32, "padded_rows")
    row_compliance = scratch_array(wp.float32, "padded_rows")
    curvature_term = scratch_array(wp.float32, "rows")  # half a step times its curvature along the start's velocities
    row_impulse = scratch_array(wp.float32, "padded_rows")
    row_r = scratch_array(wp.float32, "padded_rows")
    row_t = scratch_array(wp.float32, "padded_rows")
    row_scale = scratch_array(wp.float32, "padded_rows")
    y = scratch_array(wp.float32, "responses", "columns")  # row by row, columns of the row's group
    y_t = scratch_array(wp.float32, "response_room")  # of one group, column by column; zero where a row does not reach
    n = scratch_array(wp.float32, "factor_room")  # group by group, each (rows, padded rows)
    inv_pivot = scratch_array(wp.float32, "padded_rows")
    group_due = scratch_array(wp.int32, "groups")  # 1: impulses act on the group, which its rows have to answer

    active = scratch_array(wp.int32, "blocks")  # box constraint, or the number of box constraints plus the contact
    b_sign = scratch_array(wp.float32, "blocks")
    recovery = scratch_array(wp.float32, "blocks")  # speed of a row's recovery; 0: it only holds, -1: it takes no part
    recovery_xi = scratch_array(wp.float32, "tree_dofs")  # the recovery's motion, as `xi`
    recovery_share = scratch_array(wp.float32, "units")  # of it that a unit makes


Work = WorkScratch.struct("Work", __name__)
