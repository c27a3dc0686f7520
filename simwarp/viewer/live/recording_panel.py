"""A button that starts and ends recordings."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from simwarp.viewer.live.page_controls import set_changed
from simwarp.viewer.live.page_text import plain_text
from simwarp.viewer.live.recording import Recorder, recording_name

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView


class RecordingPanel:
    """Starts and ends recordings into the working folder, and shows the running one."""

    def __init__(self, view: LiveView) -> None:
        self._view, self._message = view, ""
        self._recorder: Recorder | None = None
        gui: Any = view.server.viser.gui
        with gui.add_folder("Recording", expand_by_default=False):
            self._button = gui.add_button("Record", hint="from now on, into a file that plays in any browser")
            self._line = gui.add_markdown("")

        @self._button.on_click
        def _(_: Any) -> None:
            view.post(self.toggle)

    def toggle(self) -> None:
        """Starts a recording, or ends the one that runs."""
        if self._running is None:
            self._message = ""
            self._recorder = Recorder(self._view, recording_name(self._view.subject.name), say=self._report)
        elif self._recorder is not None:
            path = self._recorder.finish()
            print(f"wrote {path}", flush=True)
        self.refresh(0.0)

    @property
    def _running(self) -> Recorder | None:
        """The recording that was started here or on the command line."""
        if self._recorder is None or self._recorder.written:
            self._recorder = next((each for each in self._view.recorders if isinstance(each, Recorder)), self._recorder)
        return None if self._recorder is None or self._recorder.written else self._recorder

    def refresh(self, now: float) -> None:
        """Name, length and size of the file."""
        running, recorder, line = self._running, self._recorder, self._message
        label = "Record" if running is None else "Stop recording"
        if recorder is not None and not line:
            word = "recording" if running is not None else "wrote"
            line = f"{word} {plain_text(str(recorder.path))}: {recorder.elapsed:.0f} s, {recorder.size / 1e6:.1f} MB"
        elif line:
            line = plain_text(line)
        set_changed(self._button, label=label)
        set_changed(self._line, content=line)

    def _report(self, text: str) -> None:
        self._message = text
        print(text, file=sys.stderr, flush=True)
