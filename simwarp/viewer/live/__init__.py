"""The web viewer: a page on running simulations. Needs `simwarp[viewer]`."""

from __future__ import annotations

from simwarp.viewer.live.layouts import Layout
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.panels import show
from simwarp.viewer.live.subject import Actions, Path, Subject, subject_of

__all__ = ["Actions", "Layout", "LiveView", "Path", "Subject", "show", "subject_of"]
