"""Progress display of long operations: one live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from ..algorithm.learner import IterationReport

_PLAIN_INTERVAL = 5.0
_SMOOTHING = 0.2


def number(value: float, digits: int = 1) -> str:
    """Return a number with so many digits after the point; NaN as a dash."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def duration(seconds: float) -> str:
    """Return a time as minutes:seconds, or hours:minutes:seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class LiveLine:
    """A bar with a text on a terminal; elsewhere a line of text every few seconds.

    Args:
        console: for the output.
        total: amount of work.
        done: amount of it that is done already.
        head: text before the bar at first.
    """

    def __init__(self, console: Console, total: float, done: float = 0.0, head: str = "") -> None:
        self.console = console
        self._last_line = -math.inf
        self._said = ""
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        if console.is_terminal:
            self._bar = Progress(
                TextColumn("{task.fields[head]}"),
                BarColumn(bar_width=24),
                TextColumn("{task.fields[text]}"),
                console=console,
            )
            self._task = self._bar.add_task("", total=total, head=head, text="starting")
            self._bar.update(self._task, completed=done)

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def show(self, head: str, text: str, done: float, *, certainly: bool = False) -> None:
        """Show how far the work has come.

        Args:
            head: before the bar.
            text: behind it.
            done: amount of work done.
            certainly: even if the last line is young.
        """
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, head=head, text=text)
            return
        now = time.monotonic()
        line = f"{head}  {text}"
        if certainly or (now - self._last_line >= _PLAIN_INTERVAL and line != self._said):
            self._last_line, self._said = now, line
            self.say(line)

    def say(self, text: str) -> None:
        """Print a line that stays."""
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)


class ProgressDisplay(LiveLine):
    """Shows iteration, reward, episode length, speed and time left of a training.

    Args:
        console: for the output; a terminal gets a live bar.
        first: iterations done before.
        total: iterations to reach.
        budget: time after which the training ends at the latest [s].
    """

    def __init__(self, console: Console, first: int, total: int, budget: float = math.inf) -> None:
        super().__init__(console, total, first, f"iteration {first}/{total}")
        self._total = total
        self._first = first
        self._seconds: float | None = None
        self._budget = budget
        self._started = time.monotonic()

    def update(self, report: IterationReport) -> None:
        """Show one more iteration."""
        seconds = report.collect_s + report.learn_s
        # The first iteration compiles kernels: an average that forgets it gives a better guess of what is left
        self._seconds = seconds if self._seconds is None else self._seconds + _SMOOTHING * (seconds - self._seconds)
        allowed = max(0.0, self._budget - (time.monotonic() - self._started))
        left = duration(min(self._seconds * (self._total - report.iteration), allowed))
        text = (
            f"reward {number(report.mean_reward)}  episode {number(report.mean_episode_length)} steps"
            f"  {report.env_steps_per_s:,.0f} env steps/s  ETA {left}"
        )
        edge = report.iteration in (self._first + 1, self._total)
        self.show(f"iteration {report.iteration}/{self._total}", text, report.iteration, certainly=edge)
