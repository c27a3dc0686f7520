"""Driving tasks: vehicles with suspensions, tires and drivetrains, among obstacles, on tracks and off the road.

`DrivingTask` and `LappingTask` are what a task of one's own begins with; `Hills`, `Obstacles`, `Routes` and `RangeFan`
are the parts that the shipped tasks share.
"""

from .base import DrivingTask
from .conditions import Conditions
from .driven_vehicles import CHASSIS_GROUP, DRIVEN_VEHICLES, VEHICLE_ARRAYS, DrivenVehicle, VehicleChoiceConfig
from .driving_config import DrivingConfig, Frame, Observing
from .hills import Hills
from .lapping import LappingConfig, LappingTask, Start
from .obstacles import ObstacleKind, Obstacles
from .outlines import corners, outline
from .ranging import RangeFan
from .routes import Routes
from .soil import SoilKind

__all__ = [
    "CHASSIS_GROUP",
    "DRIVEN_VEHICLES",
    "VEHICLE_ARRAYS",
    "Conditions",
    "DrivenVehicle",
    "DrivingConfig",
    "DrivingTask",
    "Frame",
    "Hills",
    "LappingConfig",
    "LappingTask",
    "Observing",
    "ObstacleKind",
    "Obstacles",
    "RangeFan",
    "Routes",
    "SoilKind",
    "Start",
    "VehicleChoiceConfig",
    "corners",
    "outline",
]
