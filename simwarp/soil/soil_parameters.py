"""Parameters of soils, and presets from the literature."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Iterable
from typing import Annotated, Any, Final

from simwarp.core.constraints import Angle, Ge, Le, Meaning, NotNegative, Positive
from simwarp.core.types import ModelError, formatted
from simwarp.model.rules import Configuration, Passive
from simwarp.soil import soil_columns_kernels as columns

DEEP: Final = 0.5
"""Sinkage down to which unloading must be stiffer than loading [m]."""

USUAL_ANGLE: Final = math.radians(30.0)
"""Of friction [rad]."""

PAGE_SIDE: Final = int(columns.SIDE)
"""Nodes along a side of a page."""


class SoilParameter(enum.IntEnum):
    """Columns of `Soil.parameter`, which are those of `SoilSpec.values`; the angle is there as its tangent."""

    K_PHI = int(columns.K_PHI)
    K_C = int(columns.K_C)
    EXPONENT = int(columns.EXPONENT)
    COHESION = int(columns.COHESION)
    TAN_PHI = int(columns.TAN_PHI)
    SHEAR_LENGTH = int(columns.SHEAR_LENGTH)
    ELASTIC = int(columns.ELASTIC)
    DAMPING = int(columns.DAMPING)
    DENSITY = int(columns.DENSITY)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SoilSpec(Configuration):
    """A soil after Bekker, Janosi and Hanamoto, with elastic unloading and damping (Chrono's SCM).

    Attributes:
        k_phi: frictional modulus [N/m^(n+2)].
        k_c: cohesive modulus [N/m^(n+1)].
        exponent: n of sinkage.
        cohesion: c [Pa].
        friction_angle: phi [rad].
        shear_length: way K_J over which shear comes up [m].
        elastic: stiffness of unloading and reloading, per area [Pa/m].
        damping: per area [Pa·s/m].
        density: of the soil as it lies [kg/m³]; blades alone ask for it.

    Raises:
        ModelError: a value breaks its rule.
    """

    k_phi: Annotated[Positive, Meaning("N/m^(n+2); a preset shows the order of magnitude")]
    k_c: Passive = 0.0
    exponent: Annotated[float, Ge(0.2), Le(2.0), Meaning("1 for a linear soil")] = 1.1
    cohesion: Passive = 0.0
    friction_angle: Annotated[NotNegative, Angle(math.radians(60.0)), Meaning("radians")] = USUAL_ANGLE
    shear_length: Annotated[Positive, Meaning("metres; a preset shows the order of magnitude")] = 0.01
    elastic: Annotated[Positive, Meaning("Pa/m; a preset shows the order of magnitude")] = 2.0e8
    damping: Passive = 3.0e4
    density: Annotated[Positive, Meaning("kg/m^3; 1590 for loose sand")] = 1590.0

    def check(self) -> None:
        """Checks that unloading is stiffer than loading.

        Raises:
            ModelError: `elastic` is too low.
        """
        steepest = self.k_phi * self.exponent * DEEP ** (self.exponent - 1.0)
        if self.elastic < steepest:
            rule = f"at least k_phi n z^(n-1) = {steepest:.4g} Pa/m at {DEEP:g} m: unloading is stiffer than loading"
            raise ModelError(
                f"SoilSpec: elastic must be {rule}, got {formatted(self.elastic)}; raise it, or lower k_phi"
            )

    def values(self) -> tuple[float, ...]:
        """The parameters in the order of `SoilParameter`."""
        return (
            self.k_phi, self.k_c, self.exponent, self.cohesion, math.tan(self.friction_angle), self.shear_length,
            self.elastic, self.damping, self.density,
        )  # fmt: skip


PRESETS: Final = {
    "soft": SoilSpec(k_phi=0.2e6, elastic=4.0e7),
    "mid": SoilSpec(k_phi=2.0e6),
    "hard": SoilSpec(
        k_phi=5.301e6, k_c=1.02e5, exponent=0.793, cohesion=1300.0, friction_angle=math.radians(31.1),
        shear_length=0.012, elastic=4.0e8,
    ),
    "clay": SoilSpec(
        k_phi=692.15e3, k_c=13.19e3, exponent=0.5, cohesion=4140.0, friction_angle=math.radians(13.0), elastic=1.0e8,
        density=1770.0,
    ),
    "snow": SoilSpec(
        k_phi=196.72e3, k_c=4.37e3, exponent=1.6, cohesion=1030.0, friction_angle=math.radians(19.7),
        shear_length=0.03, elastic=4.0e7, density=250.0,
    ),
    "sand": SoilSpec(
        k_phi=1528.43e3, k_c=0.99e3, exponent=1.1, cohesion=1040.0, friction_angle=math.radians(28.0), elastic=2.0e8,
    ),
}  # fmt: skip
"""Soft and mid soil of Chrono's demonstrations; sand: dry sand of the Land Locomotion Laboratory; hard: LETE sand;
clay: clayey soil of Thailand at 38 % moisture; snow: of the United States (Wong 2008, Theory of Ground Vehicles, table
2.3, which does not have the shear length and elasticity of sand, clay and snow: these are of the usual size).

Densities: loose mixed-grained sand, 1.59 g/cm³ dry, and soft glacial clay, 1.77 g/cm³ saturated (Terzaghi and Peck
1967, Soil Mechanics in Engineering Practice, table 6.3); settled snow, 0.2 to 0.3 g/cm³ (Paterson 1994, The Physics of
Glaciers, table 2.1)."""


def soil_preset(name: str) -> SoilSpec:
    """A published soil.

    Raises:
        ModelError: there is none of this name.
    """
    if name not in PRESETS:
        raise ModelError(f"soil: preset must be {', '.join(PRESETS)}, got {formatted(name)}; or give a SoilSpec")
    return PRESETS[name]


def soils_of(given: Any) -> tuple[SoilSpec, ...]:
    """One soil or several, each a `SoilSpec` or the name of a preset.

    Raises:
        ModelError: there is none, or one is neither.
    """
    listed = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else [given]
    if not listed or not all(isinstance(each, SoilSpec | str) for each in listed):
        raise ModelError(
            f"soil: soil must be a SoilSpec, the name of a preset, or a list of these, got {formatted(given)}; "
            f"presets are {', '.join(PRESETS)}"
        )
    return tuple(soil_preset(each) if isinstance(each, str) else each for each in listed)
