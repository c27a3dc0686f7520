"""The one kernel that works on worlds: a step, an assembly, or a measurement, one thread per world.

Its scratch are local arrays of a few fixed sizes (`SizeClass`), packed under names as a `Work`: a new model of a size
that was seen before compiles nothing.
"""

import dataclasses
import functools
from enum import IntEnum

import warp as wp

from simwarp.kernels.assembly import assemble_world, measure_world
from simwarp.kernels.step import NON_FINITE, step_world
from simwarp.kernels.tables import ControlArrays, Parameters, Reports, StateArrays, StepConfig, Topology, Work

wp.set_module_options({"enable_backward": False})


class Operation(IntEnum):
    """What a launch does."""

    STEP = 0
    ASSEMBLE = 1
    MEASURE = 2


OP_STEP = wp.constant(int(Operation.STEP))
OP_ASSEMBLE = wp.constant(int(Operation.ASSEMBLE))


@dataclasses.dataclass(frozen=True, order=True)
class SizeClass:
    """Capacity of the local arrays of a world."""

    links: int
    slots: int
    rows: int
    bounded: int

    def holds(self, other: "SizeClass") -> bool:
        """Whether a world of size `other` fits."""
        return all(a >= b for a, b in zip(dataclasses.astuple(self), dataclasses.astuple(other), strict=True))


SIZE_CLASSES = (
    SizeClass(4, 10, 8, 8),
    SizeClass(12, 24, 12, 24),
    SizeClass(28, 56, 36, 24),
    SizeClass(64, 128, 72, 64),
    SizeClass(192, 384, 192, 96),
)


@wp.func
def pack(
    x: wp.array[wp.vec3d], quat: wp.array[wp.quatd], rot: wp.array[wp.mat33d],
    link_matrices: wp.array2d[wp.mat33], link_vectors: wp.array2d[wp.vec3], slot_vectors: wp.array2d[wp.vec3],
    slot_scalars: wp.array2d[float], row_vectors: wp.array2d[wp.vec3], row_scalars: wp.array2d[float],
    y: wp.array2d[float], n: wp.array2d[float], active: wp.array[int], bounded_scalars: wp.array2d[float],
    b_y: wp.array2d[float], b_w: wp.array2d[float], s: wp.array2d[float], solver: wp.array2d[float],
) -> Work:  # fmt: skip
    """Names for the rows of the local arrays."""
    work = Work()
    work.x = x
    work.quat = quat
    work.rot = rot
    work.inertia = link_matrices[0]
    work.coupling = link_matrices[1]
    work.mass = link_matrices[2]
    work.shift = link_vectors[0]
    work.drift_ang = link_vectors[1]
    work.drift_lin = link_vectors[2]
    work.p_ang = link_vectors[3]
    work.p_lin = link_vectors[4]
    work.v_ang = link_vectors[5]
    work.v_lin = link_vectors[6]
    work.k_ang = link_vectors[7]
    work.k_lin = link_vectors[8]
    work.f_ang = link_vectors[9]
    work.f_lin = link_vectors[10]
    work.s_ang = slot_vectors[0]
    work.s_lin = slot_vectors[1]
    work.u_ang = slot_vectors[2]
    work.u_lin = slot_vectors[3]
    work.inv_sqrt_d = slot_scalars[0]
    work.gain = slot_scalars[1]
    work.effort = slot_scalars[2]
    work.rate = slot_scalars[3]
    work.xi = slot_scalars[4]
    work.qd = slot_scalars[5]
    work.k_qd = slot_scalars[6]
    work.j0_ang = row_vectors[0]
    work.j0_lin = row_vectors[1]
    work.j1_ang = row_vectors[2]
    work.j1_lin = row_vectors[3]
    work.row_b = row_scalars[0]
    work.row_compliance = row_scalars[1]
    work.row_impulse = row_scalars[2]
    work.row_r = row_scalars[3]
    work.row_t = row_scalars[4]
    work.inv_pivot = row_scalars[5]
    work.row_scale = row_scalars[6]
    work.y = y
    work.n = n
    work.active = active
    work.b_sign = bounded_scalars[0]
    work.b_lower = bounded_scalars[1]
    work.b_upper = bounded_scalars[2]
    work.b_r = bounded_scalars[3]
    work.b_scale = bounded_scalars[4]
    work.gamma = bounded_scalars[5]
    work.b_y = b_y
    work.b_w = b_w
    work.s = s
    work.solver = solver
    return work


