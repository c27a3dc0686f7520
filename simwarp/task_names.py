"""Names of tasks, known without importing one."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Iterable, Mapping
from importlib import metadata
from importlib.resources import files
from typing import Final

from simwarp.core.wording import InputError, near_names

ENTRY_POINT_GROUP: Final = "simwarp.tasks"
"""Entry points of this group are loaded once; loading one must register its tasks."""

_REGISTRY: Final = "simwarp.tasks.framework.registry"


@functools.cache
def built_in_tasks() -> Mapping[str, str]:
    """Built-in tasks and the modules that register them."""
    found: dict[str, str] = json.loads((files("simwarp") / "tasks" / "built_in.json").read_text(encoding="utf-8"))
    return found


def offered_tasks() -> metadata.EntryPoints:
    """Entry points by which installed packages offer tasks: which ones is known when they are loaded."""
    return metadata.entry_points(group=ENTRY_POINT_GROUP)


def known_tasks() -> list[str] | None:
    """Names of all tasks; None: packages offer some, or some may have been registered already."""
    return None if _REGISTRY in sys.modules or offered_tasks() else sorted(built_in_tasks())


def unknown_task(name: str, known: Iterable[str]) -> InputError:
    """Return the error about a name that no task has."""
    return InputError(f"unknown task '{name}'{near_names(name, known)}")
