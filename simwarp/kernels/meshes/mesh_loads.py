"""Meshes in a step of a world: elements' loads, their matrix and its factor.

Lanes of a GPU share a world. Each function ends where all lanes have written.
"""

import warp as wp

from simwarp.kernels.core.lanes import lane_of, meet, stride_of, sum_over_lanes
from simwarp.kernels.core.scratch import ScratchGroup, scratch_array
from simwarp.kernels.core.tables import StepConfig, Topology, Work
from simwarp.kernels.core.vector_math import to_float
from simwarp.kernels.meshes.block_factor import (
    BlockTables,
    assemble,
    assemble_double,
    factor,
    factor_double,
)
from simwarp.kernels.meshes.flexible_laws import FlexibleMaterials, FlexibleStep
from simwarp.kernels.meshes.mesh_links import has_mesh_code
from simwarp.kernels.meshes.solid_loads import SolidTables, load_solid
from simwarp.kernels.meshes.triangle_loads import TriangleTables, load_triangle

wp.set_module_options({"enable_backward": False, "max_unroll": 0})

LEAST_PIVOT = wp.constant(1.0e-6)
"""Part of its diagonal that a pivot keeps in single precision."""
LEAST_PIVOT_DOUBLE = wp.constant(1.0e-13)


class MeshLoadScratch(ScratchGroup, packed=False, prefix="mesh_"):
    """Arrays of a world's meshes in a step of a model; their factor is in `Work`."""

    shares = scratch_array(wp.vec3, "mesh_shares")
    element_blocks = scratch_array(wp.mat33, "mesh_element_blocks")
    masses = scratch_array(wp.float32, "mesh_columns")
    node_x = scratch_array(wp.vec3d, "mesh_points")  # world [m]
    node_v = scratch_array(wp.vec3, "mesh_points")  # at the start [m/s]


MeshLoads = MeshLoadScratch.struct("MeshLoads", __name__)


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
    world: int, m: MeshTables, step: FlexibleStep, x: wp.array[wp.vec3d], v: wp.array[wp.vec3],
    shares: wp.array[wp.vec3], blocks: wp.array[wp.mat33], lanes: int,
) -> int:  # fmt: skip
    """Finds all elements' impulses [N·s] and blocks [kg]; returns how many solid ones are turned inside out."""
    inverted = int(0)
    stride = stride_of(lanes)
    for element in range(lane_of(lanes), m.tetrahedra.node.shape[0], stride):
        inverted += load_solid(element, world, m.tetrahedra, m.materials, step, x, v, shares, blocks)
    for element in range(lane_of(lanes), m.hexahedra.node.shape[0], stride):
        inverted += load_solid(element, world, m.hexahedra, m.materials, step, x, v, shares, blocks)
    for element in range(lane_of(lanes), m.triangles.node.shape[0], stride):
        load_triangle(element, world, m.triangles, m.materials, step, x, v, shares, blocks)
    meet(lanes)
    return int(sum_over_lanes(lanes, float(inverted)))


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
    load_meshes(world, flexible, step, loads.node_x, loads.node_v, loads.shares, loads.element_blocks, LANES)
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
