"""Tracked vehicles, shoe by shoe: descriptions from files, chains laid around their wheels, assembly into a model.

spec = load_tracked_vehicle("m113")
"""

from __future__ import annotations

from simwarp.vehicle.spec.track_parts import ShoeTrack, TrackedVehicleSpec
from simwarp.vehicle.tracks.laying import LaidChain, TrackCourse, lay_chain
from simwarp.vehicle.tracks.track_construction import (
    ShoeTrackParts,
    SprocketContact,
    TrackedVehicleParts,
    add_tracked_vehicle,
    course_of,
    drum_radius,
    lay_track,
)
from simwarp.vehicle.tracks.tracked_files import load_tracked_vehicle, save_tracked_vehicle, tracked_vehicle_names

__all__ = [
    "LaidChain",
    "ShoeTrack",
    "ShoeTrackParts",
    "SprocketContact",
    "TrackCourse",
    "TrackedVehicleParts",
    "TrackedVehicleSpec",
    "add_tracked_vehicle",
    "course_of",
    "drum_radius",
    "lay_chain",
    "lay_track",
    "load_tracked_vehicle",
    "save_tracked_vehicle",
    "tracked_vehicle_names",
]