def _make_kernel(size: SizeClass) -> wp.Kernel:
    links = wp.constant(size.links)
    slots = wp.constant(size.slots)
    rows = wp.constant(size.rows)
    bounded = wp.constant(size.bounded)

    @wp.kernel(enable_backward=False, module="unique", module_options={"max_unroll": 0, "enable_backward": False})
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
        # in and out
        state: StateArrays,
        # outputs
        reports: Reports,
    ):
        world = wp.tid()
        if operation == OP_STEP:
            if (state.world_status[world] & NON_FINITE) != 0:
                return
        elif not mask[world]:
            return
        x = wp.zeros(shape=links, dtype=wp.vec3d)
        quat = wp.zeros(shape=links, dtype=wp.quatd)
        rot = wp.zeros(shape=links, dtype=wp.mat33d)
        link_matrices = wp.zeros(shape=(3, links), dtype=wp.mat33)
        link_vectors = wp.zeros(shape=(11, links), dtype=wp.vec3)
        slot_vectors = wp.zeros(shape=(4, slots), dtype=wp.vec3)
        slot_scalars = wp.zeros(shape=(7, slots), dtype=float)
        row_vectors = wp.zeros(shape=(4, rows), dtype=wp.vec3)
        row_scalars = wp.zeros(shape=(7, rows), dtype=float)
        y = wp.zeros(shape=(rows, slots), dtype=float)
        n = wp.zeros(shape=(rows, rows), dtype=float)
        active = wp.zeros(shape=bounded, dtype=int)
        bounded_scalars = wp.zeros(shape=(6, bounded), dtype=float)
        b_y = wp.zeros(shape=(bounded, slots), dtype=float)
        b_w = wp.zeros(shape=(bounded, rows), dtype=float)
        s = wp.zeros(shape=(bounded, bounded), dtype=float)
        solver = wp.zeros(shape=(7, bounded), dtype=float)
        work = pack(
            x, quat, rot, link_matrices, link_vectors, slot_vectors, slot_scalars, row_vectors, row_scalars,
            y, n, active, bounded_scalars, b_y, b_w, s, solver,
        )  # fmt: skip
        if operation == OP_STEP:
            step_world(world, bounded, config, topology, parameters, control, state, reports, work)
        elif operation == OP_ASSEMBLE:
            assemble_world(world, config, topology, parameters, control, joint_q, joint_qd, state, work)
        else:
            measure_world(world, topology, parameters, state, work)

    return run_worlds


@functools.cache
def world_kernel(size: SizeClass) -> wp.Kernel:
    """The kernel of a size class; compiled once, then from Warp's cache."""
    return _make_kernel(size)


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
    for dof in range(source.joint_x.shape[1]):
        target.joint_x[world, dof] = source.joint_x[world, dof]
        target.joint_q[world, dof] = source.joint_q[world, dof]
        target.joint_qd[world, dof] = source.joint_qd[world, dof]
    for row in range(source.bounded_impulse.shape[1]):
        target.bounded_impulse[world, row] = source.bounded_impulse[world, row]
    target.world_time[world] = source.world_time[world]
    target.world_status[world] = source.world_status[world]


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """Kernels that continuous integration compiles for CUDA without a GPU."""
    return [world_kernel(SIZE_CLASSES[0]), copy_worlds]
