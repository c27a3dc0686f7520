"""The one kernel that works on worlds: a step, an assembly, or a measurement, one thread per world.

All sizes are data, so one compiled kernel serves every model. Intermediate values live in a scratch of few lanes,
packed under names as a `Work`: a world writes everything that it reads there, so that lanes can be reused.
"""

import dataclasses
import functools
from enum import IntEnum

import warp as wp

from simwarp.core.types import ArrayLayout
from simwarp.kernels.cones.apgd import solve_apgd
from simwarp.kernels.cones.problem import SOLVER_VECTORS, WIDE_VECTORS, ConeConfig, ConeProblem, SolveReport
from simwarp.kernels.cones.solve import solve_with_fallback
from simwarp.kernels.core.fields import ContactArrays, ControlArrays, Parameters, Reports, StateArrays
from simwarp.kernels.core.tables import StepConfig, Topology, Work
from simwarp.kernels.dynamics.assembly import assemble_world, measure_world
from simwarp.kernels.dynamics.dense_rows import padded
from simwarp.kernels.dynamics.step import NON_FINITE, begin_step, cone_config, cone_problem, finish_step

# Warp's own flags, with fused multiply-adds (accuracy and speed) and without the superword pass, which slows this
# kernel of table loops down and takes seconds to compile.
CPU_FLAGS = (
    "-march=native -mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000"
    " -ffp-contract=fast -fno-slp-vectorize"
)

MODULE_OPTIONS = {"enable_backward": False, "max_unroll": 0, "cpu_compiler_flags": CPU_FLAGS}

wp.set_module_options(MODULE_OPTIONS)


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
    y_t: wp.array3d[float]
    n: wp.array3d[float]
    active: wp.array2d[int]
    b_sign: wp.array2d[float]

    block_ints: wp.array3d[int]
    block_scalars: wp.array3d[float]
    block_slot: wp.array3d[int]
    cone_scalars: wp.array3d[float]
    cone_y: wp.array3d[float]
    cone_w: wp.array3d[float]
    s: wp.array3d[float]
    factor: wp.array3d[float]
    slot_sum: wp.array2d[float]
    loop_sum: wp.array2d[float]
    vectors: wp.array3d[float]
    wide: wp.array3d[wp.float64]
    kept: wp.array2d[float]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sizes:
    """What a model needs room for, per world.

    `dense_rows` is the size of the largest dense Schur complement, `factor_rows` that of its factor. `kept_rows` are
    all cone rows where another solver may follow the first, whatever is dense: both solutions are compared.
    """

    links: int
    slots: int
    rows: int
    turns: int
    blocks: int
    cone_rows: int
    dense_rows: int
    factor_rows: int
    kept_rows: int
    entries: int


def scratch_layouts(lanes: int, sizes: Sizes) -> dict[str, ArrayLayout]:
    """The arrays of the scratch."""
    links, slots, rows = sizes.links, sizes.slots, sizes.rows
    shapes: dict[str, tuple[tuple[int, ...], type]] = {
        "x": ((links,), wp.vec3d),
        "quat": ((links,), wp.quatd),
        "rot": ((links,), wp.mat33d),
        "link_matrices": ((3, links), wp.mat33),
        "link_vectors": ((15, links), wp.vec3),
        "slot_vectors": ((4, slots), wp.vec3),
        "slot_scalars": ((8, slots), wp.float32),
        "row_vectors": ((4, rows + sizes.turns), wp.vec3),
        "row_scalars": ((7, padded(rows)), wp.float32),
        "y": ((rows, slots), wp.float32),
        "y_t": ((slots, padded(rows)), wp.float32),
        "n": ((rows, padded(rows)), wp.float32),
        "active": ((sizes.blocks,), wp.int32),
        "b_sign": ((sizes.blocks,), wp.float32),
        "block_ints": ((3, sizes.blocks + 1), wp.int32),
        "block_scalars": ((4, sizes.blocks), wp.float32),
        "block_slot": ((sizes.blocks, sizes.entries), wp.int32),
        "cone_scalars": ((7, sizes.cone_rows), wp.float32),
        "cone_y": ((sizes.cone_rows, sizes.entries), wp.float32),
        "cone_w": ((sizes.cone_rows, rows), wp.float32),
        "s": ((sizes.dense_rows, sizes.dense_rows), wp.float32),
        "factor": ((sizes.factor_rows, sizes.factor_rows), wp.float32),
        "slot_sum": ((slots,), wp.float32),
        "loop_sum": ((rows,), wp.float32),
        "vectors": ((SOLVER_VECTORS, sizes.cone_rows), wp.float32),
        "wide": ((WIDE_VECTORS, sizes.factor_rows), wp.float64),
        "kept": ((sizes.kept_rows,), wp.float32),
    }
    # kernels take views, which need an element per axis
    return {
        name: ArrayLayout((lanes, *(max(length, 1) for length in shape)), dtype)
        for name, (shape, dtype) in shapes.items()
    }


def make_scratch(device: wp.Device, lanes: int, sizes: Sizes) -> Scratch:
    """Allocates the scratch: on a CPU one lane, which stays in the cache, serves all worlds in turn."""
    scratch = Scratch()
    for name, layout in scratch_layouts(lanes, sizes).items():
        setattr(scratch, name, wp.zeros(layout.shape, dtype=layout.dtype, device=device))
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
    work.y_t = scratch.y_t[lane]
    work.n = scratch.n[lane]
    work.active = scratch.active[lane]
    work.b_sign = scratch.b_sign[lane]
    return work


