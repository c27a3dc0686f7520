"""Coordinates of joints for panels: their names, ranges, drives and values."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from simwarp.core.types import DriveMode, JointType, RowKind
from simwarp.model.joint_types import ELEMENTS

if TYPE_CHECKING:
    from simwarp.model.model import Model
    from simwarp.simulation.simulation import Simulation

NO_LIMIT: Final = 1e20
"""Limits beyond it are none."""
SLIDE: Final = 1.0
"""Range to both sides of a slide without limits [m]."""
LENGTHS: Final = (RowKind.POINT_AXIS0, RowKind.POINT_AXIS1, RowKind.DISTANCE)


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One column of `joint_q`.

    Attributes:
        name: of its joint, with a number where that has several.
        column: of `joint_q`.
        low, high: of its limits, else what a slider may reach [m or rad].
        driven: a position drive moves it.
        settable: it is part of the tree: `set_joint_state` takes it as it is given.
    """

    name: str
    column: int
    low: float
    high: float
    driven: bool
    settable: bool


def coordinates_of(model: Model) -> list[Coordinate]:
    """All coordinates but those of FREE joints."""
    lower, upper = (getattr(model, f"joint_limit_{side}").numpy()[0] for side in ("lower", "upper"))
    found = []
    for index, joint in enumerate(model.builder.joints):
        rows = ELEMENTS[joint.type].dofs
        if joint.type is JointType.FREE:
            continue
        for local, row in enumerate(rows):
            column = model.joint_dof_start[index] + local
            reach = SLIDE if row.kind in LENGTHS else math.pi
            low, high = float(lower[column]), float(upper[column])
            bounded = -NO_LIMIT < low < high < NO_LIMIT
            driven = model.effort_models[column].mode is DriveMode.POSITION
            name = joint.name if len(rows) == 1 else f"{joint.name} {local}"
            ends = (low, high) if bounded else (-reach, reach)
            settable = ELEMENTS[joint.type].tree and not joint.closes_loop
            found.append(Coordinate(name, column, *ends, driven, settable))
    return found


def of_world(array: Any, world: int) -> Any:
    """The row of one world of an array, on the host; from a GPU only that is copied."""
    return array.numpy()[world] if array.device.is_cpu else array[world : world + 1].numpy()[0]


def joint_series(simulation: Simulation) -> dict[str, Callable[[int], float]]:
    """Coordinates and rates of the joints, for plots."""
    state = simulation.state
    found: dict[str, Callable[[int], float]] = {}
    for each in coordinates_of(simulation.model):
        for name, array in ((f"q {each.name}", state.joint_q), (f"rate {each.name}", state.joint_qd)):
            found[name] = lambda world, array=array, column=each.column: float(  # type: ignore[misc]
                np.asarray(of_world(array, world))[column]
            )
    return found
