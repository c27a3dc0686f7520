"""The panels of a page, those that its subject has something for, and a page with all of them."""

from __future__ import annotations

import time
import webbrowser
from collections.abc import Sequence

from simwarp.sensors.scene import Scene
from simwarp.simulation.simulation import Simulation
from simwarp.viewer.live.controls.command_panel import CommandPanel, has_commands
from simwarp.viewer.live.controls.dragging import Dragging
from simwarp.viewer.live.controls.joint_coordinates import coordinates_of
from simwarp.viewer.live.controls.joint_panel import JointPanel
from simwarp.viewer.live.controls.plot_panel import PlotPanel
from simwarp.viewer.live.controls.sensor_panel import SensorPanel
from simwarp.viewer.live.controls.show_panel import ShowPanel
from simwarp.viewer.live.driving.browser_driving import vehicle_of, wheel_of
from simwarp.viewer.live.hand import hand_of
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.recording_panel import RecordingPanel
from simwarp.viewer.live.run_panel import RunPanel
from simwarp.viewer.live.subject import Subject
from simwarp.viewer.live.training_panel import TrainingPanel
from simwarp.viewer.live.world_layout import Layout


def add_panels(view: LiveView) -> None:
    """Adds to a view's page what its subject has something for."""
    subject = view.subject
    view.panels.append(RunPanel(view))
    _add_driving(view)
    if "training" in subject.details:
        view.panels.append(TrainingPanel(view, subject.details["training"]))
    view.panels += [ShowPanel(view), RecordingPanel(view)]
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


def _add_driving(view: LiveView) -> None:
    """The dashboard of a subject with a vehicle, and the switch to drive it where nothing else does."""
    wheel, vehicle = wheel_of(view.subject), vehicle_of(view.subject)
    if wheel is not None:
        from simwarp.viewer.live.driving.drive_panel import DrivePanel

        view.panels.append(DrivePanel(view, wheel))
    if vehicle is not None:
        from simwarp.viewer.live.driving.vehicle_panel import VehiclePanel

        view.panels.append(VehiclePanel(view, vehicle))


def show(
    simulation: Simulation | Subject, *, scene: Scene | None = None, worlds: int | Sequence[int] = 16,
    layout: Layout | str | None = None, port: int = 8080, open_browser: bool = True, seconds: float | None = None,
) -> LiveView:  # fmt: skip
    """Opens a page on a simulation and runs it at real time until Ctrl-C.

    Args:
        simulation: also a `Subject`.
        scene: what is seen; its shapes when None.
        worlds: how many are shown, or which.
        layout: "grid", "overlay" or "one".
        port: of the page; the next free one is taken.
        open_browser: whether a browser is opened.
        seconds: ends after that much time by the clock.

    Returns:
        The view, with its server closed.
    """
    view = LiveView(simulation, scene=scene, worlds=worlds, layout=layout, port=port)
    add_panels(view)
    print(f"view  {view.url}", flush=True)
    if open_browser:
        webbrowser.open(view.url)
    end = None if seconds is None else time.perf_counter() + seconds
    try:
        view.run(None if end is None else lambda: time.perf_counter() >= end)
    except KeyboardInterrupt:
        pass
    finally:
        view.stop()
    return view
