"""Checkpoints: written all at once or not at all, and read without running code from the file."""

from __future__ import annotations

import io
import os
import pickle
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import torch
from simwarp.tasks import InputError

FORMAT = 1
SUFFIX = ".pt"
_REQUIRED = ("format", "task", "iteration", "train_config", "task_config", "actor_state_dict")


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that whoever looks sees the old content or the new one, even if the process dies."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp gives 0600; a run folder is read by others
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, 0o666 & ~umask)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def save_checkpoint(path: Path, content: dict[str, Any]) -> None:
    """Write ``content`` (tensors, numbers, strings, lists and dicts of them) to ``path``."""
    buffer = io.BytesIO()
    torch.save({"format": FORMAT, **content}, buffer)
    write_atomically(path, buffer.getvalue())


def load_checkpoint(path: Path, device: str = "cpu") -> dict[str, Any]:
    """Read a checkpoint.

    Raises:
        InputError: the file is missing, truncated, of another kind or of another version.
    """
    if not path.is_file():
        raise InputError(f"checkpoint {path} does not exist")
    try:
        content = torch.load(path, map_location=device, weights_only=True)
    except (RuntimeError, EOFError, OSError, ValueError, KeyError, pickle.UnpicklingError, zipfile.BadZipFile) as error:
        raise InputError(f"checkpoint {path} is truncated or not a checkpoint") from error
    if not isinstance(content, dict) or any(key not in content for key in _REQUIRED):
        raise InputError(f"{path} is no simwarp checkpoint: it was written by another program")
    if content["format"] != FORMAT:
        raise InputError(f"checkpoint {path} has format {content['format']}, this simwarp reads {FORMAT}")
    return content


def checkpoint_name(iteration: int) -> str:
    """Return the file name of the checkpoint after ``iteration`` iterations."""
    return f"iteration_{iteration:06d}{SUFFIX}"


def slim(content: dict[str, Any]) -> dict[str, Any]:
    """Return only what playing needs: no optimiser, critic, random state or worlds."""
    return {key: content[key] for key in _REQUIRED}
