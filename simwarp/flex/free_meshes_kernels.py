"""A step of meshes by themselves, without contacts and other bodies; one world, which lanes of a GPU share."""

import warp as wp

from simwarp.kernels.core.lanes import lane_of, meet, stride_of
from simwarp.kernels.core.vector_math import to_double
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.kernels.meshes.flexible_laws import FlexibleStep
from simwarp.kernels.meshes.mesh_loads import (
    MeshMemory,
    MeshTables,
    MeshWork,
    factor_meshes,
    gather_impulses,
    load_meshes,
    mesh_work,
    solve_meshes,
)

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


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
    turned = load_meshes(world, m, step, x[world], v[world], work, lanes)
    gather_impulses(world, m, step, force[world], work, lanes)
    pivots = factor_meshes(m, work, lanes)
    solve_meshes(m, work, lanes)
    move_nodes(m, step, x[world], v[world], work, lanes)
    if lane_of(lanes) == 0:
        inverted[world] = turned
        raised[world] = pivots
