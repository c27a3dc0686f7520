"""A page beside a running simulation: `LiveView.step()` in a loop of one's own; `panels.show` has one."""

from __future__ import annotations

import queue
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError
from simwarp.sensors.scene import Scene
from simwarp.simulation.simulation import Simulation
from simwarp.viewer.live.driving.browser_driving import PATH as DRIVE, DriveSocket
from simwarp.viewer.live.page import Page
from simwarp.viewer.live.subject import Subject, subject_of
from simwarp.viewer.live.web_server import WebServer, open_server
from simwarp.viewer.live.world_layout import Layout, natural_layout

FRAMES: Final = 30.0
"""Updates of the scene per second, at most."""
PANELS: Final = 10.0
"""Updates of numbers and plots per second."""
SCENERY: Final = 2.0
"""Times per second that the scenery is read again."""
MOST_SHOWN: Final = 64

Command = Callable[[], None]


class Panel(Protocol):
    """A part of the page with controls and read-outs. Its callbacks run in threads: they only `post` commands."""

    def refresh(self, now: float) -> None:
        """Brings its read-outs up to date, in the stepping thread, while somebody looks."""


class FrameTaker(Protocol):
    """Takes what the page sends, looked at or not."""

    def due(self) -> bool:
        """Whether it needs a frame now; called after every step."""

    def begin_frame(self) -> None:
        """To be called before the page sends a frame."""

    def finish(self) -> object:
        """To be called before the server closes."""

    def drop(self) -> None:
        """Ends without a result."""


