"""``simwarp verify [SCENE ...]``."""

from __future__ import annotations

import dataclasses
import difflib
import inspect
import time
from typing import Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from simwarp.cli import DONE, FELL_SHORT, UsageError
from simwarp.cli.options import CommonOptions, parse_options
from simwarp.cli.verify import SCENES
from simwarp.cli.verify.rows import Row
from simwarp.model import resolve_device


@dataclasses.dataclass(frozen=True)
class VerifyOptions(CommonOptions):
    """Physics against known answers: exit code 1 if one of them is missed."""

    scenes: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[SCENE ...]")] = ()
    """What to check; everything when none is named."""
    device: str = "cpu"
    """That runs the engine."""


def chosen(names: tuple[str, ...]) -> list[str]:
    """The scenes to run.

    Raises:
        UsageError: one is unknown; says which ones come near.
    """
    for name in names:
        if name not in SCENES:
            close = difflib.get_close_matches(name, SCENES, n=3, cutoff=0.5)
            hint = f"did you mean {' or '.join(close)}?" if close else f"scenes: {', '.join(SCENES)}"
            raise UsageError(f"unknown scene '{name}'; {hint}")
    return list(dict.fromkeys(names)) or list(SCENES)


def run(arguments: list[str]) -> int:
    """Runs the checks; prints a table per scene as it comes in."""
    options = parse_options(VerifyOptions, arguments, "simwarp verify")
    options.check()
    names = chosen(options.scenes)
    resolve_device(options.device)
    console = options.console()
    rows: list[Row] = []
    for name in names:
        started = time.perf_counter()
        found = SCENES[name](options.device)
        _print(console, name, found, time.perf_counter() - started)
        rows += found
    missed = sum(not row.passed for row in rows)
    options.emit({"rows": [row.as_dict() for row in rows], "passed": len(rows) - missed, "failed": missed})
    verdict = "all within tolerance" if missed == 0 else f"{missed} of {len(rows)} missed"
    console.print(f"{len(rows)} quantities in {len(names)} scenes: {verdict}", style="bold", highlight=False)
    return DONE if missed == 0 else FELL_SHORT


def _print(console: Console, name: str, rows: list[Row], seconds: float) -> None:
    summary = (inspect.getdoc(SCENES[name]) or "").partition("\n\n")[0].replace("\n", " ")
    console.print(f"[bold]{name}[/bold]  {escape(summary)} ({seconds:.1f} s)", highlight=False)
    table = Table(box=None, pad_edge=False, show_edge=False)
    table.add_column("quantity")
    for column in ("expected", "got", "tolerance"):
        table.add_column(column, justify="right")
    table.add_column("")
    for row in rows:
        table.add_row(
            escape(row.quantity), f"{row.expected:.7g}", f"{row.got:.7g}", f"{row.tolerance:.2g}",
            "pass" if row.passed else "FAIL", style=None if row.passed else "red",
        )  # fmt: skip
    console.print(table, highlight=False)
