"""Pictures and videos of simulations by free cameras; `show` and `LiveView` open a page in the browser.

Names are imported on first use: the web server starts before the kernels are compiled, and needs viser.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from simwarp.core.names_on_demand import names_on_demand

if TYPE_CHECKING:
    from simwarp.viewer.default_visuals import add_bodies, add_skeleton, paint
    from simwarp.viewer.free_camera import FreeCamera
    from simwarp.viewer.line_overlay import Polyline, draw_lines
    from simwarp.viewer.live.live_view import LiveView
    from simwarp.viewer.live.page_panels import show
    from simwarp.viewer.portrait import portrait
    from simwarp.viewer.sheets import caption, grid
    from simwarp.viewer.studio import FollowCamera, Shot

__all__ = [
    "FollowCamera", "FreeCamera", "LiveView", "Polyline", "Shot", "add_bodies", "add_skeleton", "caption", "draw_lines",
    "grid", "paint", "portrait", "show",
]  # fmt: skip

_MODULES: Final = {
    "FollowCamera": "studio", "FreeCamera": "free_camera", "LiveView": "live.live_view", "Polyline": "line_overlay",
    "Shot": "studio", "add_bodies": "default_visuals", "add_skeleton": "default_visuals", "caption": "sheets",
    "draw_lines": "line_overlay", "grid": "sheets", "paint": "default_visuals", "portrait": "portrait",
    "show": "live.page_panels",
}  # fmt: skip

__getattr__ = names_on_demand(__name__, _MODULES)
