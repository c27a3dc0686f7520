"""The switch "Drive" of a page: gives its keys and gamepads to a vehicle, and stands the camera behind it."""

from __future__ import annotations

import functools
import json
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from simwarp.viewer.live.web_server import TOKEN, run_script
from simwarp.viewer.live.wheel.chase import Chase, Eye
from simwarp.viewer.live.wheel.driving import PATH, TAKEN, Driving, Wheel
from simwarp.viewer.live.wheel.human_driver import Keys

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

STOP = "if (window.simwarpDrive) window.simwarpDrive.stop();"


@functools.cache
def _script() -> str:
    return (files("simwarp.viewer.live.wheel") / "keys.js").read_text(encoding="utf-8")


class DrivePanel:
    """Drive, camera and keys.

    Args:
        view: that it belongs to.
        wheel: what is driven.

    Attributes:
        driving: hands inputs over.
        chase: the camera.
    """

    def __init__(self, view: LiveView, wheel: Wheel) -> None:
        self._view = view
        self.driving = Driving(wheel, view.wheel, view.subject.dt, self._world, self._pressed)
        self.chase = Chase(view.page, wheel.vehicle)
        view.preparers.append(self.driving.before_step)
        gui = view.server.viser.gui
        with gui.add_folder("Drive"):
            self._switch = gui.add_checkbox("Drive", initial_value=False, hint="keys and gamepad of your page")
            self._keys = gui.add_dropdown("Keys", tuple(kind.value for kind in Keys), initial_value="smooth")
            self._eye = gui.add_dropdown("Camera", tuple(kind.value for kind in Eye), initial_value="behind", hint="C")
            self._line = gui.add_markdown("")

        @self._switch.on_update
        def _(event: Any) -> None:
            client, on = event.client, bool(self._switch.value)
            if client is not None:  # else it was set by `switch`
                view.post(lambda: self._switched(on, [client]))

        @self._keys.on_update
        def _(_: Any) -> None:
            keys = Keys(self._keys.value)
            view.post(lambda: setattr(self.driving.driver, "keys", keys))

        @self._eye.on_update
        def _(event: Any) -> None:
            eye = Eye(self._eye.value)
            if event.client is not None:
                view.post(lambda: self.chase.use(eye))

        @view.server.viser.on_client_connect
        def _(client: Any) -> None:
            if view.wheel.open:
                run_script(client, self.script())

    def script(self) -> str:
        """What a page runs that drives."""
        config = {"path": f"{PATH}?{TOKEN}={self._view.server.token}", "gears": self.driving.wheel.gears}
        return _script().replace("__CONFIG__", json.dumps(config))

    def switch(self, on: bool, keys: Keys = Keys.SMOOTH) -> None:
        """Switches driving on or off: the first page that is opened drives."""
        self.driving.driver.keys = keys
        self._set(self._keys, keys.value)
        self._set(self._switch, on)
        self._switched(on, list(self._view.server.viser.get_clients().values()))

    def refresh(self, now: float) -> None:
        """Tells whether somebody drives."""
        line = ""
        wheel = self._view.wheel
        if wheel.open:
            line = (
                "W A S D or arrows, Space brakes, R resets" if self._view.wheel.occupied else "nobody is at the wheel"
            )
        if self._line.content != line:
            self._line.content = line

    def _switched(self, on: bool, clients: list[Any]) -> None:
        self._view.wheel.open = on
        if on:
            self.chase.use(self.chase.eye)  # also while paused, when nothing is driven yet
            for client in clients:
                run_script(client, self.script())
            return
        self.chase.leave()
        for client in self._view.server.viser.get_clients().values():
            run_script(client, STOP)

    def _world(self) -> int:
        page = self._view.page
        return int(page.worlds[page.chosen])

    def _pressed(self, button: str) -> None:
        if button == "reset":
            mask = np.zeros(self._view.subject.simulation.model.world_count, bool)
            mask[self._world()] = True
            self._view.reset(mask)
        elif button == TAKEN:
            self.chase.use(self.chase.eye)
        elif button == "camera":
            self.chase.use(self.chase.eye.next)
            self._set(self._eye, self.chase.eye.value)

    @staticmethod
    def _set(control: Any, value: Any) -> None:
        control.value = value
