"""Public names of a package whose modules are imported on first use."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable, Mapping
from typing import Any


def names_on_demand(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a package. Modules in it are found as well, as if they had been imported.

    Args:
        package: its name.
        modules: its public names, and the module in it that each is imported from; after a colon its name there, where
            that is another one.

    Raises:
        AttributeError: (of what is returned) there is no such name.
    """

    def find(name: str) -> Any:
        if name not in modules:
            if not name.startswith("_") and importlib.util.find_spec(f"{package}.{name}") is not None:
                return importlib.import_module(f"{package}.{name}")
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name)
        module, _, there = modules[name].partition(":")
        value = getattr(importlib.import_module(f"{package}.{module}"), there or name)
        setattr(sys.modules[package], name, value)
        return value

    return find
