"""Registry of tasks: built-in ones, and those that installed packages offer."""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from simwarp.core.warp_start import report_compiling
from simwarp.task_names import built_in_tasks, offered_tasks, unknown_task

from .config import TaskConfig, replace_fields
from .devices import resolve_device
from .errors import InputError, TaskFileError
from .task_class_import import class_in_file, is_task_file, name_of_class, split_source
from .variants import Variant, variant_of

if TYPE_CHECKING:
    from .joint_rows import JointRows
    from .task import Task

TaskT = TypeVar("TaskT", bound="type[Task[Any]]")

_BUILT_IN: Final = built_in_tasks()
"""Built-in tasks and the modules that register them; one is imported when its task is asked for."""

_IN_THESIS: Final = (
    "ant", "convoy", "hallway", "irb120-reach", "obstacle-avoidance", "off-road", "racer3-reach",
)  # fmt: skip
"""Built-in tasks that have the variant ``thesis``, known without importing them."""

_tasks: dict[str, type[Task[Any]]] = {}
_loaded: list[bool] = []


def register(name: str) -> Callable[[TaskT], TaskT]:
    """Class decorator: make a :class:`Task` known under ``name``.

    Args:
        name: lower-case letters, digits and hyphens.

    Raises:
        InputError: the name holds anything else, or another task has it.
    """
    if not name or not all(c.islower() or c.isdigit() or c == "-" for c in name):
        raise InputError(f"task name must be lower-case letters, digits and hyphens, got '{name}'")

    def add(task: TaskT) -> TaskT:
        if task.__module__ != _module_of(name):
            _load_built_in(name)
        known = _tasks.get(name)
        if known is not None and (known.__module__, known.__qualname__) != (task.__module__, task.__qualname__):
            raise InputError(
                f"two tasks want the name '{name}': {known.__module__}.{known.__qualname__}"
                f" and {task.__module__}.{task.__qualname__}; rename one"
            )
        _tasks[name] = task
        task.name = name
        return task

    return add


def _module_of(name: str) -> str:
    return f"simwarp.tasks.{_BUILT_IN.get(name)}"


def _load_built_in(name: str) -> None:
    if name in _BUILT_IN:
        importlib.import_module(_module_of(name))


def _load_packages() -> None:
    if _loaded:
        return
    _loaded.append(True)
    for entry in offered_tasks():
        try:
            entry.load()
        except Exception as error:  # noqa: BLE001 - another package's defect must not take the built-in tasks away
            warnings.warn(f"task entry point '{entry.name}' ({entry.value}) failed to load: {error!r}", stacklevel=3)


def task_names() -> list[str]:
    """Return the names of all tasks, sorted."""
    _load_packages()
    return sorted({*_BUILT_IN, *_tasks})


def variant_names(name: str) -> list[str]:
    """Return the variants of a task beside its default one; a built-in task is not imported for it."""
    if name in _BUILT_IN:
        return [Variant.THESIS.value] if name in _IN_THESIS else []
    return [*task_class(name).config_type.VARIANTS]


def task_class(name: str) -> type[Task[Any]]:
    """Return the class registered under ``name``, or that of ``path/to/file.py:TaskClass``.

    A class from a file need not be registered; from then on it is known as ``task-class``.

    Raises:
        InputError: no such task; the message lists near names.
        TaskFileError: it cannot be had from its file.
    """
    if is_task_file(name):
        return _from_file(name)
    _load_built_in(name)
    if name not in _tasks:
        _load_packages()
    if name not in _tasks:
        if name.endswith(".py"):
            raise InputError(f"task file '{name}': name the class too, as in {name}:TaskClass")
        raise unknown_task(name, task_names())
    return _tasks[name]


def _from_file(word: str) -> type[Task[Any]]:
    path, kind = split_source(word)
    cls = _registered_from(path, kind) or class_in_file(word)
    if _tasks.get(cls.name) is not cls:
        name = name_of_class(kind)
        taken = name in task_names()
        if taken or not all(c.islower() or c.isdigit() or c == "-" for c in name):
            why = "which another task is called" if taken else "which is no name of a task"
            raise TaskFileError(f"class '{kind}' in '{path}' would be called '{name}', {why}; rename the class")
        register(name)(cls)
    if "task_file" not in vars(cls):
        cls.task_file = f"{path}:{kind}"
    return cls


def _registered_from(path: Path, kind: str) -> type[Task[Any]] | None:
    """Return the class of a file that an installed package has imported already, under another module name."""
    for cls in _tasks.values():
        file = getattr(sys.modules.get(cls.__module__), "__file__", None)
        if cls.__qualname__ == kind and file is not None and Path(file).resolve() == path.resolve():
            return cls
    return None


def task_file(name: str) -> str | None:
    """Return file and class of a task that came from a file, as an absolute ``path/to/file.py:TaskClass``."""
    file: str | None = vars(_tasks[name]).get("task_file") if name in _tasks else None
    return file


def origin_of(name: str) -> dict[str, str]:
    """Return what a saved run or policy says of its task: its name as ``task``, its file as ``task_file`` if any."""
    file = task_file(name)
    return {"task": name} if file is None else {"task": name, "task_file": file}


