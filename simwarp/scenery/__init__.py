"""Scenery made by computing: rocks, plants, cones, barriers, corridors, tracks, hills, rough ground, textures, bodies.

Makers are pure functions of their arguments, one of which is a seed where something is random: the same arguments give
the same arrays. Lengths are metres, Z is up, X forward, Y left; colours are linear albedos. Whatever stands on the
ground has its origin in the middle of its foot, at ground level.

Names are imported on first use: few commands need all of them, and kernels take a while to import.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from simwarp.core.names_on_demand import names_on_demand
from simwarp.geometry.visual_mesh import VisualMesh, joined

if TYPE_CHECKING:
    from simwarp.scenery.corridors import Corridor, corridor
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

_MODULES: Final = {
    "BUSHES": "plants", "CONES": "roadside", "CONVOY_PATHS": "course", "LEVELS": "rough_ground", "ROCKS": "rocks",
    "TEXTURES": "textures", "TREES": "plants", "VEHICLES": "vehicle_visuals", "Corridor": "corridors",
    "Course": "course", "Detour": "course", "GroundKind": "rough_ground", "GroundPatch": "rough_ground",
    "Label": "visual", "Proxy": "visual", "Track": "tracks", "VehicleVisuals": "vehicle_visuals", "Visual": "visual",
    "add_collision": "visual", "add_tracked_vehicle_visual": "track_visuals", "add_vehicle_visual": "vehicle_visuals",
    "add_visual": "visual", "arranged": "visual", "barrier": "roadside", "barrier_chain": "roadside",
    "beside": "course", "bush": "plants", "cone": "roadside", "convoy_path": "course",
    "convoy_visuals": "vehicle_visuals", "corridor": "corridors", "crate": "roadside", "detour": "course",
    "flattened": "terrain", "ground_patch": "rough_ground", "ground_texture": "textures",
    "has_body": "vehicle_visuals", "height_at": "terrain", "hills": "terrain", "indoor_track": "tracks",
    "level_colors": "rough_ground", "pillar": "roadside", "race_course": "course", "race_track": "tracks",
    "road": "course", "rock": "rocks", "rounded": "tracks", "scattered": "course", "steepness": "terrain",
    "tree": "plants", "vehicle_visual": "vehicle_visuals", "vehicle_visuals_of": "vehicle_visuals",
    "yaw_pose": "visual",
}  # fmt: skip

__getattr__ = names_on_demand(__name__, _MODULES)
