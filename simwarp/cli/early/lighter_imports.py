"""What commands do without when they import.

`simwarp COMMAND --help` and `simwarp list` print fields, defaults and docstrings of classes. Importing these would load
torch, Warp and every kernel, several seconds of which nothing is printed: stand-ins answer these imports. The process
ends after the text, so that no stand-in is ever computed with.

Commands that run policies import tensordict, which marks some functions for `torch.compile` and for that imports the
whole compiler, two seconds. No command compiles: the marks are left out. They import rsl_rl too, whose writers for
two services on the network import TensorBoard: no command writes there, and stand-ins answer for them.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import importlib.machinery
import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Any, Final

REPLACED: Final = (
    "gymnasium", "matplotlib", "mujoco", "rsl_rl", "scipy", "tensorboard", "tensordict", "torch", "trimesh", "viser",
    "warp",
)  # fmt: skip
"""Packages that take long to import, and that no option's name, type, default or text comes from."""
SERVICES: Final = frozenset({"rsl_rl.utils.neptune_log_writer", "rsl_rl.utils.wandb_log_writer"})
"""Modules that no command uses, and that import TensorBoard."""
FULL: Final = "SIMWARP_FULL_IMPORTS"
"""Environment variable; when set, nothing is replaced."""


class StandIn:
    """Whatever a replaced package holds: a class, a decorator, a number. Nothing can be found out from it."""

    def __init__(self, name: str) -> None:
        self.__name__ = self.__qualname__ = name
        self.__doc__ = ""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return StandIn(name)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """As a decorator it leaves what it decorates, as a constant its number."""
        plain = (
            len(arguments) == 1 and not options and (callable(arguments[0]) or isinstance(arguments[0], int | float))
        )
        return arguments[0] if plain else self

    def __mro_entries__(self, bases: tuple[Any, ...]) -> tuple[type, ...]:
        return ()

    def __instancecheck__(self, instance: Any) -> bool:
        return False

    def __subclasscheck__(self, kind: type) -> bool:
        return False

    def __iter__(self) -> Iterator[Any]:
        return iter(())

    def __getitem__(self, key: Any) -> Any:
        return self

    def _same(self, *_: Any) -> Any:
        return self

    __or__ = __ror__ = __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _same
    __neg__ = __pow__ = __lshift__ = __rshift__ = __and__ = __rand__ = __invert__ = _same


class _StandInModule(ModuleType):
    __getattr__ = StandIn.__getattr__


class _Finder:
    """Finds replaced packages, and all modules in them.

    Args:
        is_replaced: whether a module of this name is.
        file: where they say that they come from. Where commands run, it must not be empty: `inspect.getmodule`, which
            torch's compiler calls, refuses modules without a file.
    """

    def __init__(self, is_replaced: Callable[[str], bool], file: str = "") -> None:
        self._is_replaced, self._file = is_replaced, file

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """A module without contents, for a name of theirs."""
        if not self._is_replaced(name):
            return None
        return importlib.machinery.ModuleSpec(name, self, is_package=True)  # type: ignore[arg-type]

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        """An empty module."""
        module = _StandInModule(spec.name)
        module.__file__, module.__path__ = self._file, []
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Nothing: it stays empty."""


@contextlib.contextmanager
def stand_ins() -> Iterator[None]:
    """Answers imports of the replaced packages by stand-ins. A package that is loaded already stays what it is.

    Warnings are errors: tasks of other packages that cannot be loaded are warned of, and stand-ins may be why.
    """
    finder: Any = _Finder(lambda name: name.partition(".")[0] in REPLACED)
    sys.meta_path.insert(0, finder)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            yield
    finally:
        sys.meta_path.remove(finder)


def run_in_full(arguments: Sequence[str]) -> int:
    """Runs a command in a process of its own that has no stand-ins; returns its exit code."""
    return subprocess.run([sys.executable, "-m", "simwarp", *arguments], env=os.environ | {FULL: "1"}).returncode


class _UncompiledFinder:
    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Tensordict, loaded while the marks of `torch.compiler` do nothing; nothing else."""
        if name != "tensordict" or "torch._dynamo" in sys.modules:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        loader: Any = None if spec is None else spec.loader
        if loader is not None:
            loader.exec_module = functools.partial(_load_without_marks, loader.exec_module)
        return spec


def _load_without_marks(load: Callable[[ModuleType], None], module: ModuleType) -> None:
    from unittest import mock

    import torch.compiler

    marks: dict[str, Any] = dict.fromkeys(("allow_in_graph", "assume_constant_result"), lambda function: function)
    with mock.patch.multiple(torch.compiler, **marks):
        load(module)


def leave_unused_out() -> None:
    """From now on, tensordict is imported without torch's compiler, and rsl_rl without writers for services."""
    finders: tuple[Any, ...] = (_UncompiledFinder(), _Finder(SERVICES.__contains__, file="<left out>"))
    sys.meta_path[:0] = finders


@contextlib.contextmanager
def few_collections() -> Iterator[None]:
    """Inside, garbage is looked for rarely: importing makes hundreds of thousands of objects that all stay, and looking
    through them over and over takes a tenth of the time.
    """
    usual = gc.get_threshold()
    gc.set_threshold(100 * usual[0], *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)
