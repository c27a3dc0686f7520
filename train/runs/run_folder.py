"""The folder of one training run: what was asked, on what it ran, checkpoints, progress and pictures."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import math
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from simwarp.core.files import DRAFT_PREFIX, FileError, check_output, output_error, read_json
from simwarp.core.types import formatted
from simwarp.tasks import InputError, TaskConfig, config_to_plain
from simwarp.tasks.framework.registry import origin_of

from ..config import TrainConfig, configs_from_plain
from .checkpoint import SUFFIX, check_members, checkpoint_bytes, checkpoint_name, load_checkpoint
from .run_files import write_json, write_run_file

CONFIG = "config.json"
PROVENANCE = "provenance.json"
PROGRESS = "progress.csv"
CURVE = "learning_curve.png"
CHECKPOINTS = "checkpoints"
FILMS = "films"
RUNS = Path("runs")
WARM_START = "warm_start"
"""Entry of ``config.json``: the policy that the run starts from."""

_CONFIG_TYPES: Final = {"task": str, "train_config": dict, "task_config": dict}
_ITERATION = re.compile(rf"iteration_([0-9]{{1,18}}){re.escape(SUFFIX)}")
_STAMP = "%Y-%m-%d_%H-%M-%S"
_RUN_NAME = re.compile(r"([0-9]{4}-[0-9]{2}-[0-9]{2}_[0-9]{2}-[0-9]{2}-[0-9]{2})(?:-([0-9]{1,9}))?")
_FOLDER_BYTES = 8192
"""Bytes of two empty folders."""
_LONGEST_SHOWN = 300
"""Characters of a path that an error shows as it is."""
_SAME_SECOND = 1000
"""Runs of a task that may begin within one second."""


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
        return self.path / CHECKPOINTS

    @property
    def progress(self) -> Path:
        """Path of the table of the training's progress, one line per iteration."""
        return self.path / PROGRESS

    @property
    def curve(self) -> Path:
        """Path of the picture of the learning curve."""
        return self.path / CURVE

    def film(self, iteration: int) -> Path:
        """Path of the film of the policy after ``iteration`` iterations."""
        return self.path / FILMS / f"iteration_{iteration:06d}.html"

    def checkpoint_files(self) -> list[Path]:
        """Return the checkpoints, by their iterations: oldest first."""
        return [path for _, path in sorted(self._numbered())]

    def _numbered(self) -> Iterator[tuple[int, Path]]:
        for path in self.checkpoints.glob(f"iteration_*{SUFFIX}"):
            found = _ITERATION.fullmatch(path.name)
            if found and path.is_file():
                yield int(found[1]), path

    def latest_checkpoint(self) -> Path:
        """Return the newest checkpoint.

        Raises:
            InputError: there is none yet.
        """
        files = self.checkpoint_files()
        if not files:
            raise InputError(f"run {self.path} has no checkpoint")
        return files[-1]

    def load_latest(self) -> tuple[Path, dict[str, Any]]:
        """Return the newest checkpoint and what is in it.

        Raises:
            InputError: there is none, or it is damaged; then the newest good one is named.
        """
        path = self.latest_checkpoint()
        try:
            return path, load_checkpoint(path)
        except InputError as error:
            good = next((older for older in reversed(self.checkpoint_files()[:-1]) if _is_good(older)), None)
            if good is None:
                raise InputError(f"{error}; run {self.path} has no good one") from None
            raise InputError(
                f"{error}; the newest good one is {good}: move the damaged one away to go on from there"
            ) from None

    def checkpoint_path(self, iteration: int) -> Path:
        """Return the path of the checkpoint after ``iteration`` iterations."""
        return self.checkpoints / checkpoint_name(iteration)

    def sweep(self) -> None:
        """Remove half-written files that a killed process left."""
        for folder in (self.path, self.checkpoints):
            for left in (*folder.glob(f"{DRAFT_PREFIX}*"), *folder.glob(".*.tmp")):
                with contextlib.suppress(OSError):
                    left.unlink()

    def save(self, content: dict[str, Any], keep: int) -> Path:
        """Write a checkpoint and drop the oldest beyond ``keep`` (0: drop none).

        Raises:
            OutputError: the disk did not take it, or the folder is gone; the other checkpoints are unharmed.
        """
        path = self.checkpoint_path(content["iteration"])
        write_run_file(path, checkpoint_bytes(content))
        if keep > 0:
            for old in self.checkpoint_files()[:-keep]:
                old.unlink(missing_ok=True)
        return path

    def load_config(self) -> dict[str, Any]:
        """Return the configuration that ``create_run`` wrote: ``task``, ``train_config``, ``task_config``.

        Raises:
            InputError: it is missing, damaged, has values of other types, or is of a task that is not installed.
        """
        path = self.path / CONFIG
        try:
            content = read_json(path, CONFIG)
        except FileError as error:
            raise InputError(f"run {self.path} has no readable {CONFIG}: is it a run folder? {error}") from None
        if not isinstance(content, dict):
            raise InputError(f"{path} is not the configuration of a run")
        check_members(content, _CONFIG_TYPES, str(path))
        configs_from_plain(content, str(path))
        return content

    def began(self) -> tuple[float, int, str]:
        """Return the key that sorts runs by time: seconds, the number behind the name, the name.

        The time is that in the provenance; of a run without one that in the name; of one without either, long ago.
        """
        found = _RUN_NAME.fullmatch(self.path.name)
        stamp, number = (found[1], found[2]) if found else ("", None)
        try:
            made = read_json(self.path / PROVENANCE, PROVENANCE)
            seconds = datetime.datetime.fromisoformat(made["started"]).timestamp()
        except (FileError, TypeError, KeyError, ValueError, OverflowError, OSError):
            seconds = _time_of(stamp)
        return seconds, int(number or 1), self.path.name


