"""``simwarp train``."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro
from rich.console import Console

from simwarp.cli import DONE, FELL_SHORT, INTERRUPTED
from simwarp.cli.options import (
    CommonOptions,
    check_variant,
    chosen_variant,
    expand_shorthands,
    in_shell,
    option_value,
    parse_options,
    split_task,
    task_options,
    with_chosen_obs,
)
from simwarp.tasks import config_to_train_in, task_class, task_names

if TYPE_CHECKING:
    from simwarp.cli.view.films import TrainingFilms
    from simwarp.train.algorithm.distiller import Lesson
    from simwarp.train.config import TrainConfig
    from simwarp.train.runs.training import TrainResult


@dataclasses.dataclass(frozen=True)
class StartOptions(CommonOptions):
    """What new runs start from."""

    warm_start: Path | None = None
    """Checkpoint or run whose policy a new run starts from; its networks are the default of the network options."""


@dataclasses.dataclass(frozen=True)
class RunOptions(StartOptions):
    """The run that is made, or gone on with."""

    resume: Path | None = None
    """Run folder to go on with; its configuration is the default of all other options."""
    take_over: tyro.conf.FlagCreatePairsOff[bool] = False
    """Resume a run that a process on another machine has locked, and that you know to be written no more."""
    runs: Path = Path("runs")
    """Folder in which run folders are made, as TASK/TIME."""


@dataclasses.dataclass(frozen=True)
class TrainOptions(RunOptions):
    """Train a policy. The run folder gets checkpoints, TensorBoard events, progress.csv and a learning curve."""

    film: int | None = None
    """Iterations from film to film of the policy, recordings in the run folder that open in a browser; else none."""


def read_options(word: str, arguments: list[str], command: str, base: type[StartOptions]) -> Any:
    """Return the options of a command that trains: those of `base`, of the training and of the task.

    Their defaults are the task's, those of the run that is resumed, or of the policy that is started from.

    Args:
        word: the task.
        arguments: the words after it.
        command: its name.
        base: of its options.

    Raises:
        UsageError: an option is wrong.
        InputError: a run or policy that is named cannot be read.
    """
    cls = task_class(word)
    name = cls.name
    variant = chosen_variant(arguments)
    check_variant(name, cls.config_type(), variant)
    usual = config_to_train_in(cls, variant=variant)
    arguments = expand_shorthands(arguments, name, usual)
    # Only now what takes seconds to import: an unknown task is known at once
    from simwarp.train.config import configs_from_plain, default_config
    from simwarp.train.runs.run_folder import CONFIG, open_run

    task_config = with_chosen_obs(arguments, usual)
    config = default_config(cls, task_config)
    resume = option_value(arguments, "--resume")
    if resume is not None:
        saved = open_run(Path(resume)).load_config()
        if saved["task"] == name:
            config, task_config = configs_from_plain(saved, str(Path(resume) / CONFIG))
    config = with_network_of_start(arguments, name, config)
    kind = task_options(f"{command.capitalize()}Command", base, flat_train=config, task=task_config)
    return parse_options(kind, arguments, f"simwarp {command} {word}")


def with_network_of_start(arguments: list[str], task: str, config: TrainConfig) -> TrainConfig:
    """Return a configuration with the networks of the policy that arguments start from, if they name one.

    Raises:
        InputError: it cannot be read.
    """
    from simwarp.train.config import train_config_from_plain
    from simwarp.train.runs.run_folder import read_policy

    start = option_value(arguments, "--warm-start")
    if start is None:
        return config
    path, content = read_policy(Path(start))
    if content["task"] != task:
        return config
    network = train_config_from_plain(content["train_config"], f"checkpoint {path}: train_config").network
    return dataclasses.replace(config, network=network)


def run(arguments: list[str]) -> int:
    """Train as the arguments say; 130 after an interruption."""
    word, arguments = split_task(arguments, "train", task_names(), run=option_value(arguments, "--resume"))
    name = task_class(word).name
    options = read_options(word, arguments, "train", TrainOptions)
    options.check(options.warm_start)
    films = None
    if options.film is not None:
        from simwarp.cli.view.films import TrainingFilms

        films = TrainingFilms(options.film)
    return train_as_asked(options.console(), name, options, "train", films=films)


def train_as_asked(
    console: Console, name: str, options: Any, command: str, *, lesson: Lesson | None = None,
    films: TrainingFilms | None = None,
) -> int:  # fmt: skip
    """Train, write and print what became of the run; return the exit code.

    Args:
        console: for people.
        name: the task.
        options: `RunOptions`, with the configurations ``flat_train`` and ``task``.
        command: that was given.
        lesson: what a teacher teaches; None: the policy learns from rewards.
        films: that are made meanwhile.
    """
    from simwarp.train.algorithm.distributed import processes
    from simwarp.train.runs.training import train

    result = train(
        name, options.flat_train, options.task, root=options.runs, resume=options.resume,
        warm_start=options.warm_start, lesson=lesson, take_over=options.take_over, console=console, films=films,
    )  # fmt: skip
    if not processes().first:
        return INTERRUPTED if result.interrupted else DONE
    options.emit(dataclasses.asdict(result))
    runs = None if options.resume is not None else options.runs
    return report_result(console, name, result, runs, command, film=None if films is None else films.every)


def report_result(
    console: Console, name: str, result: TrainResult, runs: Path | None, command: str, *, film: int | None = None
) -> int:
    """Print what became of a run, and what comes next; return the exit code.

    Args:
        console: for people.
        name: the task.
        result: of the run.
        runs: folder of all runs, of which it is the newest; None where others may be newer.
        command: that goes on with it.
        film: iterations from film to film: the run does not remember them.
    """

    def say(words: str) -> None:
        console.print(words, highlight=False, markup=False, soft_wrap=True)

    state = "interrupted and saved" if result.interrupted else "done"
    say(f"{state} after {result.iterations} iterations, {result.env_steps:,} env steps, {result.wall_s:.0f} s")
    say(f"run folder      {result.run}")
    if result.picture is not None:
        say(f"learning curve  {result.picture}")
    if result.film is not None:
        say(f"last film       {result.film}")
    if result.interrupted:
        films = "" if film is None else f" --film {film}"
        say(f"go on with      simwarp {command} {in_shell(name)} --resume {shlex.quote(result.run)}{films}")
        say(_next_words(name, result, runs))
        return INTERRUPTED
    if result.broken_iterations:
        broken = shlex.quote(f"{result.run}/broken.npz")
        print(
            f"simwarp: the physics of all worlds broke down in {result.broken_iterations} iterations: from them"
            f" nothing was learnt; `simwarp replay {broken}` repeats the first break",
            file=sys.stderr,
        )
        return FELL_SHORT
    say(_next_words(name, result, runs))
    return DONE


def _next_words(name: str, result: TrainResult, runs: Path | None) -> str:
    """Name what shows and judges the policy: by the task, which means its newest run, or by the run."""
    if runs is None:
        # A word without a folder may be the name of a task
        policy = shlex.quote(result.run if "/" in result.run else f"./{result.run}")
    else:
        policy = in_shell(name) + ("" if runs == TrainOptions.runs else f" --runs {shlex.quote(str(runs))}")
    return f"next            simwarp play {policy}  or  simwarp eval {policy}"
