"""Scratch of a step, and the kernels beside it that work on whole worlds: assembly, measurement, resets.

All sizes are data, so one compiled kernel serves every model. Intermediate values live in a scratch of few slots,
packed under names as a `Work`: a world writes everything that it reads there, so that slots can be reused.
"""

import dataclasses
from collections.abc import Set
from typing import Any

import warp as wp

from simwarp.core.types import ArrayLayout
from simwarp.kernels.cones.problem import OF_LANES, ConeProblem, ConeScratch
from simwarp.kernels.core.cpu_flags import INLINE
from simwarp.kernels.core.fields import ContactArrays, ControlArrays, Parameters, StateArrays
from simwarp.kernels.core.lanes import lanes_for
from simwarp.kernels.core.scratch import (
    ScratchGroup,
    make_memory,
    memory_layouts,
    memory_struct,
    scratch_array,
    slot_function,
)
from simwarp.kernels.core.tables import StepConfig, Topology, Work, WorkScratch
from simwarp.kernels.core.world_range import WorldRange, scratch_slot_of
from simwarp.kernels.core.world_status import NON_FINITE
from simwarp.kernels.dynamics.assembly import (
    bind_velocities,
    close_loops,
    measure_world,
    place_world,
    publish_placed,
    publish_set_velocities,
    set_tree_velocities,
)
from simwarp.kernels.dynamics.bodies import load_poses
from simwarp.kernels.dynamics.dense_rows import padded
from simwarp.kernels.meshes.mesh_loads import MeshLoads, MeshLoadScratch

# Warp's own flags, with fused multiply-adds (accuracy and speed) and without the superword pass, which slows this
# kernel of table loops down and takes seconds to compile.
CPU_FLAGS = f"{INLINE} -ffp-contract=fast -fno-slp-vectorize"

MODULE_OPTIONS = {"enable_backward": False, "max_unroll": 0, "cpu_compiler_flags": CPU_FLAGS}

wp.set_module_options(MODULE_OPTIONS)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScratchSizes:
    """Workspace sizes of a model, per world.

    `dense_rows` is the size of the largest dense Schur complement, `factor_rows` that of what solvers factorise,
    `wide_vectors` and `wide_rows` their double vectors. `columns`, `response_room` and `factor_room` are those of rows
    by group, `share_width` the loop rows that one block sees (`RowGroups`). `kept_rows` are all cone rows where another
    solver may follow the first, whatever is dense: both solutions are compared.
    """

    links: int
    tree_dofs: int
    elastic_joints: int
    units: int
    rows: int
    groups: int
    columns: int
    response_room: int
    factor_room: int
    share_width: int
    responses: int
    relative_rotations: int
    blocks: int
    cone_rows: int
    dense_rows: int
    factor_rows: int
    wide_rows: int
    wide_vectors: int
    kept_rows: int
    entries: int
    mesh_columns: int = 0
    mesh_factor: int = 0
    mesh_vector: int = 0
    mesh_factor_double: int = 0
    mesh_vector_double: int = 0
    mesh_shares: int = 0
    mesh_element_blocks: int = 0
    mesh_points: int = 0

    @property
    def elastic_matrices(self) -> int:
        """Six of each elastic joint."""
        return 6 * self.elastic_joints

    @property
    def elastic_vectors(self) -> int:
        """Four of each elastic joint."""
        return 4 * self.elastic_joints

    @property
    def padded_rows(self) -> int:
        """Length of an array of rows that wide loads run over."""
        return padded(self.rows)

    @property
    def wrench_rows(self) -> int:
        """Rows, and relative rotations of couplings."""
        return self.rows + self.relative_rotations

    @property
    def unit_ends(self) -> int:
        """Units, and their end."""
        return self.units + 1

    @property
    def block_ends(self) -> int:
        """Blocks, and their end."""
        return self.blocks + 1


class KeptScratch(ScratchGroup):
    """Impulses of the first solver, while another one tries."""

    kept = scratch_array(wp.float32, "kept_rows")


