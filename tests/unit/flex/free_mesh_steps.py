"""A step of meshes by themselves, without contacts and other bodies; one world, which lanes of a GPU share.

Each function ends where all lanes have written.
"""

import warp as wp

from simwarp.kernels.core.lanes import lane_of, meet, stride_of
from simwarp.kernels.core.scratch import ScratchGroup, memory_struct, scratch_array, slot_function
from simwarp.kernels.core.tables import world_row
from simwarp.kernels.core.vector_math import to_double
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.kernels.meshes.block_factor import (
    assemble,
    assemble_double,
    factor,
    factor_double,
    substitute_backward,
    substitute_backward_double,
    substitute_forward,
    substitute_forward_double,
)
from simwarp.kernels.meshes.flexible_laws import FlexibleStep
from simwarp.kernels.meshes.mesh_loads import LEAST_PIVOT, LEAST_PIVOT_DOUBLE, MeshTables, load_meshes

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


class MeshScratch(ScratchGroup, packed=False):
    """Arrays of a world's meshes in a step; lengths are those of `MeshSizes`."""

    shares = scratch_array(wp.vec3, "shares")  # impulses of elements on their nodes [N·s]
    element_blocks = scratch_array(wp.mat33, "element_blocks")  # [kg]
    masses = scratch_array(wp.float32, "columns")  # in the order of elimination [kg]
    factor = scratch_array(wp.float32, "factor")
    vector = scratch_array(wp.float32, "vector")  # impulses, then changes of velocity, in the order of elimination
    factor_double = scratch_array(wp.float64, "factor_double")
    vector_double = scratch_array(wp.float64, "vector_double")


MeshWork = MeshScratch.struct("MeshWork", __name__)
MeshMemory = memory_struct("MeshMemory", __name__, [MeshScratch])
mesh_work = slot_function("mesh_work", __name__, MeshScratch, MeshWork, MeshMemory)


@wp.func
def gather_impulses(
    world: int, m: MeshTables, step: FlexibleStep, force: wp.array[wp.vec3], work: MeshWork, lanes: int
):  # fmt: skip
    """Impulses of elements, gravity and forces on each node, and its mass, in the order of elimination."""
    masses = world_row(world, m.node_mass.shape[0])
    t = m.structure
    for column in range(lane_of(lanes), m.column_count, stride_of(lanes)):
        node = t.order[column]
        mass = m.node_mass[masses, node]
        total = step.h * (mass * step.gravity + force[node])
        for k in range(t.share_start[column], t.share_start[column + 1]):
            total += work.shares[t.share[k]]
        work.masses[column] = mass
        for axis in range(3):
            if m.is_double == 1:
                work.vector_double[4 * column + axis] = wp.float64(total[axis])
            else:
                work.vector[4 * column + axis] = total[axis]
        # The fourth number is only there for the width
        if m.is_double == 1:
            work.vector_double[4 * column + 3] = wp.float64(0.0)
        else:
            work.vector[4 * column + 3] = 0.0
    meet(lanes)


@wp.func
def factor_meshes(m: MeshTables, work: MeshWork, lanes: int) -> int:
    """The factor of M + h d + h² (β + ζ) K; returns how many pivots were raised."""
    t = m.structure
    n = m.column_count
    if m.is_double == 1:
        assemble_double(
            n, m.block_count, t.term_start, t.term, work.element_blocks, work.masses, work.factor_double, lanes
        )  # fmt: skip
        return factor_double(
            n, n, t.column_start, t.target_start, t.target, LEAST_PIVOT_DOUBLE, work.factor_double, lanes
        )  # fmt: skip
    assemble(n, m.block_count, t.term_start, t.term, work.element_blocks, work.masses, work.factor, lanes)
    return factor(n, n, t.column_start, t.target_start, t.target, LEAST_PIVOT, work.factor, lanes)


@wp.func
def solve_meshes(m: MeshTables, work: MeshWork, lanes: int):
    """Changes of velocity from impulses, in place."""
    t = m.structure
    n = m.column_count
    if m.is_double == 1:
        substitute_forward_double(n, n, t.column_start, t.block_row, work.factor_double, work.vector_double, lanes)
        substitute_backward_double(n, n, t.column_start, t.block_row, work.factor_double, work.vector_double, lanes)
    else:
        substitute_forward(n, n, t.column_start, t.block_row, work.factor, work.vector, lanes)
        substitute_backward(n, n, t.column_start, t.block_row, work.factor, work.vector, lanes)


@wp.func
def move_nodes(
    m: MeshTables, step: FlexibleStep, x: wp.array[wp.vec3d], v: wp.array[wp.vec3], work: MeshWork, lanes: int
):  # fmt: skip
    """Velocities with their change, and positions by the new ones."""
    for column in range(lane_of(lanes), m.column_count, stride_of(lanes)):
        node = m.structure.order[column]
        change = wp.vec3()
        for axis in range(3):
            if m.is_double == 1:
                change[axis] = float(work.vector_double[4 * column + axis])
            else:
                change[axis] = work.vector[4 * column + axis]
        v[node] = v[node] + change
        x[node] = x[node] + wp.float64(step.h) * to_double(v[node])
    meet(lanes)


@wp.kernel
def step_meshes(
    worlds: WorldRange, lanes: int, m: MeshTables, step: FlexibleStep, force: wp.array2d[wp.vec3],
    memory: MeshMemory, x: wp.array2d[wp.vec3d], v: wp.array2d[wp.vec3], inverted: wp.array[int],
    raised: wp.array[int],
):  # fmt: skip
    """One step of a world's meshes with nothing else."""
    thread = wp.tid()
    stride = stride_of(lanes)
    world = worlds.first + thread // stride
    work = mesh_work(memory, scratch_slot_of(world, worlds))
    turned = load_meshes(world, m, step, x[world], v[world], work.shares, work.element_blocks, lanes)
    gather_impulses(world, m, step, force[world], work, lanes)
    pivots = factor_meshes(m, work, lanes)
    solve_meshes(m, work, lanes)
    move_nodes(m, step, x[world], v[world], work, lanes)
    if lane_of(lanes) == 0:
        inverted[world] = turned
        raised[world] = pivots
