"""Height of the ground below a place: of a level plane, of a height field that differs by world, else of what moves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD, ShapeType
from simwarp.scenery.terrain import height_at
from simwarp.sensors.scene import Scene

Array = npt.NDArray[np.float64]


class GroundHeight:
    """Height of the ground of some worlds.

    Args:
        scene: whose ground it is: its first endless level plane, and the height fields that stand level in the world.
        worlds: indices of the worlds.
    """

    def __init__(self, scene: Scene, worlds: npt.ArrayLike) -> None:
        self._scene, self._worlds = scene, np.asarray(worlds, np.int64)
        self._plane = -math.inf
        self._fields: list[int] = []
        for index, instance in enumerate(scene.visuals.instances):
            level = np.abs(instance.pose.rotation[:2]).max() < 1e-6
            if level and instance.body == WORLD and instance.kind == ShapeType.PLANE and self._plane == -math.inf:
                self._plane = float(instance.pose.position[2])
            elif level and instance.body == WORLD and instance.kind == ShapeType.HEIGHT_FIELD:
                self._fields.append(index)

    def at(self, places: Array) -> Array:
        """(worlds,) height of the ground at places (worlds, 2 or 3) [m]; -infinity where there is none."""
        found = np.full(len(self._worlds), self._plane)
        for index in self._fields:
            x, rotation, asset = (self._rows(name, index) for name in ("x", "rot", "asset"))
            for row, place in enumerate(places):
                found[row] = max(found[row], self._of_field(int(asset[row]), x[row], rotation[row], place))
        return found

    def _rows(self, name: str, index: int) -> npt.NDArray[Any]:
        """(worlds, ...) values of an instance: of its shape, where it is one's."""
        shape = int(self._scene.shape[index])
        values = getattr(self._scene.model, f"shape_{name}") if shape >= 0 else getattr(self._scene, name)
        rows: npt.NDArray[Any] = values.numpy()[:, shape if shape >= 0 else index]
        return rows[self._worlds] if len(rows) > 1 else np.repeat(rows, len(self._worlds), axis=0)

    def _of_field(self, asset: int, x: Array, rotation: Array, place: Array) -> float:
        field = self._scene.visuals.builder.height_fields[asset]
        size = tuple(step * (count - 1) for step, count in zip(field.spacing, field.heights.shape[::-1], strict=True))
        angle = 2.0 * math.atan2(rotation[2], rotation[3])
        away = np.asarray(place[:2], np.float64) - x[:2]
        local = (
            math.cos(angle) * away[0] + math.sin(angle) * away[1],
            math.cos(angle) * away[1] - math.sin(angle) * away[0],
        )
        if any(abs(at) > 0.5 * side for at, side in zip(local, size, strict=True)):
            return -math.inf
        return float(x[2] + height_at(field.heights, size, [local])[0])
