"""What sensors of the chosen world see."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from simwarp.viewer.live.controls.joint_coordinates import of_world
from simwarp.viewer.live.controls.sensor_views import CameraView, ChannelView, PointsView, view_of
from simwarp.viewer.live.page_controls import post_value

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

NONE: Final = "none"


class SensorPanel:
    """A sensor is chosen from a list; without one nothing is read."""

    def __init__(self, view: LiveView) -> None:
        self._view = view
        self._sensors = {str(sensor.name): sensor for sensor in view.subject.simulation.sensors}
        self._name = NONE
        self._shown: CameraView | PointsView | ChannelView | None = None
        self._frame: tuple[int, float] = (-1, -1.0)
        gui = view.server.viser.gui
        self._folder = gui.add_folder("Sensors", expand_by_default=False)
        with self._folder:
            choice = gui.add_dropdown("Sensor", (NONE, *self._sensors))
        post_value(view, choice.on_update, self.choose)

    def choose(self, name: str) -> None:
        """Shows another sensor, or none."""
        if self._shown is not None:
            self._shown.remove()
            self._shown = None
        self._name, self._frame = name, (-1, -1.0)
        if name != NONE:
            with self._folder:
                self._shown = view_of(self._view, self._sensors[name])

    def refresh(self, now: float) -> None:
        """The newest frame, if it has not been shown."""
        if self._shown is None:
            return
        world = self._view.page.world
        frame = (world, float(of_world(self._sensors[self._name].timestamp, world)))
        if frame != self._frame or isinstance(self._shown, PointsView):
            self._frame = frame
            self._shown.draw(world)
