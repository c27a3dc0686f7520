"""Benchmark subjects by their names on the command line: how each is measured, and what it is compared with."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Final

from simwarp.bench.measure import Row, measure_scene
from simwarp.bench.peers import peer_measures, peer_notes
from simwarp.bench.workloads import (
    CONVOYS,
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


@dataclasses.dataclass(frozen=True, kw_only=True)
class Choices:
    """Options of some subjects alone, None where they are not given.

    Attributes:
        obs: observations of a task.
        spacing: of the soil's nodes, where it drives on soil [m].
        vehicles: in each world of a convoy.
        soil: name of what a convoy drives on.
    """

    obs: str | None = None
    spacing: float | None = None
    vehicles: int | None = None
    soil: str | None = None


USUAL_SPACING: Final = 0.05
USUAL_VEHICLES: Final = 4


def find_subject(name: str, tasks: Callable[[], list[str]], choices: Choices | None = None) -> Subject:
    """Subject called `name`; the names of tasks, which take long to find, come last.

    Args:
        name: on the command line.
        tasks: returns names.
        choices: what was chosen.

    Raises:
        UsageError: nothing has that name.
    """
    chosen = choices or Choices()
    obs = chosen.obs
    if obs is not None and (name in bench_scenes() or name in vehicle_row_names() or name in SENSOR_SCENES):
        raise UsageError(
            f"--obs is of tasks, and '{name}' is none: leave it away, or write {name}-task where there is one"
        )
    _check_choices(name, chosen)
    scene = bench_scenes().get(name)
    if scene is not None:
        peers = tuple(functools.partial(_beside, measure, name) for measure in peer_measures(name))
        return Subject(
            "scene", (functools.partial(measure_scene, scene),), peers, tuple(peer_notes(name)), cold_name=name
        )
    if name in vehicle_row_names():
        return _vehicle(name, chosen)
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
    """A peer's row."""
    return measure(bench_scenes()[name], worlds, device, dt, seconds)


def _check_choices(name: str, chosen: Choices) -> None:
    """Refuses options that the subject does not have."""
    for option, given in (("--vehicles", chosen.vehicles), ("--soil", chosen.soil)):
        if given is not None and name not in CONVOYS:
            raise UsageError(f"{option} is of convoys ({', '.join(CONVOYS)}), and '{name}' is none; leave it away")
    if chosen.spacing is not None and name not in ON_SOIL and (name not in CONVOYS or chosen.soil is None):
        more = "; choose --soil mid" if name in CONVOYS else ""
        raise UsageError(f"--spacing is of what drives on soil ({', '.join(ON_SOIL)}), and '{name}' does not{more}")


def _vehicle(name: str, chosen: Choices) -> Subject:
    """A vehicle; of a convoy a row with one vehicle in each world, then one with all of them."""
    from simwarp.bench.vehicle_rows import VehicleScene, measure_vehicle

    spacing = USUAL_SPACING if chosen.spacing is None else chosen.spacing
    counts = [1]
    if name in CONVOYS:
        counts = sorted({1, USUAL_VEHICLES if chosen.vehicles is None else chosen.vehicles})
    scenes = [VehicleScene(name=name, vehicles=count, soil=chosen.soil, spacing=spacing) for count in counts]
    measures = tuple(functools.partial(measure_vehicle, scene) for scene in scenes)
    return Subject("vehicle", measures, notes=tuple(peer_notes(name)), cold_name=name)


def _sensor(name: str) -> Subject:
    from simwarp.bench import rays, sensor_rows as sensors

    if name != "rays":
        return Subject("sensor", (functools.partial(sensors.measure_sensor, name),))
    return Subject(
        "sensor",
        tuple(functools.partial(rays.measure_rays, mesh) for mesh in rays.TRIANGLES),
        () if rays.embree_notes() else tuple(functools.partial(rays.measure_embree, mesh) for mesh in rays.TRIANGLES),
        tuple(rays.embree_notes()),
    )
