"""Sensors: cameras, lidar and radar by ray casting; inertial, satellite, magnetic and joint sensors."""

from simwarp.sensors.clock import Field, Frames, mount_arrays
from simwarp.sensors.interface import Mount, Schedule, Sensor

__all__ = ["Field", "Frames", "Mount", "Schedule", "Sensor", "mount_arrays"]
