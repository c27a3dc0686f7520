"""``simwarp list``."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import inspect
from types import ModuleType
from typing import Any

from simwarp.cli import DONE
from simwarp.cli.options import CommonOptions, parse_options

_CATALOGUES = {
    "vehicles": "simwarp.vehicle.spec.catalogue",
    "sensors": "simwarp.sensors.shipped",
    "scenes": "simwarp.scenes",
}
"""Section -> module whose ``catalogue()`` returns name -> one line, or whose public builders are the entries.

A missing module is an empty section.
"""


@dataclasses.dataclass(frozen=True)
class ListOptions(CommonOptions):
    """Lists tasks, vehicles, sensors and scenes."""


def catalogue(module: str) -> dict[str, str]:
    """Return the entries of a section; none where the module or its parent does not exist."""
    try:
        if importlib.util.find_spec(module) is None:
            return {}
    except ModuleNotFoundError:
        return {}
    loaded = importlib.import_module(module)
    entries: Any = getattr(loaded, "catalogue", None)
    return dict(entries()) if callable(entries) else builders(loaded)


def builders(module: ModuleType) -> dict[str, str]:
    """Return the public functions of a module that return a ModelBuilder, with their first line of documentation."""
    return {
        name.replace("_", "-"): (inspect.getdoc(function) or "").partition("\n")[0]
        for name, function in inspect.getmembers(module, inspect.isfunction)
        if not name.startswith("_") and function.__annotations__.get("return") == "ModelBuilder"
    }


def run(arguments: list[str]) -> int:
    """Print the catalogue."""
    from simwarp.tasks import task_class, task_names

    options = parse_options(ListOptions, arguments, "simwarp list")
    options.check()
    listed = [kind for kind in map(task_class, task_names()) if kind.listed]
    sections = {"tasks": {kind.name: kind.summary for kind in listed}}
    sections |= {section: catalogue(module) for section, module in _CATALOGUES.items()}
    console = options.console()
    width = max((len(name) for entries in sections.values() for name in entries), default=0)
    for section, entries in sections.items():
        if entries:
            console.print(section, style="bold")
        for name, line in entries.items():
            console.print(f"  {name:<{width}}  {line}", highlight=False, markup=False, soft_wrap=True)
    options.emit(
        {
            section: [{"name": name, "summary": line} for name, line in entries.items()]
            for section, entries in sections.items()
        }
    )
    return DONE
