"""``simwarp distill``."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path
from typing import Any

from simwarp.cli import UsageError
from simwarp.cli.options import (
    HELP,
    check_obs,
    check_variant,
    chosen_variant,
    expand_shorthands,
    option_value,
    parse_options,
    split_task,
    task_options,
    with_chosen_obs,
)
from simwarp.cli.training import RunOptions, train_as_asked, with_network_of_start
from simwarp.tasks import config_to_train_in, task_class, task_names


@dataclasses.dataclass(frozen=True)
class DistillOptions(RunOptions):
    """Teach a student with one set of observations what a teacher with another does, while the student leads.

    The run folder is as that of a training: it plays, evaluates, exports, and starts a training.
    """

    teacher: str | None = None
    """Who teaches: a run, a checkpoint, or the name of a shipped policy; or the name of observations, such as state,
    for the newest run that was trained on them, else the shipped policy."""
    student: str | None = None
    """Name of the observations that the student has, such as camera; by default those of the task."""


def read_options(word: str, arguments: list[str]) -> Any:
    """Return the options of the command: its own, and those of the training, the lessons and the task.

    Raises:
        UsageError: an option is wrong.
        InputError: the run that is resumed cannot be read.
    """
    cls = task_class(word)
    student = option_value(arguments, "--student")
    variant = chosen_variant(arguments)
    check_variant(cls.name, cls.config_type(), variant)
    base = config_to_train_in(cls, student=True, variant=variant)
    if student is not None:
        check_obs(cls.name, base, student, "--student")
        arguments = [*arguments, "--task.obs", student]
    arguments = expand_shorthands(arguments, cls.name, base)
    from simwarp.train.algorithm.distillation import DistillationConfig
    from simwarp.train.config import configs_from_plain, student_config
    from simwarp.train.runs.run_folder import CONFIG, open_run
    from simwarp.train.runs.saved_distillation import distillation_config

    task_config = with_chosen_obs(arguments, base)
    config, lessons = student_config(cls, task_config), DistillationConfig()
    resume = option_value(arguments, "--resume")
    if resume is not None:
        saved, where = open_run(Path(resume)).load_config(), str(Path(resume) / CONFIG)
        found = distillation_config(saved, where)
        if found is None:
            remedy = f"simwarp train {shlex.quote(word)} --resume {shlex.quote(resume)}"
            raise UsageError(f"run {resume} has no teacher: go on with `{remedy}`")
        if saved["task"] == cls.name:
            lessons = found
            config, task_config = configs_from_plain(saved, where)
    config = with_network_of_start(arguments, cls.name, config)
    kind = task_options("DistillCommand", DistillOptions, flat_train=config, distillation=lessons, task=task_config)
    options: Any = parse_options(kind, arguments, f"simwarp distill {word}")
    if options.flat_train.ppo != config.ppo:
        raise UsageError("--ppo options are those of `simwarp train`; those of lessons begin with --distillation")
    if options.flat_train.critic_warmup != config.critic_warmup:
        raise UsageError("--critic-warmup is an option of `simwarp train`; lessons have no critic")
    return options


def run(arguments: list[str]) -> int:
    """Distil as the arguments say; 130 after an interruption."""
    resumed = option_value(arguments, "--resume")
    word, arguments = split_task(arguments, "distill", task_names(), run=resumed)
    name = task_class(word).name
    teacher = option_value(arguments, "--teacher")
    if not HELP & set(arguments) and (teacher is None) == (resumed is None):
        remedy = "give one of them" if teacher else f"usage: simwarp distill {word} --teacher state --student camera"
        raise UsageError(f"--teacher begins a new run and --resume goes on with one; {remedy}")
    options = read_options(word, arguments)
    options.check(options.warm_start)
    from simwarp.train.runs.saved_distillation import lesson_by

    lesson, console = None, options.console()
    if options.teacher is not None:
        path, origin = _teacher_of(name, options)
        console.print(f"teacher         {origin}", highlight=False, soft_wrap=True)
        lesson = lesson_by(path, name, options.distillation)
    return train_as_asked(console, name, options, "distill", lesson=lesson)


def _teacher_of(name: str, options: Any) -> tuple[Path, str]:
    """Return the file of the teacher's policy, and where it came from.

    Raises:
        InputError: there is none.
        UsageError: it needs no training.
    """
    from simwarp.train.networks.policies import UNTRAINED, find_policy

    if options.teacher in UNTRAINED:
        raise UsageError(f"--teacher {options.teacher}: nothing is to be learnt from it; name observations or a policy")
    choices = [kind.value for kind in type(options.task.obs)] if hasattr(options.task, "obs") else []
    path, obs = (None, options.teacher) if options.teacher in choices else (Path(options.teacher), None)
    found = find_policy(name, path, options.runs, obs)
    return found.path, found.origin
