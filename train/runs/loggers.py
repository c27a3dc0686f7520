"""Loggers of a run's scalars: ``progress.csv`` always, TensorBoard events or Weights & Biases beside it."""

from __future__ import annotations

import importlib
import io
import math
import os
import socket
import time
from pathlib import Path
from typing import Any, Protocol

from simwarp.tasks import InputError

from ..algorithm.learner import IterationReport
from ..config import LoggerKind
from .progress_table import FIRST_COLUMNS, WALL, ProgressTable
from .run_files import append_whole
from .run_folder import RunFolder


class ScalarWriter(Protocol):
    """Takes scalars by name."""

    def write(self, values: dict[str, float], iteration: int) -> None:
        """Take the scalars of one iteration."""

    def close(self) -> None:
        """Write what is still in memory."""


class TensorBoard:
    """TensorBoard events in the run folder, written at once.

    Torch's own writer has a thread that a full disk ends, with a traceback, and that the training then waits for.

    Args:
        folder: the run folder.
        first: first iteration to come; events of it and of later ones, of a run that was killed, are dropped.

    Raises:
        OutputError: the disk did not take them.
    """

    def __init__(self, folder: Path, first: int) -> None:
        from tensorboard.compat.proto.event_pb2 import SessionLog

        name = f"events.out.tfevents.{int(time.time()):010d}.{socket.gethostname()}.{os.getpid()}.0"
        self._path = folder / name
        self._add(first, file_version="brain.Event:2")
        self._add(first, session_log=SessionLog(status=SessionLog.START))

    def _add(self, step: int, **content: Any) -> None:
        from tensorboard.compat.proto.event_pb2 import Event
        from tensorboard.summary.writer.record_writer import RecordWriter

        record = io.BytesIO()
        RecordWriter(record).write(Event(wall_time=time.time(), step=step, **content).SerializeToString())
        append_whole(self._path, record.getvalue())

    def write(self, values: dict[str, float], iteration: int) -> None:
        """Take the scalars of one iteration.

        Raises:
            OutputError: the disk did not take them.
        """
        from tensorboard.compat.proto.summary_pb2 import Summary

        scalars = [Summary.Value(tag=name, simple_value=value) for name, value in values.items()]
        self._add(iteration, summary=Summary(value=scalars))

    def close(self) -> None:
        """Nothing is left to be written."""


class WeightsAndBiases:
    """Weights & Biases; offline, in the run folder, unless the variable WANDB_MODE says otherwise.

    Args:
        folder: the run folder.
        description: task and configurations.
    """

    def __init__(self, folder: Path, description: dict[str, Any]) -> None:
        self._run: Any = import_wandb().init(
            project=os.environ.get("WANDB_PROJECT", "simwarp"),
            name=folder.name,
            dir=str(folder),
            config=description,
            mode=os.environ.get("WANDB_MODE", "offline"),
        )

    def write(self, values: dict[str, float], iteration: int) -> None:
        """Take the scalars of one iteration."""
        self._run.log(values, step=iteration)

    def close(self) -> None:
        """Finish the run."""
        self._run.finish()


def import_wandb() -> Any:
    """Return the module wandb.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module("wandb")
    except ImportError as error:
        raise InputError("--logger wandb needs the package wandb: pip install 'simwarp[wandb]'") from error


def check_logger(kind: LoggerKind) -> None:
    """Refuse a logger that is not installed, before any work is done."""
    if kind is LoggerKind.WANDB:
        import_wandb()


class RunLog:
    """All records of one run.

    Args:
        folder: the run folder.
        first: report of the first iteration; its values are the first columns.
        kind: logger beside the table.
        description: task and configurations.

    Attributes:
        lost: lines of an earlier table that could not be read.

    Raises:
        OutputError: the disk did not take them.
    """

    def __init__(
        self, folder: RunFolder, first: IterationReport, kind: LoggerKind, description: dict[str, Any]
    ) -> None:
        done = first.iteration - 1
        self._table = ProgressTable(folder.progress, [*FIRST_COLUMNS, *sorted(first.values)], keep_below=done)
        self.lost = self._table.lost
        self._sink: ScalarWriter | None = None
        if kind is LoggerKind.TENSORBOARD:
            self._sink = TensorBoard(folder.path, first.iteration)
        elif kind is LoggerKind.WANDB:
            self._sink = WeightsAndBiases(folder.path, description)

    def add(self, report: IterationReport, wall: float) -> None:
        """Record one iteration, ``wall`` seconds after the start or the resume.

        Raises:
            OutputError: the disk did not take it.
        """
        row: dict[str, float | int] = {
            "iteration": report.iteration,
            "env_steps": report.env_steps,
            WALL: round(self._table.wall + wall, 3),
            "mean_reward": report.mean_reward,
            "mean_episode_length": report.mean_episode_length,
            "env_steps_per_s": round(report.env_steps_per_s, 1),
        }
        self._table.append(row | report.values)
        if self._sink is None:
            return
        scalars = {f"train/{name}": float(row[name]) for name in ("mean_reward", "mean_episode_length")}
        scalars = {name: value for name, value in scalars.items() if math.isfinite(value)}
        scalars |= {
            "speed/env_steps_per_s": report.env_steps_per_s,
            "speed/collect_s": report.collect_s,
            "speed/learn_s": report.learn_s,
        }
        scalars |= {name if "/" in name else f"train/{name}": value for name, value in report.values.items()}
        self._sink.write(scalars, report.iteration)

    def close(self) -> None:
        """Write what is still in memory."""
        if self._sink is not None:
            self._sink.close()
