"""Writing of the files of a run folder: whole or not at all, with an error where the disk does not take them.

The folder could be written to when the run began: whatever is wrong later is not the user's input.
"""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

from simwarp.core.files import FileError, OutputError, output_error, write_file


def write_run_file(path: Path, data: bytes) -> None:
    """Write a whole file.

    Raises:
        OutputError: the disk did not take it, or the folder is gone; what stood there is unharmed.
    """
    try:
        write_file(path, data)
    except FileError as error:
        if not path.parent.is_dir():
            gone = OSError(errno.ENOENT, os.strerror(errno.ENOENT))
            raise output_error(path, gone, needed=len(data)) from None
        raise OutputError(str(error)) from None


def append_whole(path: Path, data: bytes) -> None:
    """Add to the end of a file, which is made if it is not there: all of the data or nothing.

    Raises:
        OutputError: the disk did not take it, or the folder is gone.
    """
    try:
        with path.open("ab", buffering=0) as file:
            _append(file.fileno(), data)
    except OSError as error:
        raise output_error(path, error, needed=len(data)) from error


def _append(handle: int, data: bytes) -> None:
    end = os.fstat(handle).st_size
    rest = data
    try:
        while rest:
            # A disk with room for a part takes that, and says why not more when it gets the rest
            rest = rest[os.write(handle, rest) :]
    except OSError:
        os.ftruncate(handle, end)
        raise


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write readable JSON, all at once.

    Raises:
        OutputError: see :func:`write_run_file`.
    """
    write_run_file(path, (json.dumps(content, indent=2, default=str) + "\n").encode())
