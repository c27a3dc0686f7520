"""``simwarp doctor --warm``: compiles what commands need, small models first."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import warp as wp
from rich.console import Console

from simwarp.core.warp_start import BUILD_FOLDER

FILM: Final = "film"
"""Pictures and films of a task."""
SMALL: Final = ("pendulum", "cart-pole", "ant", "hexapod")
"""Subjects that are compiled first, so that a person can begin with them."""
VARIANTS: Final = ("hmmwv", "gator", "hmmwv-reduced", "hmmwv-soil", "rod", "tetra", "shell", "stack")
"""Vehicles and scenes that have kernels which no task has."""


class Warmed(NamedTuple):
    """What one subject took.

    Attributes:
        name: of a scene, a vehicle or a task; `FILM`.
        modules: that were compiled for it.
        wall_s: by the clock [s].
        cpu_s: of this process, all threads together [s].
        problem: why it failed, in one line; empty where it did not.
    """

    name: str
    modules: int
    wall_s: float
    cpu_s: float
    problem: str = ""


def subjects() -> list[str]:
    """What is compiled, in turn: each compiles what those before it have not."""
    from simwarp.bench.workloads import bench_scenes, vehicle_row_names
    from simwarp.tasks import task_names

    there = {*bench_scenes(), *vehicle_row_names(), *task_names()}
    first = [name for name in (*SMALL, FILM, *VARIANTS) if name in there or name == FILM]
    return [*first, *(name for name in sorted(task_names()) if name not in first)]


def warm(names: list[str], device: str, console: Console) -> list[Warmed]:
    """Makes a first step of each subject, which compiles what is not in the cache; a line for each.

    Args:
        names: see `subjects`.
        device: for which kernels are compiled.
        console: for the lines.
    """
    found = []
    for number, name in enumerate(names, 1):
        console.print(f"{number}/{len(names)} {name} ...", highlight=False)
        one = _warm_one(name, device)
        found.append(one)
        words = one.problem or f"{one.modules} modules compiled, {one.wall_s:.0f} s"
        console.print(f"{number}/{len(names)} {name}: {words}", highlight=False, soft_wrap=True)
    return found


def _warm_one(name: str, device: str) -> Warmed:
    from simwarp.bench.compiling import first_step

    before, start, cpu = _cached(), time.perf_counter(), time.process_time()
    step: Callable[[str, str], Any] = _film if name == FILM else first_step
    problem = ""
    try:
        step(name, device)
    except Exception as error:  # noqa: BLE001  the others are compiled all the same
        problem = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    passed = time.perf_counter() - start, time.process_time() - cpu
    return Warmed(name, len(_cached() - before), *passed, problem)


def _film(_: str, device: str) -> None:
    """One image of a film, and one of a picture, of a task by state."""
    from simwarp.tasks import make
    from simwarp.train.evaluation.filming import Film, FilmOptions

    task = make("ant", 1, device=device, seed=0)
    task.restart(seed=0)
    for video in (True, False):
        Film(task, video, FilmOptions(size=(64, 48))).render(1, 2, 0.0)


def _cached() -> set[str]:
    """Names of the modules in the cache; those that are being compiled have others."""
    folder = Path(wp.config.kernel_cache_dir or "")
    return {path.name for path in folder.iterdir() if not BUILD_FOLDER.match(path.name)} if folder.is_dir() else set()