GROUPS = (WorkScratch, ConeScratch, KeptScratch, MeshLoadScratch)
Scratch = memory_struct("Scratch", __name__, GROUPS)
pack = slot_function("pack", __name__, WorkScratch, Work, Scratch)
pack_cone = slot_function("pack_cone", __name__, ConeScratch, ConeProblem, Scratch)
pack_loads = slot_function("pack_loads", __name__, MeshLoadScratch, MeshLoads, Scratch)
OF_MESHES = frozenset(
    {"mesh_factor", "mesh_vector", "mesh_factor_double", "mesh_vector_double", *MeshLoadScratch.blocks()}
)
"""Scratch of which lanes of a GPU share a slot, and which native functions walk."""


def part_of_work(name: str, only: Set[str], *, inline: bool | None = None) -> Any:
    """`pack` that finds only the arrays of these names."""
    return slot_function(name, f"{__name__}.parts", WorkScratch, Work, Scratch, only=only, inline=inline)


def part_of_cone(name: str, only: Set[str], *, inline: bool | None = None) -> Any:
    """`pack_cone` that finds only the arrays of these names."""
    return slot_function(name, f"{__name__}.parts", ConeScratch, ConeProblem, Scratch, only=only, inline=inline)


def scratch_layouts(slots: int, sizes: ScratchSizes) -> dict[str, ArrayLayout]:
    """The arrays of the scratch."""
    return memory_layouts(GROUPS, slots, sizes)


def make_scratch(device: wp.Device, slots: int, sizes: ScratchSizes) -> Any:
    """Allocates the scratch: on a CPU a slot for each chunk of worlds, which stays in the cache."""
    of_lanes = OF_MESHES | (OF_LANES if lanes_for(sizes.cone_rows) > 1 else frozenset[str]())
    return make_memory(Scratch, scratch_layouts(slots, sizes), device, of_lanes=of_lanes)


@wp.func
def kept_rows(scratch: Scratch, slot: int) -> wp.array[float]:
    """Impulses of the first solver, of one slot."""
    return scratch.kept[slot]


@wp.func
def forget_contacts(world: int, contacts: ContactArrays):
    """No contacts and no forces of contacts; without a slot in use, the next step has no impulses to start from."""
    contacts.contact_count[world] = 0
    contacts.contact_overflow[world] = 0
    contacts.penetration[world] = 0.0
    for shape in range(contacts.shape_contact_force.shape[1]):
        contacts.shape_contact_force[world, shape] = wp.vec3()
    for body in range(contacts.body_contact_force.shape[1]):
        contacts.body_contact_force[world, body] = wp.vec3()


@wp.kernel(enable_backward=False, module="unique", module_options=MODULE_OPTIONS)
def assemble_trees(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    control: ControlArrays,
    joint_q: wp.array2d[float],
    joint_qd: wp.array2d[float],
    scratch: Scratch,
    # in and out
    state: StateArrays,
    # outputs
    contacts: ContactArrays,
):
    """Sets the worlds of the mask, whose model has neither loops nor couplings, to coordinates and rates.

    Nothing has touched yet.
    """
    world = worlds.first + wp.tid()
    if mask[world]:
        work = pack(scratch, scratch_slot_of(world, worlds))
        place_world(world, topology, parameters, joint_q, state, work)
        publish_placed(world, 0.0, topology, parameters, state, work)
        set_tree_velocities(world, config, topology, parameters, control, joint_qd, state, work)
        publish_set_velocities(world, topology, parameters, joint_qd, state, work)
        forget_contacts(world, contacts)


@wp.kernel(enable_backward=False, module="unique", module_options=MODULE_OPTIONS)
def assemble_positions(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    control: ControlArrays,
    joint_q: wp.array2d[float],
    joint_qd: wp.array2d[float],
    scratch: Scratch,
    # in and out
    state: StateArrays,
    # outputs
    contacts: ContactArrays,
):
    """Sets the worlds of the mask to coordinates, and closes the loops near them. Nothing has touched yet."""
    world = worlds.first + wp.tid()
    if mask[world]:
        work = pack(scratch, scratch_slot_of(world, worlds))
        place_world(world, topology, parameters, joint_q, state, work)
        error = float(0.0)
        if topology.joint_row_count > 0:
            error = close_loops(world, topology, parameters, state, control, config, work)
        publish_placed(world, error, topology, parameters, state, work)
        forget_contacts(world, contacts)


