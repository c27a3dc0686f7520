"""The one kernel that works on worlds: a step, an assembly, or a measurement, one thread per world.

All sizes are data, so one compiled kernel serves every model. Intermediate values live in a scratch of few lanes,
packed under names as a `Work`: a world writes everything that it reads there, so that lanes can be reused.
"""

from enum import IntEnum

import warp as wp

from simwarp.kernels.assembly import assemble_world, measure_world
from simwarp.kernels.step import NON_FINITE, step_world
from simwarp.kernels.tables import ControlArrays, Parameters, Reports, StateArrays, StepConfig, Topology, Work

# Warp's own flags, with fused multiply-adds (accuracy and speed) and without the superword pass, which slows this
# kernel of table loops down and takes seconds to compile.
CPU_FLAGS = (
    "-march=native -mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000"
    " -ffp-contract=fast -fno-slp-vectorize"
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0, "cpu_compiler_flags": CPU_FLAGS})


class Operation(IntEnum):
    """What a launch does."""

    STEP = 0
    ASSEMBLE = 1
    MEASURE = 2


OP_STEP = wp.constant(int(Operation.STEP))
OP_ASSEMBLE = wp.constant(int(Operation.ASSEMBLE))


@wp.struct
class Scratch:
    """Room for the intermediate values of a few worlds ("lanes"): first axis the lane, last the element."""

    x: wp.array2d[wp.vec3d]
    quat: wp.array2d[wp.quatd]
    rot: wp.array2d[wp.mat33d]
    link_matrices: wp.array3d[wp.mat33]
    link_vectors: wp.array3d[wp.vec3]
    slot_vectors: wp.array3d[wp.vec3]
    slot_scalars: wp.array3d[float]
    row_vectors: wp.array3d[wp.vec3]
    row_scalars: wp.array3d[float]
    y: wp.array3d[float]
    n: wp.array3d[float]
    active: wp.array2d[int]
    bounded_scalars: wp.array3d[float]
    b_y: wp.array3d[float]
    b_w: wp.array3d[float]
    s: wp.array3d[float]
    solver: wp.array3d[float]


def make_scratch(device: wp.Device, lanes: int, links: int, slots: int, rows: int, bounded: int) -> Scratch:
    """Allocates the scratch: on a CPU one lane, which stays in the cache, serves all worlds in turn."""

    def zeros(*shape: int, dtype: type = float) -> wp.array:
        return wp.zeros((lanes, *(max(n, 1) for n in shape)), dtype=dtype, device=device)

    scratch = Scratch()
    scratch.x = zeros(links, dtype=wp.vec3d)
    scratch.quat = zeros(links, dtype=wp.quatd)
    scratch.rot = zeros(links, dtype=wp.mat33d)
    scratch.link_matrices = zeros(3, links, dtype=wp.mat33)
    scratch.link_vectors = zeros(15, links, dtype=wp.vec3)
    scratch.slot_vectors = zeros(4, slots, dtype=wp.vec3)
    scratch.slot_scalars = zeros(8, slots)
    scratch.row_vectors = zeros(4, rows, dtype=wp.vec3)
    scratch.row_scalars = zeros(7, rows)
    scratch.y = zeros(rows, slots)
    scratch.n = zeros(rows, rows)
    scratch.active = zeros(bounded, dtype=int)
    scratch.bounded_scalars = zeros(6, bounded)
    scratch.b_y = zeros(bounded, slots)
    scratch.b_w = zeros(bounded, rows)
    scratch.s = zeros(bounded, bounded)
    scratch.solver = zeros(7, bounded)
    return scratch


