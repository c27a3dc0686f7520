"""Deformable ground: soils, wheels and feet that sink in, ruts that stay (docs/soil.md).

Names are imported on first use: few commands need all of them, and kernels take a while to import.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from simwarp.core.names_on_demand import names_on_demand

# At once: a function of its name would be hidden by the module when that is imported later
from simwarp.soil.soil_shapes import (
    SoilBlade,
    SoilBox,
    SoilCapsule,
    SoilCylinder,
    SoilShape,
    SoilSphere,
    SoilWheel,
    soil_shapes,
)

if TYPE_CHECKING:
    from simwarp.soil.bulldozing import Bulldozing
    from simwarp.soil.soil import PressureNormal, ShearMemory, Soil
    from simwarp.soil.soil_parameters import PAGE_SIDE, PRESETS, SoilParameter, SoilSpec, soil_preset
    from simwarp.soil.soil_sheets import SoilMesh
    from simwarp.soil.vehicle_wheels import pads_of, soil_under, soil_under_tracks, wheels_of

__all__ = [
    "PAGE_SIDE", "PRESETS", "Bulldozing", "PressureNormal", "ShearMemory", "Soil", "SoilBlade", "SoilBox",
    "SoilCapsule", "SoilCylinder", "SoilMesh", "SoilParameter", "SoilShape", "SoilSpec", "SoilSphere", "SoilWheel",
    "pads_of", "soil_preset", "soil_shapes", "soil_under", "soil_under_tracks", "wheels_of",
]  # fmt: skip

_MODULES: Final = {
    "PAGE_SIDE": "soil_parameters", "PRESETS": "soil_parameters", "Bulldozing": "bulldozing", "PressureNormal": "soil",
    "ShearMemory": "soil", "Soil": "soil",
    "SoilMesh": "soil_sheets", "SoilParameter": "soil_parameters",
    "SoilSpec": "soil_parameters",
    "pads_of": "vehicle_wheels", "soil_preset": "soil_parameters",
    "soil_under": "vehicle_wheels", "soil_under_tracks": "vehicle_wheels", "wheels_of": "vehicle_wheels",
}  # fmt: skip

__getattr__ = names_on_demand(__name__, _MODULES)
