"""Robots on legs that follow commanded velocities, on flat and on rough ground and on soil."""

from .config import VelocityConfig, VelocityObs
from .ground import Climbing, FlatGround, Ground, RoughConfig, RoughGround, ScanConfig, ground_of
from .height_scan import RayScan
from .hexapod import HexapodVelocity, HexapodVelocityConfig
from .legged import LeggedTask
from .quadruped import QuadrupedVelocity
from .walked_soil import WalkedSoilConfig, WalkedSoilKind

__all__ = [
    "Climbing",
    "FlatGround",
    "Ground",
    "HexapodVelocity",
    "HexapodVelocityConfig",
    "LeggedTask",
    "QuadrupedVelocity",
    "RayScan",
    "RoughConfig",
    "RoughGround",
    "ScanConfig",
    "VelocityConfig",
    "VelocityObs",
    "WalkedSoilConfig",
    "WalkedSoilKind",
    "ground_of",
]
