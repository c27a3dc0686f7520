"""The web viewer: a page on running simulations. Needs `simwarp[viewer]`."""

from __future__ import annotations

from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.page_panels import show
from simwarp.viewer.live.subject import Actions, Path, Subject, subject_of
from simwarp.viewer.live.world_layout import Layout

__all__ = ["Actions", "Layout", "LiveView", "Path", "Subject", "show", "subject_of"]
