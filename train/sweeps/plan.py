"""What a sweep trains: runs that differ in their seed and in some fields of their configurations."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from simwarp.core.files import LONGEST_NAME
from simwarp.tasks import InputError, TaskConfig, config_to_plain
from simwarp.tasks.framework.config_values import plain_value

from ..config import TrainConfig
from ..runs.run_folder import CONFIG, WARM_START, RunFolder, prepare_run, run_description

OWN: Final = ("train_config.seed", "train_config.threads", "train_config.iterations")
"""Settings in which runs of one sweep may differ: its own seed, processors as there are, iterations to go on to."""
_TASK = "task."
_LONGEST = LONGEST_NAME - 55
"""Bytes of a name, beside which a seed or a digest still finds its place."""


@dataclasses.dataclass(frozen=True)
class SweepRun:
    """A training of a sweep.

    Attributes:
        label: of its point: ``ppo.gamma=0.97``; runs of one label differ in their seed alone.
        values: field -> value at the point, as JSON has it.
        config: configuration of the training, the seed in it.
        task_config: the task's configuration.
        folder: its run folder, there or not.
        warm_start: policy it starts from.
    """

    label: str
    values: Mapping[str, Any]
    config: TrainConfig
    task_config: TaskConfig
    folder: RunFolder
    warm_start: Path | None = None

    @property
    def seed(self) -> int:
        """Seed of worlds, networks and exploration."""
        return self.config.seed

    @property
    def name(self) -> str:
        """Name for people: the point and the seed."""
        return run_name(self.label, self.seed)

    def prepare(self, task: str) -> None:
        """Make the run folder, or hold the one that is there to the configuration that is asked for.

        Raises:
            InputError: it is of another configuration.
            OutputError: the disk did not take it.
        """
        wanted = run_description(task, self.config, self.task_config, self.warm_start)
        if not (self.folder.path / CONFIG).is_file():
            prepare_run(self.folder.path, wanted)
            return
        saved, task_config = self.folder.load_config(), self.task_config
        fields = (field.name for field in dataclasses.fields(task_config))
        free = {f"task_config.{name}" for name in fields if isinstance(getattr(task_config, name), Mapping)}
        start = wanted.pop(WARM_START, None)
        for key, was, now in differences(saved, wanted, free):
            if key not in OWN[1:]:
                raise InputError(
                    f"run {self.folder.path} was made with {_word(key)} = {json.dumps(was)}, not {json.dumps(now)}: "
                    "give another --out"
                )
        started = saved.get(WARM_START)
        if started != start:
            was, now = _recorded_start(started), _recorded_start(start)
            raise InputError(f"run {self.folder.path} was made with {was}, not {now}: give another --out")


def run_name(label: str, seed: int) -> str:
    """Return the name of a run, which is that of its folder."""
    return f"{label},seed={seed}" if label else f"seed={seed}"


def point_label(values: Mapping[str, Any]) -> str:
    """Return the name of a point, ``ppo.gamma=0.97,task.hills=1``, as a file may have it; empty of a point alone."""
    words = ",".join(f"{key}={_value_text(value)}" for key, value in values.items()).replace("/", "|")
    return words if len(words.encode()) <= _LONGEST else f"{words[: _LONGEST // 4]}...{_digest(words)}"


def _value_text(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "x".join(_value_text(item) for item in value)
    return f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else str(value)


def flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested objects as one, with dots between the keys."""
    found: dict[str, Any] = {}
    for key, value in content.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return found


def differences(
    saved: Mapping[str, Any], asked: Mapping[str, Any], free: Collection[str], prefix: str = ""
) -> Iterator[tuple[str, Any, Any]]:
    """Yield key, saved and asked value of each field that differs; fields that are not saved are younger than the run.

    Args:
        saved: configurations of a run, nested.
        asked: those that are asked for.
        free: keys, with dots, of mappings whose entries are no fields: they are compared as a whole.
        prefix: of the keys.
    """
    for name, now in asked.items():
        key = f"{prefix}{name}"
        if name not in saved:
            continue
        was = saved[name]
        if isinstance(now, Mapping) and isinstance(was, Mapping) and key not in free:
            yield from differences(was, now, free, f"{key}.")
        elif was != now:
            yield key, was, now


def _recorded_start(path: str | None) -> str:
    return "no --warm-start" if path is None else f"--warm-start {path}"


def _word(key: str) -> str:
    """Return a key of ``config.json`` as options call it."""
    return key.replace("task_config.", _TASK).removeprefix("train_config.").replace("_", "-")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def sweep_name(
    task: str, config: TrainConfig, task_config: TaskConfig, keys: Sequence[str], more: Mapping[str, Any]
) -> str:
    """Return a name that is the same for all commands that hold the same settings fixed and vary the same fields.

    Values, seeds and iterations are not in it: with more of them, a sweep grows.

    Args:
        task: a registered task.
        config: of the training.
        task_config: of the task.
        keys: fields that are varied, ``ppo.gamma`` and ``task.hills``.
        more: whatever else tells sweeps apart.
    """
    fixed = flat({"train_config": config_to_plain(config), "task_config": config_to_plain(task_config)})
    varied = {
        f"task_config.{key.removeprefix(_TASK)}" if key.startswith(_TASK) else f"train_config.{key}" for key in keys
    }
    content = {key: value for key, value in fixed.items() if key not in varied | set(OWN)} | dict(more)
    words = "-".join([task, *(key.rpartition(".")[2] for key in keys)])[:_LONGEST]
    return f"{words}-{_digest(json.dumps(plain_value(content), sort_keys=True, default=str))}"
