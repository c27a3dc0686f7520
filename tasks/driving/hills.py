"""Hilly ground: a few height fields that all worlds share, of which each shows one, raised as much as it likes."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
import warp as wp

import simwarp as sw

from ..framework.recorded_launches import TensorFunction, filled
from .hills_kernels import FLATTEST, HillTables, measure_heights, measure_normals, show_hills
from .tire_ground import GRIPPING

__all__ = ["FLATTEST", "Hills"]


class Hills:
    """Ground of fields whose heights are at most 1 m above or below 0, bumps aside, times each world's amplitude.

    Call `build` in `build_world`, return `terrain` from `ground`, call `bind` in `setup` before its ``super()``, and
    `show` in `draw_world`. The task's `per_world` names `model_arrays` too.

    Args:
        count: number of fields.
        side: length of their sides [m].
        seed: of their form.
        spacing: of their nodes [m].
        bumps: (count, rows, columns) added to the fields, as shares of the amplitude: they rise and fall with it.

    Attributes:
        tables: the fields, and what each world shows of them, for kernels; once bound.
    """

    tables: HillTables

    model_arrays: ClassVar[tuple[str, ...]] = ("shape_asset", "shape_size")

    def __init__(
        self, count: int, side: float, seed: int = 0, *, spacing: float = 1.5,
        bumps: npt.NDArray[np.float32] | None = None,
    ) -> None:  # fmt: skip
        self.side = side
        self.fields = [
            sw.scenery.hills(seed + index, size=(side, side), spacing=spacing, amplitude=1.0) for index in range(count)
        ]
        if bumps is not None:
            self.fields = [field + bump for field, bump in zip(self.fields, bumps, strict=True)]

    def __repr__(self) -> str:
        return f"Hills: {len(self.fields)} fields of {self.side:g} m"

    def build(self, builder: sw.ModelBuilder, *, mask: int = 0) -> None:
        """Add the ground as a shape that is seen, and that tires stand on; it meets the groups of the mask besides."""
        size = (self.side, self.side)
        self._assets = [builder.add_height_field_asset(field, size=size) for field in self.fields]
        self.shape = builder.add_shape_height_field(
            sw.WORLD,
            self.fields[0],
            size=size,
            scale=(1.0, 1.0, FLATTEST),
            name="hills",
            mask=mask,
            material=GRIPPING if mask else None,
        )

    def terrain(self, model: sw.Model) -> Any:
        """Return the ground for tires: the shape, as each world shows it."""
        return sw.vehicle.ground_of(model, self.shape)

    def bind(self, model: sw.Model) -> None:
        """Make tables of what a reset changes."""
        device = torch.device(str(model.device))
        self.tables = filled(
            HillTables,
            side=self.side,
            heights=wp.array(np.stack(self.fields), dtype=float, device=model.device),
            assets=wp.array(self._assets, dtype=int, device=model.device),
            shape=self.shape,
            field=wp.zeros(model.world_count, dtype=wp.int64, device=model.device),
            shape_asset=model.shape_asset,
            shape_size=model.shape_size,
        )
        number, vector = (torch.float32, ()), (torch.float32, (3,))
        self._show = TensorFunction(show_hills, [self.tables], [], device)
        self._height = TensorFunction(measure_heights, [self.tables], [number], device, dimensions=2)
        self._normal = TensorFunction(measure_normals, [self.tables], [vector], device)

    def show(self, world_mask: torch.Tensor, field: torch.Tensor, amplitude: torch.Tensor) -> None:
        """Put fields below the worlds of a mask: tires, sensors, `height` and `normal` have them from then on.

        Args:
            world_mask: (W,) bool; only these worlds change.
            field: (W,) int64, numbers of the fields, from 0.
            amplitude: (W,) of the hills [m].
        """
        self._show(world_mask, field, amplitude.float())

    def height(self, place: torch.Tensor) -> torch.Tensor:
        """Return heights (W, N) [m] of the ground at places (W, N, 2), of the triangles that tires stand on."""
        return self._height(place.float().contiguous())[0]

    def normal(self, place: torch.Tensor) -> torch.Tensor:
        """Return (W, 3) unit normals of the plane through the ground 1.2 metres around places (W, 2)."""
        return self._normal(place.float().contiguous())[0]
