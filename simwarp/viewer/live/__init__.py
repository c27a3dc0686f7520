"""The web viewer: a page on running simulations. Needs `simwarp[viewer]`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from simwarp.core.names_on_demand import names_on_demand

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView
    from simwarp.viewer.live.page_panels import show
    from simwarp.viewer.live.subject import Actions, Path, Subject, subject_of
    from simwarp.viewer.live.world_layout import Layout

__all__ = ["Actions", "Layout", "LiveView", "Path", "Subject", "show", "subject_of"]

_MODULES: Final = {
    "Actions": "subject", "Layout": "world_layout", "LiveView": "live_view", "Path": "subject", "Subject": "subject",
    "show": "page_panels", "subject_of": "subject",
}  # fmt: skip

__getattr__ = names_on_demand(__name__, _MODULES)
