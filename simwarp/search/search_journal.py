"""Journal of a search by Optuna: a file in which its trials are kept, so that it can go on."""

from __future__ import annotations

import importlib
import json
import os
from pathlib import Path
from typing import Any, Final

from simwarp.core.files import FileError, check_input, output_error
from simwarp.core.types import ModelError

STORAGE: Final = "search.log"
"""Journal of the trials, in the folder of the search."""


def import_optuna() -> Any:
    """Return the module optuna.

    Raises:
        ModelError: it is not installed.
    """
    try:
        return importlib.import_module("optuna")
    except ImportError as error:
        raise ModelError("--search needs the package optuna: pip install 'simwarp[sweep]'") from error


def _damaged(path: Path, why: str) -> FileError:
    remedy = "put a whole copy in its place, or give another --out"
    return FileError(f"journal of the search {path} is damaged ({why}); {remedy}")


def _check_journal(path: Path) -> None:
    """Refuse a journal that is none, and drop the end of one whose writer was killed in the middle of a line.

    What is added to it would stand in the same line.

    Raises:
        FileError: it is no regular file, or a line is no object of JSON.
        OutputError: it cannot be shortened.
    """
    if not os.path.lexists(path):
        return
    data = check_input(path, "journal of the search").read_bytes()
    whole = data.rfind(b"\n") + 1
    for number, line in enumerate(data[:whole].splitlines(), 1):
        try:
            known = isinstance(json.loads(line), dict)
        except (ValueError, RecursionError):
            known = False
        if not known:
            raise _damaged(path, f"line {number}")
    if whole < len(data):
        try:
            os.truncate(path, whole)
        except OSError as error:
            raise output_error(path, error) from error


def open_study(path: Path, name: str, *, maximise: bool = True) -> Any:
    """Return the study that a journal holds, or begin both.

    Args:
        path: of the journal.
        name: of the study in it.
        maximise: whether large values are good.

    Raises:
        ModelError: optuna is not installed.
        FileError: the journal is damaged, or no regular file.
        OutputError: the disk did not take it.
    """
    optuna = import_optuna()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    _check_journal(path)
    try:
        backend = importlib.import_module("optuna.storages.journal").JournalFileBackend(str(path))
        study = optuna.create_study(
            storage=optuna.storages.JournalStorage(backend), study_name=name,
            direction="maximize" if maximise else "minimize", load_if_exists=True,
        )  # fmt: skip
        study.get_trials(deepcopy=False)
    except OSError as error:
        raise output_error(path, error) from error
    except Exception as error:  # Optuna trusts its journal: a damaged one may raise anything
        raise _damaged(path, type(error).__name__) from error
    return study
