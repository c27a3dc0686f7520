"""Tasks in files that are not installed: ``path/to/file.py:TaskClass``."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

from simwarp.core.types import formatted

from .errors import TaskFileError, near_names

if TYPE_CHECKING:
    from .task import Task

FORM: Final = "path/to/file.py:TaskClass"
_WORDS: Final = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
"""Where a word of a class name ends: MyTask is two, LQRTask too."""

_modules: dict[Path, ModuleType] = {}


def is_task_file(word: str) -> bool:
    """Return True for ``path/to/file.py:TaskClass``, which no name of a task can be: these have no colon."""
    return ":" in word


def name_of_class(kind: str) -> str:
    """Return the name of a task after its class: ``my-task`` for ``MyTask``."""
    return _WORDS.sub("-", kind.strip("_")).replace("_", "-").lower()


def split_source(word: str) -> tuple[Path, str]:
    """Return the file, as an absolute path, and the class that a word names.

    Raises:
        TaskFileError: it is not of that form.
    """
    file, _, kind = word.rpartition(":")
    if not file.endswith(".py"):
        raise TaskFileError(f"a task that is not installed is given as {FORM}, got {formatted(word)}")
    return Path(file).absolute(), kind


def class_in_file(word: str) -> type[Task[Any]]:
    """Import the file and return the class in it; a file is imported once.

    Raises:
        TaskFileError: there is no such file or class, the file cannot be imported, or the class is no task.
    """
    path, name = split_source(word)
    module = _module(path)
    kind = getattr(module, name, None) if name else None
    if kind is None:
        known = _classes(module)
        hint = near_names(name, known) if known else "; it has no task"
        raise TaskFileError(f"file '{path}' has no class {formatted(name)}{hint}" if name else _nameless(path, known))
    if not _is_task(kind):
        raise TaskFileError(f"'{name}' in '{path}' is no task: write a class that is derived from simwarp.tasks.Task")
    missing = sorted(kind.__abstractmethods__)
    if missing:
        raise TaskFileError(f"class '{name}' in '{path}' lacks what every task has: write {', '.join(missing)}")
    found: type[Task[Any]] = kind
    return found


def module_of_file(path: str) -> ModuleType | None:
    """Return the module that a Python file was imported as, under whatever name; None if it was not."""
    wanted = os.path.realpath(path)
    named = ((getattr(module, "__file__", None), module) for module in list(sys.modules.values()))
    return next((module for file, module in named if file is not None and os.path.realpath(file) == wanted), None)


def imported_file(path: str) -> ModuleType:
    """Return the module of a Python file; one that is imported already, under whatever name, is not imported again.

    Raises:
        TaskFileError: there is no such file, or it cannot be imported.
    """
    return module_of_file(path) or _module(Path(path).absolute())


def _is_task(kind: object) -> bool:
    from .task import Task

    return isinstance(kind, type) and issubclass(kind, Task)


def _classes(module: ModuleType) -> list[str]:
    """Return the names of the tasks that a module itself defines."""
    return [
        name for name, kind in vars(module).items() if _is_task(kind) and kind.__module__ == module.__name__
    ]  # fmt: skip


def _nameless(path: Path, known: list[str]) -> str:
    return f"which class of '{path}'? write {path.name}:{known[0] if known else 'TaskClass'}"


def _module(path: Path) -> ModuleType:
    known = _modules.get(path)
    if known is not None:
        return known
    if not path.is_file():
        what = "is no file" if path.exists() else "does not exist"
        raise TaskFileError(f"file '{path}' {what}; give {FORM}")
    spec = importlib.util.spec_from_file_location(f"{_package_of(path.parent)}.{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    if str(path.parent) not in sys.path:
        sys.path.insert(0, str(path.parent))  # as Python does for a script: files beside it can be imported
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[spec.name]
        what = f"{type(error).__name__}: {error}".rstrip(": ")
        raise TaskFileError(f"file '{path}' cannot be imported{_line(error, path)}: {what}") from error
    _modules[path] = module
    return module


def _package_of(folder: Path) -> str:
    """Return the name of the package that a folder of tasks is: its files may import each other as `.other`."""
    # Two folders may share a name; pickles and tracebacks want the same one in every process
    name = f"simwarp_tasks_{hashlib.sha256(str(folder).encode()).hexdigest()[:8]}"
    if name not in sys.modules:
        sys.modules[name] = ModuleType(name, f"Files of tasks in {folder}.")
        sys.modules[name].__path__ = [str(folder)]
    return name


def _line(error: BaseException, path: Path) -> str:
    """Return the line of the file at which its import failed, as words."""
    lines = [error.lineno] if isinstance(error, SyntaxError) and error.filename == str(path) else []
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            lines.append(trace.tb_lineno)
        trace = trace.tb_next
    return f" (line {lines[-1]})" if lines else ""
