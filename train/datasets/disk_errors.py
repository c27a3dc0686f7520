"""What the disk says while a dataset is written, in one line."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from simwarp.core.files import OutputError, output_error


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Make one error of whatever goes wrong with the disk inside the block.

    Args:
        path: of what is written.

    Raises:
        OutputError: the disk did not take it.
    """
    try:
        yield
    except OutputError:
        raise
    except (OSError, pa.ArrowException) as error:
        number = getattr(error, "errno", None)
        reason = OSError(number, os.strerror(number)) if number else OSError(str(error).partition("\n")[0])
        raise output_error(path, reason) from error
