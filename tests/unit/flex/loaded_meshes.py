"""What the kernels find for a mesh, as dense or sparse NumPy arrays, put together from its elements alone."""

import numpy as np
import scipy.sparse
import warp as wp

from simwarp.kernels.core.scratch import make_memory, memory_layouts
from simwarp.kernels.meshes.flexible_laws import FlexibleStep
from simwarp.kernels.meshes.mesh_loads import MeshTables, load_meshes
from simwarp.meshes.block_structure import element_blocks
from simwarp.meshes.mesh_tables import ORDER
from tests.unit.flex.free_mesh_steps import MeshMemory, MeshScratch, mesh_work

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.kernel
def load(
    m: MeshTables, step: FlexibleStep, memory: MeshMemory, x: wp.array[wp.vec3d], v: wp.array[wp.vec3],
    inverted: wp.array(dtype=int),  # type: ignore[valid-type]
):  # fmt: skip
    work = mesh_work(memory, 0)
    inverted[0] = load_meshes(0, m, step, x, v, work.shares, work.element_blocks, 1)


def element_nodes(mesh):
    """Nodes of each element in the order of the kernels; -1: none."""
    found = []
    for kind in ORDER:
        nodes = getattr(mesh.tables, kind).node.numpy()
        slopes = mesh.tables.triangles.slope.numpy()
        if kind == "triangles":
            nodes[:, 3:][(slopes[:, :, 3] == 0.0).all(axis=2)] = -1
        found.extend(nodes.tolist())
    return found


def loads(mesh, x, v=None, *, h=1.0, zeta=0.0):
    """Forces (n, 3) [N], matrix (3n, 3n) sparse, M left out [kg], and how many elements are inside out."""
    memory = make_memory(MeshMemory, memory_layouts([MeshScratch], 1, mesh.sizes), "cpu")
    step = FlexibleStep()
    step.h, step.numerical_damping = h, zeta
    inverted = wp.zeros(1, dtype=int, device="cpu")
    velocity = np.zeros_like(x) if v is None else v
    wp.launch(
        load, 1, device="cpu",
        inputs=[
            mesh.tables, step, memory, wp.array(x, dtype=wp.vec3d, device="cpu"),
            wp.array(velocity, dtype=wp.vec3, device="cpu"), inverted,
        ],
    )  # fmt: skip
    shares = memory.shares.numpy()[0].astype(float) / h
    blocks = memory.element_blocks.numpy()[0].astype(float)
    forces = np.zeros(x.shape)
    rows, columns, values = [], [], []
    share = block = 0
    for nodes in element_nodes(mesh):
        for a, node in enumerate(nodes):
            if node >= 0:
                forces[node] += shares[share + a]
        share += len(nodes)
        for a, b in element_blocks(len(nodes)):
            if nodes[a] >= 0 and nodes[b] >= 0:
                for i, j in np.ndindex(3, 3):
                    rows.append(3 * nodes[a] + i)
                    columns.append(3 * nodes[b] + j)
                    values.append(blocks[block, i, j])
                    if a != b:
                        rows.append(3 * nodes[b] + j)
                        columns.append(3 * nodes[a] + i)
                        values.append(blocks[block, i, j])
            block += 1
    size = 3 * len(x)
    matrix = scipy.sparse.coo_matrix((values, (rows, columns)), shape=(size, size)).tocsc()
    return forces, matrix, int(inverted.numpy()[0])


def small_displacements(mesh, forces, held):
    """(n, 3) displacements of a mesh at rest under small forces (n, 3); `held` (n, 3) says what does not move."""
    _, matrix, _ = loads(mesh, mesh.points)
    free = np.flatnonzero(~np.asarray(held).reshape(-1))
    found = np.zeros(3 * len(mesh.points))
    stiffness = (matrix * 4.0)[free][:, free]  # with ζ = 0 the gain is h² / 4
    found[free] = scipy.sparse.linalg.spsolve(stiffness.tocsc(), np.asarray(forces).reshape(-1)[free])
    return found.reshape(-1, 3)
