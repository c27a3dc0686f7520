"""``simwarp verify [SCENE ...]``."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import inspect
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from simwarp.cli import DONE, FELL_SHORT, UsageError
from simwarp.cli.options import CommonOptions, parse_options
from simwarp.cli.verify import SCENES
from simwarp.cli.verify.rows import Row
from simwarp.cli.verify.vehicle_cases import EXPLAINED, is_known
from simwarp.model import resolve_device


@dataclasses.dataclass(frozen=True)
class VerifyOptions(CommonOptions):
    """Physics against known answers: exit code 1 if one of them is missed."""

    scenes: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[SCENE ...]")] = ()
    """What to check; everything when none is named."""
    device: str = "cpu"
    """That runs the engine."""
    reference: Path | None = None
    """Of vehicles: folder of recorded CSV files to compare with; by default those that are shipped."""
    plots: Path | None = None
    """Of vehicles: folder for a picture of every run beside its reference."""


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
    checks = dict(SCENES)
    if "vehicles" in names:
        checks["vehicles"] = functools.partial(
            SCENES["vehicles"], reference=options.reference, plots=options.plots, report=_reporter(console)
        )
    elif options.reference is not None or options.plots is not None:
        raise UsageError("--reference and --plots belong to the scene 'vehicles'")
    rows: list[Row] = []
    for name in names:
        started = time.perf_counter()
        found = checks[name](options.device)
        _print(console, name, found, time.perf_counter() - started)
        rows += found
    missed = sum(not row.passed for row in rows)
    known = sum(is_known(row) for row in rows if not row.passed)
    counts = {"passed": len(rows) - missed, "failed": missed, "failed_known": known}
    options.emit({"rows": [row.as_dict() for row in rows], **counts})
    verdict = "all within tolerance" if missed == 0 else f"{missed} of {len(rows)} missed"
    scenes = f"{len(names)} scene{'s' if len(names) > 1 else ''}"
    console.print(f"{len(rows)} quantities in {scenes}: {verdict}", style="bold", highlight=False)
    if known:
        which = "All of these misses are" if known == missed else f"{known} of these {missed} misses are"
        console.print(f"{which} known: {EXPLAINED}.", highlight=False, soft_wrap=True)
    return DONE if missed == 0 else FELL_SHORT


def _reporter(console: Console) -> Callable[[str], None] | None:
    """Tells on a terminal what runs; a file gets no such lines."""
    if not console.is_terminal:
        return None
    return lambda title: console.print(f"  {title} ...", style="dim", highlight=False)


def _verdict(row: Row) -> str:
    if row.passed:
        return "pass"
    return "FAIL (known)" if is_known(row) else "FAIL"


def _print(console: Console, name: str, rows: list[Row], seconds: float) -> None:
    summary = (inspect.getdoc(SCENES[name]) or "").partition("\n\n")[0].replace("\n", " ")
    console.print(f"[bold]{name}[/bold]  {escape(summary)} ({seconds:.1f} s)", highlight=False)
    table = Table(box=None, pad_edge=False, show_edge=False)
    several = len({row.scene for row in rows}) > 1
    table.add_column("quantity")
    for column in ("expected", "got", "tolerance"):
        table.add_column(column, justify="right")
    table.add_column("")
    scene = None
    for row in rows:
        if several and row.scene != scene:
            scene = row.scene
            table.add_row(escape(scene.removeprefix(f"{name}: ")), style="bold")
        table.add_row(
            escape(row.quantity), f"{row.expected:.7g}", f"{row.got:.7g}", f"{row.tolerance:.2g}",
            _verdict(row), style=None if row.passed else "red",
        )  # fmt: skip
    console.print(table, highlight=False)
