"""``simwarp eval``."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console

from simwarp.cli import DONE, FELL_SHORT, INTERRUPTED, UsageError
from simwarp.cli.evaluation.eval_report import Report, open_folder
from simwarp.cli.evaluation.grids import grid_points, level_of
from simwarp.cli.options import CommonOptions, option_value
from simwarp.cli.policy_command import policy_command
from simwarp.core.files import OutputError
from simwarp.core.stopping import stop_on_signals
from simwarp.tasks import TaskConfig, resolve_device
from simwarp.train.evaluation.grid import EvaluationStoppedError, GridDisplay, GridSettings, evaluate_grid

if TYPE_CHECKING:
    from simwarp.cli.evaluation.task_record import TaskRecord


@dataclasses.dataclass(frozen=True)
class EvalOptions(CommonOptions):
    """Statistics of a policy over fresh worlds, with the zero-action and the random policy beside it."""

    episodes: int = 256
    """Episodes, each world's first ones; with --grid of every point."""
    checkpoint: Path | None = None
    """Checkpoint file or run folder, or `shipped`, the name of a shipped one, `zero`, `random`; by default the newest
    run, else the shipped."""
    num_envs: int | None = None
    """Worlds stepped together; by default as many as the episodes fill, at most 4096."""
    seed: int = 1_000_003
    """Seed of the worlds, other than that of training."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""
    level: float = 1.0
    """Level of the curriculum in [0, 1], held throughout: 1 is the whole difficulty, at which tasks are outside of
    training."""
    capture: bool = True
    """Capture each control step into a CUDA graph; of no effect on a CPU."""
    grid: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="KEY=a,b,c")] = ()
    """Evaluate for each value of a field of the task's configuration, or of `level`; given again, for every
    combination."""
    baselines: bool = True
    """Evaluate the zero-action and the random policy too; with --grid by default not: it takes thrice the time."""
    plot: Path | None = None
    """Folder for results.json, rates and maps of paths as pictures; by default TASK-eval, but none without --grid."""
    record: Path | None = None
    """File for tools of ROS 2, .mcap: the first world with its sensors and the policy's actions, all its episodes."""
    runs: Path = Path("runs")
    """Folder of the run folders."""


@dataclasses.dataclass(frozen=True)
class GridEvalOptions(EvalOptions):
    """Statistics of a policy at every point of a grid."""

    baselines: bool = False
    """Evaluate the zero-action and the random policy too, which takes thrice the time."""


def run(arguments: list[str]) -> int:
    """Evaluate as the arguments say; 130 after an interruption."""
    base = EvalOptions if option_value(arguments, "--grid") is None else GridEvalOptions
    command = policy_command("eval", arguments, base)
    name, options = command.name, command.options()
    source = command.source
    assert source is not None  # options() has ended the process where help was asked for
    record = _record(options)
    options.check(source.path, record=options.record)
    _check_counts(options)
    # All points are checked before the first one is evaluated
    level = level_of("--level", options.level)
    points = grid_points(options.grid, options.task, lambda words: _task_of(command.options(words)), level)
    settings = GridSettings(
        episodes=options.episodes,
        seed=options.seed,
        device=resolve_device(options.device),
        num_envs=options.num_envs,
        baselines=options.baselines,
        capture=options.capture,
        paths_driven=bool(options.grid) or options.plot is not None,
    )
    folder = open_folder(options.plot, name, bool(options.grid))
    settings = dataclasses.replace(settings, kept=(folder or Path()) / f"{name}-broken.npz")
    report, console = Report(name, source, settings, points, folder), options.console()
    with stop_on_signals() as stop:
        try:
            with GridDisplay(console, len(points), 3 if settings.baselines else 1, settings.episodes) as display:
                evaluate_grid(
                    name, source.policy if record is None else record.recorded(source.policy), points, settings,
                    results=report.results, display=display, stop=stop, after=report.save,
                )  # fmt: skip
        except EvaluationStoppedError as stopped:
            report.stopped = stopped
        finally:
            if record is not None:
                record.close()
            _finish(report, console, options)
    if report.stopped is not None:
        return INTERRUPTED
    if report.problem:
        print(f"simwarp: {report.problem}", file=sys.stderr)
        return FELL_SHORT
    return DONE


def _finish(report: Report, console: Console, options: Any) -> None:
    """Print the tables and write the files; the JSON also where the pictures cannot be written."""
    try:
        complete = report.finish(console)
    except OutputError:
        options.emit(report.content())
        raise
    if complete:
        options.emit(report.content())


def _record(options: Any) -> TaskRecord | None:
    """What records the first world, where that is asked for."""
    if options.record is None:
        return None
    if options.grid:
        raise UsageError("--record: records one evaluation, and --grid makes several; leave out one of them")
    from simwarp.cli.evaluation.task_record import TaskRecord
    from simwarp.mcap.mcap_extra import check_mcap_path

    return TaskRecord(check_mcap_path(options.record))


def _task_of(options: Any) -> TaskConfig:
    config: TaskConfig = options.task
    return config


def _check_counts(options: Any) -> None:
    for field in ("episodes", "num_envs"):
        value = getattr(options, field)
        if value is not None and value < 1:
            raise UsageError(f"{field.replace('_', '-')} must be at least 1, got {value}")
