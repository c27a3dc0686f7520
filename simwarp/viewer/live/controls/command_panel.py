"""Sliders with which a person acts in place of the policy, moves actuators, and commands a task."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from simwarp.actuators import Actuators
from simwarp.viewer.live.controls.joint_coordinates import of_world
from simwarp.viewer.live.controls.sliders import Sliders

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView
    from simwarp.viewer.live.subject import Actions

MOST: Final = 40
"""Sliders of one kind."""


def has_commands(view: LiveView) -> bool:
    """Whether there is anything to command."""
    subject = view.subject
    return subject.actions is not None or bool(subject.details.get("commands")) or _actuators(view) is not None


class CommandPanel:
    """For the chosen world: a slider moved takes its action over; "Policy" gives all of them back."""

    def __init__(self, view: LiveView) -> None:
        self._view = view
        self._given: dict[int, dict[int, float]] = {}
        """What a person gave: world -> component -> value."""
        self._actions = view.subject.actions
        self._actuators = _actuators(view) if self._actions is None else None
        asked = view.subject.details.get("commands")
        self._commands: dict[str, Any] = dict(asked() if asked is not None else {})
        gui = view.server.viser.gui
        with gui.add_folder("Commands", expand_by_default=False):
            if self._commands:
                ranges = list(self._commands.values())
                self._asked = Sliders(
                    view, list(self._commands), [each.low for each in ranges], [each.high for each in ranges], self.ask
                )
            if self._actions is not None:
                self._policy = gui.add_checkbox("Policy", initial_value=True, hint="off: the sliders act")
                self._policy.on_update(self._switched)
                names = self._actions.names[:MOST]
                self._sliders = Sliders(view, names, self._actions.low, self._actions.high, self.act)
            if self._actuators is not None:
                bounds = np.clip(self._actuators.ctrl_range, -1e6, 1e6)
                bounds = np.where(np.abs(bounds) >= 1e6, np.sign(bounds), bounds)
                names = self._actuators.names[:MOST]
                self._controls = Sliders(view, names, bounds[:, 0], bounds[:, 1], self.control)

    def refresh(self, now: float) -> None:
        """Shows what is in force."""
        world = self._view.page.world
        if self._commands:
            self._asked.show([float(each.values[world]) for each in self._commands.values()])
        if self._actuators is not None:
            self._controls.show(of_world(self._actuators.ctrl, world))
        if self._actions is not None:
            given = self._given.get(world, {})
            values = np.asarray(self._actions.values()[world], np.float64).copy()
            for component, value in given.items():
                values[component] = value
            self._sliders.show(values)
            self._tick()

    def act(self, component: int, value: float) -> None:
        """Takes an action of the chosen world over."""
        actions: Actions | None = self._actions
        assert actions is not None
        self._given.setdefault(self._view.page.world, {})[component] = value
        actions.override(self._view.page.world, component, value)
        self._tick()

    def give_back(self) -> None:
        """All actions of the chosen world are the policy's again."""
        assert self._actions is not None
        for component in self._given.pop(self._view.page.world, {}):
            self._actions.override(self._view.page.world, component, None)
        self._tick()

    def hold_all(self) -> None:
        """The chosen world's actions stay as they are until they are moved."""
        assert self._actions is not None
        for component, value in enumerate(self._actions.values()[self._view.page.world]):
            self.act(component, float(value))

    def control(self, column: int, value: float) -> None:
        """Sets the control of an actuator in the chosen world."""
        assert self._actuators is not None
        self._actuators.ctrl[self._view.page.world, column] = value

    def ask(self, index: int, value: float) -> None:
        """Commands a task's number in the chosen world."""
        list(self._commands.values())[index].values[self._view.page.world] = value

    def _tick(self) -> None:
        policy: Any = self._policy
        policy.value = not self._given.get(self._view.page.world)

    def _switched(self, event: Any) -> None:
        if event.client is not None:
            # not by the box's value, which `refresh` may have written since
            self._view.post(lambda: self.give_back() if self._given.get(self._view.page.world) else self.hold_all())


def _actuators(view: LiveView) -> Actuators | None:
    elements = view.subject.simulation.elements
    return next((each for each in elements if isinstance(each, Actuators) and len(each)), None)
