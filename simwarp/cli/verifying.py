"""``simwarp verify [SCENE ...]``."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text

from simwarp.cli import DONE, FELL_SHORT, UsageError, shortened
from simwarp.cli.options import CommonOptions, parse_options
from simwarp.core.wording import suggestions
from simwarp.model.model import resolve_device
from simwarp.verify import SCENES
from simwarp.verify.check_result import CheckResult
from simwarp.verify.known import EXPLAINED, Verdict, reason, verdict

_STYLES = {Verdict.KNOWN: "yellow", Verdict.FAILED: "red"}


@dataclasses.dataclass(frozen=True)
class VerifyOptions(CommonOptions):
    """Physics against known answers: exit code 1 if one of them is missed by more than is known."""

    scenes: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[SCENE ...]")] = ()
    """Names of the checks to run; everything when none is named."""
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
            hint = suggestions(name, SCENES, f"scenes: {', '.join(SCENES)}")
            raise UsageError(f"unknown scene '{shortened(name)}'; {hint}")
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
    if options.plots is not None:
        _make_folder(options.plots)
    rows: list[CheckResult] = []
    for name in names:
        started = time.perf_counter()
        found = checks[name](options.device)
        _print(console, name, found, time.perf_counter() - started)
        rows += found
    verdicts = [verdict(row) for row in rows]
    counts = {
        "passed": sum(found.good for found in verdicts),
        "known": verdicts.count(Verdict.KNOWN),
        "failed": verdicts.count(Verdict.FAILED),
    }
    options.emit({"rows": [row.as_dict() | {"known": reason(row)} for row in rows], **counts})
    _summarise(console, len(names), rows, counts)
    return DONE if counts["failed"] == 0 else FELL_SHORT


def _summarise(console: Console, scenes: int, rows: list[CheckResult], counts: dict[str, int]) -> None:
    """Print how many quantities there are of each verdict, and what is to be done about the list of known ones."""
    passed, known, failed = counts["passed"], counts["known"], counts["failed"]
    heading = f"{len(rows)} quantities in {scenes} scene{'s' if scenes > 1 else ''}"
    words = f"{passed} passed, {known} known deviation{'s' if known != 1 else ''}, {failed} failed"
    console.print(f"{heading}: {words}", style="bold", highlight=False, soft_wrap=True)
    if known:
        console.print(f"Known deviations are explained in {EXPLAINED}.", highlight=False, soft_wrap=True)
    for row in rows:
        name = f"{row.scene}: {row.quantity}"
        if verdict(row) is Verdict.MENDED:
            text = f"{name} is within its tolerance now: take it off the list of known deviations"
            console.print(text, highlight=False, markup=False, soft_wrap=True)
        elif verdict(row) is Verdict.FAILED and reason(row) is not None:
            text = f"{name} is a known deviation that has got worse"
            console.print(text, highlight=False, markup=False, soft_wrap=True)


def _make_folder(folder: Path) -> None:
    """Make the folder of pictures before any work is done.

    Raises:
        UsageError: there can be none.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--plots: cannot make folder '{folder}': {error.strerror}") from None


def _reporter(console: Console) -> Callable[[str], None] | None:
    """Shows on a terminal the check that runs; a file gets no such lines."""
    if not console.is_terminal:
        return None
    return lambda title: console.print(f"  {title} ...", style="dim", highlight=False)


def _print(console: Console, name: str, rows: list[CheckResult], seconds: float) -> None:
    summary = (inspect.getdoc(SCENES[name]) or "").partition("\n\n")[0].replace("\n", " ")
    console.print(Text.assemble((name, "bold"), f"  {summary} ({seconds:.1f} s)"), highlight=False)
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
            table.add_row(scene.removeprefix(f"{name}: "), style="bold")
        table.add_row(
            row.quantity, f"{row.expected:.7g}", f"{row.got:.7g}", f"{row.tolerance:.2g}",
            verdict(row).value, style=_STYLES.get(verdict(row)),
        )  # fmt: skip
    console.print(table, highlight=False)
