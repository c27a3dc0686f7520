"""Pictures and videos of simulations, by cameras that belong to nobody's body."""

from __future__ import annotations

from simwarp.viewer.free_camera import FreeCamera
from simwarp.viewer.lines import Polyline, draw_lines
from simwarp.viewer.painting import add_bodies, add_skeleton, paint
from simwarp.viewer.sheets import caption, grid
from simwarp.viewer.studio import Shot, Studio

__all__ = [
    "FreeCamera", "Polyline", "Shot", "Studio", "add_bodies", "add_skeleton", "caption", "draw_lines", "grid", "paint",
]  # fmt: skip
