"""A whole training run: folder, checkpoints, logs, picture, interruption and resuming."""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from simwarp.tasks import InputError, TaskConfig, config_to_plain, make

from .checkpoint import load_checkpoint
from .config import TrainConfig
from .curve import draw_learning_curve
from .distributed import Processes, connect, processes
from .loggers import RunLog, check_logger
from .progress import ProgressDisplay
from .run_folder import RUNS, RunFolder, create_run, open_run, provenance, resolve_checkpoint, write_json
from .stopping import StopRequest, stop_on_signals
from .trainer import IterationReport, Trainer


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


def train(
    task_name: str,
    config: TrainConfig,
    task_config: TaskConfig,
    *,
    root: Path = RUNS,
    resume: Path | None = None,
    warm_start: Path | None = None,
    console: Console | None = None,
) -> TrainResult:
    """Train a policy and leave a run folder.

    Under ``torchrun`` all processes train one policy, each with worlds of its own; the first one writes the folder.

    Args:
        task_name: a registered task.
        config: how to train.
        task_config: the task's configuration.
        root: folder of all runs.
        resume: run folder to go on with, in place of a new one.
        warm_start: checkpoint or run whose actor a new run starts from.
        console: where the progress goes; standard output by default.

    Raises:
        InputError: something asked for is impossible.
        TaskError: the task broke its contract.
        TrainingError: learning diverged.
    """
    group = processes()
    console = (console or Console()) if group.first else Console(quiet=True)
    device = group.device(config.device)
    torch.set_num_threads(config.threads)
    check_logger(config.logger)
    if resume is not None and warm_start is not None:
        raise InputError("--warm-start begins a new run and --resume goes on with one: give one of them")
    saved = None if resume is None else _saved_run(resume, task_name, config)
    start = None if warm_start is None else _start_policy(warm_start, task_name)
    # Kernels are compiled once per machine, which takes a while in which nothing else is shown
    console.print(f"building {config.num_envs} worlds of '{task_name}' on {device} ...", highlight=False)
    connect(group, device)
    first_world = group.rank * config.num_envs
    task = make(
        task_name, config.num_envs, device=device, seed=config.seed, config=task_config, first_world=first_world
    )
    trainer = Trainer(task, config, group)
    if saved is not None and not trainer.load(saved):
        console.print(
            "the checkpoint has another number of worlds or processes: the worlds start afresh", soft_wrap=True
        )
    description = {
        "task": task_name,
        "train_config": config_to_plain(config),
        "task_config": config_to_plain(task_config),
    }
    if start is not None:
        trainer.warm_start(start)
        description["warm_start"] = str(warm_start)
    folder = _folder(trainer, root, resume, description)
    _keep_breaks(trainer, folder)
    console.print(f"run folder {folder.path}", highlight=False, soft_wrap=True)
    return _run(trainer, folder, console, description)


def _folder(trainer: Trainer, root: Path, resume: Path | None, description: dict[str, Any]) -> RunFolder:
    """Make or open the run folder, in the first process; the others are told which one it is."""
    path: Path | None = None
    if trainer.group.first:
        if resume is None:
            path = create_run(root, trainer.task.name, description).path
        else:
            path = open_run(resume).path
            kept = {key: value for key, value in RunFolder(path).load_config().items() if key not in description}
            write_json(path / "config.json", description | kept)
            write_json(path / f"provenance_{trainer.iteration:06d}.json", provenance())
            RunFolder(path).sweep()
    told: Path = trainer.group.gather(path)[0]
    return RunFolder(told)


def _keep_breaks(trainer: Trainer, folder: RunFolder) -> None:
    """Let the task write the first breakdown of its physics to the run folder, for ``simwarp replay``."""
    guard = getattr(trainer.task, "guard", None)
    if guard is not None:
        number = f"_{trainer.group.rank}" if trainer.group.several else ""
        guard.path = folder.path / f"broken{number}.npz"


def _start_policy(path: Path, task_name: str) -> dict[str, Any]:
    content = load_checkpoint(resolve_checkpoint(path))
    if content["task"] != task_name:
        raise InputError(f"the policy to start from, {path}, is of task '{content['task']}', not '{task_name}'")
    return content


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


def _stops(group: Processes, stop: StopRequest, device: str) -> bool:
    """Whether any process was asked to stop: all must leave in the same iteration."""
    return group.sums({"stop": float(stop.requested)}, device)["stop"] > 0.0


def _save(trainer: Trainer, folder: RunFolder) -> Path:
    """Write a checkpoint, all processes together; return its path."""
    content = trainer.checkpoint()
    if trainer.group.first:
        folder.save(content, trainer.config.keep_checkpoints)
    trainer.group.gather(None)  # none goes on before the file is there
    return folder.checkpoint_path(content["iteration"])


def _run(trainer: Trainer, folder: RunFolder, console: Console, description: dict[str, Any]) -> TrainResult:
    config, group = trainer.config, trainer.group
    first, first_steps = trainer.iteration, trainer.env_steps
    started = time.perf_counter()
    log: RunLog | None = None
    report: IterationReport | None = None
    display = ProgressDisplay(console, first, config.iterations)
    checkpoint: Path | None = None
    stopped = False
    with stop_on_signals() as stop:
        try:
            with display:
                while trainer.iteration < config.iterations and not stopped:
                    report = trainer.iterate()
                    if group.first:
                        log = log or RunLog(folder, report, config.logger, description)
                        log.add(report, time.perf_counter() - started)
                        display.update(report)
                    if report.iteration % config.save_interval == 0:
                        checkpoint = _save(trainer, folder)
                    stopped = _stops(group, stop, trainer.device)
            if report is not None and report.iteration % config.save_interval != 0:
                checkpoint = _save(trainer, folder)
        finally:
            if log is not None:
                log.close()
    wall = time.perf_counter() - started
    if report is None or checkpoint is None:
        raise KeyboardInterrupt
    if group.first:
        worlds = config.num_envs * group.count
        draw_learning_curve(folder.progress, folder.curve, f"{trainer.task.name}: {worlds} worlds")
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
        interrupted=stopped and trainer.iteration < config.iterations,
    )
