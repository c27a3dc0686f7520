"""The switch "Drive" of a page: gives its keys and gamepads to a vehicle, and stands the camera behind it."""

from __future__ import annotations

import functools
import json
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from simwarp.viewer.live.driving.browser_driving import PATH, TAKEN, Driving, Wheel
from simwarp.viewer.live.driving.chase import Chase, Eye
from simwarp.viewer.live.driving.human_driver import Keys
from simwarp.viewer.live.page_controls import post_value, set_changed
from simwarp.viewer.live.web_server import TOKEN, run_script

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

STOP = "if (window.simwarpDrive) window.simwarpDrive.stop();"


@functools.cache
def _script() -> str:
    return (files("simwarp.viewer.live.driving") / "keys.js").read_text(encoding="utf-8")


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
        self.driving = Driving(wheel, view.wheel, view.subject.dt, lambda: view.page.world, self._pressed)
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

        post_value(view, self._keys.on_update, lambda keys: setattr(self.driving.driver, "keys", Keys(keys)))
        post_value(view, self._eye.on_update, lambda eye: self.chase.use(Eye(eye)), by_person=True)

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
        set_changed(self._keys, value=keys.value)
        set_changed(self._switch, value=on)
        self._switched(on, list(self._view.server.viser.get_clients().values()))

    def refresh(self, now: float) -> None:
        """Tells whether somebody drives."""
        wheel = self._view.wheel
        line = "W A S D or arrows, Space brakes, R resets" if wheel.occupied else "nobody is at the wheel"
        set_changed(self._line, content=line if wheel.open else "")

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

    def _pressed(self, button: str) -> None:
        if button == "reset":
            self._view.reset(self._view.page.mask)
        elif button == TAKEN:
            self.chase.use(self.chase.eye)
        elif button == "camera":
            self.chase.use(self.chase.eye.next)
            set_changed(self._eye, value=self.chase.eye.value)
