"""Pictures and videos of simulations, by cameras that belong to nobody's body; `show` and `LiveView` in a browser."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from simwarp.viewer.live import LiveView as LiveView
    from simwarp.viewer.live import show as show

_renamed = renamed_names(__name__, Studio="FollowCamera")


def __getattr__(name: str) -> Any:
    """What shows a page is imported when it is asked for: it needs viser."""
    if name in ("LiveView", "show"):
        return getattr(importlib.import_module("simwarp.viewer.live"), name)
    return _renamed(name)
