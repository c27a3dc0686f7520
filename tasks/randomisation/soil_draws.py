"""Parameters of soils that are drawn for every episode, between those of two soils."""

from __future__ import annotations

import math
from typing import Final

import torch

import simwarp as sw

from .randomness import WorldRandom

RIGID_SHARE: Final = 0.2
"""Of the episodes with drawn soil: in them the ground is nearly rigid."""
RIGID_MODULUS: Final = 1.0e8
"""Its k_phi, at an exponent of 1 [N/m^3]: a Gator's wheels and a quadruped's feet sink in by millimetres."""
RIGID_ELASTIC: Final = 4.0e8
"""Its stiffness of unloading, that of the preset hard [Pa/m]."""
STEEPEST: Final = math.radians(60.0)
"""Largest friction angle of a soil [rad]."""
DRAWS: Final = 4
"""Numbers that a soil is drawn with."""
LOGARITHMIC: Final = [sw.soil.SoilParameter.K_PHI, sw.soil.SoilParameter.ELASTIC]
"""Parameters whose logarithm is uniform."""
DRAW_OF: Final = tuple(
    {sw.soil.SoilParameter.EXPONENT: 1, sw.soil.SoilParameter.COHESION: 2, sw.soil.SoilParameter.TAN_PHI: 3}.get(
        parameter, 0
    )
    for parameter in sw.soil.SoilParameter
)
"""Which number each parameter is drawn with: k_c, shear length, elastic and damping go with k_phi."""


def rigid_soil(friction: float) -> sw.soil.SoilSpec:
    """Return a soil that hardly gives way, with the friction of a road."""
    return sw.soil.SoilSpec(
        k_phi=RIGID_MODULUS, exponent=1.0, friction_angle=min(math.atan(friction), STEEPEST), elastic=RIGID_ELASTIC
    )


class SoilDraws:
    """Writes the parameters of a soil that differs by world and episode, or is the same in all of them.

    Drawn are log k_phi, n, phi and c, each by itself; k_c, the shear length and the stiffness of unloading go with log
    k_phi.

    Args:
        element: made `per_world`, with one soil.
        soil: of all episodes; None: they are drawn between `soft` and `hard`.
        random: of the task.
        soft: one end of what is drawn.
        hard: the other end.
        rigid: soil of a share of the drawn episodes.
        rigid_share: of them.

    Attributes:
        parameter: (W, 1, 9) of `SoilSpec.values`.
    """

    def __init__(
        self, element: sw.soil.Soil, soil: sw.soil.SoilSpec | None, random: WorldRandom, *, soft: sw.soil.SoilSpec,
        hard: sw.soil.SoilSpec, rigid: sw.soil.SoilSpec, rigid_share: float,
    ) -> None:  # fmt: skip
        self.parameter = sw.to_torch(element.parameter)
        self._random, self._rigid_share = random, rigid_share
        self._rigid = self._row(rigid)
        self._fixed = None if soil is None else self._row(soil)
        self._low, self._high = (_spread(self._row(end)) for end in (soft, hard))
        self._draw_of = torch.tensor(DRAW_OF, device=self.parameter.device)
        self._logarithmic = torch.zeros_like(self._low, dtype=torch.bool)
        self._logarithmic[LOGARITHMIC] = True

    def draw(self, world_mask: torch.Tensor) -> None:
        """Write the parameters of the running episodes where ``world_mask`` (W,) is true."""
        rows = self._draw_rows() if self._fixed is None else self._fixed.expand(len(world_mask), -1)
        self.parameter.copy_(torch.where(world_mask.view(-1, 1, 1), rows.unsqueeze(1), self.parameter))

    def _row(self, soil: sw.soil.SoilSpec) -> torch.Tensor:
        return torch.tensor(soil.values(), dtype=torch.float32, device=self.parameter.device)

    def _draw_rows(self) -> torch.Tensor:
        """Return (W, 9): what the draws of the running episodes say."""
        shares = self._random.uniform("soil", size=DRAWS + 1)
        rows = torch.lerp(self._low, self._high, shares.index_select(1, self._draw_of))
        rows = torch.where(self._logarithmic, rows.exp(), rows)
        rows[:, sw.soil.SoilParameter.TAN_PHI] = rows[:, sw.soil.SoilParameter.TAN_PHI].tan()
        return torch.where(shares[:, DRAWS:] < self._rigid_share, self._rigid, rows)


def _spread(row: torch.Tensor) -> torch.Tensor:
    """Return a row (9,) with logarithms and the angle in place of what is drawn by them."""
    spread = row.clone()
    spread[LOGARITHMIC] = row[LOGARITHMIC].log()
    spread[sw.soil.SoilParameter.TAN_PHI] = row[sw.soil.SoilParameter.TAN_PHI].atan()
    return spread
