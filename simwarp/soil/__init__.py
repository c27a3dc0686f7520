"""Deformable ground: soils, wheels that sink in, ruts that stay (docs/soil.md)."""

from simwarp.soil.soil import ShearMemory, Soil, SoilWheel
from simwarp.soil.soil_parameters import PRESETS, SoilSpec, soil_preset

__all__ = ["PRESETS", "ShearMemory", "Soil", "SoilSpec", "SoilWheel", "soil_preset"]