def task_word(name: str) -> str:
    """Return the word for a task on the command line: its name; of one from a file the file, nearest, and the class."""
    file = task_file(name)
    if file is None:
        return name
    path = Path(file)
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else file


def task_class_of(saved: Mapping[str, Any], where: str) -> type[Task[Any]]:
    """Return the class of the task of a saved run or policy, from the file that it remembers if it does.

    Args:
        saved: of :func:`origin_of`.
        where: where it stood: the errors begin with it.

    Raises:
        InputError: there is no such task.
        TaskFileError: its file is not what it was.
    """
    name, file = saved["task"], saved.get("task_file")
    if not isinstance(file, str) or name in _tasks or name in _BUILT_IN:
        return task_class(name)
    try:
        cls = task_class(file)
    except TaskFileError as error:
        raise TaskFileError(
            f"{where} needs task '{name}': {error}; for another file add --checkpoint or --resume RUN"
        ) from error
    if cls.name != name:
        raise TaskFileError(f"{where} is of task '{name}', and {file} is now called '{cls.name}'; name it as before")
    return cls


def config_to_train_in(
    task: type[Task[Any]], *, student: bool = False, variant: str | None = None
) -> TaskConfig:  # fmt: skip
    """Return the configuration that a training begins with: the defaults, but for what the task is ``trained_in``.

    Args:
        task: that is learnt.
        student: of a distillation, what it is ``distilled_in``.
        variant: of the task; in another one than the default it is trained as it is.

    Raises:
        InputError: the task has no such variant.
    """
    usual: TaskConfig = task.config_type()
    if variant not in (None, variant_of(usual)):
        return replace_fields(usual, {"variant": variant})
    return replace_fields(usual, task.distilled_in if student else task.trained_in)


@report_compiling()
def make(
    name: str,
    num_worlds: int = 1,
    *,
    device: str = "cpu",
    seed: int = 0,
    config: TaskConfig | None = None,
    first_world: int = 0,
    capture: bool = True,
    elements: Callable[[Any], Sequence[Any]] | None = None,
    **overrides: Any,
) -> Task[Any]:
    """Build a task with ``num_worlds`` worlds, reset and ready to step.

    Args:
        name: a registered task, or ``path/to/file.py:TaskClass``.
        num_worlds: number of worlds W, at least 1.
        device: ``cpu``, ``cuda``, ``cuda:N`` or ``auto``.
        seed: seed of all randomness.
        config: configuration; by default the task's own.
        first_world: global index of world 0, where several processes share one batch.
        capture: capture control steps into a CUDA graph, where there is a CUDA device.
        elements: returns further force elements for the finished model, which come after the task's own.
        overrides: single fields of the configuration.

    Raises:
        InputError: there is no such task or device, or the configuration or a field is not of this task.
    """
    cls, chosen = _played(name, config, overrides)
    device = resolve_device(device)

    def built(
        cls: type[Task[Any]], config: TaskConfig, worlds: int, first: int, rows: JointRows | None = None
    ) -> Task[Any]:  # fmt: skip
        task = cls.__new__(cls)
        task.rows_in_batch = rows  # before it builds; tasks may have constructors of their own
        if elements is not None:
            task.further_elements = elements
        cls.__init__(task, config, worlds, device=device, seed=seed, first_world=first)
        return task

    if not chosen.by_model():
        task = built(cls, chosen, num_worlds, first_world)
    else:
        from .mixed_task import MixedTask  # it is a task: whoever asks for a name alone need not load any

        def member(config: TaskConfig, num_worlds: int, first_world: int, rows: JointRows) -> Task[Any]:
            return built(_played(name, config, {})[0], config, num_worlds, first_world, rows)

        task = MixedTask(cls.name, chosen, num_worlds, member, device=device, seed=seed, first_world=first_world)
    task.capture = capture
    return task


def agents_in_world(name: str, config: TaskConfig | None = None) -> int:
    """Return how many agents a world of a task has, before any is built.

    Args:
        name: a registered task, or ``path/to/file.py:TaskClass``.
        config: configuration; by default the task's own.

    Raises:
        InputError: as :func:`make`.
    """
    cls, chosen = _played(name, config, {})
    task = cls.__new__(cls)
    task.config = chosen  # where their number is a choice, a property reads it
    try:
        return max(1, int(task.agents))
    except AttributeError:
        return 1  # known only to a task that is built


def _played(
    name: str, config: TaskConfig | None, overrides: Mapping[str, Any]
) -> tuple[type[Task[Any]], TaskConfig]:  # fmt: skip
    """Return the class that plays a configuration of a task, and the configuration."""
    cls = task_class(name)
    chosen = cls.config_type() if config is None else config
    if not isinstance(chosen, cls.config_type):
        raise InputError(f"task '{name}' wants a {cls.config_type.__name__}, got {type(chosen).__name__}")
    chosen = replace_fields(chosen, overrides)
    player = cls.played_by(chosen)
    if player is not None:
        module, _, kind = player.partition(":")
        cls = getattr(importlib.import_module(module), kind)
    return cls, chosen
