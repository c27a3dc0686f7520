"""The panels of a page: those that its subject has something for."""

from __future__ import annotations

from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.recording_panel import RecordingPanel
from simwarp.viewer.live.run_panel import RunPanel
from simwarp.viewer.live.training_panel import TrainingPanel
from simwarp.viewer.live.vehicle_panel import add_driving


def add_panels(view: LiveView) -> None:
    """Adds to a view's page what its subject has something for."""
    view.panels.append(RunPanel(view))
    view.panels.append(RecordingPanel(view))
    if "training" in view.subject.details:
        view.panels.append(TrainingPanel(view, view.subject.details["training"]))
    add_driving(view)