class LiveView(Readable):
    """A page that shows a subject as it moves.

    Args:
        subject: a `Subject`, or a simulation.
        scene: of the simulation; painted shapes when None.
        worlds: how many worlds are shown, at most 64, or their indices.
        layout: of the worlds; what suits their size when None.
        host, port: of the server; the next free port is taken.
        server: one that is open already, instead of these two.

    Attributes:
        page: the scene.
        server: the server.
        wheel: connections of a person who drives.
        panels: refreshed while somebody looks.
        recorders: take the page's frames, looked at or not.
        paused: whether the loop of `run` rests.
        speed: of `run`, times real time; 0: as fast as it goes.

    Raises:
        ModelError: viser is not installed, or an argument is not usable.
    """

    def __init__(
        self, subject: Subject | Simulation, *, scene: Scene | None = None, worlds: int | Sequence[int] = 16,
        layout: Layout | str | None = None, host: str = "127.0.0.1", port: int = 8080,
        server: WebServer | None = None,
    ) -> None:  # fmt: skip
        self.subject = subject if isinstance(subject, Subject) else subject_of(subject, scene)
        chosen = _worlds(worlds, self.subject.simulation.model.world_count)
        self.wheel = DriveSocket()
        self.server = open_server(host, port, self.subject.name) if server is None else server
        self.server.sockets[DRIVE] = self.wheel.handle
        self.page = Page(self.server, self.subject, chosen[:1], Layout.ONE)
        extent, bodies = self.page.batches.extent, self.page.bodies
        natural = natural_layout(extent(bodies), extent(bodies, moving=False))
        chosen_layout = natural if layout is None else Layout(layout)
        if chosen_layout is not Layout.ONE:
            self.page.layout = chosen_layout
            self.page.show_worlds(chosen)
        self.page.aim()
        self.server.viser.on_client_connect(self.page.greet)
        self.page.follow(self.page.layout is Layout.ONE or self.subject.trail is not None)
        self.panels: list[Panel] = []
        self.preparers: list[Command] = []
        """Called before every `advance` of `run`, looked at or not."""
        self.listeners: list[Command] = []
        """Called after every `advance` of `run`, looked at or not."""
        self.shown = len(chosen)
        """Worlds that were asked for."""
        self.last_failed: int | None = None
        self.paused = False
        self.speed = 1.0
        self.stopped = False
        self.factor = 0.0
        self._commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._next_frame = self._next_panels = self._next_scenery = 0.0
        self._clients = self.server.viser._connected_clients
        self.closers: list[Command] = []
        """Called once, when the view is stopped."""
        self.recorders: list[FrameTaker] = []

    def _readable_title(self) -> str:
        return f" of '{self.subject.name}' at {self.server.url.partition('?')[0]}"

    @property
    def url(self) -> str:
        """Address for a browser."""
        return self.server.url

    def post(self, command: Command) -> None:
        """Has the stepping thread run a command, between two control steps. May be called from any thread."""
        self._commands.put(command)

    def step(self) -> None:
        """To be called after every step of one's own loop: sends a frame if one is due and somebody looks."""
        if not self._clients and not self.recorders and self._commands.empty():
            return
        self.obey()
        now = time.perf_counter()
        seen = bool(self._clients) and now >= self._next_frame
        if seen:
            self._next_frame = max(self._next_frame + 1.0 / FRAMES, now)
        if seen or any(recorder.due() for recorder in self.recorders):
            self._draw(now)

    def obey(self) -> None:
        """Runs the commands that have been posted."""
        while True:
            try:
                command = self._commands.get_nowait()
            except queue.Empty:
                return
            try:
                command()
            except Exception as error:  # noqa: BLE001  a click must not end a simulation
                self.report(error)

    def report(self, error: Exception) -> None:
        """An error in the terminal and in the page."""
        text = f"{type(error).__name__}: {error}"
        print(f"viewer: {text}", file=sys.stderr, flush=True)
        for client in self.server.viser.get_clients().values():
            client.add_notification(title="Error", body=text, loading=False, with_close_button=True, color="red")

    def reset(self, mask: Any = None) -> None:
        """Begins again, in the worlds of a mask."""
        self.subject.reset(mask)
        self.page.refresh()

    def run(self, until: Callable[[], bool] | None = None) -> None:
        """Goes on until it is stopped, at its speed."""
        from simwarp.viewer.live.pacing import Pace

        pace = Pace(self.subject.dt)
        while not self.stopped and not (until is not None and until()):
            self.obey()
            if self.paused:
                pace.rest()
                self._idle()
                continue
            self.advance()
            pace.wait(self.speed, self.obey)
            self.factor = pace.factor

    def advance(self) -> None:
        """One step of the subject, and what goes with it; an error rests the loop and leaves the page alive."""
        try:
            for preparer in self.preparers:
                preparer()
            self.subject.advance()
            for listener in self.listeners:
                listener()
        except Exception as error:  # noqa: BLE001  told in the page, which lives on
            self.paused = True
            self.report(error)
        self.step()

    def _note_failures(self) -> None:
        if self._clients and self.subject.ended is not None:
            ended = self.subject.ended().nonzero()[0]
            if len(ended):
                self.last_failed = int(ended[0])
                self._next_scenery = 0.0  # a new episode may have other obstacles

    def stop(self) -> None:
        """Ends the loop and all recordings, and closes the server."""
        self.stopped = True
        try:
            for recorder in list(self.recorders):
                recorder.finish()
        finally:
            self.server.stop()
            while self.closers:
                self.closers.pop()()

    def _idle(self) -> None:
        time.sleep(1.0 / FRAMES)
        if self._clients:
            self._draw(time.perf_counter())

    def _draw(self, now: float) -> None:
        self._note_failures()
        if now >= self._next_scenery:
            self._next_scenery = now + 1.0 / SCENERY
            self.page.refresh_scenery()
        for recorder in list(self.recorders):
            recorder.begin_frame()
        with self.server.viser.atomic():
            self.page.frame(waits=bool(self.recorders))
            self._each(self.page.overlays, lambda draw: draw())
        if self._clients and now >= self._next_panels:
            self._next_panels = now + 1.0 / PANELS
            self._each(self.panels, lambda panel: panel.refresh(now))

    def _each(self, parts: list[Any], act: Callable[[Any], None]) -> None:
        """Does something with parts of the page; one that fails is told of and left out from then on."""
        for part in tuple(parts):
            try:
                act(part)
            except Exception as error:  # noqa: BLE001  a read-out must not end a simulation
                if part in parts:
                    parts.remove(part)
                self.report(error)


def _worlds(worlds: int | Sequence[int], count: int) -> list[int]:
    if isinstance(worlds, int):
        if worlds < 1:
            raise ModelError(f"viewer: worlds must be at least 1, got {worlds}; 16 is the default")
        return list(range(min(worlds, count, MOST_SHOWN)))
    chosen = [int(world) for world in worlds]
    if not 1 <= len(chosen) <= MOST_SHOWN or min(chosen) < 0 or max(chosen) >= count:
        raise ModelError(f"viewer: worlds must be 1 to {MOST_SHOWN} indices below {count}, got {chosen}; name some")
    return chosen
