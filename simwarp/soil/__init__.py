"""Deformable ground: soils, wheels and feet that sink in, ruts that stay (docs/soil.md)."""

from simwarp.soil.bulldozing import Bulldozing
from simwarp.soil.soil import PressureNormal, ShearMemory, Soil
from simwarp.soil.soil_parameters import PAGE_SIDE, PRESETS, SoilParameter, SoilSpec, soil_preset
from simwarp.soil.soil_shapes import SoilBox, SoilCapsule, SoilCylinder, SoilShape, SoilSphere, SoilWheel, soil_shapes
from simwarp.soil.soil_sheets import SoilMesh
from simwarp.soil.vehicle_wheels import pads_of, soil_under, soil_under_tracks, wheels_of

__all__ = [
    "PAGE_SIDE", "PRESETS", "Bulldozing", "PressureNormal", "ShearMemory", "Soil", "SoilBox", "SoilCapsule",
    "SoilCylinder", "SoilMesh", "SoilParameter", "SoilShape", "SoilSpec", "SoilSphere", "SoilWheel", "pads_of",
    "soil_preset", "soil_shapes", "soil_under", "soil_under_tracks", "wheels_of",
]  # fmt: skip
