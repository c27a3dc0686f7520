"""A step of meshes: elements' loads, the matrix and its factor, the change of velocity, the positions; one world.

Lanes of a GPU share a world. Each function ends where all lanes have written.
"""

import warp as wp

from simwarp.kernels.core.lanes import lane_of, meet, stride_of, sum_over_lanes
from simwarp.kernels.core.scratch import ScratchGroup, memory_struct, scratch_array, slot_function
from simwarp.kernels.core.tables import StepConfig, Topology, Work, world_row
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.meshes.block_factor import (
    BlockTables,
    assemble,
    assemble_double,
    factor,
    factor_double,
    substitute_backward,
    substitute_backward_double,
    substitute_forward,
    substitute_forward_double,
)
from simwarp.kernels.meshes.flexible_laws import FlexibleMaterials, FlexibleStep
from simwarp.kernels.meshes.mesh_links import has_mesh_code
from simwarp.kernels.meshes.solid_loads import SolidTables, load_solid
from simwarp.kernels.meshes.triangle_loads import TriangleTables, load_triangle

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

LEAST_PIVOT = wp.constant(1.0e-6)
"""Part of its diagonal that a pivot keeps in single precision."""
LEAST_PIVOT_DOUBLE = wp.constant(1.0e-13)


class MeshScratch(ScratchGroup, packed=False):
    """Arrays of a world's meshes in a step; lengths are those of `MeshSizes`."""

    shares = scratch_array(wp.vec3, "shares")  # impulses of elements on their nodes [N·s]
    element_blocks = scratch_array(wp.mat33, "element_blocks")  # [kg]
    masses = scratch_array(wp.float32, "columns")  # in the order of elimination [kg]
    factor = scratch_array(wp.float32, "factor")
    vector = scratch_array(wp.float32, "vector")  # impulses, then changes of velocity, in the order of elimination
    factor_double = scratch_array(wp.float64, "factor_double")
    vector_double = scratch_array(wp.float64, "vector_double")


class MeshLoadScratch(ScratchGroup, packed=False, prefix="mesh_"):
    """Arrays of a world's meshes in a step of a model; their factor is in `Work`."""

    shares = scratch_array(wp.vec3, "mesh_shares")
    element_blocks = scratch_array(wp.mat33, "mesh_element_blocks")
    masses = scratch_array(wp.float32, "mesh_columns")
    node_x = scratch_array(wp.vec3d, "mesh_points")  # world [m]
    node_v = scratch_array(wp.vec3, "mesh_points")  # at the start [m/s]


MeshLoads = MeshLoadScratch.struct("MeshLoads", __name__)

MeshWork = MeshScratch.struct("MeshWork", __name__)
MeshMemory = memory_struct("MeshMemory", __name__, [MeshScratch])
mesh_work = slot_function("mesh_work", __name__, MeshScratch, MeshWork, MeshMemory)


@wp.struct
class GlueTables:
    """What nodes of the meshes of a model hang on, and the blocks of the matrix that glued ones add: force on a body
    and torque about its centre, per velocity of a node or of the body.
    """

    body: wp.array[int]  # of each node: its own, or the one that it is glued to; -1: it is fixed in the world
    is_glued: wp.array[int]
    place: wp.array[wp.vec3d]  # of glued nodes in the frame of their body, of fixed ones in the world [m]
    first_block: int  # place of the first of these blocks among all elements'
    source_start: wp.array[int]  # CSR over them: they are sums of elements' blocks
    source: wp.array[int]  # place of a block times 2, and 1 where it is transposed
    left: wp.array[int]  # node whose lever makes a torque of the force; -1: none
    right: wp.array[int]  # node whose lever makes a velocity of the angular velocity; -1: none
    share_start: wp.array[int]  # CSR over bodies that meshes are glued to
    share: wp.array[int]  # place among all elements' shares
    share_node: wp.array[int]


@wp.struct
class MeshTables:
    """All meshes of a model: their structure, elements and materials."""

    column_count: int  # nodes that move by themselves
    block_count: int
    is_double: int  # 1: the factor is in double precision
    structure: BlockTables
    tetrahedra: SolidTables
    hexahedra: SolidTables
    triangles: TriangleTables
    materials: FlexibleMaterials
    glue: GlueTables
    node_mass: wp.array2d[float]  # (1 or W, nodes) [kg]


@wp.func
def load_meshes(
    world: int, m: MeshTables, step: FlexibleStep, x: wp.array[wp.vec3d], v: wp.array[wp.vec3], work: MeshWork,
    lanes: int,
) -> int:  # fmt: skip
    """Finds all elements' impulses and blocks; returns how many solid ones are turned inside out."""
    inverted = int(0)
    stride = stride_of(lanes)
    for element in range(lane_of(lanes), m.tetrahedra.node.shape[0], stride):
        inverted += load_solid(
            element, world, m.tetrahedra, m.materials, step, x, v, work.shares, work.element_blocks
        )  # fmt: skip
    for element in range(lane_of(lanes), m.hexahedra.node.shape[0], stride):
        inverted += load_solid(
            element, world, m.hexahedra, m.materials, step, x, v, work.shares, work.element_blocks
        )  # fmt: skip
    for element in range(lane_of(lanes), m.triangles.node.shape[0], stride):
        load_triangle(element, world, m.triangles, m.materials, step, x, v, work.shares, work.element_blocks)
    meet(lanes)
    return int(sum_over_lanes(lanes, float(inverted)))


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


