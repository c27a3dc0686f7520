"""Hilly ground: a few height fields that all worlds share, of which each shows one, raised as much as it likes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import torch

if TYPE_CHECKING:
    from simwarp import Model, ModelBuilder

FLATTEST = 1e-3
"""Least factor of the heights: a height field must not be flat altogether."""


class Hills:
    """Ground of fields whose heights are at most 1 m above or below 0, times the amplitude of each world.

    Args:
        count: number of fields.
        side: length of their sides [m].
        seed: of their form.
    """

    model_arrays: ClassVar[tuple[str, ...]] = ("shape_asset", "shape_size")

    def __init__(self, count: int, side: float, seed: int = 0) -> None:
        from simwarp.scenery import hills

        self.side = side
        self.fields = [hills(seed + index, size=(side, side), spacing=1.5, amplitude=1.0) for index in range(count)]

    def build(self, builder: ModelBuilder) -> None:
        """Add the ground as a shape that is seen, and that nothing but tires meets."""
        import simwarp as sw

        size = (self.side, self.side)
        self._assets = [builder.add_height_field_asset(field, size=size) for field in self.fields]
        self.shape = builder.add_shape_height_field(sw.WORLD, self.fields[0], size=size, name="hills", mask=0)

    def terrain(self, model: Model) -> Any:
        """Return the ground for tires."""
        from simwarp import ShapeType
        from simwarp.vehicle import ground

        worlds = model.world_count
        self._terrain = ground(
            model.device, kind=ShapeType.HEIGHT_FIELD, asset=[self._assets[0]] * worlds,
            scale=np.tile((1.0, 1.0, FLATTEST), (worlds, 1)),
        )  # fmt: skip
        return self._terrain

    def bind(self, model: Model) -> None:
        """Make views of what a reset changes."""
        from simwarp import to_torch

        terrain: Any = self._terrain
        self._asset, self._scale = to_torch(terrain.asset), to_torch(terrain.scale)
        self._shape_asset = to_torch(model.shape_asset)[:, self.shape]
        self._shape_size = to_torch(model.shape_size)[:, self.shape]
        device = self._asset.device
        self._known = torch.tensor(self._assets, dtype=torch.int32, device=device)
        self._heights = torch.tensor(np.stack(self.fields), device=device)
        self._field = torch.zeros(len(self._asset), dtype=torch.int64, device=device)
        self._around = torch.tensor([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]], device=device)

    def choose(self, world_mask: torch.Tensor, field: torch.Tensor, amplitude: torch.Tensor) -> None:
        """Give the worlds of a mask (W,) a field (W,) and an amplitude (W,) [m]."""
        self._field.copy_(torch.where(world_mask, field, self._field))
        asset = self._known[self._field]
        self._asset.copy_(asset)
        self._shape_asset.copy_(asset)
        factor = amplitude.clamp(min=FLATTEST)
        for size in (self._scale, self._shape_size):
            size[:, 2] = torch.where(world_mask, factor, size[:, 2])

    def height(self, place: torch.Tensor) -> torch.Tensor:
        """Return heights (W, N) [m] of the ground at places (W, N, 2), of the triangles that tires stand on."""
        rows, columns = self._heights.shape[1:]
        u = ((place[..., 0] / self.side + 0.5) * (columns - 1)).clamp(0.0, columns - 1.001)
        v = ((place[..., 1] / self.side + 0.5) * (rows - 1)).clamp(0.0, rows - 1.001)
        i, j = u.long(), v.long()
        s, t = u - i, v - j
        field = self._field.unsqueeze(1)
        low, high = self._heights[field, j, i], self._heights[field, j + 1, i + 1]
        # cells are cut from node (i, j) to node (i + 1, j + 1)
        above = t > s
        other = self._heights[field, j + above.long(), i + (~above).long()]
        first, second = torch.where(above, t, s), torch.where(above, s, t)
        return self._scale[:, 2:] * (low + first * (other - low) + second * (high - other))

    def normal(self, place: torch.Tensor, over: float = 1.2) -> torch.Tensor:
        """Return (W, 3) unit normals of the plane through the ground `over` metres around places (W, 2)."""
        height = self.height(place.unsqueeze(1) + over * self._around)
        slope = torch.stack([height[:, 0] - height[:, 1], height[:, 2] - height[:, 3]], dim=1) / (2.0 * over)
        normal = torch.cat([-slope, torch.ones_like(slope[:, :1])], dim=1)
        return normal / normal.norm(dim=1, keepdim=True)
