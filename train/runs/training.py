"""A whole training run: folder, checkpoints, logs, picture, interruption and resuming."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import torch
from rich.console import Console

from simwarp.core.files import OutputError, output_error
from simwarp.core.object_repr import ReadableFields
from simwarp.core.stopping import stop_on_signals
from simwarp.core.threads import default_threads
from simwarp.core.types import ModelError, formatted
from simwarp.tasks import InputError, Task, TaskConfig, make, task_class
from simwarp.tasks.framework.variants import variant_of

from ..algorithm.distiller import Distiller, Lesson
from ..algorithm.distributed import Processes, connect, processes
from ..algorithm.learner import IterationLeftError, IterationReport, Learner, TrainingError
from ..algorithm.trainer import Trainer
from ..config import LoggerKind, TrainConfig, configs_from_plain
from ..evaluation.learning_curve import draw_learning_curve
from .changed_options import changed_options_error
from .loggers import RunLog, check_logger
from .progress_display import ProgressDisplay
from .run_files import write_json
from .run_folder import (
    CONFIG,
    RUNS,
    WARM_START,
    RunFolder,
    check_root,
    create_run,
    open_run,
    provenance,
    read_policy,
    run_description,
)
from .run_lock import RunLock, writing
from .run_saver import RunSaver
from .saved_distillation import planned_lesson, saved_lesson


@dataclasses.dataclass(frozen=True)
class TrainResult(ReadableFields):
    """Result of a run. The names are the keys of ``simwarp train --json``."""

    task: str
    run: str
    checkpoint: str
    picture: str | None
    iterations: int
    env_steps: int
    env_steps_per_s: float
    wall_s: float
    mean_reward: float | None
    mean_episode_length: float | None
    interrupted: bool
    broken_iterations: int = 0
    """Iterations in which the physics of all worlds broke down: nothing was learnt from them."""
    film: str | None = None
    """The last film of the policy."""


class FilmMaker(Protocol):
    """Makes films of a policy while it is trained."""

    every: int
    """Iterations from film to film; one more is made at the end."""

    def make(self, trainer: Learner, path: Path) -> None:
        """Write a film of the present policy, and leave all of the training as it is."""


def train(
    task_name: str,
    config: TrainConfig,
    task_config: TaskConfig,
    *,
    root: Path = RUNS,
    resume: Path | None = None,
    warm_start: Path | None = None,
    lesson: Lesson | None = None,
    take_over: bool = False,
    console: Console | None = None,
    films: FilmMaker | None = None,
) -> TrainResult:
    """Train a policy and leave a run folder.

    Under ``torchrun`` all processes train one policy, each with worlds of its own; the first one writes the folder.

    Args:
        task_name: a registered task, or ``path/to/file.py:TaskClass``.
        config: configuration of the training.
        task_config: the task's configuration.
        root: folder of all runs.
        resume: run folder to go on with, in place of a new one; one without a checkpoint begins at its beginning.
        warm_start: checkpoint or run whose actor a new run starts from.
        lesson: a teacher, from whom the policy of a new run learns by distillation; None: it learns by PPO.
        take_over: resume a run that a process elsewhere has locked, and that is known to write it no more.
        console: for the progress; standard output by default.
        films: makes films of the policy for the run folder; None: there are none.

    Raises:
        InputError: something asked for is impossible.
        TaskError: the task broke its contract.
        TrainingError: learning diverged, or another process has taken the run over.
        OutputError: the disk did not take a file of the run; its checkpoints are unharmed.
    """
    task_name = task_class(task_name).name
    group = processes()
    console = (console or Console()) if group.first else Console(quiet=True)
    device = group.device(config.device)
    connect(group, device)
    config = dataclasses.replace(config, threads=group.threads(config.threads))
    torch.set_num_threads(config.torch_threads)
    check_logger(config.logger)
    if resume is not None:
        _refuse_beginnings(warm_start, lesson)
    start = None if warm_start is None else _start_policy(warm_start, task_name)
    with contextlib.ExitStack() as held:
        saved: tuple[Path, dict[str, Any]] | None = None
        lock: RunLock | None = None
        if resume is None:
            check_root(root / task_name)
        else:
            open_run(resume)
            if group.first:
                # Before the checkpoint is read: another writer could replace it
                lock = held.enter_context(writing(resume, take_over))
                if lock.took_over:
                    console.print(lock.took_over, highlight=False, markup=False, soft_wrap=True)
            saved = _saved_run(resume, task_name, config, task_config)
            if saved is None:
                console.print("the run has no checkpoint yet: it begins at iteration 0", highlight=False)
                start = _start_of_run(resume, task_name)
            lesson = _lesson_of_run(resume, saved)
        described = {} if lesson is None else lesson.described()
        description = run_description(task_name, config, task_config, warm_start) | described
        task = _worlds(task_name, config, task_config, group, device, console)
        trainer = Trainer(task, config, group) if lesson is None else Distiller(task, config, lesson, group)
        held.callback(trainer.close)
        if saved is not None and not _load(trainer, *saved):
            console.print("the checkpoint is of other worlds or processes: the worlds start afresh", soft_wrap=True)
        if start is not None:
            trainer.warm_start(start)
        folder = _folder(trainer, root, resume, description)
        console.print(f"run folder {folder.path}", highlight=False, soft_wrap=True)
        if lock is None and group.first:
            lock = held.enter_context(writing(folder.path))
        try:
            return _run(trainer, folder, lock, console, description, films)
        except OutputError as error:
            raise OutputError(f"{error}; {_kept(folder)}") from error


def _refuse_beginnings(warm_start: Path | None, lesson: Lesson | None) -> None:
    """Refuse what begins a run, where one is resumed."""
    for given, word in ((warm_start, "--warm-start"), (lesson, "a teacher")):
        if given is not None:
            raise InputError(f"{word} begins a new run and --resume goes on with one: give one of them")


def _refuse_other_variant(resume: Path, task_name: str, task_config: TaskConfig) -> None:
    """Refuse to go on with a run in another variant of its task.

    Raises:
        InputError: it is another one.
    """
    content = open_run(resume).load_config()
    began, wanted = variant_of(configs_from_plain(content, str(resume / CONFIG))[1]), variant_of(task_config)
    if content["task"] == task_name and began != wanted:
        raise InputError(
            f"--task.variant must be '{began}', as run {resume} began, got '{wanted}': leave it away, or begin a new "
            "run without --resume"
        )


def _load(trainer: Learner, path: Path, content: dict[str, Any]) -> bool:
    """Go on from a checkpoint; False where its worlds are others in number.

    Raises:
        InputError: it does not fit; options that have changed since are named.
    """
    try:
        return trainer.load(content, f"checkpoint {path}")
    except InputError as error:
        raise changed_options_error(error, path, content, trainer.config, trainer.task.config) from error


def _worlds(
    task_name: str, config: TrainConfig, task_config: TaskConfig, group: Processes, device: str, console: Console
) -> Task[Any]:
    """Build the worlds of this process."""
    # Kernels are compiled once per machine, which takes a while in which nothing else is shown
    console.print(f"building {config.num_envs} worlds of '{task_name}' on {device} ...", highlight=False)
    first_world = group.rank * config.num_envs
    with default_threads(config.threads):
        task = make(
            task_name, config.num_envs, device=device, seed=config.seed, config=task_config, first_world=first_world,
            capture=config.capture,
        )  # fmt: skip
    console.print(f"rewards {', '.join(task.weighted_terms)}", highlight=False, soft_wrap=True)
    return task


def _lesson_of_run(resume: Path, saved: tuple[Path, dict[str, Any]] | None) -> Lesson | None:
    """Return the lesson of a run that is resumed; None where it has no teacher."""
    if saved is not None:
        return saved_lesson(saved[1], f"checkpoint {saved[0]}")
    return planned_lesson(open_run(resume).load_config(), str(resume / CONFIG))


def _kept(folder: RunFolder) -> str:
    """Return a text on the remains of a run that a disk has stopped."""
    files = folder.checkpoint_files()
    if not files:
        return f"run {folder.path} has no checkpoint"
    return f"run {folder.path} is saved up to {files[-1].name}"


def _folder(trainer: Learner, root: Path, resume: Path | None, description: dict[str, Any]) -> RunFolder:
    """Make or open the run folder, in the first process; the others receive its path."""
    path: Path | None = None
    if trainer.group.first:
        if resume is None:
            path = create_run(root, trainer.task.name, description).path
        else:
            folder = open_run(resume)
            path = folder.path
            kept = {key: value for key, value in folder.load_config().items() if key not in description}
            folder.sweep()
            write_json(path / CONFIG, description | kept)
            write_json(path / f"provenance_{trainer.iteration:06d}.json", provenance())
    told: Path = trainer.group.gather(path)[0]
    folder = RunFolder(told)
    _keep_breaks(trainer, folder)
    return folder


def _keep_breaks(trainer: Learner, folder: RunFolder) -> None:
    """Let the task write the first breakdown of its physics to the run folder, for ``simwarp replay``."""
    number = f"_{trainer.group.rank}" if trainer.group.several else ""
    for group in trainer.task.model_groups:
        if group.task.guard is not None:
            group.task.guard.path = folder.path / f"broken{number}.npz"


def _start_policy(path: Path, task_name: str) -> dict[str, Any]:
    path, content = read_policy(path)
    if content["task"] != task_name:
        raise InputError(
            f"the policy to start from, {path}, is of task {formatted(content['task'])}, not '{task_name}'"
        )
    configs_from_plain(content, f"checkpoint {path}")
    return content


def _start_of_run(resume: Path, task_name: str) -> dict[str, Any] | None:
    """Return the policy that a run was to start from when it was made, if there is one."""
    named = open_run(resume).load_config().get(WARM_START)
    return None if named is None else _start_policy(Path(named), task_name)


def _saved_run(
    resume: Path, task_name: str, config: TrainConfig, task_config: TaskConfig
) -> tuple[Path, dict[str, Any]] | None:
    """Return the newest checkpoint and its content; None of a run that was prepared, or ended before its first one."""
    _refuse_other_variant(resume, task_name, task_config)
    folder = open_run(resume)
    if not folder.checkpoint_files():
        saved = folder.load_config()["task"]
        if saved != task_name:
            raise InputError(f"run {resume} is of task {formatted(saved)}, not '{task_name}'")
        return None
    path, content = folder.load_latest()
    if content["task"] != task_name:
        raise InputError(f"run {resume} is of task {formatted(content['task'])}, not '{task_name}'")
    if "worlds" not in content:
        raise InputError(f"checkpoint {path} holds only a policy: it cannot be resumed")
    configs_from_plain(content, f"checkpoint {path}")
    if content["iteration"] >= config.iterations:
        raise InputError(f"run {resume} already has {content['iteration']} iterations; ask for more with --iterations")
    return path, content


def _film(trainer: Learner, folder: RunFolder, films: FilmMaker, say: Callable[[str], None]) -> Path | None:
    """Make a film in the first process; a policy that cannot be shown is no reason to stop."""
    path = folder.film(trainer.iteration)
    if trainer.group.first:
        try:
            path.parent.mkdir(exist_ok=True)
            films.make(trainer, path)
        except (TrainingError, InputError, ModelError) as error:
            say(f"iteration {trainer.iteration}: no film: {error}")
            return None
        except OSError as error:
            raise output_error(path, error) from error
    return path


@dataclasses.dataclass
class _Course:
    """What a run has come to.

    Attributes:
        log: its records, in the first process; None before there are any.
        report: of the last whole iteration; None before that.
        film: the last one.
        broken: iterations in which the physics of all worlds broke down.
        stopped: it was asked to stop.
        spent: its time is used up.
        drawn: there is a picture of the learning curve.
    """

    log: RunLog | None = None
    report: IterationReport | None = None
    film: Path | None = None
    broken: int = 0
    stopped: bool = False
    spent: bool = False
    drawn: bool = False


def _log_of(
    folder: RunFolder, report: IterationReport, kind: LoggerKind, description: dict[str, Any], display: ProgressDisplay
) -> RunLog:
    """Begin the records of a run, now that it is known what is recorded."""
    log = RunLog(folder, report, kind, description)
    if log.lost:
        display.say(f"{folder.progress}: {log.lost} lines could not be read and are dropped; the run goes on")
    return log


def _spent(trainer: Learner, seconds: float) -> bool:
    """Return True if the time of a run is used up by the clock of its first process: all leave in the same iteration.

    Args:
        trainer: what learns.
        seconds: since the start or the resume.
    """
    minutes, group = trainer.config.minutes, trainer.group
    if minutes is None:
        return False
    over = group.first and seconds >= 60.0 * minutes
    return group.sums({"over": float(over)}, trainer.device)["over"] > 0.0


def _iterate(
    trainer: Learner, folder: RunFolder, saver: RunSaver, course: _Course, console: Console,
    description: dict[str, Any], films: FilmMaker | None,
) -> None:  # fmt: skip
    """Learn until all iterations are done, or until there is a request to stop; what was learnt is saved."""
    config, group, started = trainer.config, trainer.group, time.perf_counter()
    budget = math.inf if config.minutes is None else 60.0 * config.minutes
    with ProgressDisplay(console, trainer.iteration, config.iterations, budget) as display:
        saver.say = display.say
        while trainer.iteration < config.iterations and not course.stopped and not course.spent:
            try:
                course.report = report = trainer.iterate()
            except IterationLeftError:
                course.stopped = True
                break
            course.stopped = saver.stops()
            if course.stopped:
                saver.save()  # before anything else: whoever asked may not wait
            if group.first:
                course.log = course.log or _log_of(folder, report, config.logger, description, display)
                course.log.add(report, time.perf_counter() - started)
                display.update(report)
            if report.all_broken and not course.broken:
                display.say(f"iteration {report.iteration}: the physics of all worlds broke down in it")
            course.broken += report.all_broken
            if report.iteration % config.save_interval == 0:
                saver.save()
            if films is not None and report.iteration % films.every == 0 and not course.stopped:
                course.film = _film(trainer, folder, films, display.say)
            course.spent = _spent(trainer, time.perf_counter() - started)
        if course.spent and trainer.iteration < config.iterations:
            where = f"iteration {trainer.iteration} of {config.iterations}"
            display.say(f"the {config.minutes:g} min are used up after {where}; go on with --resume {folder.path}")
        saver.save()


def _finish(trainer: Learner, folder: RunFolder, course: _Course, console: Console, films: FilmMaker | None) -> None:
    """Make the last film and the picture of the learning curve."""
    report = course.report
    if films is not None and report is not None and (report.iteration % films.every != 0 or course.stopped):
        course.film = _film(trainer, folder, films, lambda text: console.print(text, highlight=False, markup=False))
    if trainer.group.first and report is not None:
        worlds = trainer.config.num_envs * trainer.group.count
        draw_learning_curve(folder.progress, folder.curve, f"{trainer.task.name}: {worlds} worlds")
        course.drawn = True


def _run(
    trainer: Learner, folder: RunFolder, lock: RunLock | None, console: Console, description: dict[str, Any],
    films: FilmMaker | None = None,
) -> TrainResult:  # fmt: skip
    config, group, course = trainer.config, trainer.group, _Course()
    first_steps, started = trainer.env_steps, time.perf_counter()
    with stop_on_signals() as stop:
        saver = RunSaver(trainer, folder, lock, stop)
        try:
            with stop.saving():
                _iterate(trainer, folder, saver, course, console, description, films)
            with contextlib.suppress(KeyboardInterrupt):  # asked once more: all that was learnt is saved
                if not stop.at_once:
                    _finish(trainer, folder, course, console, films)
        finally:
            with contextlib.suppress(KeyboardInterrupt):
                if course.log is not None:
                    course.log.close()
        if course.stopped:
            with stop.saving():
                group.gather(None)  # `torchrun` stops all processes when the first one ends with an exit code
    wall = time.perf_counter() - started
    report = course.report
    if report is None or saver.newest is None:
        raise KeyboardInterrupt
    return TrainResult(
        task=trainer.task.name,
        run=str(folder.path),
        checkpoint=str(saver.newest),
        picture=str(folder.curve) if course.drawn or not group.first else None,
        iterations=trainer.iteration,
        env_steps=trainer.env_steps,
        env_steps_per_s=(trainer.env_steps - first_steps) / wall,
        wall_s=wall,
        mean_reward=report.mean_reward if math.isfinite(report.mean_reward) else None,
        mean_episode_length=report.mean_episode_length if math.isfinite(report.mean_episode_length) else None,
        interrupted=course.stopped and trainer.iteration < config.iterations,
        broken_iterations=course.broken,
        film=None if course.film is None else str(course.film),
    )
