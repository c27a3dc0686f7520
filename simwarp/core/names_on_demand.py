"""Public names of a package whose modules are imported when they are asked for."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any


def names_on_demand(package: str, names: Mapping[str, str], missing: Callable[[str], Any]) -> Callable[[str], Any]:
    """The `__getattr__` of a package.

    Args:
        package: its name.
        names: its public names, and the modules that they are imported from.
        missing: is asked for any other name.
    """

    def find(name: str) -> Any:
        if name not in names:
            return missing(name)
        value = getattr(importlib.import_module(names[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return find
