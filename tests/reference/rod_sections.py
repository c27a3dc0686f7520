"""Stiffness of sections of rods, float64: areas, second moments, torsion constants, shear factors.

Axes: x along the rod, y and z in the section. A rectangle is `width` along y and `height` along z, so that `inertia_y`,
which resists bending about y, is width height^3 / 12.

Sources:
    Shear factors: G.R. Cowper, The shear coefficient in Timoshenko's beam theory, J. Appl. Mech. 33 (1966) 335, which
    depend on Poisson's ratio. The plain 5/6 and 9/10 follow from parabolic shear stresses (D.J. Jourawski).
    Torsion of a rectangle: S. Timoshenko, J. Goodier, Theory of Elasticity, section 109, the series of St. Venant.
"""

from __future__ import annotations

import dataclasses
import enum
import math

import numpy as np

from tests.reference.rods import Array


class Factors(enum.Enum):
    """Where shear factors come from."""

    PLAIN = "plain"
    """5/6 of a rectangle, 9/10 of a disc; a tube's is Cowper's for a ratio of zero, 1/2 where it is thin."""
    COWPER = "cowper"


@dataclasses.dataclass(frozen=True)
class Section:
    """A section by its numbers.

    Attributes:
        area: [m^2].
        inertia_y: second moment about y, the integral of z^2 [m^4].
        inertia_z: second moment about z [m^4].
        torsion: St. Venant's constant J [m^4].
        shear_y: part of the area that resists shear along y.
        shear_z: the same along z.
    """

    area: float
    inertia_y: float
    inertia_z: float
    torsion: float
    shear_y: float = 1.0
    shear_z: float = 1.0

    def stiffness(self, young: float, poisson: float) -> Array:
        """(6,) EA, kGA_y, kGA_z [N], GJ, EI_y, EI_z [N m^2]."""
        shear = young / (2.0 * (1.0 + poisson))
        return np.array(
            [
                young * self.area,
                self.shear_y * shear * self.area,
                self.shear_z * shear * self.area,
                shear * self.torsion,
                young * self.inertia_y,
                young * self.inertia_z,
            ]
        )


def round_section(radius: float, poisson: float = 0.3, factors: Factors = Factors.PLAIN) -> Section:
    """A disc."""
    quarter = math.pi * radius**4 / 4.0
    shear = 0.9 if factors is Factors.PLAIN else 6.0 * (1.0 + poisson) / (7.0 + 6.0 * poisson)
    return Section(math.pi * radius**2, quarter, quarter, 2.0 * quarter, shear, shear)


def tube_section(outer: float, inner: float, poisson: float = 0.3, factors: Factors = Factors.PLAIN) -> Section:
    """A ring between two radii [m]."""
    quarter = math.pi * (outer**4 - inner**4) / 4.0
    ratio = (inner / outer) ** 2
    square = (1.0 + ratio) ** 2
    nu = poisson if factors is Factors.COWPER else 0.0
    shear = 6.0 * (1.0 + nu) * square / ((7.0 + 6.0 * nu) * square + (20.0 + 12.0 * nu) * ratio)
    return Section(math.pi * (outer**2 - inner**2), quarter, quarter, 2.0 * quarter, shear, shear)


def rectangle_torsion(width: float, height: float, terms: int = 40) -> float:
    """St. Venant's constant [m^4] by the series of hyperbolic tangents, which converges as n^-5."""
    long, short = max(width, height), min(width, height)
    odd = np.arange(1, 2 * terms, 2)
    series = np.sum(np.tanh(odd * math.pi * long / (2.0 * short)) / odd**5)
    return long * short**3 / 3.0 * (1.0 - 192.0 / math.pi**5 * short / long * float(series))


def rectangle_section(width: float, height: float, poisson: float = 0.3, factors: Factors = Factors.PLAIN) -> Section:
    """A rectangle, `width` along y, `height` along z."""
    shear = 5.0 / 6.0 if factors is Factors.PLAIN else 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson)
    return Section(
        width * height,
        width * height**3 / 12.0,
        height * width**3 / 12.0,
        rectangle_torsion(width, height),
        shear,
        shear,
    )
