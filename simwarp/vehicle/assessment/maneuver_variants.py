"""Variants of one manoeuvre at once: each in a world of its own, such as a course at several speeds."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Final, Unpack

import numpy as np
import warp as wp

from simwarp.core.types import WorldStatus
from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.assessment.entry_speed import asked_speed, is_held
from simwarp.vehicle.assessment.verdict import Verdict
from simwarp.vehicle.assessment.verdicts import passed, verdicts
from simwarp.vehicle.construction import add_vehicle
from simwarp.vehicle.driving.maneuver_spec import Maneuver
from simwarp.vehicle.initial_velocity import Rolling
from simwarp.vehicle.reduced.reduced_wheels import rolling_speeds
from simwarp.vehicle.results.channels import Run
from simwarp.vehicle.results.results import results
from simwarp.vehicle.results.run_result import Result, until
from simwarp.vehicle.results.runs import Drive, Setup, SetUpOptions, set_up
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec
from simwarp.vehicle.vehicle import Vehicle

VARIED: Final = ("follow", "initial_speed", "intervention", "course", "duration", "held_gear")
"""Fields of a `Maneuver` in which variants may differ; the road, the start and the script are those of all."""


def set_up_variants(spec: VehicleSpec, variants: Sequence[Maneuver], **options: Unpack[SetUpOptions]) -> Setup[Vehicle]:
    """Builds one simulation with a world for each variant of a manoeuvre.

    Each world has its own driver with path, speed, steering law and gains, its own intervention, lanes and speed at the
    start: it is the world of `set_up` with this variant alone. All run until the last one is over.

    Args:
        spec: of the vehicle, on wheels.
        variants: of one manoeuvre that has a driver on a path, one for each world.
        options: those of `set_up` but `worlds`.

    Raises:
        SpecError: there is no variant, they differ in something else, or they have no driver on a path.
    """
    _check_alike(variants)
    longest = max(each.duration for each in variants)
    merged = dataclasses.replace(variants[0], duration=longest)
    options["worlds"] = len(variants)
    setup = set_up(spec, merged, variants=variants, **options)
    _start_rolling(setup, [(each.initial_speed, each.held_gear) for each in variants])
    return setup


def _check_alike(variants: Sequence[Maneuver]) -> None:
    if not variants:
        raise SpecError("variants: must be one or more, got none")
    first = variants[0]
    for index, each in enumerate(variants):
        if each.follow is None:
            raise SpecError(f"variants: {each.name}: must have a driver on a path, got a script; drive them one by one")
        names = [field.name for field in dataclasses.fields(Maneuver) if field.name not in VARIED]
        other = next((name for name in names if not _same(getattr(each, name), getattr(first, name))), None)
        if other is not None:
            rule = f"must have the {other} of the first one, which all worlds share"
            raise SpecError(f"variants: number {index} ({each.name}): {rule}; drive it alone")


def _same(one: object, other: object) -> bool:
    """Whether values are equal; NaN is equal to itself here."""
    if isinstance(one, float) and isinstance(other, float) and math.isnan(one):
        return math.isnan(other)
    return one == other


def _start_rolling(setup: Setup[Vehicle], starts: Sequence[tuple[float, int | None]]) -> None:
    """Every world begins at a speed [m/s] and in a gear of its own: its bodies, shafts and engine, all consistent."""
    vehicle, simulation = setup.vehicle, setup.simulation
    if len(set(starts)) == 1:
        return
    state = simulation.state
    moving: tuple[wp.array, ...] = (state.body_v, state.body_omega, state.joint_qd)
    velocity, omega, rates = (array.numpy() for array in moving)
    names: tuple[str, ...] = ("gear", "engine_speed", "last_input", "last_drive")
    memory: dict[str, wp.array] = {name: vehicle.memory[name] for name in names}
    rolling: list[Rolling] = []
    values = {name: array.numpy() for name, array in memory.items()}
    for world, (speed, gear) in enumerate(starts):
        builder = ModelBuilder()
        parts = add_vehicle(builder, vehicle.parts.spec, speed=speed, gear=gear)
        for index, body in enumerate(builder.bodies):
            velocity[world, index], omega[world, index] = body.velocity, body.omega
        for joint, made in enumerate(builder.joints):
            rates[world, builder.dof_start(joint) : builder.dof_start(joint + 1)] = made.initial_qd
        start = parts.start
        values["gear"][world] = start.gear
        values["engine_speed"][world] = abs(start.motor_speed)
        values["last_input"][world], values["last_drive"][world] = start.motor_speed, start.drive_speed
        rolling.append(start)
    for array, rows in zip(moving, (velocity, omega, rates), strict=True):
        array.assign(rows)
    for name, array in memory.items():
        array.assign(values[name])
    if vehicle.reduced is not None:
        vehicle.reduced.roll(np.stack([rolling_speeds(vehicle.parts.spec, each) for each in rolling]))
    simulation.measure()
    simulation.keep_as_initial()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of one variant.

    Attributes:
        maneuver: that was driven.
        run: recorded, up to its own duration or its breakdown.
        broken: True if a value of its world was not finite any more.
        results: numbers of the run.
        verdicts: rules and whether it kept to them.
    """

    maneuver: Maneuver
    run: Run
    broken: bool
    results: tuple[Result, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def passed(self) -> bool | None:
        """Whether all rules are kept by a run that did not break down; None without any rule."""
        return False if self.broken else passed(self.verdicts)

    @property
    def held(self) -> bool:
        """Whether the run came into the test at the speed asked for."""
        return is_held(self.results, self.maneuver)


def drive_variants(
    spec: VehicleSpec, variants: Sequence[Maneuver], progress: Callable[[float], None] | None = None,
    **options: Unpack[SetUpOptions],
) -> list[Outcome]:  # fmt: skip
    """Drives variants of one manoeuvre, each in a world, and judges them alike.

    A world that breaks down is marked and does not stop the others.

    Args:
        spec: of the vehicle, on wheels.
        variants: see `set_up_variants`.
        progress: called with the manoeuvre's time [s] after every row.
        options: of `set_up_variants`.

    Raises:
        SpecError: the variants cannot be driven together.
    """
    drive = Drive(set_up_variants(spec, variants, **options), worlds=slice(0, len(variants)))
    drive.run(progress)
    return outcomes(drive, variants)


def outcomes(drive: Drive, variants: Sequence[Maneuver]) -> list[Outcome]:
    """Results and verdicts of every recorded world of a drive.

    Args:
        drive: after its run, with a world for each variant.
        variants: as they were set up.
    """
    status = drive.setup.simulation.state.world_status.numpy()
    found = []
    for world, (each, recorded) in enumerate(zip(variants, drive.results(), strict=True)):
        broken = bool(status[world] & WorldStatus.NON_FINITE)
        run = until(recorded, each.duration)
        if broken:
            run = _before_freeze(run)
        found.append(Outcome(
            maneuver=each, run=run, broken=broken, results=tuple(results(run, each)),
            verdicts=tuple(verdicts(run, each)),
        ))  # fmt: skip
    return found


def _before_freeze(run: Run) -> Run:
    """The rows of a world before it broke down: from then on it shows one state again and again."""
    table = np.stack([values for name, values in run.columns.items() if name != "t_s"])
    same = np.all(np.diff(table, axis=1) == 0.0, axis=0) | ~np.isfinite(table[:, 1:]).all(axis=0)
    moving = np.flatnonzero(~same)
    end = int(moving[-1]) + 2 if moving.size else 1
    return Run({name: values[:end] for name, values in run.columns.items()})


def highest_passed(found: Sequence[Outcome]) -> float:
    """The greatest speed of the variants that was held and passed, below which none failed [m/s]; NaN if none is."""
    best = math.nan
    for each in sorted(found, key=lambda outcome: asked_speed(outcome.maneuver)):
        if not (each.passed and each.held):
            break
        best = asked_speed(each.maneuver)
    return best
