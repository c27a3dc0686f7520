"""Readers of what other programs write.

robot = sw.importers.load_urdf("robot.urdf", base="fixed")
spec = sw.importers.load_chrono_vehicle("HMMWV_Vehicle.json")
"""

from __future__ import annotations

from simwarp.importers.chrono_sensors import load_chrono_sensor
from simwarp.importers.chrono_tracks import load_chrono_tracked_vehicle
from simwarp.importers.chrono_vehicle import load_chrono_vehicle
from simwarp.importers.imported import Imported
from simwarp.importers.mjcf.mjcf_reader import load_mjcf
from simwarp.importers.report import ImportedWarning, ImportReport
from simwarp.importers.saved_robot import load_robot, save_robot
from simwarp.importers.solidworks.solidworks_reader import load_solidworks
from simwarp.importers.step.step_reader import load_step
from simwarp.importers.urdf.urdf_reader import load_urdf
from simwarp.importers.usd.usd_reader import load_usd

__all__ = [
    "ImportReport",
    "Imported",
    "ImportedWarning",
    "load_chrono_sensor",
    "load_chrono_tracked_vehicle",
    "load_chrono_vehicle",
    "load_mjcf",
    "load_robot",
    "load_solidworks",
    "load_step",
    "load_urdf",
    "load_usd",
    "save_robot",
]
