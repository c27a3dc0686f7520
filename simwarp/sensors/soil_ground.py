"""Which instance of a scene is the ground that a soil deforms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from simwarp.core.types import WORLD, ModelError, ShapeType

if TYPE_CHECKING:
    from simwarp.sensors.scene import Scene
    from simwarp.soil.soil import Soil

TITLES: Final = {ShapeType.PLANE: "plane", ShapeType.HEIGHT_FIELD: "height field"}


def ground_instance(scene: Scene, soil: Soil, ground: int | str | None) -> int:
    """Index of the instance that shows the undeformed ground of a soil.

    Raises:
        ModelError: see `Scene.cover_with`.
    """
    if soil.model is not scene.model:
        raise ModelError("scene: cover_with must get a soil of the scene's model, got that of another; pass its own")
    kind = ShapeType(soil.cover.terrain.kind)
    if kind not in TITLES:
        raise ModelError(
            f"scene: the soil's ground must be a plane or a height field to be seen, got a {kind.name.lower()}; "
            "simwarp.vehicle.ground makes one of a height field"
        )
    kinds = np.array([instance.kind for instance in scene.visuals.instances], np.int64)
    found = [int(index) for index in np.flatnonzero((scene.body == WORLD) & (kinds == int(kind)))]
    if ground is None:
        if len(found) != 1:
            names = ", ".join(scene.names[index] for index in found) or "none"
            raise ModelError(
                f"scene: cover_with must know which {TITLES[kind]} on WORLD is the soil's ground, got {names}; "
                "add it to the visuals, or name one with ground="
            )
        return found[0]
    index = scene.instance(ground) if isinstance(ground, str) else int(ground)
    if index not in found:
        raise ModelError(
            f"scene: ground of cover_with must be a {TITLES[kind]} on WORLD, got "
            f"{scene.names[index] if 0 <= index < len(scene.names) else index}; name that of the soil"
        )
    return index
