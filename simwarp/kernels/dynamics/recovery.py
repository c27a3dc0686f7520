"""Recovery from states that no motion leads to: shapes that overlap as built, coordinates outside their limits.

A row that asks the step for a velocity out of the overlap keeps that velocity. Where the point of contact has a short
lever to its joint, or where rows contradict each other, the velocity of the bodies then has no bound: 0.6 m/s at 1 mm
from a hinge are 600 rad/s. So the step only holds such rows (they must not be passed further), and a motion of its own,
which enters the poses and no velocity, takes the overlap away: no coordinate moves faster than the depenetration
velocity, whatever the rows ask for (docs/theory.md).
"""

import warp as wp

from simwarp.kernels.cones.problem import ConeProblem
from simwarp.kernels.core.fields import ContactArrays, Parameters, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import turned
from simwarp.kernels.dynamics.dense_rows import solve_group_backward
from simwarp.kernels.dynamics.joints import FREE, POINT_AXIS0, SHAFT
from simwarp.kernels.dynamics.tree import forward_pass
from simwarp.kernels.meshes.mesh_links import NODE

wp.set_module_options({"enable_backward": False})

LEAST_SHARE = wp.constant(0.02)
"""Of the depenetration velocity: what asks for less is no overlap but the error of a step, and stays in its rows."""
SOFTNESS = wp.constant(0.1)
"""Of a row's diagonal, added to it: rows that contradict each other share the motion, and sweeps come to an end."""
SWEEPS = wp.constant(30)
"""Of projected Gauss-Seidel; what they leave is left to the next steps."""


@wp.func
def recovery_speed(dt: float, gap: float, fastest: float) -> float:
    """Speed at which a row leaves its overlap [m/s or rad/s]; 0 where the step's own rows can take it away."""
    if gap >= -LEAST_SHARE * fastest * dt:
        return 0.0
    return wp.min(-gap / dt, fastest)


@wp.func
def needs_recovery(blocks: int, work: Work) -> bool:
    """True if a row of this step has to recover."""
    wanted = bool(False)
    for block in range(blocks):
        wanted = wanted or work.recovery[block] > 0.0
    return wanted


@wp.func
def mobility_apart(
    world: int, block: int, topology: Topology, parameters: Parameters, contacts: ContactArrays, work: Work
) -> float:
    """Of a contact's two bodies as points without joints [1/kg]; 0: a limit."""
    contact = work.active[block] - topology.box_count
    mobility = float(0.0)
    if contact >= 0:
        w = world_row(world, parameters.body_mass.shape[0])
        body0 = topology.shape_body[contacts.contact_shape0[world, contact]]
        body1 = topology.shape_body[contacts.contact_shape1[world, contact]]
        if body0 >= 0:
            mobility += 1.0 / parameters.body_mass[w, body0]
        if body1 >= 0:
            mobility += 1.0 / parameters.body_mass[w, body1]
    return mobility


@wp.func
def recover_row(block: int, row: int, asked: float, work: Work, cone: ConeProblem):
    """One step of projected Gauss-Seidel on a row: `scale` has its impulse, `loop_sum` the share of the loops."""
    entries = cone.block_entries[block]
    first = cone.block_loops[block, 0]
    near = cone.block_loops[block, 1]
    other = cone.block_loops[block, 2]
    far = cone.block_loops[block, 3]
    speed = float(0.0)
    size = float(0.0)
    for e in range(entries):
        value = cone.y[row, e]
        speed += value * work.recovery_xi[cone.block_tree_dof[block, e]]
        size += value * value
    for k in range(near):
        speed -= cone.w[row, k] * cone.loop_sum[first + k]
    for k in range(far):
        speed -= cone.w[row, near + k] * cone.loop_sum[other + k]
    before = cone.scale[row]
    soft = SOFTNESS * size
    # a row that is alone reaches what is asked for
    wanted = asked * (1.0 + soft / cone.diagonal[row])
    impulse = wp.max(before + (wanted - speed - soft * before) / (cone.diagonal[row] + soft), 0.0)
    change = impulse - before
    if change != 0.0:
        cone.scale[row] = impulse
        for e in range(entries):
            tree_dof = cone.block_tree_dof[block, e]
            work.recovery_xi[tree_dof] = work.recovery_xi[tree_dof] + cone.y[row, e] * change
        for k in range(near):
            cone.loop_sum[first + k] = cone.loop_sum[first + k] + cone.w[row, k] * change
        for k in range(far):
            cone.loop_sum[other + k] = cone.loop_sum[other + k] + cone.w[row, near + k] * change


