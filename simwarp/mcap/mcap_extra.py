"""The extra that recordings need, and what a recording may be called."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Final

from simwarp.core.files import check_output
from simwarp.core.types import ModelError

SUFFIX: Final = ".mcap"
LIBRARIES: Final = ("mcap", "rosbags")


def not_installed(error: ImportError) -> ModelError:
    """What to raise where one of its libraries is missing."""
    return ModelError(f"recording: must have module '{error.name}', got none; pip install 'simwarp[mcap]'")


def check_mcap_path(path: str | Path, option: str = "--record") -> Path:
    """Refuses what cannot be recorded to, before any work is done; nothing is touched.

    Raises:
        ModelError: it is another kind of file, or the extra is not installed.
        FileError: it cannot be written to.
    """
    if Path(path).suffix.lower() != SUFFIX:
        raise ModelError(f"{option}: the name must end in {SUFFIX}, got '{path}'; rename it")
    for name in LIBRARIES:
        if importlib.util.find_spec(name) is None:
            raise not_installed(ImportError(name=name))
    return check_output(path, option)