@wp.func
def pack_cone(scratch: Scratch, lane: int) -> ConeProblem:
    """The cone problem of one lane of the scratch."""
    cone = ConeProblem()
    cone.block_row = scratch.block_ints[lane, 0]
    cone.block_kind = scratch.block_ints[lane, 1]
    cone.block_entries = scratch.block_ints[lane, 2]
    cone.friction = scratch.block_scalars[lane, 0]
    cone.rolling = scratch.block_scalars[lane, 1]
    cone.spinning = scratch.block_scalars[lane, 2]
    cone.cohesion = scratch.block_scalars[lane, 3]
    cone.lower = scratch.cone_scalars[lane, 0]
    cone.upper = scratch.cone_scalars[lane, 1]
    cone.r = scratch.cone_scalars[lane, 2]
    cone.diagonal = scratch.cone_scalars[lane, 3]
    cone.gamma = scratch.cone_scalars[lane, 4]
    cone.compliance = scratch.cone_scalars[lane, 5]
    cone.scale = scratch.cone_scalars[lane, 6]
    cone.s = scratch.s[lane]
    cone.y = scratch.cone_y[lane]
    cone.block_slot = scratch.block_slot[lane]
    cone.w = scratch.cone_w[lane]
    cone.slot_sum = scratch.slot_sum[lane]
    cone.loop_sum = scratch.loop_sum[lane]
    cone.vectors = scratch.vectors[lane]
    cone.factor = scratch.factor[lane]
    cone.wide = scratch.wide[lane]
    return cone


@wp.func
def solve_quickly(problem: ConeProblem, config: ConeConfig, kept: wp.array[float]) -> SolveReport:
    """Accelerated gradient descent alone."""
    return solve_apgd(problem, config)


@wp.func
def solve_or_fall_back(problem: ConeProblem, config: ConeConfig, kept: wp.array[float]) -> SolveReport:
    """The solver of the configuration, and the interior point for what it leaves above the tolerance."""
    return solve_with_fallback(problem, config, 1, kept)


@functools.cache
def run_worlds_kernel(all_solvers: bool) -> wp.Kernel:
    """The kernel, with accelerated gradient descent as its only solver, or with all of them (twice the code)."""
    solve = solve_or_fall_back if all_solvers else solve_quickly

    @wp.kernel(enable_backward=False, module="unique", module_options=MODULE_OPTIONS)
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
        contacts: ContactArrays,
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
        lane = world % scratch.x.shape[0]
        work = pack(scratch, lane)
        if operation == OP_STEP:
            cone = pack_cone(scratch, lane)
            progress = begin_step(world, config, topology, parameters, control, state, contacts, work, cone)
            solution = SolveReport()
            if progress.blocks > 0:
                problem = cone_problem(progress.blocks, topology, config, cone)
                solution = solve(problem, cone_config(config), scratch.kept[lane])
            finish_step(
                world, progress, solution, config, topology, parameters, control, state, contacts, reports, work, cone
            )
        elif operation == OP_ASSEMBLE:
            assemble_world(world, config, topology, parameters, control, joint_q, joint_qd, state, work)
        else:
            measure_world(world, topology, parameters, state, work)

    return run_worlds


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """The small one: minutes of compilation. The solvers that the other one adds are those of `cones.batch`."""
    return [run_worlds_kernel(False)]


@wp.kernel(enable_backward=False)
def copy_rows(
    # inputs
    mask: wp.array[wp.bool],
    source: wp.array2d[int],
    # outputs
    target: wp.array2d[int],
):
    """Masked reset of any array whose rows belong to worlds, seen as whole words."""
    world = wp.tid()
    if mask[world]:
        for word in range(source.shape[1]):
            target[world, word] = source[world, word]


@wp.kernel(enable_backward=False)
def flag_worlds(
    # inputs
    mask: wp.array[wp.bool],
    joint_q: wp.array2d[float],
    joint_qd: wp.array2d[float],
    # in and out
    world_status: wp.array[int],
):
    """Freezes the worlds of the mask that were given coordinates or rates which are not finite."""
    world = wp.tid()
    if not mask[world]:
        return
    for dof in range(joint_q.shape[1]):
        if not (wp.isfinite(joint_q[world, dof]) and wp.isfinite(joint_qd[world, dof])):
            world_status[world] = world_status[world] | NON_FINITE


@wp.kernel(enable_backward=False)
def copy_worlds(
    # inputs
    mask: wp.array[wp.bool],
    source: StateArrays,
    # outputs
    target: StateArrays,
    contacts: ContactArrays,
):
    """Masked reset: every array of the state, for the worlds in the mask, which forget their contacts."""
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
    contacts.contact_count[world] = 0
    contacts.contact_overflow[world] = 0
    contacts.penetration[world] = 0.0
    for shape in range(contacts.shape_contact_force.shape[1]):
        contacts.shape_contact_force[world, shape] = wp.vec3()
    for body in range(contacts.body_contact_force.shape[1]):
        contacts.body_contact_force[world, body] = wp.vec3()
    target.world_time[world] = source.world_time[world]
    target.world_status[world] = source.world_status[world]