@wp.func
def respond_with_loops(topology: Topology, work: Work, cone: ConeProblem):
    """The loop rows' answer to the recovery, so that it keeps closed loops closed."""
    for row in range(topology.row_count):
        work.row_r[row] = cone.loop_sum[row]
    for group in range(topology.group_count):
        solve_group_backward(group, topology, work)
        for row in range(topology.group_row[group], topology.group_row[group + 1]):
            for index in range(topology.row_path[row], topology.row_path[row + 1]):
                tree_dof = topology.path_tree_dof[index]
                answer = work.y[row, topology.path_column[index]] * work.row_r[row]
                work.recovery_xi[tree_dof] = work.recovery_xi[tree_dof] - answer


@wp.func
def find_recovery(
    world: int, blocks: int, topology: Topology, parameters: Parameters, contacts: ContactArrays, work: Work,
    cone: ConeProblem,
) -> int:  # fmt: skip
    """recovery_xi <- the motion that takes overlaps and passed limits away, without passing the others; 1 if it is
    finite.

    From rest and without loads: least impulses on the rows of the step, those of the contacts along their normals.
    """
    for tree_dof in range(topology.tree_dof_count):
        work.recovery_xi[tree_dof] = 0.0
    for row in range(topology.row_count):
        cone.loop_sum[row] = 0.0
    for block in range(blocks):
        row = cone.block_row[block]
        cone.scale[row] = 0.0
        # beside a joint the bodies would move faster than the point of contact: no more energy than without joints
        if work.recovery[block] > 0.0:
            mobility = mobility_apart(world, block, topology, parameters, contacts, work)
            if mobility > cone.diagonal[row]:
                work.recovery[block] = work.recovery[block] * wp.sqrt(cone.diagonal[row] / mobility)
    for _ in range(SWEEPS):
        for block in range(blocks):
            if work.recovery[block] >= 0.0:
                recover_row(block, cone.block_row[block], work.recovery[block], work, cone)
    if topology.row_count > 0:
        respond_with_loops(topology, work, cone)
    total = float(0.0)
    for tree_dof in range(topology.tree_dof_count):
        total += wp.abs(work.recovery_xi[tree_dof])
    return wp.where(wp.isfinite(total), 1, 0)


@wp.func
def limit_shares(topology: Topology, config: StepConfig, work: Work):
    """recovery_share <- for each unit, what of the recovery keeps all its coordinates below the depenetration
    velocity.
    """
    for unit in range(topology.unit_count):
        work.recovery_share[unit] = 1.0
    for tree_dof in range(topology.tree_dof_count):
        link = topology.tree_dof_link[tree_dof]
        speed = wp.abs(work.qd[tree_dof])
        fastest = config.max_depenetration_rate
        if topology.link_type[link] == FREE:
            speed = wp.length(work.v_ang[link])
            if tree_dof - topology.link_tree_dof[link] < 3:
                speed = wp.length(work.v_lin[link])
                fastest = config.max_depenetration_velocity
        elif topology.link_type[link] == NODE:
            speed = wp.length(work.v_lin[link])
            fastest = config.max_depenetration_velocity
        elif topology.dof_kind[topology.tree_dof_to_dof[tree_dof]] == POINT_AXIS0:
            fastest = config.max_depenetration_velocity
        unit = topology.tree_dof_unit[tree_dof]
        if speed > fastest and unit >= 0:
            work.recovery_share[unit] = wp.min(work.recovery_share[unit], fastest / speed)


@wp.func
def make_recovery(world: int, topology: Topology, config: StepConfig, state: StateArrays, work: Work):
    """Moves the poses in `work` by the recovery. Velocities and efforts in `work` are used up."""
    for link in range(topology.link_count):
        work.stabilisation_ang[link] = wp.vec3()
        work.stabilisation_lin[link] = wp.vec3()
    for tree_dof in range(topology.tree_dof_count):
        work.rate[tree_dof] = 0.0
        work.xi[tree_dof] = work.recovery_xi[tree_dof]
    # once for the speeds, and once for what is made of them
    for again in range(2):
        if again == 1:
            limit_shares(topology, config, work)
            for tree_dof in range(topology.tree_dof_count):
                unit = topology.tree_dof_unit[tree_dof]
                if unit >= 0:
                    work.xi[tree_dof] = work.xi[tree_dof] * work.recovery_share[unit]
        forward_pass(topology, work)
    h = wp.float64(config.dt)
    for link in range(topology.link_count):
        body = topology.link_body[link]
        v = work.v_lin[link]
        omega = work.v_ang[link]
        if topology.link_type[link] == SHAFT:
            tree_dof = topology.link_tree_dof[link]
            dof = topology.tree_dof_to_dof[tree_dof]
            state.joint_x[world, dof] = state.joint_x[world, dof] + h * wp.float64(work.qd[tree_dof])
        elif body >= 0 and wp.length_sq(v) + wp.length_sq(omega) > 0.0:
            work.x[body] = work.x[body] + wp.vec3d(h * wp.float64(v[0]), h * wp.float64(v[1]), h * wp.float64(v[2]))
            work.quat[body] = turned(work.quat[body], omega * config.dt)
            work.rot[body] = wp.quat_to_matrix(work.quat[body])
