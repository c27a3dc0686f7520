"""Deformable ground: soils, wheels that sink in, ruts that stay (docs/soil.md)."""

from simwarp.soil.soil import ShearMemory, Soil, SoilWheel
from simwarp.soil.soil_parameters import PRESETS, SoilSpec, soil_preset
from simwarp.soil.vehicle_wheels import soil_under, wheels_of

__all__ = ["PRESETS", "ShearMemory", "Soil", "SoilSpec", "SoilWheel", "soil_preset", "soil_under", "wheels_of"]
