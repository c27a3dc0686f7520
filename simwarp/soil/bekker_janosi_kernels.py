"""Pressure over sinkage (Bekker), shear over way (Janosi and Hanamoto), of one node.

Bekker (1969), Introduction to Terrain-Vehicle Systems; Wong (2008), Theory of Ground Vehicles, chapter 2; unloading as
in Krenn and Hirzinger's SCM (2009).
"""

import warp as wp

from simwarp.soil.soil_columns_kernels import COHESION, DAMPING, ELASTIC, EXPONENT, K_C, K_PHI, SHEAR_LENGTH, TAN_PHI

wp.set_module_options({"enable_backward": False, "max_unroll": 0})


@wp.struct
class Law:
    """Parameters of the soil at a wheel."""

    stiffness: float  # k_c / b + k_phi
    exponent: float
    cohesion: float
    tan_phi: float
    shear_length: float
    elastic: float
    damping: float


@wp.func
def law_of(world: int, soil: int, inverse_b: float, parameter: wp.array3d[float]) -> Law:
    """The law of a soil for a patch whose shorter half side is 1 / `inverse_b` [1/m]."""
    law = Law()
    law.stiffness = parameter[world, soil, K_PHI] + parameter[world, soil, K_C] * inverse_b
    law.exponent = parameter[world, soil, EXPONENT]
    law.cohesion = parameter[world, soil, COHESION]
    law.tan_phi = parameter[world, soil, TAN_PHI]
    law.shear_length = parameter[world, soil, SHEAR_LENGTH]
    law.elastic = parameter[world, soil, ELASTIC]
    law.damping = parameter[world, soil, DAMPING]
    return law


@wp.struct
class Pressed:
    """A node at a sinkage: pressure without damping, and what it would remember."""

    pressure: float  # [Pa]
    plastic: float  # sinkage that stays [m]
    limit: float  # pressure at which it yields again [Pa]


@wp.func
def press(sinkage: float, plastic: float, limit: float, law: Law) -> Pressed:
    """Elastic below the yield pressure and where Bekker's curve is above it, else on that curve."""
    p = Pressed()
    p.plastic = plastic
    p.limit = limit
    p.pressure = law.elastic * (sinkage - plastic)
    if p.pressure <= 0.0 or sinkage <= 0.0:
        p.pressure = 0.0
    elif p.pressure > limit:
        # Where loading is the stiffer of both, the soil is elastic: yielding would push it up
        bekker = law.stiffness * wp.pow(sinkage, law.exponent)
        if bekker < p.pressure:
            p.pressure = bekker
            p.limit = bekker
            p.plastic = sinkage - bekker / law.elastic
    return p
