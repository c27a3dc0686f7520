"""A manoeuvre in a page while it is driven and recorded: `simwarp drive --view`."""

from __future__ import annotations

import time
from typing import Final

from simwarp.cli.view.maneuver_scene import maneuver_scene
from simwarp.core.types import ModelError
from simwarp.vehicle.results.runs import SAMPLE_TIME, Progress, Setup
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle
from simwarp.viewer.live.driving.chase import Chase, Eye
from simwarp.viewer.live.live_view import LiveView
from simwarp.viewer.live.pacing import Pace
from simwarp.viewer.live.page_panels import add_panels
from simwarp.viewer.live.subject import Mask, Subject
from simwarp.viewer.studio import Shot

OPENING: Final = 10.0
"""Time that a browser is waited for [s]."""
REST: Final = 1.0 / 30.0


def maneuver_subject(setup: Setup[AnyVehicle], name: str) -> Subject:
    """A manoeuvre's simulation with the vehicle's body and its ground, as a subject that the manoeuvre moves on."""

    def refuse(mask: Mask | None) -> None:
        raise ModelError("drive: a manoeuvre cannot begin again, for its record would jump; start it anew")

    shot = Shot(body=setup.vehicle.parts.chassis, target=(0.0, 0.0, 0.3), eye=(-7.0, -5.0, 3.2))
    return Subject(
        name, setup.simulation, maneuver_scene(setup), SAMPLE_TIME, lambda: None, refuse, shot,
        elements={"vehicle": setup.vehicle},
    )  # fmt: skip


class ManeuverView:
    """Shows a manoeuvre at the speed of its page; pausing holds it, closing all pages does not.

    Args:
        setup: of the manoeuvre.
        name: title of the page.
        port: of it; the next free one is taken.

    Attributes:
        view: the page.
    """

    def __init__(self, setup: Setup[AnyVehicle], name: str, port: int = 8080) -> None:
        worlds = setup.simulation.model.world_count
        subject = maneuver_subject(setup, name)
        subject.advance = self._let_pass
        self.view = LiveView(subject, worlds=min(worlds, 16), port=port)
        add_panels(self.view)
        Chase(self.view.page, setup.vehicle).use(Eye.BEHIND)
        self._pace = Pace(SAMPLE_TIME)
        self._passes = 0

    def wait(self) -> None:
        """Until a browser has come, or for ten seconds."""
        end = time.perf_counter() + OPENING
        while not self.view.server.watched and time.perf_counter() < end:
            time.sleep(REST)
        self._pace.rest()

    def advance(self, t: float) -> None:
        """To be called after every 10 ms of the manoeuvre; waits until they are over by the clock, or pausing is."""
        view = self.view
        view.obey()
        view.step()
        self._pace.wait(view.speed, view.obey)
        view.factor = self._pace.factor
        while view.paused and not self._passes:
            self._pace.rest()
            self._rest()
        self._passes = 0

    def beside(self, progress: Progress) -> Progress:
        """Both, after every row of the record."""

        def advance(t: float) -> None:
            progress(t)
            self.advance(t)

        return advance

    def hold(self) -> None:
        """At the end: as long as somebody looks, or until Ctrl-C."""
        try:
            while self.view.server.watched:
                self._rest()
        except KeyboardInterrupt:
            pass

    def __enter__(self) -> ManeuverView:
        return self

    def __exit__(self, *reason: object) -> None:
        self.view.stop()

    def _rest(self) -> None:
        time.sleep(REST)
        self.view.obey()
        self.view.step()

    def _let_pass(self) -> None:
        self._passes = 1
