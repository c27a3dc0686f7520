"""Scenery made by computing: rocks, plants, cones, barriers, corridors, tracks, hills, rough ground, textures, bodies.

Makers are pure functions of their arguments, one of which is a seed where something is random: the same arguments give
the same arrays. Lengths are metres, Z is up, X forward, Y left; colours are linear albedos. Whatever stands on the
ground has its origin in the middle of its foot, at ground level.
"""

from __future__ import annotations

from simwarp.geometry.visual_mesh import VisualMesh, joined
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
from simwarp.scenery.roadside import CONES, barrier, barrier_chain, cone, crate, pillar
from simwarp.scenery.rocks import ROCKS, rock
from simwarp.scenery.rough_ground import LEVELS, GroundKind, GroundPatch, ground_patch, level_colors
from simwarp.scenery.terrain import flattened, height_at, hills, steepness
from simwarp.scenery.textures import TEXTURES, ground_texture
from simwarp.scenery.track_visuals import add_tracked_vehicle_visual
from simwarp.scenery.tracks import Track, indoor_track, race_track, rounded
from simwarp.scenery.vehicle_visuals import (
    VEHICLES,
    VehicleVisuals,
    add_vehicle_visual,
    convoy_visuals,
    has_body,
    vehicle_visual,
    vehicle_visuals_of,
)
from simwarp.scenery.visual import Label, Proxy, Visual, add_collision, add_visual, arranged, yaw_pose

__all__ = [
    "BUSHES", "CONES", "CONVOY_PATHS", "LEVELS", "ROCKS", "TEXTURES", "TREES", "VEHICLES", "Corridor", "Course",
    "Detour", "GroundKind", "GroundPatch", "Label", "Proxy", "Track", "VehicleVisuals", "Visual", "VisualMesh",
    "add_collision", "add_tracked_vehicle_visual", "add_vehicle_visual", "add_visual", "arranged", "barrier",
    "barrier_chain", "beside", "bush", "cone",
    "convoy_path", "convoy_visuals", "corridor", "crate", "detour", "flattened", "ground_patch",
    "ground_texture", "has_body", "height_at", "hills", "indoor_track", "joined", "level_colors", "pillar",
    "race_course", "race_track", "road", "rock", "rounded", "scattered", "steepness", "tree", "vehicle_visual",
    "vehicle_visuals_of", "yaw_pose",
]  # fmt: skip
