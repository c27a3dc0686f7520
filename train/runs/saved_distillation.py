"""Lessons of a distillation in its checkpoints and its run folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simwarp.tasks import InputError, config_from_plain

from ..algorithm.distillation import DistillationConfig
from ..algorithm.distiller import LESSON, TAUGHT_BY, Lesson
from ..config import configs_from_plain
from .checkpoint import POLICY, check_members
from .run_folder import read_policy


def distillation_config(description: Mapping[str, Any], where: str) -> DistillationConfig | None:
    """Return the hyperparameters in a checkpoint or ``config.json``; None where it is of no distillation.

    Raises:
        InputError: a value is of a wrong type or breaks its rule.
    """
    if LESSON not in description:
        return None
    check_members(description, {LESSON: dict}, where)
    check_members(description[LESSON], {TAUGHT_BY: str, "config": dict}, f"{where}: {LESSON}")
    return config_from_plain(DistillationConfig, description[LESSON]["config"], f"{where}: {LESSON}")


def saved_lesson(content: Mapping[str, Any], where: str) -> Lesson | None:
    """Return the lesson in a checkpoint; None where it is of no distillation.

    Raises:
        InputError: it is damaged.
    """
    config = distillation_config(content, where)
    if config is None:
        return None
    check_members(content, {TAUGHT_BY: dict}, where)
    check_members(content[TAUGHT_BY], POLICY, f"{where}: {TAUGHT_BY}")
    configs_from_plain(content[TAUGHT_BY], f"{where}: {TAUGHT_BY}")
    return Lesson(content[TAUGHT_BY], content[LESSON][TAUGHT_BY], config)


def planned_lesson(description: Mapping[str, Any], where: str) -> Lesson | None:
    """Return the lesson that ``config.json`` of a run without a checkpoint tells; None where it is no distillation.

    Raises:
        InputError: the teacher's policy is no longer there.
    """
    config = distillation_config(description, where)
    if config is None:
        return None
    return lesson_by(Path(description[LESSON][TAUGHT_BY]), description["task"], config)


def lesson_by(teacher: Path, task: str, config: DistillationConfig) -> Lesson:
    """Return the lesson of the policy in a checkpoint or run.

    Raises:
        InputError: it cannot be read, or is of another task.
    """
    path, content = read_policy(teacher)
    if content["task"] != task:
        raise InputError(f"teacher {path} is of task '{content['task']}', not '{task}'")
    configs_from_plain(content, f"teacher {path}")
    return Lesson(content, str(path), config)
