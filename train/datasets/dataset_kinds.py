"""Formats of datasets: what each needs, and what may be read or written where; light, so that it comes first."""

from __future__ import annotations

import enum
import importlib.util
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from simwarp.core.files import FileError, check_input, check_output
from simwarp.core.wording import InputError


class DatasetFormat(enum.Enum):
    """Format of a dataset."""

    NPZ = "npz"
    """One file of arrays, without a further library."""
    MINARI = "minari"
    """A folder of Minari; images as they are."""
    LEROBOT = "lerobot"
    """A folder of LeRobot, format v3.0; images as H.264."""


_MODULES: Final[Mapping[DatasetFormat, tuple[str, ...]]] = {
    DatasetFormat.NPZ: (),
    DatasetFormat.MINARI: ("minari", "pyarrow"),
    DatasetFormat.LEROBOT: ("pyarrow",),
}
"""What each needs; the extra has the name of the format."""
_NAMED: Final = re.compile(r"[-\w]+-v\d+", re.ASCII)
"""Names by which Minari finds datasets: letters, digits, - and _, then the version."""
WORST_QUALITY: Final = 51
"""Of H.264."""


def default_output(kind: DatasetFormat, task_name: str) -> Path:
    """Return where a dataset of a task is written, unless something else is asked for."""
    return Path(task_name + {"npz": ".npz", "minari": "-v0", "lerobot": "_lerobot"}[kind.value])


def check_dataset(kind: DatasetFormat, path: Path, quality: int, option: str = "--output") -> None:
    """Refuse what cannot be recorded to, before any work is done; nothing is touched.

    Args:
        kind: format.
        path: of the file or the folder.
        quality: of videos.
        option: what asked for the path: the errors begin with it.

    Raises:
        InputError: the name is not one of the format, its extra is not installed, or there is no such quality.
        FileError: it exists already, or cannot be written.
    """
    check_installed(kind)
    if not 0 <= quality <= WORST_QUALITY:
        raise InputError(f"video-quality must be from 0 to {WORST_QUALITY}, got {quality}")
    if kind is DatasetFormat.NPZ:
        if path.suffix != ".npz":
            raise InputError(f"{option} must end in .npz, got '{path}'")
        return
    if os.path.lexists(path):
        raise FileError(f"{option}: '{path}' exists already; give another name or remove it")
    check_output(path, option)
    if kind is DatasetFormat.MINARI and _NAMED.fullmatch(path.name) is None:
        raise InputError(
            f"{option}: a dataset of Minari must be named by letters, digits, - and _, and a version, such as"
            f" '{default_output(kind, 'pendulum')}', got '{path.name}'"
        )


def check_installed(kind: DatasetFormat) -> None:
    """Look for what a format needs without importing it.

    Raises:
        InputError: it is not installed.
    """
    for module in _MODULES[kind]:
        if importlib.util.find_spec(module) is None:
            raise InputError(
                f"format {kind.value} must have module '{module}', got none; pip install 'simwarp[{kind.value}]'"
            )


def check_source(path: Path, task_name: str) -> DatasetFormat:
    """Return the format of what can be read as a dataset; its content is not looked at.

    Args:
        path: of the file or the folder.
        task_name: task that it should be of.

    Raises:
        FileError: nothing is there, or a folder without a dataset.
        InputError: an extra is not installed.
    """
    found = _format_of(path)
    check_installed(found)
    if found is DatasetFormat.NPZ:
        if not os.path.lexists(path):
            raise FileError(
                f"trajectories '{path}': there is no such file or folder; write it with `simwarp record {task_name}"
                f" --output {path}`"
            )
        check_input(path, "file of trajectories")
    return found


def _format_of(path: Path) -> DatasetFormat:
    try:
        if not path.is_dir():
            return DatasetFormat.NPZ
        if (path / "meta").is_dir():
            return DatasetFormat.LEROBOT
        if (path / "data" / "metadata.json").exists() or (path / "metadata.json").exists():
            return DatasetFormat.MINARI
    except (OSError, ValueError):
        return DatasetFormat.NPZ  # its reader says what is wrong with the name
    raise FileError(
        f"trajectories '{path}': the folder holds no dataset, neither meta/ of LeRobot nor data/metadata.json of Minari"
    )