@wp.kernel(enable_backward=False, module="unique", module_options=MODULE_OPTIONS)
def assemble_velocities(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    config: StepConfig,
    topology: Topology,
    parameters: Parameters,
    control: ControlArrays,
    joint_q: wp.array2d[float],
    joint_qd: wp.array2d[float],
    scratch: Scratch,
    # in and out
    state: StateArrays,
    # outputs
    contacts: ContactArrays,
):
    """Sets the velocities of the worlds of the mask after `assemble_positions`, consistent with loops and couplings."""
    world = worlds.first + wp.tid()
    if mask[world]:
        work = pack(scratch, scratch_slot_of(world, worlds))
        load_poses(world, topology, state, work)
        set_tree_velocities(world, config, topology, parameters, control, joint_qd, state, work)
        bind_velocities(world, config, topology, parameters, control, joint_qd, state, work)
        publish_set_velocities(world, topology, parameters, joint_qd, state, work)


def assembly_kernels(row_count: int) -> list[wp.Kernel]:
    """Kernels that set worlds of a model with so many rows of loops and couplings to a state, in their order.

    A model without rows does not compile what factors them: two thirds of the time.
    """
    return [assemble_positions, assemble_velocities] if row_count else [assemble_trees]


@wp.kernel(enable_backward=False, module="unique", module_options=MODULE_OPTIONS)
def measure_worlds(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    topology: Topology,
    parameters: Parameters,
    scratch: Scratch,
    # in and out
    state: StateArrays,
    # outputs
    contacts: ContactArrays,
):
    """Publishes what follows from the poses and velocities of record, in the worlds of the mask (`measure_world`).

    Somebody wrote them: contacts of the state before are forgotten.
    """
    world = worlds.first + wp.tid()
    if mask[world]:
        measure_world(world, topology, parameters, state, pack(scratch, scratch_slot_of(world, worlds)))
        forget_contacts(world, contacts)


def kernels_for_cuda_check() -> list[wp.Kernel]:
    """Those with modules of their own."""
    return [assemble_trees, assemble_positions, assemble_velocities, measure_worlds]


@wp.kernel(enable_backward=False)
def copy_rows(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    source: wp.array2d[int],
    # outputs
    target: wp.array2d[int],
):
    """Masked reset of any array whose rows belong to worlds, seen as whole words."""
    world = worlds.first + wp.tid()
    if mask[world]:
        for word in range(source.shape[1]):
            target[world, word] = source[world, word]


@wp.kernel(enable_backward=False)
def flag_worlds(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    joint_q: wp.array2d[float],
    joint_qd: wp.array2d[float],
    # in and out
    world_status: wp.array[int],
):
    """Freezes the worlds of the mask that were given coordinates or rates which are not finite."""
    world = worlds.first + wp.tid()
    if not mask[world]:
        return
    for dof in range(joint_q.shape[1]):
        if not (wp.isfinite(joint_q[world, dof]) and wp.isfinite(joint_qd[world, dof])):
            world_status[world] = world_status[world] | NON_FINITE


@wp.kernel(enable_backward=False)
def copy_worlds(
    # inputs
    worlds: WorldRange,
    mask: wp.array[wp.bool],
    source: StateArrays,
    # outputs
    target: StateArrays,
    contacts: ContactArrays,
):
    """Masked reset: every array of the state, for the worlds in the mask, which forget their contacts."""
    world = worlds.first + wp.tid()
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
    for row in range(source.box_impulse.shape[1]):
        target.box_impulse[world, row] = source.box_impulse[world, row]
    forget_contacts(world, contacts)
    target.world_time[world] = source.world_time[world]
    target.world_status[world] = source.world_status[world]
