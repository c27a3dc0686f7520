"""Sections of rods: areas, second moments, torsion constants, shear factors, and where stresses are largest.

Axes as in a rod: x along it, y and z in the section. Shear factors are those of parabolic shear stresses, 9/10 of a
disc and 5/6 of a rectangle; a tube's is Cowper's (1966) for a Poisson's ratio of zero, which is 1/2 where it is thin.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Annotated, Final, TypeAlias

from simwarp.core.constraints import Meaning, NotNegative, Positive
from simwarp.core.types import ModelError
from simwarp.model.rules import Configuration

METRES: Final = Meaning("metres")
TERMS: Final = 40
"""Of the series for the torsion of a rectangle, which converges with the fifth power."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Section(Configuration):
    """A section by its numbers.

    Attributes:
        area: [m²].
        inertia_y: second moment of area about y, the integral of z² [m⁴].
        inertia_z: that about z [m⁴].
        torsion: constant J of St. Venant [m⁴].
        shear_y, shear_z: shares of the area that resist shear along y, along z.
        reach_y, reach_z: largest distances from the axis along y and z, for stresses [m].
    """

    area: Annotated[Positive, Meaning("m²")]
    inertia_y: Annotated[Positive, Meaning("m⁴")]
    inertia_z: Annotated[Positive, Meaning("m⁴")]
    torsion: Annotated[Positive, Meaning("m⁴")]
    shear_y: Annotated[Positive, Meaning("a share, 1 by default")] = 1.0
    shear_z: Annotated[Positive, Meaning("a share, 1 by default")] = 1.0
    reach_y: Annotated[NotNegative, METRES] = 0.0
    reach_z: Annotated[NotNegative, METRES] = 0.0

    @property
    def numbers(self) -> Section:
        """Itself."""
        return self


@dataclasses.dataclass(frozen=True, kw_only=True)
class Round(Configuration):
    """A disc of a diameter [m]."""

    diameter: Annotated[Positive, METRES]

    @property
    def numbers(self) -> Section:
        """Areas and moments."""
        return Tube(outer=self.diameter, inner=0.0).numbers


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tube(Configuration):
    """A ring between two diameters [m]."""

    outer: Annotated[Positive, METRES]
    inner: Annotated[NotNegative, METRES]

    def check(self) -> None:
        """The wall has a thickness.

        Raises:
            ModelError: it has none.
        """
        if self.inner >= self.outer:
            raise ModelError(
                f"Tube: inner must be below outer, {self.outer:g} m, got {self.inner:g} m; both are diameters"
            )

    @property
    def numbers(self) -> Section:
        """Areas and moments."""
        outer, inner = self.outer / 2.0, self.inner / 2.0
        second = math.pi * (outer**4 - inner**4) / 4.0
        share = (inner / outer) ** 2
        square = (1.0 + share) ** 2
        shear = 0.9 if inner == 0.0 else 6.0 * square / (7.0 * square + 20.0 * share)
        return Section(
            area=math.pi * (outer**2 - inner**2), inertia_y=second, inertia_z=second, torsion=2.0 * second,
            shear_y=shear, shear_z=shear, reach_y=outer, reach_z=outer,
        )  # fmt: skip


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rectangle(Configuration):
    """A rectangle, `width` along y, `height` along z [m]."""

    width: Annotated[Positive, METRES]
    height: Annotated[Positive, METRES]

    @property
    def numbers(self) -> Section:
        """Areas and moments; torsion by the series of St. Venant (Timoshenko & Goodier, section 109)."""
        wide, high = self.width, self.height
        long, short = max(wide, high), min(wide, high)
        series = sum(math.tanh(n * math.pi * long / (2.0 * short)) / n**5 for n in range(1, 2 * TERMS, 2))
        torsion = long * short**3 / 3.0 * (1.0 - 192.0 / math.pi**5 * short / long * series)
        return Section(
            area=wide * high, inertia_y=wide * high**3 / 12.0, inertia_z=high * wide**3 / 12.0, torsion=torsion,
            shear_y=5.0 / 6.0, shear_z=5.0 / 6.0, reach_y=wide / 2.0, reach_z=high / 2.0,
        )  # fmt: skip


AnySection: TypeAlias = Section | Round | Tube | Rectangle
