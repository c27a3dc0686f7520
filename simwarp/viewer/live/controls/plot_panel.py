"""Lines of what the subject names: rewards, observations, joints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simwarp.viewer.live.controls.charts import MOST_LINES, Chart
from simwarp.viewer.live.controls.joint_coordinates import of_world

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView


class PlotPanel:
    """Up to eight lines of the chosen world; only those that are chosen are read."""

    def __init__(self, view: LiveView) -> None:
        self._view = view
        self._lines: list[str] = []
        self._world = -1
        gui = view.server.viser.gui
        with gui.add_folder("Plots", expand_by_default=False):
            self._choice = gui.add_dropdown("Series", tuple(view.subject.series))
            buttons = gui.add_button_group("Line", ("add", "remove", "clear"))
            self._chart = Chart(view, ())

        @buttons.on_click
        def _(event: Any) -> None:
            what, name = str(event.target.value), str(self._choice.value)
            view.post(lambda: self.change(what, name))

    def change(self, what: str, name: str) -> None:
        """Adds a line, removes it, or removes all."""
        lines = self._lines
        if what == "clear":
            lines = []
        elif what == "remove":
            lines = [each for each in lines if each != name]
        elif name not in lines and len(lines) < MOST_LINES:
            lines = [*lines, name]
        if lines != self._lines:
            self._lines = lines
            self._chart.show(lines)

    def refresh(self, now: float) -> None:
        """One more point."""
        if not self._lines:
            return
        view = self._view
        world = view.page.world
        if world != self._world:
            self._world = world
            self._chart.clear()
        series = view.subject.series
        time = float(of_world(view.subject.simulation.state.world_time, world))
        self._chart.add(time, [series[name](world) for name in self._lines])