LANES = wp.constant(32)
"""Threads of a GPU that share the meshes of a world."""


@wp.func
def has_meshes(topology: Topology) -> bool:
    """Nodes of meshes."""
    return topology.mesh_nodes > 0


@wp.func
def place_nodes(g: GlueTables, topology: Topology, work: Work, loads: MeshLoads):
    """Positions and velocities of all nodes at the step's start."""
    for node in range(lane_of(LANES), g.body.shape[0], stride_of(LANES)):
        body = g.body[node]
        x = g.place[node]
        v = wp.vec3()
        if body >= 0:
            link = topology.body_link[body]
            v = work.o_lin[link] + work.l_lin[link]
            if g.is_glued[node] == 1:
                lever = work.rot[body] * x
                x = work.x[body] + lever
                v += wp.cross(work.o_ang[link] + work.l_ang[link], to_float(lever))
            else:
                x = work.x[body]
        loads.node_x[node] = x
        loads.node_v[node] = v
    meet(LANES)


@wp.func
def lever_of(node: int, g: GlueTables, work: Work) -> wp.vec3:
    """From the centre of the body that a node is glued to [m], world axes."""
    return to_float(work.rot[g.body[node]] * g.place[node])


@wp.func
def load_glue(g: GlueTables, work: Work, loads: MeshLoads):
    """Blocks of the matrix of the bodies that meshes are glued to."""
    for index in range(lane_of(LANES), g.source_start.shape[0] - 1, stride_of(LANES)):
        total = wp.mat33()
        for k in range(g.source_start[index], g.source_start[index + 1]):
            block = loads.element_blocks[g.source[k] // 2]
            if g.source[k] % 2 == 1:
                block = wp.transpose(block)
            if g.left[k] >= 0:
                block = wp.skew(lever_of(g.left[k], g, work)) * block
            if g.right[k] >= 0:
                block = block * wp.transpose(wp.skew(lever_of(g.right[k], g, work)))
            total += block
        loads.element_blocks[g.first_block + index] = total
    meet(LANES)


@wp.func
def push_nodes(m: MeshTables, topology: Topology, work: Work, loads: MeshLoads):
    """Adds elements' impulses to nodes and to the bodies that they are glued to; the masses of columns."""
    t = m.structure
    g = m.glue
    for column in range(lane_of(LANES), topology.mesh_columns, stride_of(LANES)):
        mass = float(0.0)
        if column < topology.mesh_nodes:
            link = topology.mesh_link0 + topology.mesh_nodes - 1 - column
            mass = work.mass[link][0, 0]
            total = wp.vec3()
            for k in range(t.share_start[column], t.share_start[column + 1]):
                total += loads.shares[t.share[k]]
            work.p_lin[link] = work.p_lin[link] + total
            parent = topology.link_parent[link]
            work.shift[link] = wp.vec3()
            if parent >= 0:
                work.shift[link] = to_float(work.x[topology.link_body[link]] - work.x[topology.link_body[parent]])
        loads.masses[column] = mass
    if lane_of(LANES) == 0:
        for pair in range(g.share_start.shape[0] - 1):
            owner = topology.mesh_owner[pair]
            for k in range(g.share_start[pair], g.share_start[pair + 1]):
                impulse = loads.shares[g.share[k]]
                work.p_lin[owner] = work.p_lin[owner] + impulse
                work.p_ang[owner] = work.p_ang[owner] + wp.cross(lever_of(g.share_node[k], g, work), impulse)
    meet(LANES)


@wp.func(inline=True)
def load_flexible_meshes(
    world: int, config: StepConfig, topology: Topology, flexible: MeshTables, work: Work, loads: MeshLoads
):
    """Impulses of all elements, and the factor of the meshes' matrix."""
    if not has_mesh_code():
        return
    step = FlexibleStep()
    step.h = config.dt
    step.numerical_damping = config.flexible_damping
    place_nodes(flexible.glue, topology, work, loads)
    elements = MeshWork()
    elements.shares = loads.shares
    elements.element_blocks = loads.element_blocks
    load_meshes(world, flexible, step, loads.node_x, loads.node_v, elements, LANES)
    load_glue(flexible.glue, work, loads)
    push_nodes(flexible, topology, work, loads)
    t = flexible.structure
    n = topology.mesh_columns
    if topology.mesh_double == 1:
        assemble_double(
            n, flexible.block_count, t.term_start, t.term, loads.element_blocks, loads.masses,
            work.mesh_factor_double, LANES,
        )  # fmt: skip
        factor_double(
            topology.mesh_nodes, n, t.column_start, t.target_start, t.target, LEAST_PIVOT_DOUBLE,
            work.mesh_factor_double, LANES,
        )  # fmt: skip
    else:
        assemble(
            n, flexible.block_count, t.term_start, t.term, loads.element_blocks, loads.masses, work.mesh_factor, LANES
        )  # fmt: skip
        factor(
            topology.mesh_nodes, n, t.column_start, t.target_start, t.target, LEAST_PIVOT, work.mesh_factor, LANES
        )  # fmt: skip
