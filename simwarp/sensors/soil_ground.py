"""The ground that a soil deforms, as rays of a scene meet it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import warp as wp

from simwarp.core.types import WORLD, ModelError, ShapeType
from simwarp.soil.soil_rays_kernels import SoilView

if TYPE_CHECKING:
    from simwarp.model.model import Model
    from simwarp.soil.soil import Soil

TITLES: Final = {ShapeType.PLANE: "plane", ShapeType.HEIGHT_FIELD: "height field"}


def ground_instance(
    soil: Soil, ground: int | str | None, *, model: Model, names: Sequence[str], kinds: Any, bodies: Any
) -> int:
    """Index of the instance that shows the undeformed ground of a soil.

    Args:
        soil: that covers the scene.
        ground: name or index of the instance; None: the only one of its kind on WORLD.
        model: of the scene.
        names, kinds, bodies: of all instances; kinds are those of shapes.

    Raises:
        ModelError: see `Scene.cover_with`.
    """
    if soil.model is not model:
        raise ModelError("scene: cover_with must get a soil of the scene's model, got that of another; pass its own")
    kind = ShapeType(soil.cover.terrain.kind)
    if kind not in TITLES:
        raise ModelError(
            f"scene: the soil's ground must be a plane or a height field to be seen, got a {kind.name.lower()}; "
            "simwarp.vehicle.ground makes one of a height field"
        )
    fitting = (np.asarray(bodies) == WORLD) & (np.asarray(kinds) == int(kind))
    found = [int(index) for index in np.flatnonzero(fitting)]
    if ground is None:
        if len(found) != 1:
            many = ", ".join(names[index] for index in found) or "none"
            raise ModelError(
                f"scene: cover_with must know which {TITLES[kind]} on WORLD is the soil's ground, got {many}; "
                "add it to the visuals, or name one with ground="
            )
        return found[0]
    index = names.index(ground) if ground in names else int(ground) if isinstance(ground, int) else -1
    if index not in found:
        raise ModelError(
            f"scene: ground of cover_with must be a {TITLES[kind]} on WORLD, got "
            f"{names[index] if 0 <= index < len(names) else ground}; name that of the soil"
        )
    return index


def soil_view(soil: Soil, instance: int, placed: Mapping[str, wp.array]) -> Any:
    """All that rays need of a soil.

    Args:
        soil: that covers the scene.
        instance: that it takes the place of.
        placed: arrays of the scene that `place_instances` writes, by name.
    """
    view: Any = SoilView()
    view.instances, view.instance, view.cover, view.assets = 1, instance, soil.cover, soil.model.assets
    for name in ("x", "rot", "size", "asset"):
        setattr(view, name, placed[f"place_{name}"])
    for name in ("origin", "lower", "upper"):
        setattr(view, name, placed[name])
    view.levels = wp.zeros(soil.model.world_count, dtype=wp.vec2, device=soil.model.device)
    return view
