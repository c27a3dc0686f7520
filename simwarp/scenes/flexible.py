"""Scenes with flexible bodies."""

from __future__ import annotations

from typing import Final

from simwarp.core.types import Material
from simwarp.flex import Clamp, Elastic, Round
from simwarp.model.builder import ModelBuilder

ROD_LENGTH: Final = 1.0
"""Of `rod` [m]."""
ROD_SECTION: Final = Round(diameter=0.02)
"""Of `rod`."""
ROD_MATERIAL: Final = Elastic(young=2.1e11, density=7850.0)
"""Of `rod`: steel."""


def rod(*, elements: int = 20, floor: bool = False) -> ModelBuilder:
    """A rod of steel, 1 m by 20 mm, clamped at one end or falling on a floor.

    Args:
        elements: of equal length.
        floor: drop it from 0.2 m, level, with friction 0.6.
    """
    builder = ModelBuilder()
    height = 0.2 if floor else 0.0
    if floor:
        builder.add_shape_plane()
    builder.add_rod(
        "rod", [(0.0, 0.0, height), (ROD_LENGTH, 0.0, height)], elements=elements, section=ROD_SECTION,
        material=ROD_MATERIAL, start=None if floor else Clamp(), surface=Material() if floor else None,
    )  # fmt: skip
    return builder


def rod_on_floor() -> ModelBuilder:
    """A rod of steel of 20 elements falls on a floor and lies there."""
    return rod(floor=True)
