"""Sliders of joints: paused they place the chosen world, running they are targets of its drives."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from simwarp.core.types import WorldStatus
from simwarp.viewer.live.controls.joint_coordinates import Coordinate, coordinates_of, of_world
from simwarp.viewer.live.controls.sliders import Sliders
from simwarp.viewer.live.page_controls import post_value, set_changed

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

MOST: Final = 40
"""Sliders; of more coordinates one is chosen."""


class JointPanel:
    """Coordinates of the chosen world."""

    def __init__(self, view: LiveView) -> None:
        self._view = view
        self._all = coordinates_of(view.subject.simulation.model)
        self._seen: list[Coordinate] = self._all if len(self._all) <= MOST else self._all[:1]
        self._sliders: Sliders | None = None
        gui = view.server.viser.gui
        self._folder = gui.add_folder("Joints", expand_by_default=False)
        with self._folder:
            self._note = gui.add_markdown("")
            box = gui.add_checkbox("Sliders", initial_value=False, hint="paused: place it; running: targets of drives")
            if len(self._all) > MOST:
                listed = gui.add_dropdown("Joint", tuple(dict.fromkeys(each.name for each in self._all)))
                post_value(view, listed.on_update, self.choose)
        post_value(view, box.on_update, self.show)

    def show(self, on: bool) -> None:
        """Makes the sliders, or takes them away."""
        if self._sliders is not None:
            self._sliders.remove()
            self._sliders = None
        if on:
            with self._folder:
                names = [each.name for each in self._seen]
                low, high = [each.low for each in self._seen], [each.high for each in self._seen]
                self._sliders = Sliders(self._view, names, low, high, self.move)

    def choose(self, name: str) -> None:
        """Another joint, where there are too many for sliders of all."""
        self._seen = [each for each in self._all if each.name == name][:1]
        self.show(self._sliders is not None)

    def move(self, index: int, value: float) -> None:
        """A slider was moved: paused it places the chosen world, running it is the target of a drive."""
        view, each = self._view, self._seen[index]
        simulation, world = view.subject.simulation, view.page.world
        if view.paused:
            q = simulation.state.joint_q.numpy().copy()
            q[world, each.column] = value
            simulation.set_joint_state(view.page.mask, q, None)
        elif each.driven:
            simulation.control.joint_target_q[world, each.column] = value

    def refresh(self, now: float) -> None:
        """Shows coordinates, or targets of drives while it runs."""
        if self._sliders is None:
            return
        view, world = self._view, self._view.page.world
        simulation = view.subject.simulation
        q = of_world(simulation.state.joint_q, world)
        targets = q if view.paused else of_world(simulation.control.joint_target_q, world)
        self._sliders.show([(targets if each.driven else q)[each.column] for each in self._seen])
        note = self._status_text(WorldStatus(int(of_world(simulation.state.world_status, world))))
        set_changed(self._note, content=note)

    def _status_text(self, status: WorldStatus) -> str:
        if status & WorldStatus.NOT_ASSEMBLED:
            return '<span style="color:#d33">NOT_ASSEMBLED</span>: the loops do not close there'
        if status & WorldStatus.NON_FINITE:
            return '<span style="color:#d33">NON_FINITE</span>: reset this world'
        if self._view.paused:
            return "paused: sliders place this world"
        return "sliders are targets" if any(each.driven for each in self._seen) else "pause to place this world"
