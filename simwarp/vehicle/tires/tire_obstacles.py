"""Static shapes that tires meet beside their ground: which they are, and the arrays of their search."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, Literal, TypeAlias

import numpy as np
import warp as wp

from simwarp.core.object_repr import Readable, plural
from simwarp.core.types import WORLD, ShapeType
from simwarp.core.wording import close_names
from simwarp.model.model import Model
from simwarp.vehicle.spec.parts import SpecError
from simwarp.vehicle.tires.patch_kernels import Envelopes
from simwarp.vehicle.tires.tire_obstacles_kernels import ObstacleTables

ObstacleNames: TypeAlias = Sequence[int | str] | Literal["all"]
"""Shapes on WORLD by index or name; "all": every one that tires can meet."""

UNMET: Final = (ShapeType.SPROCKET, ShapeType.GROOVE)
"""Kinds that no tire meets."""


def shape_on_world(model: Model, shape: int | str, place: str = "terrain") -> int:
    """Return the index of a shape on WORLD that is named by its index or name.

    Args:
        model: finished.
        shape: index or name.
        place: that errors begin with.

    Raises:
        SpecError: there is none.
    """
    names = model.shape_names
    if isinstance(shape, str) and shape not in names:
        near = close_names(shape, names, 3) or names
        raise SpecError(f"{place}: no shape is called '{shape}'; there are {', '.join(near) or 'none'}")
    index = names.index(shape) if isinstance(shape, str) else shape
    if not 0 <= index < model.shape_count:
        raise SpecError(f"{place}: shape must be below {model.shape_count}, got {index}")
    body = model.builder.shapes[index].body
    if body != WORLD:
        raise SpecError(
            f"{place}: shape '{names[index]}' must be on WORLD, it is on '{model.body_names[body]}'; tires stand on"
            " ground that stands still"
        )
    return index


class TireObstacles(Readable):
    """Static shapes that the tires of a vehicle meet beside their ground, in every world.

    It reads the model's own arrays: what is written to `shape_x`, `shape_rot`, `shape_size` and `shape_asset` counts
    from the next step on.

    Args:
        model: finished.
        shapes: on WORLD, by index or name, or "all".

    Attributes:
        model: of the shapes.
        shapes: their indices.

    Raises:
        SpecError: there is no such shape, it is on a body, it is named twice, or it is a sprocket or groove.
    """

    def __init__(self, model: Model, shapes: ObstacleNames = "all") -> None:
        self.model = model
        self.shapes = _chosen(model, shapes)

    def _readable_title(self) -> str:
        return f": {plural(len(self.shapes), 'shape')}"

    def tables(self, wheels: int) -> Any:
        """Their device tables, with scratch for so many wheels of each world."""
        tables: Any = ObstacleTables()
        device, kinds = self.model.device, self.model.shape_types
        tables.shape = wp.array(np.array(self.shapes, np.int32), dtype=int, device=device)
        tables.kind = wp.array(
            np.array([int(kinds[shape]) for shape in self.shapes], np.int32), dtype=int, device=device
        )
        tables.near = wp.zeros((self.model.world_count, wheels, len(self.shapes)), dtype=int, device=device)
        return tables


def make_envelopes(shape: tuple[int, int], device: wp.DeviceLike) -> Any:
    """What wheels meet, (W, wheels); (0, 0) where there are no obstacles."""
    envelopes: Any = Envelopes()
    envelopes.normal = wp.zeros(shape, dtype=wp.vec3, device=device)
    envelopes.deflection = wp.zeros(shape, dtype=float, device=device)
    return envelopes


def _chosen(model: Model, shapes: ObstacleNames) -> tuple[int, ...]:
    """Indices of the shapes."""
    if shapes == "all":
        bodies = [shape.body for shape in model.builder.shapes]
        kinds = model.shape_types
        return tuple(k for k in range(model.shape_count) if bodies[k] == WORLD and kinds[k] not in UNMET)
    found: list[int] = []
    for shape in shapes:
        index = shape_on_world(model, shape, "obstacles")
        name = model.shape_names[index]
        if index in found:
            raise SpecError(f"obstacles: shape '{name}' must be named once, it is named twice")
        if model.shape_types[index] in UNMET:
            kind = model.shape_types[index].name
            raise SpecError(f"obstacles: shape '{name}' must not be a sprocket or groove, got {kind}; leave it out")
        found.append(index)
    return tuple(found)
