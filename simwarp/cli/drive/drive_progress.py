"""Progress of a manoeuvre that is driven: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

import time
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

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

    def __enter__(self) -> ManeuverBar:
        self._progress.start()
        return self

    def __exit__(self, *reason: object) -> None:
        self._progress.stop()

    def advance(self, t: float) -> None:
        """To a time of the manoeuvre [s]."""
        if self.console.is_terminal:
            self._progress.update(self._task, completed=t + self.what.start, t=f"{t:.1f} s")
        elif time.perf_counter() - self._printed_at > PROGRESS_INTERVAL:
            self._printed_at = time.perf_counter()
            self.console.print(f"{self.title}: {t:.1f} of {self.what.duration:g} s", highlight=False)
