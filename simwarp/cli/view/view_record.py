"""Recordings of what `simwarp view` shows: pages, or messages for tools of ROS 2, as the file's name says."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from simwarp.cli import UsageError
from simwarp.core.files import OutputError
from simwarp.mcap.mcap_extra import SUFFIX, check_mcap_path

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView
    from simwarp.viewer.live.recording import Recorder

PAGES: Final = (".html", ".viser")


def check_view_record(path: Path) -> None:
    """Refuses what cannot be recorded to, before any work is done.

    Raises:
        UsageError: it is another kind of file.
        ModelError: an extra is not installed.
        FileError: it cannot be written to.
    """
    suffix = path.suffix.lower()
    if suffix == SUFFIX:
        check_mcap_path(path)
        return
    if suffix not in PAGES:
        raise UsageError(f"--record: the name must end in {', '.join(PAGES)} or {SUFFIX}, got '{path}'; give it one")
    from simwarp.viewer.live.recording import check_recording_path

    check_recording_path(path)


def view_recorder(view: LiveView, path: Path) -> Recorder | MessageRecorder:
    """What records a view to a file from now on."""
    if path.suffix.lower() == SUFFIX:
        return MessageRecorder(view, path)
    from simwarp.viewer.live.recording import Recorder

    return Recorder(view, path)


class MessageRecorder:
    """Records the world that a page is about, after every step.

    Args:
        view: whose worlds move.
        path: of the file.

    Attributes:
        path: of the file.
        written: whether it is complete.
    """

    def __init__(self, view: LiveView, path: Path) -> None:
        from simwarp.mcap import Writer

        self.path, self.written = path, False
        self._view, self._advance = view, view.subject.advance
        world = int(view.page.worlds[view.page.chosen])
        self._writer = Writer(path, view.subject.simulation, world=world)
        view.subject.advance = self._step
        view.recorders.append(self)

    @property
    def elapsed(self) -> float:
        """Simulated time that was recorded [s]."""
        return self._writer.elapsed

    @property
    def size(self) -> int:
        """Bytes of the messages."""
        return self._writer.size

    def due(self) -> bool:
        """It needs no frames of the page."""
        return False

    def begin_frame(self) -> None:
        """Frames of the page are not recorded."""

    def finish(self) -> None:
        """Ends the file; a second call does nothing."""
        if not self.written:
            self._end()
            self._writer.close()

    def drop(self) -> None:
        """Ends the file as it is: what was written stays."""
        self.finish()

    def _step(self) -> None:
        self._advance()
        try:
            self._writer.add()
        except OutputError:
            self._end()  # the page goes on without it
            raise

    def _end(self) -> None:
        self.written = True
        self._view.subject.advance = self._advance
        if self in self._view.recorders:
            self._view.recorders.remove(self)
