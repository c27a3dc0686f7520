"""A full vehicle reduced to a chassis on four wheels whose suspensions are tables: fourteen degrees of freedom."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Final

import numpy as np

from simwarp.vehicle.reduced.linkage_measurement import LinkageMeasurement, rigid_part
from simwarp.vehicle.reduced.reduced_construction import tables_of
from simwarp.vehicle.rigs.suspension_curves import SuspensionReference
from simwarp.vehicle.rigs.suspension_rig import reference_state
from simwarp.vehicle.spec.parts import Array, RigidPart, SpecError, merged
from simwarp.vehicle.spec.tabulated_suspension import REDUCED, TabulatedSuspension
from simwarp.vehicle.spec.vehicle_spec import (
    Axle,
    BeamAxle,
    DifferentialDrive,
    MultiAxleDriveline,
    PinnedAxle,
    RigidSuspension,
    SolidAxle,
    VehicleSpec,
)
from simwarp.vehicle.tires.parameter_vector import MODELS

REACH: Final = 0.3
"""Travel of the tables up and down from the standing vehicle, as a share of the tire's radius."""
SHRINKING: Final = 0.9
"""By which the travel is tried again where the linkage does not reach it."""
TRIALS: Final = 8
ROWS: Final = 25
"""Travels of a table."""
COLUMNS: Final = 21
"""Steerings of a table."""
LARGEST_RATE: Final = 4.0
"""Of the travel in the dampers' tables [m/s]."""
RATES: Final = 17

Progress = Callable[[float], None]


def reduce_vehicle(
    spec: VehicleSpec, *, rows: int = ROWS, columns: int = COLUMNS, device: str = "cpu",
    progress: Progress | None = None,
) -> VehicleSpec:  # fmt: skip
    """The vehicle with tabulated suspensions and the name with `REDUCED`.

    Tires, brakes, engine, transmission and driveline stay as they are; wheels, links and steering become parts of the
    chassis, as the vehicle stands. Anti-roll bars become stiffnesses between the travels of an axle's wheels.

    Args:
        spec: with two axles, whose suspensions are independent or rigid.
        rows: travels of the tables.
        columns: steerings of the tables, an odd number.
        device: that closes the linkages.
        progress: is called with the share that is done.

    Raises:
        SpecError: the vehicle cannot be reduced, or its linkages reach no travel.
    """
    _check(spec, rows, columns)
    axles: list[Axle] = []
    parts: list[RigidPart] = list(spec.chassis.components)
    for index, axle in enumerate(spec.axles):
        suspension, bodies = _reduced_axle(spec, index, rows, columns, device)
        axles.append(dataclasses.replace(axle, suspension=suspension, steering=None, antiroll_bar=None))
        parts += bodies
        if progress is not None:
            progress((index + 1) / len(spec.axles))
    mass, com, inertia = merged(parts)
    chassis = dataclasses.replace(spec.chassis, components=(rigid_part(mass, com, inertia),))
    return dataclasses.replace(
        spec, name=f"{spec.name}{REDUCED}", chassis=chassis, axles=tuple(axles), steerings=(),
        start_height=spec.start_height - min(tables_of(axle).standing for axle in axles),
    )  # fmt: skip


def _check(spec: VehicleSpec, rows: int, columns: int) -> None:
    if rows < 3 or columns < 3 or columns % 2 == 0:
        raise SpecError(f"tables: must have 3 rows or more and an odd number of columns, got {rows} and {columns}")
    name = f"'{spec.name}'"
    if spec.trailers:
        raise SpecError(f"trailers: must be left out of what is reduced, got {len(spec.trailers)} of {name}")
    if len(spec.axles) != 2:
        raise SpecError(f"axles: must be two to be reduced, got {len(spec.axles)} of {name}")
    if isinstance(spec.driveline, DifferentialDrive):
        raise SpecError(f"driveline: must have an engine or none to be reduced, got the motors per side of {name}")
    if isinstance(spec.driveline, MultiAxleDriveline):
        rule = "a template for one or two axles to be reduced"
        raise SpecError(f"driveline: must be {rule}, got '{spec.driveline.template}' of {name}; take 'simple'")
    for index, axle in enumerate(spec.axles):
        suspension = axle.suspension
        if isinstance(suspension, TabulatedSuspension):
            raise SpecError(f"axles[{index}]: must be a linkage, got tables: {name} is reduced already")
        if isinstance(suspension, (SolidAxle, BeamAxle, PinnedAxle)):
            rule = "independent or rigid to be reduced"
            raise SpecError(f"axles[{index}]: must be {rule}, got the template '{suspension.template}' of {name}")
        if axle.tire.template not in MODELS:
            rule = "a force law to be reduced"
            raise SpecError(f"axles[{index}].tire: must be {rule}, got '{axle.tire.template}'; choose another tire")


def _reduced_axle(
    spec: VehicleSpec, index: int, rows: int, columns: int, device: str
) -> tuple[TabulatedSuspension, list[RigidPart]]:
    """Tables of an axle, and its bodies as parts of the chassis."""
    axle = spec.axles[index]
    fixed = isinstance(axle.suspension, RigidSuspension)
    steering = np.linspace(-1.0, 1.0, columns) if axle.steering is not None else np.zeros(1)
    rates = np.linspace(-LARGEST_RATE, LARGEST_RATE, RATES)
    standing, reach = 0.0, REACH * axle.tire.radius
    if not fixed:
        standing = reference_state(spec, index, SuspensionReference.STANDING, device=device).travel
    for _ in range(TRIALS):
        travels = standing + np.linspace(-reach, reach, 3 if fixed else rows)
        measured = LinkageMeasurement(spec, index, np.zeros(3) if fixed else travels, steering, device)
        if measured.reached.all():
            break
        reach *= SHRINKING
    else:
        raise SpecError(f"axles[{index}]: its linkage must close {reach:.3g} m around the standing state, and does not")
    middle = len(travels) // 2
    left, right = (measured.wheel_table(side, middle, rates) for side in (0, 1))
    bar = axle.antiroll_bar
    suspension = TabulatedSuspension(
        spindle=_spindle(axle, measured), travel=_places(travels), steering=_places(steering),
        rate=_places(rates), standing=float(standing), fixed=fixed, left=left, right=right,
        bar_stiffness=0.0 if bar is None else bar.stiffness, bar_damping=0.0 if bar is None else bar.damping,
    )  # fmt: skip
    return suspension, measured.rigid_parts(middle)


def _places(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _spindle(axle: Axle, measured: LinkageMeasurement) -> RigidPart:
    """The left wheel's bearing as built, in the frame of the axle."""
    x, y, z = (float(value) for value in measured.held.rest[0, 0] - np.asarray(axle.location))
    return dataclasses.replace(axle.suspension.spindle, com=(x, y - axle.wheel.offset, z))
