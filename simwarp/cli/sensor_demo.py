"""``simwarp sensor-demo``."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from simwarp.cli import DONE, UsageError
from simwarp.cli.options import CommonOptions, parse_options
from simwarp.core.files import replacing
from simwarp.model.model import resolve_device
from simwarp.viewer.demo import LEAST_PANEL, MOST_PANEL, sensor_demo


@dataclasses.dataclass(frozen=True)
class SensorDemoOptions(CommonOptions):
    """Drives a truck over hills, and writes a picture of the data of cameras, lidar, radar, inertial unit and GPS."""

    out: Path = Path("sensor_demo.png")
    """Picture to write, a .png file."""
    data: Path | None = None
    """Writes all that was measured to this .npz file."""
    panel: int = 320
    """Width of a small picture [pixels]."""
    seed: int = 0
    """Of the landscape and of the noise."""
    device: str = "auto"
    """cpu, cuda, cuda:N or auto."""


def run(arguments: list[str]) -> int:
    """Make the contact sheet as the arguments say."""
    options = parse_options(SensorDemoOptions, arguments, "simwarp sensor-demo")
    _check(options)
    console = options.console()
    device = str(resolve_device(None if options.device == "auto" else options.device))
    begin = time.perf_counter()
    with _StageProgress(console) as progress:
        demo = sensor_demo(seed=options.seed, device=device, panel=options.panel, report=progress.update)
    wall = time.perf_counter() - begin
    with replacing(options.out) as draft:
        demo.sheet.save(draft)
    if options.data is not None:
        content: Any = {name.replace(" ", "_"): array for name, array in demo.data.items()}
        with replacing(options.data) as draft, draft.open("wb") as file:
            np.savez_compressed(file, **content)
    for name, value in demo.summary.items():
        shown = f"{value:.4g}" if isinstance(value, float) else f"{value:,}"
        console.print(f"{name.replace('_', ' '):<24} {shown}", highlight=False)
    for path in (options.out, options.data):
        if path is not None:
            console.print(f"wrote {path}", highlight=False, markup=False, soft_wrap=True)
    files = {"picture": str(options.out), "data": None if options.data is None else str(options.data)}
    options.emit({**files, "device": device, "seed": options.seed, **demo.summary, "wall_s": wall})
    return DONE


def _check(options: SensorDemoOptions) -> None:
    """Refuse what cannot work, before any work is done."""
    options.check(out=options.out, data=options.data)
    for path, suffix in ((options.out, ".png"), (options.data, ".npz")):
        if path is not None and path.suffix.lower() != suffix:
            raise UsageError(f"cannot write '{path}': the name must end in {suffix}")
    if options.panel < LEAST_PANEL:
        raise UsageError(f"panel must be at least {LEAST_PANEL} pixels, got {options.panel}")
    if options.panel > MOST_PANEL:
        raise UsageError(f"panel must be at most {MOST_PANEL} pixels, got {options.panel}; four stand side by side")


class _StageProgress:
    """Progress: a bar on a terminal, elsewhere a line for each stage."""

    def __init__(self, console: Console) -> None:
        self._console = console
        columns = (TextColumn("{task.description}"), BarColumn())
        self._progress = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task = self._progress.add_task("", total=1.0)
        self._stage = ""

    def __enter__(self) -> _StageProgress:
        self._progress.start()
        return self

    def __exit__(self, *reason: object) -> None:
        self._progress.stop()

    def update(self, stage: str, share: float) -> None:
        """Shows the present stage, and the share of it that is done."""
        if self._console.is_terminal:
            self._progress.update(self._task, description=stage, completed=share)
        elif stage != self._stage:
            self._console.print(f"{stage} ...", highlight=False)
        self._stage = stage
