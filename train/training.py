"""A whole training run: folder, checkpoints, logs, picture, interruption and resuming."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from simwarp.tasks import InputError, TaskConfig, make, resolve_device

from .checkpoint import load_checkpoint
from .config import TrainConfig, to_plain
from .curve import draw_learning_curve
from .progress import ProgressDisplay
from .run_folder import RUNS, ProgressTable, RunFolder, create_run, open_run, provenance, write_json
from .trainer import IterationReport, Trainer

_COLUMNS = ("iteration", "env_steps", "wall_s", "mean_reward", "mean_episode_length", "env_steps_per_s")


@dataclasses.dataclass(frozen=True)
class TrainResult:
    """What a run reached. The names are the keys of ``simwarp train --json``."""

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


@dataclasses.dataclass
class StopRequest:
    """Whether someone asked the run to stop after the running iteration."""

    requested: bool = False


@contextlib.contextmanager
def stop_on_signals() -> Iterator[StopRequest]:
    """Turn the first Ctrl-C or SIGTERM into a request to stop; a second one stops at once.

    An iteration is left whole: its rollout is learnt from and the checkpoint is one that can be resumed exactly.
    """
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return

    def ask(number: int, frame: object) -> None:
        if request.requested:
            raise KeyboardInterrupt
        request.requested = True

    previous = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


class _Log:
    """``progress.csv`` and TensorBoard events of one run."""

    def __init__(self, folder: RunFolder, first: IterationReport) -> None:
        from torch.utils.tensorboard import SummaryWriter

        done = first.iteration - 1
        self._table = ProgressTable(folder.progress, [*_COLUMNS, *sorted(first.values)], keep_below=done)
        self._events = SummaryWriter(log_dir=str(folder.path), purge_step=first.iteration)

    def add(self, report: IterationReport, wall: float) -> None:
        row: dict[str, float | int] = {
            "iteration": report.iteration,
            "env_steps": report.env_steps,
            "wall_s": round(wall, 3),
            "mean_reward": report.mean_reward,
            "mean_episode_length": report.mean_episode_length,
            "env_steps_per_s": round(report.env_steps_per_s, 1),
        }
        self._table.append(row | report.values)
        for name in ("mean_reward", "mean_episode_length"):
            if math.isfinite(row[name]):
                self._events.add_scalar(f"train/{name}", row[name], report.iteration)
        self._events.add_scalar("speed/env_steps_per_s", report.env_steps_per_s, report.iteration)
        self._events.add_scalar("speed/collect_s", report.collect_s, report.iteration)
        self._events.add_scalar("speed/learn_s", report.learn_s, report.iteration)
        for name, value in report.values.items():
            self._events.add_scalar(name if "/" in name else f"train/{name}", value, report.iteration)

    def close(self) -> None:
        self._events.close()


def train(
    task_name: str,
    config: TrainConfig,
    task_config: TaskConfig,
    *,
    root: Path = RUNS,
    resume: Path | None = None,
    console: Console | None = None,
) -> TrainResult:
    """Train a policy and leave a run folder.

    Args:
        task_name: a registered task.
        config: how to train.
        task_config: the task's configuration.
        root: folder of all runs.
        resume: run folder to go on with, in place of a new one.
        console: where the progress goes; standard output by default.

    Raises:
        InputError: something asked for is impossible.
        TaskError: the task broke its contract.
        TrainingError: learning diverged.
    """
    console = console or Console()
    device = resolve_device(config.device)
    torch.set_num_threads(config.threads)
    saved = None if resume is None else _saved_run(resume, task_name, config)
    # Kernels are compiled once per machine, which takes a while in which nothing else is shown
    console.print(f"building {config.num_envs} worlds of '{task_name}' on {device} ...", highlight=False)
    task = make(task_name, config.num_envs, device=device, seed=config.seed, config=task_config)
    trainer = Trainer(task, config)
    if saved is not None and not trainer.load(saved):
        console.print(f"the checkpoint has another number of worlds than {config.num_envs}: they start afresh")
    description = {"task": task_name, "train_config": to_plain(config), "task_config": to_plain(task_config)}
    if resume is None:
        folder = create_run(root, task_name, description)
    else:
        folder = open_run(resume)
        write_json(folder.path / "config.json", description)
        write_json(folder.path / f"provenance_{trainer.iteration:06d}.json", provenance())
    console.print(f"run folder {folder.path}", highlight=False, soft_wrap=True)
    return _run(trainer, folder, console)


def _saved_run(resume: Path, task_name: str, config: TrainConfig) -> dict[str, Any]:
    folder = open_run(resume)
    content = load_checkpoint(folder.latest_checkpoint())
    if content["task"] != task_name:
        raise InputError(f"run {resume} is of task '{content['task']}', not '{task_name}'")
    if "worlds" not in content:
        raise InputError(f"checkpoint {folder.latest_checkpoint()} holds only a policy: it cannot be resumed")
    if content["iteration"] >= config.iterations:
        raise InputError(f"run {resume} already has {content['iteration']} iterations; ask for more with --iterations")
    return content


def _run(trainer: Trainer, folder: RunFolder, console: Console) -> TrainResult:
    config = trainer.config
    first, first_steps = trainer.iteration, trainer.env_steps
    started = time.perf_counter()
    log: _Log | None = None
    report: IterationReport | None = None
    display = ProgressDisplay(console, first, config.iterations)
    checkpoint = None
    with stop_on_signals() as stop:
        try:
            with display:
                while trainer.iteration < config.iterations and not stop.requested:
                    report = trainer.iterate()
                    log = log or _Log(folder, report)
                    log.add(report, time.perf_counter() - started)
                    display.update(report)
                    if report.iteration % config.save_interval == 0:
                        checkpoint = folder.save(trainer.checkpoint(), config.keep_checkpoints)
            if report is not None and report.iteration % config.save_interval != 0:
                checkpoint = folder.save(trainer.checkpoint(), config.keep_checkpoints)
        finally:
            if log is not None:
                log.close()
    wall = time.perf_counter() - started
    if report is None or checkpoint is None:
        raise KeyboardInterrupt
    draw_learning_curve(folder.progress, folder.curve, f"{trainer.task.name}: {config.num_envs} worlds")
    return TrainResult(
        task=trainer.task.name,
        run=str(folder.path),
        checkpoint=str(checkpoint),
        picture=str(folder.curve),
        iterations=trainer.iteration,
        env_steps=trainer.env_steps,
        env_steps_per_s=(trainer.env_steps - first_steps) / wall,
        wall_s=wall,
        mean_reward=report.mean_reward if math.isfinite(report.mean_reward) else None,
        mean_episode_length=report.mean_episode_length if math.isfinite(report.mean_episode_length) else None,
        interrupted=stop.requested and trainer.iteration < config.iterations,
    )
