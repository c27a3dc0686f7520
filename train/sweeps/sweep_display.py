"""A live table of a sweep on a terminal; plain lines where there is none."""

from __future__ import annotations

import math
import time
from collections import Counter
from types import TracebackType
from typing import Final, Self

from rich.console import Console, RenderableType
from rich.live import Live
from rich.table import Table

from ..runs.progress_display import duration, number
from .run_state import RunRecord, RunState

REDRAW: Final = 0.5
"""Time between two tables [s]."""
LINE: Final = 30.0
"""Time between two plain lines about runs under way [s]."""
_HEAD = 6
"""Lines of a terminal beside the rows."""
_ORDER = (RunState.RUNNING, RunState.FAILED, RunState.STOPPED, RunState.DONE, RunState.WAITING)
"""What is shown first where there is no room for all."""


class SweepDisplay:
    """Shows the runs of a sweep.

    Args:
        console: for the output; a terminal gets a table that stands still.
        total: number of runs.
        jobs: runs at a time.
    """

    def __init__(self, console: Console, total: int, jobs: int) -> None:
        self.console = console
        self._total, self._jobs = total, jobs
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
        self._last = -math.inf
        self._records: list[RunRecord] = []

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self, records: list[RunRecord]) -> None:
        """Show how far the runs are, if the last look is old enough."""
        self._records = records
        now = time.monotonic()
        if self._live is not None:
            if now - self._last >= REDRAW:
                self._last = now
                self._live.update(self.table(records), refresh=True)
        elif now - self._last >= LINE:
            if math.isfinite(self._last):
                self.say(self._summary(records))
            self._last = now

    def changed(self, record: RunRecord) -> None:
        """Print a line on a run that began, ended or was found as it is; the table shows those under way."""
        if self._live is not None and record.state is RunState.RUNNING:
            return
        head = f"{record.run.name}  {_word(record)}"
        told = f"  {record.reason}" if record.reason else ""
        reward = f"  reward {number(record.reward)}" if record.state is RunState.DONE else ""
        self.say(f"{head}{reward}{told}")

    def say(self, text: str) -> None:
        """Print a line that stays."""
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def table(self, records: list[RunRecord]) -> RenderableType:
        """Return the table: the runs under way first where there are more than lines."""
        table = Table(title=self._summary(records), title_justify="left", title_style="", box=None, pad_edge=False)
        table.add_column("run", overflow="fold")
        for column in ("state", "iteration", "reward", "left"):
            table.add_column(column, justify="right")
        room = max(3, self.console.height - _HEAD)
        ordered = sorted(records, key=lambda record: _ORDER.index(record.state))
        shown = records if len(records) <= room else ordered[:room]
        for record in shown:
            left = duration(record.seconds_left) if _is_known(record) else ""
            table.add_row(
                record.run.name, _word(record), f"{record.iteration}/{record.run.config.iterations}",
                number(record.reward), left,
            )  # fmt: skip
        if len(shown) < len(records):
            table.add_row(f"... and {len(records) - len(shown)} more")
        return table

    def _summary(self, records: list[RunRecord]) -> str:
        """Return counts and the time that all of it takes, by the runs under way and those that are finished."""
        counts = Counter(record.state for record in records)
        parts = [
            f"{counts[state]} {state.value}"
            for state in (RunState.RUNNING, RunState.DONE, RunState.FAILED, RunState.STOPPED)
            if counts[state]
        ]
        running = [record for record in records if _is_known(record)]
        words = f"{', '.join(parts) or 'starting'} of {self._total} runs"
        iterations = ", ".join(f"{record.iteration}/{record.run.config.iterations}" for record in running)
        told = f"  iteration {iterations}" if running and self._live is None else ""
        return f"{words}{told}{self._left(running, len(records))}"

    def _left(self, running: list[RunRecord], taken: int) -> str:
        if not running:
            return ""
        whole = [
            record.seconds_left * record.run.config.iterations / max(record.run.config.iterations - record.iteration, 1)
            for record in running
        ]
        waiting = (self._total - taken) * sum(whole) / len(whole)
        seconds = (sum(record.seconds_left for record in running) + waiting) / min(self._jobs, max(1, self._total))
        return f"  ETA {duration(max(seconds, max(record.seconds_left for record in running)))}"


def _word(record: RunRecord) -> str:
    if record.kept:
        return f"{record.state.value} before"
    return record.state.value


def _is_known(record: RunRecord) -> bool:
    """Return True if it is known how long a run still takes."""
    return record.state is RunState.RUNNING and math.isfinite(record.seconds_left)
