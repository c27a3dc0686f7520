"""Options of the commands on datasets, ``record`` and ``clone``."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

from simwarp.cli import UsageError
from simwarp.cli.options import CommonOptions
from simwarp.train.datasets.dataset_kinds import DatasetFormat, check_dataset, check_installed, default_output


@dataclasses.dataclass(frozen=True)
class RecordOptions(CommonOptions):
    """Write whole episodes of a policy, observations and actions of every step, to a dataset that `clone` reads."""

    episodes: int = 64
    """Episodes, each world's first ones."""
    format: Literal["npz", "minari", "lerobot"] = "npz"
    """One file of arrays, or a folder that Minari or LeRobot opens."""
    output: Path | None = None
    """File or new folder to write; by default TASK.npz, TASK-v0 (minari) or TASK_lerobot in the working folder."""
    instruction: str | None = None
    """Sentence that says what is to be done, for minari and lerobot; by default the task's own."""
    video_quality: int = 18
    """Of images in lerobot, H.264: from 0, which keeps every bit in large files, to 51, the worst."""
    checkpoint: Path | None = None
    """Checkpoint file or run folder, or `shipped`, the name of a shipped one, `zero`, `random`; by default the newest
    run, else the shipped."""
    num_envs: int | None = None
    """Worlds stepped together; by default one per episode, at most 256."""
    seed: int = 2_000_003
    """Seed of the worlds, other than those of training and evaluation."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""
    runs: Path = Path("runs")
    """Folder of the run folders."""

    @property
    def kind(self) -> DatasetFormat:
        """Of the dataset."""
        return DatasetFormat(self.format)

    def target(self, task: str) -> Path:
        """File or folder that is written for a task."""
        return self.output or default_output(self.kind, task)

    def check_record(self, task: str | None, *inputs: Path) -> None:
        """Refuse what cannot be recorded, before any work is done.

        Args:
            task: its name; None: it is not known yet.
            inputs: files that are read.

        Raises:
            UsageError: a number is out of bounds, or two outputs are the same.
            InputError: the format is not installed, or the output's name is not one of it.
            FileError: the output is there already, or cannot be written.
        """
        for field in ("episodes", "num_envs"):
            value = getattr(self, field)
            if value is not None and value < 1:
                raise UsageError(f"{field.replace('_', '-')} must be at least 1, got {value}")
        check_installed(self.kind)
        if self.output is not None or task is not None:
            target = self.target(str(task))
            check_dataset(self.kind, target, self.video_quality)
            self.check(*inputs, output=target)


@dataclasses.dataclass(frozen=True)
class CloneOptions(CommonOptions):
    """Fit a policy to recorded trajectories. The file it writes plays, evaluates, exports, and starts a training."""

    data: Path | None = None
    """File or folder that `record` wrote, in any of its formats."""
    output: Path | None = None
    """Checkpoint to write, .pt; by default TASK_clone.pt in the working folder."""
