"""Recordings of a page's scene: one file that plays in a browser, without a server and without a network."""

from __future__ import annotations

import datetime
import html
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from simwarp.core.files import check_output, write_file
from simwarp.core.types import WORLD, ModelError
from simwarp.viewer.live.page import ROOT
from simwarp.viewer.live.viser_extra import not_installed
from simwarp.viewer.live.world_layout import Layout

try:
    import zstandard
except ImportError as error:
    raise not_installed(error) from None

if TYPE_CHECKING:
    from simwarp.viewer.live.live_view import LiveView

SUFFIXES: Final = (".html", ".viser")
RATE: Final = 30.0
"""Frames per second of simulated time."""
LARGEST: Final = 50_000_000
"""Bytes of a file at which a recording stops."""
BASE64: Final = 4.0 / 3.0
BLOCK: Final = 16_384
"""Bytes that may wait to be compressed and counted."""
TEXT: Final = 16
"""Bytes of a message around its arrays, in the file: they are much alike."""
NODE: Final = f"{ROOT}/recording"
POSES: Final = frozenset(("batched_positions", "batched_wxyzs", "vertices"))
TITLE: Final = "<title>Viser</title>"


def check_recording_path(path: str | Path, option: str = "--record") -> None:
    """Refuses what cannot be recorded to, before any work is done.

    Raises:
        ModelError: it is another kind of file.
        FileError: it cannot be written to.
    """
    if Path(path).suffix.lower() not in SUFFIXES:
        raise ModelError(f"{option}: the name must end in .html or .viser, got '{path}'; give it one of these")
    check_output(path, option)


def recording_name(target: str) -> Path:
    """File in the working folder for a recording that begins now."""
    word = re.sub(r"[^A-Za-z0-9._-]+", "-", target).strip("-.") or "scene"
    stem = f"{word[:60]}-{datetime.datetime.now():%Y-%m-%d_%H-%M-%S}"
    names = (Path(f"{stem}{suffix}.html") for suffix in ("", *(f"-{number}" for number in range(2, 1000))))
    return next(name for name in names if not name.exists())


