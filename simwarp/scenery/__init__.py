"""Scenery made by computing: rocks, plants, cones, barriers, corridors, tracks, hills, textures, vehicle bodies.

Makers are pure functions of their arguments, one of which is a seed where something is random: the same arguments give
the same arrays. Lengths are metres, Z is up, X forward, Y left; colours are linear albedos. Whatever stands on the
ground has its origin in the middle of its foot, at ground level.
"""

from __future__ import annotations

from simwarp.scenery.corridor import Corridor, corridor
from simwarp.scenery.course import (
    CONVOY_PATHS,
    Course,
    Detour,
    beside,
    convoy_path,
    detour,
    race_course,
    road,
    scattered,
)
from simwarp.scenery.plants import BUSHES, TREES, bush, tree
from simwarp.scenery.prop import Label, Prop, Proxy, add_collision, add_picture, arranged, yaw_pose
from simwarp.scenery.roadside import CONES, barrier, barrier_chain, cone, crate, pillar
from simwarp.scenery.rocks import ROCKS, rock
from simwarp.scenery.terrain import flattened, height_at, hills, steepness
from simwarp.scenery.textures import TEXTURES, ground_texture
from simwarp.scenery.tracks import Track, indoor_track, race_track, rounded
from simwarp.scenery.vehicle_visuals import VEHICLES, VehicleLook, add_vehicle_picture, vehicle_look, vehicle_prop

__all__ = [
    "BUSHES", "CONES", "CONVOY_PATHS", "ROCKS", "TEXTURES", "TREES", "VEHICLES", "Corridor", "Course", "Detour",
    "Label", "Prop", "Proxy", "Track", "VehicleLook", "add_collision", "add_picture", "add_vehicle_picture", "arranged",
    "barrier", "barrier_chain", "beside", "bush", "cone", "convoy_path", "corridor", "crate", "detour", "flattened",
    "ground_texture", "height_at", "hills", "indoor_track", "pillar", "race_course", "race_track", "road", "rock",
    "rounded", "scattered", "steepness", "tree", "vehicle_look", "vehicle_prop", "yaw_pose",
]  # fmt: skip
