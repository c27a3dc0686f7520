"""The panels of a page: those that its subject has something for."""

from __future__ import annotations

from simwarp.viewer.live.dragging import Dragging
from simwarp.viewer.live.hand import hand_of
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.run_panel import RunPanel


def add_panels(view: LiveView) -> None:
    """Adds to a view's page what its subject has something for."""
    view.panels.append(RunPanel(view))
    hand = hand_of(view.subject.simulation.elements)
    if hand is not None:
        view.panels.append(Dragging(view, hand))
