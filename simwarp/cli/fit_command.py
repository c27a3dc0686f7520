"""``simwarp fit CONFIG`` and ``simwarp fit --list TARGET``."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress as Bar, TextColumn, TimeElapsedColumn
from rich.table import Table

from simwarp.cli import DONE, INTERRUPTED, UsageError
from simwarp.cli.options import CommonOptions, option_value, parse_options, require_subject, split_subject
from simwarp.core.files import check_input
from simwarp.core.stopping import stop_on_signals
from simwarp.identify import Fit, FitResult, Progress, list_parameters, read_fit
from simwarp.identify.fit_config import FitConfig
from simwarp.identify.fit_report import content_of, share_of, strong_correlations, unidentified, write_results
from simwarp.model.model import resolve_device

USAGE = "usage: simwarp fit CONFIG [options], or simwarp fit --list TARGET"
STATE = "state.npz"
"""File of an unfinished fit in its folder."""


@dataclasses.dataclass(frozen=True)
class FitOptions(CommonOptions):
    """Fits parameters of a vehicle, a robot or a model to recorded runs, as a TOML or JSON file says.

    Ctrl-C ends it after the present iteration with the best that was found; --resume goes on from there.
    """

    list: Annotated[str | None, tyro.conf.arg(metavar="TARGET", help_behavior_hint="(default: a fit)")] = None
    """Print what can be fitted of a vehicle, or of a file of a vehicle, robot or model, in place of a fit."""
    match: Annotated[str | None, tyro.conf.arg(metavar="TEXT", help_behavior_hint="(default: all)")] = None
    """With --list, only names that hold this text."""
    soil: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="(default: a road)")] = None
    """With --list, the preset of the soil below a vehicle."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR", help_behavior_hint="(default: fits/CONFIG)")] = None
    """Folder of the results."""
    resume: tyro.conf.FlagCreatePairsOff[bool] = False
    """Go on where an interrupted fit of the same configuration and folder was."""
    iterations: Annotated[int | None, tyro.conf.arg(help_behavior_hint="(default: as configured)")] = None
    """Most iterations, in place of those of the configuration."""
    threads: Annotated[int | None, tyro.conf.arg(help_behavior_hint="(default: all cores)")] = None
    """Threads of a CPU; results do not depend on them."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""


def run(arguments: list[str]) -> int:
    """List or fit as the arguments say."""
    if option_value(arguments, "--list") is not None:
        return _list(parse_options(FitOptions, arguments, "simwarp fit"))
    overview = f"{USAGE}\n\nCONFIG is a TOML or JSON file\n\n`simwarp fit CONFIG --help` lists the options."
    word, rest = split_subject(arguments, lambda word: word.endswith((".toml", ".json")))
    name = require_subject(word, arguments, overview, f"which configuration? {USAGE}")
    options = parse_options(FitOptions, rest, f"simwarp fit {name}")
    if options.match is not None or options.soil is not None:
        raise UsageError("--match and --soil are for --list; a fit has its soil in its configuration")
    if options.iterations is not None and options.iterations < 1:
        raise UsageError(f"--iterations must be at least 1, got {options.iterations}")
    check_input(name, "configuration")
    options.check(name)
    config = read_fit(name)
    if options.iterations is not None:
        config = dataclasses.replace(
            config, search=dataclasses.replace(config.search, iterations=options.iterations)
        )  # fmt: skip
    return _fit(config, options, options.out or Path("fits") / Path(name).stem)


def _list(options: FitOptions) -> int:
    """Print what can be fitted of a target."""
    assert options.list is not None
    rows = [row for row in list_parameters(options.list, soil=options.soil) if (options.match or "") in row["name"]]
    console = options.console()
    for row in rows:
        value = f"{row['value']:.6g}" if row["kind"] == "value" else "table, a factor"
        console.print(f"{row['name']}  {value}", highlight=False, markup=False, soft_wrap=True)
    if not rows:
        console.print(f"nothing that holds '{options.match}'", highlight=False, soft_wrap=True)
    options.emit({"target": options.list, "parameters": rows, "cost": None, "iterations": 0})
    return DONE


def _fit(config: FitConfig, options: FitOptions, folder: Path) -> int:
    """Fit, print and write the result."""
    console = options.console()
    device = str(resolve_device(None if options.device == "auto" else options.device))
    state = folder / STATE
    fit = Fit(config, device=device, threads=options.threads)
    if options.resume:
        fit.resume(state)
    folder.mkdir(parents=True, exist_ok=True)
    _print_task(console, fit)
    with stop_on_signals() as stop, _Display(console, config.search.iterations) as display:
        result = fit.run(on_progress=display.show, stop=lambda: stop.requested, state=state)
        interrupted = stop.requested and not fit.done
    _print_result(console, result)
    written = write_results(fit, result, folder)
    for path in written.values():
        console.print(f"wrote {path}", highlight=False, markup=False, soft_wrap=True)
    files = {what: str(path) for what, path in written.items()}
    options.emit({"target": fit.target.name, **content_of(result), "interrupted": interrupted, "files": files})
    if interrupted:
        console.print(f"interrupted; simwarp fit ... --resume goes on from {state}", highlight=False, soft_wrap=True)
        return INTERRUPTED
    return DONE


class _Display:
    """A bar on a terminal; elsewhere a line for each iteration."""

    def __init__(self, console: Console, iterations: int) -> None:
        self.console = console
        columns = (TextColumn("fit"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[cost]}"),
                   TimeElapsedColumn())  # fmt: skip
        self._bar = Bar(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task = self._bar.add_task("fit", total=iterations, cost="")

    def __enter__(self) -> _Display:
        self._bar.start()
        return self

    def __exit__(self, *reason: object) -> None:
        self._bar.stop()

    def show(self, progress: Progress) -> None:
        """After an iteration."""
        diverged = f", {progress.worlds_diverged} worlds diverged" if progress.worlds_diverged else ""
        text = f"cost {progress.cost:.6g}{diverged}"
        if self.console.is_terminal:
            self._bar.update(self._task, completed=progress.iteration, cost=text)
        else:
            self.console.print(f"iteration {progress.iteration}: {text}", highlight=False, soft_wrap=True)


def _print_task(console: Console, fit: Fit) -> None:
    problem = fit.problem
    count = len(fit.parameters.unknowns)
    others = len(problem.unknowns) - count
    beside = f" and {others} of starts and poses" if others else ""
    console.print(
        f"{fit.target.name}: {count} parameters{beside}, {len(problem.runs)} runs in {len(problem.pieces)} segments, "
        f"{problem.row_count} residuals",
        highlight=False, soft_wrap=True,
    )  # fmt: skip


def _print_result(console: Console, result: FitResult) -> None:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for column in ("parameter", "start", "value", "low", "high", ""):
        table.add_column(column, justify="left" if column in ("parameter", "") else "right")
    for row in result.rows():
        ends = [_text(row[key]) for key in ("low", "high")]
        table.add_row(
            row["name"], f"{row['start']:.5g}", f"{row['value']:.6g}", *ends, "" if row["identifiable"] else "not told"
        )  # fmt: skip
    console.print(table)
    readings = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for column in ("run", "reading", "left over (rms)", "over its spread", ""):
        readings.add_column(column, justify="left" if column in ("run", "reading", "") else "right")
    for each in result.readings:
        share = share_of(each)
        readings.add_row(
            each.run, each.reading, f"{each.rms:.3g}", "" if share is None else f"{100.0 * share:.2g} %",
            "held out" if each.held_out else "",
        )  # fmt: skip
    console.print(readings)
    for line in unidentified(result):
        console.print(f"not told: {line}", highlight=False, markup=False, soft_wrap=True)
    for pair in strong_correlations(result):
        text = f"correlated: {pair['first']} and {pair['second']} ({pair['correlation']:+.3f})"
        console.print(text, highlight=False, markup=False, soft_wrap=True)
    console.print(
        f"cost {result.first_cost:.6g} -> {result.cost:.6g} in {result.iterations} iterations: {result.reason}"
        + (f"; {result.diverged} worlds diverged" if result.diverged else ""),
        highlight=False, soft_wrap=True,
    )  # fmt: skip


def _text(value: Any) -> str:
    return "" if value is None else f"{value:.6g}"
