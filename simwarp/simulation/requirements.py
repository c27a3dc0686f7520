"""What a Simulation allocates, from the layouts that its arrays are made of: known before the first one is made."""

from __future__ import annotations

from simwarp.core.types import ArrayLayout
from simwarp.kernels.collision.collide import collision_layouts
from simwarp.kernels.dynamics.world import Sizes, scratch_layouts
from simwarp.model.model import Model
from simwarp.simulation.contacts import Contacts
from simwarp.simulation.diagnostics import Diagnostics
from simwarp.simulation.state import Control, State


def run_layouts(model: Model, *, elements: bool = False, reactions: bool = False) -> dict[str, ArrayLayout]:
    """State, its initial values, control, contacts and diagnostics of any Simulation of the model."""
    groups = {
        "state": State.layouts(model),
        "initial state": State.layouts(model),
        "control": Control.layouts(model, elements),
        "contacts": Contacts.layouts(model),
        "diagnostics": Diagnostics.layouts(model, reactions),
    }
    return {f"{group}.{name}": layout for group, part in groups.items() for name, layout in part.items()}


def snapshot_layouts(model: Model, *, elements: bool) -> dict[str, ArrayLayout]:
    """The arrays of a snapshot, without what force elements and sensors remember."""
    groups = {
        "state": State.layouts(model),
        "control": Control.layouts(model, elements),
        "contacts": Contacts.layouts(model),
    }
    return {f"{group}.{name}": layout for group, part in groups.items() for name, layout in part.items()}


def lanes_of(model: Model) -> int:
    """Worlds that work at the same time: one on a CPU, whose launches are serial; all on a GPU."""
    return model.world_count if model.device.is_cuda else 1


def step_sizes(model: Model, dense_rows: int, all_solvers: bool) -> Sizes:
    """What one world of a model needs room for in a step.

    Args:
        model: the model.
        dense_rows: most rows for which the Schur complement is formed.
        all_solvers: whether other solvers than accelerated gradient descent may run.
    """
    topology = model.topology
    rows = model.bounded_count + (6 if model.has_rolling_friction else 3) * model.contact_capacity
    dense = min(rows, dense_rows)
    return Sizes(
        links=topology.link_count, slots=topology.slot_count, rows=topology.row_count, turns=model.turn_count,
        blocks=model.bounded_count + model.contact_capacity, cone_rows=rows, dense_rows=dense,
        factor_rows=dense if all_solvers else 0, kept_rows=rows if all_solvers else 0, entries=2 * model.path_length,
    )  # fmt: skip


def step_layouts(model: Model, sizes: Sizes) -> dict[str, ArrayLayout]:
    """Scratch of a step and of collision."""
    lanes = lanes_of(model)
    buckets = model.topology.grid_buckets
    groups = {
        "scratch": scratch_layouts(lanes, sizes),
        "collision": collision_layouts(lanes, model.shape_count, model.contact_capacity, buckets),
    }
    return {f"{group}.{name}": layout for group, part in groups.items() for name, layout in part.items()}
