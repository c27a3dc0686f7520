"""Benchmark subjects by their names on the command line: how each is measured, and what it is compared with."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

from simwarp.bench.measure import Row, measure_scene
from simwarp.bench.peers import peer_measures, peer_notes
from simwarp.bench.workloads import (
    ON_SOIL,
    SENSOR_SCENES,
    bench_scenes,
    task_of,
    unknown_name_message,
    vehicle_row_names,
)
from simwarp.cli import UsageError
from simwarp.cli.options import check_obs

Measure = Callable[[int, str, float | None, float], Row]
"""From worlds, device, dt and seconds."""


@dataclasses.dataclass(frozen=True)
class Subject:
    """Something to measure.

    Attributes:
        kind: scene, vehicle, sensor or task.
        measures: each gives a row for every number of worlds.
        peers: the same of other engines.
        notes: reasons why others are missing.
        cold_name: by which a new process knows it; None: it has no cold start.
    """

    kind: str
    measures: tuple[Measure, ...]
    peers: tuple[Measure, ...] = ()
    notes: tuple[str, ...] = ()
    cold_name: str | None = None


def find_subject(
    name: str, tasks: Callable[[], list[str]], obs: str | None = None, spacing: float | None = None
) -> Subject:
    """Subject called `name`; the names of tasks, which take long to find, come last.

    Args:
        name: on the command line.
        tasks: returns names.
        obs: observations of a task.
        spacing: of the soil's nodes, where it drives on soil [m].

    Raises:
        UsageError: nothing has that name.
    """
    if obs is not None and (name in bench_scenes() or name in vehicle_row_names() or name in SENSOR_SCENES):
        raise UsageError(
            f"--obs is of tasks, and '{name}' is none: leave it away, or write {name}-task where there is one"
        )
    if spacing is not None and name not in ON_SOIL:
        raise UsageError(f"--spacing is of what drives on soil ({', '.join(ON_SOIL)}), and '{name}' does not")
    scene = bench_scenes().get(name)
    if scene is not None:
        peers = tuple(functools.partial(_beside, measure, name) for measure in peer_measures(name))
        return Subject(
            "scene", (functools.partial(measure_scene, scene),), peers, tuple(peer_notes(name)), cold_name=name
        )
    if name in vehicle_row_names():
        from simwarp.bench.vehicle_rows import measure_vehicle

        measured = functools.partial(measure_vehicle, name, spacing=0.05 if spacing is None else spacing)
        return Subject("vehicle", (measured,), notes=tuple(peer_notes(name)),
                       cold_name=name)  # fmt: skip
    if name in SENSOR_SCENES:
        return _sensor(name)
    known = tasks()
    task = task_of(name, known)
    if task is None:
        raise UsageError(unknown_name_message(name, known))
    from simwarp.bench.task_rows import measure_task, task_device
    from simwarp.tasks import task_class
    from simwarp.tasks.framework.registry import task_word

    if obs is not None:
        check_obs(task, task_class(task).config_type(), obs)

    def measure(worlds: int, device: str, dt: float | None, seconds: float) -> Row:
        row = measure_task(task, worlds, task_device(device), dt, seconds, obs)
        return dataclasses.replace(row, scene=name)

    return Subject("task", (measure,), notes=tuple(peer_notes(name)), cold_name=task_word(task))


def _beside(measure: Callable[..., Row], name: str, worlds: int, device: str, dt: float | None, seconds: float) -> Row:
    """A peer's row; peers run where they can, whatever our device."""
    return measure(bench_scenes()[name], worlds, dt, seconds)


def _sensor(name: str) -> Subject:
    from simwarp.bench import rays
    from simwarp.bench import sensor_rows as sensors

    if name != "rays":
        return Subject("sensor", (functools.partial(sensors.measure_sensor, name),))
    return Subject(
        "sensor",
        tuple(functools.partial(rays.measure_rays, mesh) for mesh in rays.TRIANGLES),
        () if rays.embree_notes() else tuple(functools.partial(rays.measure_embree, mesh) for mesh in rays.TRIANGLES),
        tuple(rays.embree_notes()),
    )
