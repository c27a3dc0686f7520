"""Progress of a study: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

import time

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from simwarp.cli.drive.drive_progress import PROGRESS_INTERVAL


class StudyBar:
    """Progress of so many things.

    Args:
        console: for people.
        title: of the study.
        total: of the things.
        things: what they are called.
    """

    def __init__(self, console: Console, title: str, total: int, things: str) -> None:
        self.console, self.title, self.total, self.things = console, title, total, things
        self._printed_at = time.perf_counter()
        columns = (
            TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[text]}"),
            TimeRemainingColumn(),
        )  # fmt: skip
        self._bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task = self._bar.add_task(title, total=total, text="")

    def __enter__(self) -> StudyBar:
        self._bar.start()
        return self

    def __exit__(self, *reason: object) -> None:
        self._bar.stop()

    def advance(self, done: float, beside: str = "") -> None:
        """To a number of things, whole or in part, with words beside it."""
        text = f"{done:.0f} of {self.total} {self.things}{beside}"
        if self.console.is_terminal:
            self._bar.update(self._task, completed=done, text=text)
        elif time.perf_counter() - self._printed_at > PROGRESS_INTERVAL:
            self._printed_at = time.perf_counter()
            self.console.print(f"{self.title}: {text}", highlight=False, soft_wrap=True)
