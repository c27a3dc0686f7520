"""Pictures and videos of simulations, by cameras that belong to nobody's body."""

from __future__ import annotations

from simwarp.core.renames import renamed_names
from simwarp.viewer.default_appearance import add_bodies, add_skeleton, paint
from simwarp.viewer.free_camera import FreeCamera
from simwarp.viewer.lines import Polyline, draw_lines
from simwarp.viewer.portrait import portrait
from simwarp.viewer.sheets import caption, grid
from simwarp.viewer.studio import FollowCamera, Shot

__all__ = [
    "FollowCamera", "FreeCamera", "Polyline", "Shot", "add_bodies", "add_skeleton", "caption", "draw_lines", "grid",
    "paint", "portrait",
]  # fmt: skip

__getattr__ = renamed_names(__name__, Studio="FollowCamera")
