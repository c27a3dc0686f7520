"""Materials of flexible bodies."""

from __future__ import annotations

import dataclasses
from typing import Annotated, TypeAlias

from simwarp.core.constraints import Ge, Le, Meaning, NotNegative, Positive
from simwarp.model.rules import Configuration

Poisson: TypeAlias = Annotated[float, Ge(0.0), Le(0.499), Meaning("a ratio, 0.3 for steel, 0.45 for rubber")]
Density: TypeAlias = Annotated[Positive, Meaning("kg/m³, 7850 for steel, 1100 for rubber")]
DampingTime: TypeAlias = Annotated[NotNegative, Meaning("seconds, 0 damps nothing")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Elastic(Configuration):
    """An isotropic material whose stress is proportional to strain: metals, wood, ropes, cloth.

    Solids of it follow Saint Venant and Kirchhoff: strains must stay small, rotations need not.

    Attributes:
        young: Young's modulus [Pa].
        poisson: Poisson's ratio, 0 to 0.499.
        density: [kg/m³].
        damping_time: stress per strain rate over stress per strain [s]. A vibration of ω [rad/s] is damped with
            ω · damping_time / 2 of the critical damping.

    Raises:
        ModelError: a value breaks its rule.
    """

    young: Annotated[Positive, Meaning("pascals, 2.1e11 for steel, 1e9 for nylon")]
    poisson: Poisson = 0.3
    density: Density
    damping_time: DampingTime = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rubber(Configuration):
    """A stable neo-Hookean material (Smith, de Goes and Kim 2018, ACM TOG 37:12): for large strains, finite where an
    element is turned inside out.

    Attributes:
        young: Young's modulus of small strains [Pa].
        poisson: Poisson's ratio of small strains, 0 to 0.499.
        density: [kg/m³].
        damping_time: stress per strain rate over stress per strain [s], as of `Elastic`.

    Raises:
        ModelError: a value breaks its rule.
    """

    young: Annotated[Positive, Meaning("pascals, 1e6 for soft rubber, 1e7 for that of tires")]
    poisson: Poisson = 0.45
    density: Density
    damping_time: DampingTime = 0.0
