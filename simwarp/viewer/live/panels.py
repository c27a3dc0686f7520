"""The panels of a page: those that its subject has something for."""

from __future__ import annotations

from simwarp.viewer.live.controls.command_panel import CommandPanel, has_commands
from simwarp.viewer.live.controls.dragging import Dragging
from simwarp.viewer.live.controls.joint_channels import coordinates_of
from simwarp.viewer.live.controls.joint_panel import JointPanel
from simwarp.viewer.live.controls.plot_panel import PlotPanel
from simwarp.viewer.live.controls.sensor_panel import SensorPanel
from simwarp.viewer.live.controls.show_panel import ShowPanel
from simwarp.viewer.live.hand import hand_of
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.run_panel import RunPanel


def add_panels(view: LiveView) -> None:
    """Adds to a view's page what its subject has something for."""
    subject = view.subject
    view.panels += [RunPanel(view), ShowPanel(view)]
    if has_commands(view):
        view.panels.append(CommandPanel(view))
    if coordinates_of(subject.simulation.model):
        view.panels.append(JointPanel(view))
    if subject.simulation.sensors:
        view.panels.append(SensorPanel(view))
    if subject.series:
        view.panels.append(PlotPanel(view))
    hand = hand_of(subject.simulation.elements)
    if hand is not None:
        view.panels.append(Dragging(view, hand))
