"""Driving tasks: vehicles with suspensions, tires and drivetrains, among obstacles, on tracks and off the road."""

from .base import DrivingConfig, DrivingTask

__all__ = ["DrivingConfig", "DrivingTask"]
