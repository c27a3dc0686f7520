"""Installs the emulated CUDA device in a Python process with EMULATED_CUDA=1, when Warp and torch are imported."""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType


def _warp_is_there(module: ModuleType) -> None:
    from tests.emulated_cuda.warp_calls import warp_library

    warp_library.install(module)


def _torch_is_there(module: ModuleType) -> None:
    from tests.emulated_cuda.torch_calls import torch_device

    torch_device.install()


AFTER: dict[str, Callable[[ModuleType], None]] = {"warp._src.context": _warp_is_there, "torch": _torch_is_there}
"""What is to be done when a module has been imported."""


PACKAGE = "tests.emulated_cuda"
CHECKOUT = Path(__file__).resolve().parents[3]


class Finder(importlib.abc.MetaPathFinder):
    """Finds this checkout's emulated device, and the modules after which there is something to do."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The ordinary module, with more to do."""
        if name == PACKAGE:
            return importlib.machinery.PathFinder.find_spec(name, [str(CHECKOUT / "tests")])
        after = AFTER.get(name)
        spec = importlib.machinery.PathFinder.find_spec(name, path) if after else None
        if spec is None or after is None or spec.loader is None:
            return None
        if name == "torch":
            from tests.emulated_cuda.torch_calls import torch_hooks

            torch_hooks.load(Path(str(spec.origin)).parent)
        run = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            run(module)
            after(module)

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


if os.environ.get("EMULATED_CUDA") == "1":
    sys.path.append(str(CHECKOUT))
    sys.meta_path.insert(0, Finder())