class Recorder:
    """Records what a page shows, looked at or not, from the scene as it is.

    Playback takes as long as the simulation's own time: nothing is added while that rests.

    Args:
        view: whose scene is recorded. Its steps are taken by the caller, or by its `run`.
        path: of the file, .html or .viser.
        largest: bytes of the file at which it stops.
        say: is told when it stops by itself; by default it goes to standard error.

    Attributes:
        elapsed: simulated time that was recorded [s].
        frames: moments that were recorded.
        path: of the file.
        written: whether it is there.

    Raises:
        ModelError: a file of another kind, or a recording runs.
    """

    def __init__(
        self, view: LiveView, path: str | Path, *, largest: int = LARGEST, say: Callable[[str], None] | None = None
    ) -> None:
        check_recording_path(path)
        other = next((each for each in view.recorders if isinstance(each, Recorder)), None)
        if other is not None:
            raise ModelError(f"recording: one runs at a time, and one into '{other.path}' does; end it first")
        self.view, self.elapsed, self.frames, self.written = view, 0.0, 0, False
        self.path: Path = Path(path)
        self._largest, self._say = largest, say or _say
        self._times, self._next = self._now(), 1.0 / RATE
        self._passing = True
        """Whether places of bodies that are sent are of a frame that is due."""
        self._held: dict[tuple[str, ...], Any] = {}
        """Messages that were left out since no frame was due."""
        self._owed = False
        """Whether time went on and the places of bodies were not sent since."""
        page = view.page
        page.recorded += 1
        page.bodies.read()
        self._label = page.scene.add_label(
            NODE, self._text(), position=self._place(), anchor="bottom-center", font_screen_scale=1.1
        )
        page.refresh_scenery()
        page.frame()
        server: Any = view.server.viser
        self._serializer = server.get_scene_serializer()
        # Private to viser: steps of a slow motion that no frame is due for are left out by its filter
        self._plain, self._serializer._filter = self._serializer._filter, self._wanted
        self._meter = _Meter(path, self._serializer)
        self.frames = 1
        view.recorders.append(self)

    @property
    def size(self) -> int:
        """Bytes of the file if it ended now, as nearly as that is known while it grows."""
        return self._meter.size

    @property
    def full(self) -> bool:
        """True if it has stopped by itself."""
        return self.written and self.size > self._largest

    def due(self) -> bool:
        """Whether enough simulated time went by for the next frame."""
        return self.elapsed + self._gone(self._now()) >= self._next - 1e-4

    def begin_frame(self) -> None:
        """To be called before the page sends a frame; the frame is recorded if one is due."""
        if self.size > self._largest:
            self.finish()
            self._say(f"recording: stopped at {self._largest / 1e6:.0f} MB after {self.elapsed:.1f} s: {self.path}")
            return
        self._give_held()
        self._passing = self.due()
        if self._passing:
            self._move_on()

    def finish(self) -> Path:
        """Ends the recording with the present state and writes the file; a second call does nothing."""
        if self.written:
            return self.path
        page = self.view.page
        self._give_held()
        if self._gone(self._now()) > 0.0:
            self._move_on()
        if self._owed:
            self._passing = True
            page.frame()
        self._passing = True
        self._give_held()
        self._serializer.insert_sleep(1.0 / RATE)  # the last frame is seen too
        if self.path.suffix.lower() == ".viser":
            content: bytes | str = self._serializer.serialize()
        else:
            content = _titled(self._serializer.as_html(), self.view.subject.name)
        self.written = True
        self._end()
        write_file(self.path, content)
        return self.path

    def drop(self) -> None:
        """Ends the recording without a file."""
        if not self.written:
            self.written = True
            self._serializer.serialize()
            self._end()

    def _end(self) -> None:
        if self in self.view.recorders:
            self.view.recorders.remove(self)
        self.view.page.recorded -= 1
        self._label.remove()

    def _move_on(self) -> None:
        self.view.page.bodies.read()
        now = self._now()
        gone = self._gone(now)
        self._serializer.insert_sleep(gone)
        self._times = now
        self.elapsed += gone
        self._next = (math.floor(self.elapsed * RATE + 1e-3) + 1) / RATE
        self.frames += 1
        self._owed = True
        self._label.text = self._text()
        self._label.position = self._place()

    def _now(self) -> Any:
        return self.view.subject.simulation.state.world_time.numpy().astype(np.float64)

    def _gone(self, now: Any) -> float:
        """Simulated time since the last frame [s]: in a world that was not reset, else since that."""
        change = now - self._times
        return float(max(change.max(), now.min(initial=np.inf, where=change < 0.0) if (change < 0.0).all() else 0.0))

    def _give_held(self) -> None:
        """Adds the places that were left out and have not changed since: viser does not send those again."""
        if self._passing:
            for message in list(self._held.values()):
                self._serializer._insert_message(message)

    def _wanted(self, message: Any) -> bool:
        if not self._plain(message):
            return False
        moves = getattr(message, "updates", {}).keys() & POSES
        passing = self._passing or not moves
        key = (getattr(message, "name", ""), *sorted(moves))
        if not passing:
            self._held[key] = message
        elif moves:
            self._owed = False
            self._held.pop(key, None)
        elif hasattr(message, "props"):  # a node that is made anew brings its places with it
            for old in [old for old in self._held if old[0] == key[0]]:
                del self._held[old]
        if passing:
            self._meter.look()
        return passing

    def _text(self) -> str:
        """Time, speed and return of the world that the page is about."""
        page, subject = self.view.page, self.view.subject
        world, state = int(page.worlds[page.chosen]), subject.simulation.state
        text = f"{float(state.world_time.numpy()[world]):.1f} s"
        if page.body() != WORLD:
            text += f"   {float(np.linalg.norm(page.velocity())):.1f} m/s"
        if subject.returns is not None:
            text += f"   return {float(subject.returns()[world]):.1f}"
        return text

    def _place(self) -> Any:
        """Above all worlds side by side, or above the body that is followed."""
        page = self.view.page
        if self.frames and page.layout is Layout.GRID and len(page.worlds) > 1:
            return self._label.position
        extent = page.batches.extent(page.bodies) + page.offsets[:, None]
        if page.layout is Layout.GRID and len(page.worlds) > 1:
            low, high = extent[:, 0].min(axis=0), extent[:, 1].max(axis=0)
            return np.array([*(0.5 * (low + high))[:2], high[2] + 0.1 * float(np.max(high - low))])
        low, high = extent[page.chosen]
        top = np.array([0.0, 0.0, 0.75 * float(np.max(high - low))])
        return page.followed() + top if page.body() != WORLD else 0.5 * (low + high) + top


class _Meter:
    """Estimates the size of a growing file by compressing added bytes, faster and less densely than the file is."""

    def __init__(self, path: str | Path, serializer: Any) -> None:
        self._serializer = serializer
        self._compressor = zstandard.ZstdCompressor(level=1).compressobj()
        self._buffers = self._messages = self._bytes = self._waiting = 0
        self._page, self._factor = 0, 1.0
        if Path(path).suffix.lower() == ".html":
            import viser

            self._page = (Path(viser.__file__).parent / "client/build/index.html").stat().st_size
            self._factor = BASE64
        self.look()

    @property
    def size(self) -> int:
        """Bytes."""
        return self._page + round(self._factor * self._bytes)

    def look(self) -> None:
        """Counts what was added since it was last asked."""
        buffers, messages = self._serializer._binary_buffers, self._serializer._messages
        for buffer in buffers[self._buffers :]:
            self._bytes += len(self._compressor.compress(buffer))
            self._waiting += buffer.nbytes
        if self._waiting > BLOCK:
            self._bytes += len(self._compressor.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK))
            self._waiting = 0
        self._bytes += TEXT * (len(messages) - self._messages)
        self._buffers, self._messages = len(buffers), len(messages)


def _titled(page: str, name: str) -> str:
    return page.replace(TITLE, f"<title>{html.escape(name)}</title>", 1)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
