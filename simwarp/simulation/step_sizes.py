"""Sizes of what the steps of a model need: scratch memory, known before the first array is made."""

from __future__ import annotations

from simwarp.core.types import ArrayLayout
from simwarp.kernels.collision.contact_lists import ListSizes, list_layouts
from simwarp.kernels.collision.placement import CollisionSizes, collision_layouts
from simwarp.kernels.collision.shape import MANIFOLD_CONTACTS
from simwarp.kernels.cones.problem import WIDE_VECTORS
from simwarp.kernels.cones.proximal_newton import MOST_DOFS, NEWTON_ROWS, NEWTON_VECTORS
from simwarp.kernels.core.tables import progress_layouts
from simwarp.kernels.dynamics.world import ScratchSizes, scratch_layouts
from simwarp.meshes.mesh_columns import mesh_sizes
from simwarp.model.model import Model
from simwarp.simulation.world_launches import WorldShares


def scratch_slots_of(shares: WorldShares) -> int:
    """Places for scratch: one for each chunk of worlds, or one for each world."""
    return shares.worlds if shares.own_slots else len(shares.ranges)


def step_sizes(model: Model, dense_rows: int, all_solvers: bool) -> ScratchSizes:
    """Workspace sizes of one world of a model in a step.

    Args:
        model: the model.
        dense_rows: most rows for which the Schur complement is formed.
        all_solvers: True if other solvers than accelerated gradient descent may run.
    """
    topology = model.topology
    rows = model.box_count + (6 if model.has_rolling_friction else 3) * model.contact_capacity
    dense = min(rows, dense_rows)
    newton = newton_dofs(model)
    groups = model.row_groups
    return ScratchSizes(
        links=topology.link_count, tree_dofs=topology.tree_dof_count,
        elastic_joints=topology.elastic_count, units=topology.unit_count,
        rows=topology.row_count, groups=topology.group_count, columns=groups.max_columns,
        response_room=groups.response_room, factor_room=groups.factor_start[-1], share_width=model.share_width,
        responses=model.response_count, relative_rotations=model.relative_rotation_count,
        blocks=model.box_count + model.contact_capacity,
        cone_rows=rows, dense_rows=dense, factor_rows=max(dense if all_solvers else 0, newton),
        # proximal Newton steps keep vectors of the tree beside those of rows
        wide_rows=max(dense if all_solvers else 0, max(min(rows, NEWTON_ROWS), newton) if newton else 0),
        wide_vectors=WIDE_VECTORS if all_solvers else NEWTON_VECTORS,
        kept_rows=rows if all_solvers else 0, entries=model.entry_count,
        **mesh_sizes(model.builder.flexible_meshes, model.tables.meshes),
    )  # fmt: skip


def newton_dofs(model: Model) -> int:
    """Degrees of freedom for which Newton steps of the contacts have room; 0: none are tried.

    There is room for all units together that may take them (`Model.unit_newton`), but no more than for one island.
    """
    if model.contact_capacity == 0 or model.every_contact_rolls:
        return 0
    groups = model.row_groups
    free = sum(model.unit_newton[groups.link_unit[link]] for link in model.tables.tree_dof_link)
    if groups.unit_count < 2 and free > MOST_DOFS:
        return 0
    return min(free, MOST_DOFS)


def collision_sizes(model: Model) -> CollisionSizes:
    """Room that one world of a model needs for its collision."""
    return CollisionSizes(
        shapes=model.shape_count,
        contacts=model.contact_capacity,
        buckets=model.topology.grid_buckets,
        on_faces=model.contact_capacity if model.topology.face_count else 0,
    )


LEAST_ROOM = {True: (64, 0, 256), False: (8192, 64, 8192)}
"""Pairs, contacts of a shape, and triangles that lists have room for at least, by whether every world has lists of its
own. A CPU has few lists: with few contact slots it still sees all contacts, and keeps the deepest.
"""
PER_SLOT = 4
"""Pairs and triangles that there is room for, per contact slot: bounds of boxes cross more often than shapes touch."""


def list_sizes(model: Model, *, own_slots: bool) -> ListSizes:
    """Room for the lists that stages of collision hand on."""
    topology, slots = model.topology, model.contact_capacity
    searched, ground, faces = topology.searched_pairs, topology.ground_pairs, topology.face_count
    pairs, contacts, triangles = LEAST_ROOM[own_slots]
    found = min(int(MANIFOLD_CONTACTS) * (topology.pair_count + faces), max(contacts * model.shape_count, 2 * slots))
    return ListSizes(
        lists=0 if topology.pair_count == 0 else 4 if faces else 3 if ground else 2 if searched else 1,
        found=found, pairs=min(searched, max(pairs, PER_SLOT * slots)),
        triangles=max(triangles, PER_SLOT * slots) if ground or faces else 0, on_faces=found if faces else 0,
    )  # fmt: skip


def step_layouts(model: Model, sizes: ScratchSizes, slots: int, *, own_slots: bool = False) -> dict[str, ArrayLayout]:
    """Scratch of a step and of collision, in so many slots, and what the stages of a step hand on."""
    groups = {
        "scratch": scratch_layouts(slots, sizes),
        "collision": collision_layouts(slots, collision_sizes(model)),
        "lists": list_layouts(slots, list_sizes(model, own_slots=own_slots)),
        "progress": progress_layouts(model.world_count),
    }
    return {f"{group}.{name}": layout for group, part in groups.items() for name, layout in part.items()}
