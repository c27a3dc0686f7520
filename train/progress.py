"""What a user sees while a policy trains: one live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from .trainer import IterationReport

_PLAIN_INTERVAL = 5.0
_SMOOTHING = 0.2


def _number(value: float, digits: int = 1) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class ProgressDisplay:
    """Shows iteration, reward, episode length, speed and time left.

    Args:
        console: where to write; a terminal gets a live bar.
        first: iterations done before.
        total: iterations to reach.
    """

    def __init__(self, console: Console, first: int, total: int) -> None:
        self._console = console
        self._total = total
        self._first = first
        self._started = time.monotonic()
        self._last_line = -math.inf
        self._seconds: float | None = None
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        if console.is_terminal:
            self._bar = Progress(
                TextColumn("iteration {task.completed}/{task.total}"),
                BarColumn(bar_width=24),
                TextColumn("{task.fields[text]}"),
                console=console,
            )
            self._task = self._bar.add_task("", total=total, completed=first, text="starting")

    def __enter__(self) -> ProgressDisplay:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def update(self, report: IterationReport) -> None:
        """Show one more iteration."""
        seconds = report.collect_s + report.learn_s
        # The first iteration compiles kernels: an average that forgets it gives a better guess of what is left
        self._seconds = seconds if self._seconds is None else self._seconds + _SMOOTHING * (seconds - self._seconds)
        left = _duration(self._seconds * (self._total - report.iteration))
        text = (
            f"reward {_number(report.mean_reward)}  episode {_number(report.mean_episode_length)} steps"
            f"  {report.env_steps_per_s:,.0f} env steps/s  ETA {left}"
        )
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=report.iteration, text=text)
            return
        now = time.monotonic()
        edge = report.iteration in (self._first + 1, self._total)
        if edge or now - self._last_line >= _PLAIN_INTERVAL:
            self._last_line = now
            self._console.print(f"iteration {report.iteration}/{self._total}  {text}", highlight=False, soft_wrap=True)
