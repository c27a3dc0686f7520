"""From a name or a file on the command line to what is meant by it."""

from __future__ import annotations

import dataclasses
import json
from importlib.resources import files
from pathlib import Path

from simwarp.cli import UsageError
from simwarp.cli.options import TASK_FILE
from simwarp.core.wording import close_names

MODEL_FILES = (".xml", ".urdf", ".usd", ".usda", ".usdc", ".stp", ".step", ".py")
DUMPS = (".npz",)


@dataclasses.dataclass(frozen=True)
class ViewTarget:
    """What was asked for.

    Attributes:
        kind: task, vehicle, scene, model or dump.
        name: of it, or path of its file.
        file: whether it is a file.
    """

    kind: str
    name: str
    file: bool = False

    @property
    def title(self) -> str:
        """Of its page."""
        return Path(self.name).stem if self.file else self.name.rpartition(":")[2]


def find_target(name: str) -> ViewTarget:
    """What a TARGET means: a file, a shipped task, vehicle or scene, or a task of another package, which takes longest.

    Raises:
        UsageError: nothing has that name.
    """
    if TASK_FILE in name:
        return ViewTarget("task", name)
    path = Path(name)
    suffix = path.suffix.lower()
    if suffix in MODEL_FILES:
        return ViewTarget("model", name, True)
    if suffix in DUMPS:
        return ViewTarget("dump", name, True)
    if suffix == ".json":
        return ViewTarget("model" if _is_model(path) else "vehicle", name, True)
    package = files("simwarp")
    if name in json.loads((package / "tasks" / "built_in.json").read_text(encoding="utf-8")):
        return ViewTarget("task", name)
    shipped = package / "vehicle" / "data"
    if any((shipped / folder / f"{name}.json").is_file() for folder in (".", "tracked", "reduced")):
        return ViewTarget("vehicle", name)
    from simwarp.cli.listing import catalogue

    scenes = catalogue("simwarp.scenes")
    if name in scenes:
        return ViewTarget("scene", name)
    from simwarp.tasks import task_names
    from simwarp.vehicle.tracks.tracked_files import all_vehicle_names

    if name in all_vehicle_names():  # m113-belt, which has no file of its own
        return ViewTarget("vehicle", name)
    if name in task_names():
        return ViewTarget("task", name)
    close = close_names(name, [*task_names(), *all_vehicle_names(), *scenes])
    hint = f"; did you mean {' or '.join(close)}?" if close else ";"
    raise UsageError(
        f"nothing is called '{name}'{hint} `simwarp list` shows all, and model files end in {', '.join(MODEL_FILES)} or"
        " .json"
    )


def _is_model(path: Path) -> bool:
    """Whether a .json file is a model of ours; else it is taken for a vehicle."""
    try:
        head = path.read_text(encoding="utf-8", errors="replace")[:400]
    except OSError:
        return False
    return '"chassis"' not in head and "simwarp" in head