def _is_good(path: Path) -> bool:
    try:
        load_checkpoint(path)
    except InputError:
        return False
    return True


def _time_of(stamp: str) -> float:
    """Return the seconds of a time as run folders are called after it; minus infinity of anything else."""
    try:
        return datetime.datetime.strptime(stamp, _STAMP).timestamp()
    except (ValueError, OverflowError, OSError):
        return -math.inf


def check_root(root: Path, option: str = "--runs") -> None:
    """Refuse a folder of runs in which none could be made, before any work is done; `option` gave it.

    Raises:
        FileError: it, or the nearest folder above it that there is, is no folder or write-protected.
    """
    above = next((path for path in (root, *root.absolute().parents) if os.path.lexists(path)), Path("/"))
    if not os.path.isdir(above):
        raise FileError(f"{option}: '{above}' is no folder; name one in which run folders can be made")
    check_output(above / "run", option)


def run_description(
    task_name: str, config: TrainConfig, task_config: TaskConfig, warm_start: Path | None = None
) -> dict[str, Any]:
    """Return what ``config.json`` of a run says: the task and its file, configurations, the policy to start from."""
    configs = {"train_config": config_to_plain(config), "task_config": config_to_plain(task_config)}
    start = {} if warm_start is None else {WARM_START: str(warm_start)}
    return {**origin_of(task_name), **configs, **start}


def create_run(root: Path, task: str, config: dict[str, Any]) -> RunFolder:
    """Create ``root/task/<time>`` with its configuration and provenance.

    Raises:
        FileError: a thousand runs began in this second.
        OutputError: the disk did not take it; nothing is left.
    """
    stamp = datetime.datetime.now().strftime(_STAMP)
    for attempt in range(1, _SAME_SECOND + 1):
        path = root / task / (stamp if attempt == 1 else f"{stamp}-{attempt}")
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise output_error(path, error, needed=_FOLDER_BYTES) from error
        return _filled(path, config)
    raise FileError(f"--runs: no run folder can be made in {root / task}; choose another")


def prepare_run(path: Path, config: dict[str, Any]) -> RunFolder:
    """Create a run folder at ``path`` that ``simwarp train --resume`` begins; it is there whole or not at all.

    Raises:
        OutputError: something stands there, or the disk did not take it; nothing is left.
    """
    draft = path.with_name(f"{DRAFT_PREFIX}{path.name}")
    shutil.rmtree(draft, ignore_errors=True)  # of a process that was killed
    try:
        draft.mkdir(parents=True)
        _filled(draft, config)
        draft.rename(path)
    except OSError as error:
        shutil.rmtree(draft, ignore_errors=True)
        raise output_error(path, error, needed=_FOLDER_BYTES) from error
    return RunFolder(path)


def _filled(path: Path, config: dict[str, Any]) -> RunFolder:
    """Write what is known of a run before it begins; remove its new folder if that fails."""
    try:
        (path / CHECKPOINTS).mkdir()
        write_json(path / CONFIG, config)
        write_json(path / PROVENANCE, provenance())
    except BaseException as error:
        shutil.rmtree(path, ignore_errors=True)
        if isinstance(error, OSError):
            raise output_error(path, error, needed=_FOLDER_BYTES) from error
        raise
    return RunFolder(path)


def open_run(path: Path) -> RunFolder:
    """Return an existing run folder.

    Raises:
        InputError: there is none at ``path``.
    """
    if not os.path.isdir(path):
        what = "is no folder" if os.path.lexists(path) else "does not exist"
        raise InputError(f"run folder {path if len(str(path)) <= _LONGEST_SHOWN else formatted(str(path))} {what}")
    folder = RunFolder(path)
    folder.load_config()
    return folder


def latest_run(root: Path, task: str, obs: str | None = None, variant: str | None = None) -> RunFolder | None:
    """Return the newest run of a task (with ``obs`` observations, in a ``variant``) that has a checkpoint, if any."""
    folders = [RunFolder(path) for path in (root / task).glob("*") if path.is_dir()] if os.path.isdir(root) else []
    for folder in sorted(folders, key=RunFolder.began, reverse=True):
        if folder.checkpoint_files() and _is_wanted(folder, {"obs": obs, "variant": variant}):
            return folder
    return None


def _is_wanted(folder: RunFolder, wanted: Mapping[str, str | None]) -> bool:
    """Return True if a run's task had these fields, None being any; False where they cannot be read."""
    if all(value is None for value in wanted.values()):
        return True
    try:
        content = folder.load_config()
        config = config_to_plain(configs_from_plain(content, str(folder.path / CONFIG))[1])
    except InputError:
        return False
    return all(value in (None, config.get(name)) for name, value in wanted.items())


def read_policy(path: Path) -> tuple[Path, dict[str, Any]]:
    """Return the checkpoint that ``path``, a file or a run folder, stands for, and what is in it.

    Raises:
        InputError: there is none, or it cannot be read.
    """
    return open_run(path).load_latest() if os.path.isdir(path) else (path, load_checkpoint(path))


def git_revision() -> dict[str, Any]:
    """Return revision and state of the repository the package runs from; empty where it is installed."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return {}

    def git(*arguments: str) -> str | None:
        try:
            done = subprocess.run(
                ["git", "-C", str(root), *arguments],
                capture_output=True,
                encoding="utf-8",
                errors="replace",
                timeout=10,
            )
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
    """Return the provenance of a run: command, revision, versions, machine."""
    return {
        "command": ["simwarp", *sys.argv[1:]],
        "started": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "git": git_revision(),
        "versions": versions(),
        "platform": platform.platform(),
        "machine": platform.machine(),
    }
