"""The drawbar test: pull over slip of a vehicle, at the constant speed of a carriage that it pulls."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
import warp as wp

from simwarp.core.constraints import Gt, Lt, Meaning, Positive
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.vehicle.drawbar_kernels import Carriage, DrawbarState, pull_carriage
from simwarp.vehicle.spec.drivetrain_parts import (
    DifferentialDrive,
    ShaftsDriveline2WD,
    ShaftsDriveline4WD,
    SimpleDriveline,
)
from simwarp.vehicle.spec.parts import Spec
from simwarp.vehicle.spec.vehicle_spec import SpecError, VehicleSpec
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle, TrackedVehicle
from simwarp.vehicle.vehicle import Vehicle

GRAVITY: Final = 9.81


Slip: TypeAlias = Annotated[float, Gt(-1.0), Lt(1.0)]


@dataclasses.dataclass(frozen=True, kw_only=True)
class DrawbarSpec(Spec):
    """A carriage that holds the vehicle's speed, while its throttle holds the mean slip of the wheels.

    Attributes:
        speed: of the carriage [m/s].
        start: time at which it moves off [s]; until then the vehicle brakes.
        ramp: to its speed [s].
        sweep: from the first slip to the last one, evenly [s].
        slips: the first and the last one, 1 - v / (omega r).

    Raises:
        SpecError: a value breaks its rule.
    """

    speed: Annotated[Positive, Meaning("m/s")]
    start: float
    ramp: Annotated[Positive, Meaning("seconds")]
    sweep: Annotated[Positive, Meaning("seconds")]
    slips: tuple[Slip, Slip] = (0.0, 0.65)


LOCKED: Final = 1.0e5
"""Torque of the locked clutches: more than any ground gives [N·m]."""


def driven_axles(spec: VehicleSpec) -> tuple[int, ...]:
    """Indices of the axles that the engine turns.

    Raises:
        SpecError: there is no driveline.
    """
    driveline = spec.driveline
    if driveline is None:
        raise SpecError("driveline: must turn an axle in a drawbar test, got none; give the vehicle one")
    if isinstance(driveline, ShaftsDriveline2WD):
        return (driveline.axle % len(spec.axles),)
    if isinstance(driveline, DifferentialDrive):
        return tuple(range(len(spec.axles)))
    axles = tuple(axle % len(spec.axles) for axle in driveline.axles)
    if isinstance(driveline, SimpleDriveline) and driveline.front_torque_fraction in (0.0, 1.0):
        return axles[:1] if driveline.front_torque_fraction == 1.0 else axles[1:]
    return axles


def with_locks(spec: VehicleSpec) -> VehicleSpec:
    """The vehicle with differentials that `Vehicle.lock` closes for good; those of a simple driveline stay as they are.

    With open ones the wheel that bears least spins alone, and no slip of the others is ever seen.
    """
    driveline = spec.driveline
    if isinstance(driveline, ShaftsDriveline2WD):
        return dataclasses.replace(
            spec, driveline=dataclasses.replace(driveline, lockable=True, locking_limit=LOCKED)
        )  # fmt: skip
    if isinstance(driveline, ShaftsDriveline4WD):
        closed = dataclasses.replace(
            driveline, lockable=True, axle_locking_limit=LOCKED, central_locking_limit=LOCKED
        )  # fmt: skip
        return dataclasses.replace(spec, driveline=closed)
    return spec


@dataclasses.dataclass(frozen=True)
class Driven:
    """A wheel or sprocket that the engine turns: index among the tires, body, joint, radius of its surface [m]."""

    wheel: int
    body: int
    joint: int
    radius: float


def _driven_wheels(vehicle: Vehicle) -> list[Driven]:
    axles, spec = driven_axles(vehicle.parts.spec), vehicle.parts.spec
    return [
        Driven(wheel, side.spindle, side.turn, spec.axles[side.axle].tire.radius)
        for wheel, side in enumerate(vehicle.parts.sides)
        if side.axle in axles
    ]


def _driven_tracks(vehicle: TrackedVehicle) -> list[Driven]:
    parts, spec = vehicle.parts, vehicle.parts.spec
    if spec.driveline is None:
        raise SpecError("driveline: must turn the sprockets in a drawbar test, got none; give the vehicle one")
    joints: Any = vehicle.model.builder.joints
    return [
        Driven(number, joints[side.sprocket].child, side.sprocket, track.sprocket.assembly_radius)
        for number, (side, track) in enumerate(((parts.left, spec.left), (parts.right, spec.right)))
    ]


class Drawbar(ForceElement):
    """A `ForceElement` that comes after its vehicle, to whose forces it adds: the carriage's pull, and the pedals.

    Args:
        vehicle: that pulls; its differentials are locked from now on if they can be (`with_locks`). Of one on tracks
            the sprockets count, with the radius of their pins.
        spec: of the test.

    Attributes:
        measured: (W,) arrays: mean slip of the driven wheels or tracks, pull on the carriage [N], pull over the
            vehicle's weight, and, of wheels, torque of the ground on the driven ones against their turning [N·m].
    """

    def __init__(self, vehicle: AnyVehicle, spec: DrawbarSpec) -> None:
        model, parts = vehicle.model, vehicle.parts
        self.vehicle, self.spec = vehicle, spec
        device = model.device
        table: Any = Carriage()
        table.chassis, table.reference = parts.chassis, wp.vec3(*parts.reference)
        turning = _driven_tracks(vehicle) if isinstance(vehicle, TrackedVehicle) else _driven_wheels(vehicle)
        table.wheel = wp.array([each.wheel for each in turning], dtype=int, device=device)
        table.spindle = wp.array([each.body for each in turning], dtype=int, device=device)
        table.turn = wp.array([model.joint_dof_start[each.joint] for each in turning], dtype=int, device=device)
        table.radius = wp.array([each.radius for each in turning], dtype=float, device=device)
        self._torque: wp.array = (
            wp.zeros((model.world_count, len(turning)), dtype=wp.vec3, device=device)
            if isinstance(vehicle, TrackedVehicle)
            else vehicle.tires.torque_w
        )
        table.mass = float(np.sum(model.body_mass.numpy()[0]))
        table.weight = GRAVITY * table.mass
        table.start, table.ramp, table.sweep, table.speed = spec.start, spec.ramp, spec.sweep, spec.speed
        table.first_slip, table.last_slip = spec.slips
        # the carriage is firm: a tenth of a second, well damped; the throttle answers a surface that is slow by 1 m/s
        table.stiffness, table.damping = 100.0, 20.0
        table.proportional, table.integral = 1.0, 2.0
        self._table = table
        if not isinstance(vehicle, TrackedVehicle):
            vehicle.lock.fill_(1.0)
        self._state: Any = DrawbarState()
        for name in ("force_sum", "throttle_sum", *MEASURED):
            setattr(self._state, name, wp.zeros(model.world_count, dtype=float, device=device))

    def _readable_title(self) -> str:
        return f" of vehicle '{self.vehicle.parts.spec.name}' at {self.spec.speed:g} m/s"

    @property
    def measured(self) -> Mapping[str, wp.array]:
        """(W,) arrays by the name of their column."""
        names = [name for name in MEASURED if name != "torque" or not isinstance(self.vehicle, TrackedVehicle)]
        return {MEASURED[name]: getattr(self._state, name) for name in names}

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """The controllers' integrals."""
        return {name: getattr(self._state, name) for name in ("force_sum", "throttle_sum")}

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that pulls, and writes the pedals for the vehicle's next step."""
        return [
            simulation.shares.record(
                pull_carriage,
                inputs=[dt, self._table, self._torque, simulation.state.arrays],
                outputs=[self._state, simulation.control.arrays, self.vehicle.input],
            )
        ]  # fmt: skip


MEASURED: Final = {"slip": "slip", "pull": "pull_N", "share": "pull_per_weight", "torque": "wheel_torque_Nm"}
"""Columns of a run by the arrays of the state."""
