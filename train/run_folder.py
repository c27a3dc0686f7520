"""The folder of one training run: what was asked, on what it ran, checkpoints, progress and pictures."""

from __future__ import annotations

import csv
import dataclasses
import datetime
import io
import json
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from simwarp.tasks import InputError

from .checkpoint import SUFFIX, checkpoint_name, load_checkpoint, save_checkpoint, write_atomically

CONFIG = "config.json"
PROVENANCE = "provenance.json"
PROGRESS = "progress.csv"
CURVE = "learning_curve.png"
RUNS = Path("runs")


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """A run folder that exists.

    Attributes:
        path: the folder.
    """

    path: Path

    @property
    def checkpoints(self) -> Path:
        """Folder of the checkpoints."""
        return self.path / "checkpoints"

    @property
    def progress(self) -> Path:
        """One line per iteration."""
        return self.path / PROGRESS

    @property
    def curve(self) -> Path:
        """Picture of the learning curve."""
        return self.path / CURVE

    def checkpoint_files(self) -> list[Path]:
        """Return the checkpoints, oldest first."""
        return sorted(self.checkpoints.glob(f"iteration_*{SUFFIX}"))

    def latest_checkpoint(self) -> Path:
        """Return the newest checkpoint.

        Raises:
            InputError: there is none yet.
        """
        files = self.checkpoint_files()
        if not files:
            raise InputError(f"run {self.path} has no checkpoint")
        return files[-1]

    def checkpoint_path(self, iteration: int) -> Path:
        """Return where the checkpoint after ``iteration`` iterations is written."""
        return self.checkpoints / checkpoint_name(iteration)

    def sweep(self) -> None:
        """Remove half-written files that a killed process left."""
        for folder in (self.path, self.checkpoints):
            for left in folder.glob(".*.tmp"):
                left.unlink(missing_ok=True)

    def save(self, content: dict[str, Any], keep: int) -> Path:
        """Write a checkpoint and drop the oldest beyond ``keep`` (0: drop none)."""
        path = self.checkpoint_path(content["iteration"])
        save_checkpoint(path, content)
        if keep > 0:
            for old in self.checkpoint_files()[:-keep]:
                old.unlink()
        return path

    def load_config(self) -> dict[str, Any]:
        """Return what :func:`create_run` wrote: ``task``, ``train_config``, ``task_config``."""
        path = self.path / CONFIG
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"run {self.path} has no readable {CONFIG}: is it a run folder?") from error
        if not isinstance(content, dict) or not {"task", "train_config", "task_config"} <= content.keys():
            raise InputError(f"{path} is not the configuration of a run")
        return content


def create_run(root: Path, task: str, config: dict[str, Any]) -> RunFolder:
    """Create ``root/task/<time>`` with its configuration and provenance."""
    stamp = datetime.datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    for attempt in range(1000):
        path = root / task / (stamp if attempt == 0 else f"{stamp}-{attempt + 1}")
        try:
            path.mkdir(parents=True)
            break
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"cannot create run folder {path}: {error.strerror}") from error
    folder = RunFolder(path)
    folder.checkpoints.mkdir()
    write_json(path / CONFIG, config)
    write_json(path / PROVENANCE, provenance())
    return folder


def open_run(path: Path) -> RunFolder:
    """Return an existing run folder.

    Raises:
        InputError: there is none at ``path``.
    """
    if not path.is_dir():
        raise InputError(f"run folder {path} does not exist")
    folder = RunFolder(path)
    folder.load_config()
    return folder


def latest_run(root: Path, task: str, obs: str | None = None) -> RunFolder | None:
    """Return the newest run of a task (with ``obs`` observations) that has a checkpoint, if there is one."""
    folders = sorted((path for path in (root / task).glob("*") if path.is_dir()), key=lambda path: path.name)
    for path in reversed(folders):
        folder = RunFolder(path)
        if folder.checkpoint_files() and obs in (None, folder.load_config()["task_config"].get("obs")):
            return folder
    return None


def resolve_checkpoint(path: Path) -> Path:
    """Return the checkpoint file that ``path``, a file or a run folder, stands for."""
    return open_run(path).latest_checkpoint() if path.is_dir() else path


def newest_loadable(folder: RunFolder) -> dict[str, Any]:
    """Read the newest checkpoint of a run."""
    return load_checkpoint(folder.latest_checkpoint())


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write readable JSON, all at once."""
    write_atomically(path, (json.dumps(content, indent=2, default=str) + "\n").encode())


def git_revision() -> dict[str, Any]:
    """Return revision and state of the repository the package runs from; empty where it is installed."""
    root = Path(__file__).resolve().parents[1]
    if not (root / ".git").exists():
        return {}

    def git(*arguments: str) -> str | None:
        try:
            done = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=10)
        except (OSError, subprocess.TimeoutExpired):
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    status = git("status", "--porcelain")
    return {"revision": git("rev-parse", "HEAD"), "dirty": None if status is None else bool(status)}


def versions() -> dict[str, str | None]:
    """Return the versions of Python, of this package and of what it stands on."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    for name in ("simwarp", "warp-lang", "torch", "rsl-rl-lib", "gymnasium", "numpy", "trimesh", "tyro"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found


def provenance() -> dict[str, Any]:
    """Return what made a run: command, revision, versions, machine."""
    return {
        "command": ["simwarp", *sys.argv[1:]],
        "started": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "git": git_revision(),
        "versions": versions(),
        "platform": platform.platform(),
        "machine": platform.machine(),
    }


class ProgressTable:
    """``progress.csv``: one line per iteration, appended and flushed at once.

    Args:
        path: the file.
        columns: names of the columns.
        keep_below: of an existing file, keep the lines of iterations below this one.
    """

    def __init__(self, path: Path, columns: list[str], keep_below: int = 0) -> None:
        self.path = path
        self.columns = columns
        kept = [row for row in read_progress(path) if int(row["iteration"]) <= keep_below]
        buffer = io.StringIO()
        writer = csv.DictWriter(buffer, columns, extrasaction="ignore", restval="")
        writer.writeheader()
        writer.writerows(kept)
        write_atomically(path, buffer.getvalue().encode())

    def append(self, row: dict[str, float | int]) -> None:
        """Add one line."""
        with self.path.open("a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, self.columns, extrasaction="ignore", restval="").writerow(row)


def read_progress(path: Path) -> list[dict[str, str]]:
    """Return the lines of ``progress.csv`` that are complete; none where there is no file."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        # A process killed while it wrote leaves half a line
        return [row for row in csv.DictReader(file) if None not in row.values() and None not in row]