@wp.func
def pack(scratch: Scratch, lane: int) -> Work:
    """The named arrays of one lane of the scratch."""
    work = Work()
    work.x = scratch.x[lane]
    work.quat = scratch.quat[lane]
    work.rot = scratch.rot[lane]
    work.inertia = scratch.link_matrices[lane, 0]
    work.coupling = scratch.link_matrices[lane, 1]
    work.mass = scratch.link_matrices[lane, 2]
    work.shift = scratch.link_vectors[lane, 0]
    work.drift_ang = scratch.link_vectors[lane, 1]
    work.drift_lin = scratch.link_vectors[lane, 2]
    work.p_ang = scratch.link_vectors[lane, 3]
    work.p_lin = scratch.link_vectors[lane, 4]
    work.v_ang = scratch.link_vectors[lane, 5]
    work.v_lin = scratch.link_vectors[lane, 6]
    work.o_ang = scratch.link_vectors[lane, 7]
    work.o_lin = scratch.link_vectors[lane, 8]
    work.t_ang = scratch.link_vectors[lane, 9]
    work.t_lin = scratch.link_vectors[lane, 10]
    work.f_ang = scratch.link_vectors[lane, 11]
    work.f_lin = scratch.link_vectors[lane, 12]
    work.l_ang = scratch.link_vectors[lane, 13]
    work.l_lin = scratch.link_vectors[lane, 14]
    work.s_ang = scratch.slot_vectors[lane, 0]
    work.s_lin = scratch.slot_vectors[lane, 1]
    work.u_ang = scratch.slot_vectors[lane, 2]
    work.u_lin = scratch.slot_vectors[lane, 3]
    work.inv_sqrt_d = scratch.slot_scalars[lane, 0]
    work.gain = scratch.slot_scalars[lane, 1]
    work.effort = scratch.slot_scalars[lane, 2]
    work.rate = scratch.slot_scalars[lane, 3]
    work.xi = scratch.slot_scalars[lane, 4]
    work.qd = scratch.slot_scalars[lane, 5]
    work.k_qd = scratch.slot_scalars[lane, 6]
    work.k_effort = scratch.slot_scalars[lane, 7]
    work.j0_ang = scratch.row_vectors[lane, 0]
    work.j0_lin = scratch.row_vectors[lane, 1]
    work.j1_ang = scratch.row_vectors[lane, 2]
    work.j1_lin = scratch.row_vectors[lane, 3]
    work.row_b = scratch.row_scalars[lane, 0]
    work.row_compliance = scratch.row_scalars[lane, 1]
    work.row_impulse = scratch.row_scalars[lane, 2]
    work.row_r = scratch.row_scalars[lane, 3]
    work.row_t = scratch.row_scalars[lane, 4]
    work.inv_pivot = scratch.row_scalars[lane, 5]
    work.row_scale = scratch.row_scalars[lane, 6]
    work.y = scratch.y[lane]
    work.n = scratch.n[lane]
    work.active = scratch.active[lane]
    work.b_sign = scratch.bounded_scalars[lane, 0]
    work.b_lower = scratch.bounded_scalars[lane, 1]
    work.b_upper = scratch.bounded_scalars[lane, 2]
    work.b_r = scratch.bounded_scalars[lane, 3]
    work.b_scale = scratch.bounded_scalars[lane, 4]
    work.gamma = scratch.bounded_scalars[lane, 5]
    work.b_y = scratch.b_y[lane]
    work.b_w = scratch.b_w[lane]
    work.s = scratch.s[lane]
    work.solver = scratch.solver[lane]
    return work


@wp.kernel(enable_backward=False)
def run_worlds(
    # inputs
    operation: int,
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    control: ControlArrays,
    mask: wp.array[wp.bool],
    joint_q: wp.array2d[float],
    joint_qd: wp.array2d[float],
    scratch: Scratch,
    # in and out
    state: StateArrays,
    # outputs
    reports: Reports,
):
    """Steps, assembles or measures (`Operation`) the worlds: all that are not frozen, or those in the mask."""
    world = wp.tid()
    if operation == OP_STEP:
        if (state.world_status[world] & NON_FINITE) != 0:
            return
    elif not mask[world]:
        return
    work = pack(scratch, world % scratch.x.shape[0])
    if operation == OP_STEP:
        step_world(world, config, topology, parameters, control, state, reports, work)
    elif operation == OP_ASSEMBLE:
        assemble_world(world, config, topology, parameters, control, joint_q, joint_qd, state, work)
    else:
        measure_world(world, topology, parameters, state, work)


@wp.kernel(enable_backward=False)
def copy_worlds(
    # inputs
    mask: wp.array[wp.bool],
    source: StateArrays,
    # outputs
    target: StateArrays,
):
    """Masked reset: every array of the state, for the worlds in the mask."""
    world = wp.tid()
    if not mask[world]:
        return
    for body in range(source.body_x.shape[1]):
        target.body_x[world, body] = source.body_x[world, body]
        target.body_rot[world, body] = source.body_rot[world, body]
        target.body_q[world, body] = source.body_q[world, body]
        target.body_v[world, body] = source.body_v[world, body]
        target.body_omega[world, body] = source.body_omega[world, body]
        target.body_omega_last[world, body] = source.body_omega_last[world, body]
        target.body_v_low[world, body] = source.body_v_low[world, body]
        target.body_omega_low[world, body] = source.body_omega_low[world, body]
    for dof in range(source.joint_x.shape[1]):
        target.joint_x[world, dof] = source.joint_x[world, dof]
        target.joint_q[world, dof] = source.joint_q[world, dof]
        target.joint_qd[world, dof] = source.joint_qd[world, dof]
    for row in range(source.bounded_impulse.shape[1]):
        target.bounded_impulse[world, row] = source.bounded_impulse[world, row]
    target.world_time[world] = source.world_time[world]
    target.world_status[world] = source.world_status[world]
