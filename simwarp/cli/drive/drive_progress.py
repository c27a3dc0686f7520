"""Progress of a manoeuvre that is driven, and of kernels as they are compiled: a bar on a terminal, else lines."""

from __future__ import annotations

import time
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from simwarp.core.warp_start import LINES_APART, report_compiling, start_warp
from simwarp.vehicle.driving.maneuver_spec import Maneuver

PROGRESS_INTERVAL: Final = 10.0
"""Between lines of progress where there is no terminal [s]."""


class ManeuverBar:
    """Progress: a bar on a terminal, elsewhere a line now and then."""

    def __init__(self, console: Console, title: str, what: Maneuver) -> None:
        self.console, self.title, self.what = console, title, what
        self._printed_at = time.perf_counter()
        columns = (
            TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[t]}"),
            TimeRemainingColumn(),
        )  # fmt: skip
        self._progress = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task = self._progress.add_task(title, total=what.start + what.duration, t="")
        self._compiling = report_compiling(self._report, every=1.0 if console.is_terminal else LINES_APART)

    def __enter__(self) -> ManeuverBar:
        self._progress.start()
        start_warp()
        self._compiling.__enter__()
        return self

    def __exit__(self, *reason: object) -> None:
        self._compiling.__exit__(None, None, None)
        self._progress.stop()

    def _report(self, text: str) -> None:
        """Of kernels that are compiled."""
        if self.console.is_terminal:
            self._progress.update(self._task, description=f"{self.title}: {text}")
        else:
            self.console.print(f"{self.title}: {text}", highlight=False, markup=False, soft_wrap=True)

    def advance(self, t: float) -> None:
        """To a time of the manoeuvre [s]."""
        if self.console.is_terminal:
            done = t + self.what.start
            self._progress.update(self._task, completed=done, t=f"{t:.1f} s", description=self.title)
        elif time.perf_counter() - self._printed_at > PROGRESS_INTERVAL:
            self._printed_at = time.perf_counter()
            self.console.print(f"{self.title}: {t:.1f} of {self.what.duration:g} s", highlight=False)
