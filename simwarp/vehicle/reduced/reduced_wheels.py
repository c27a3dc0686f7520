"""Wheels, suspensions and powertrain of reduced vehicles at work: their arrays, and the launches of a step."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import warp as wp

from simwarp.core.arrays import writable, writable_from
from simwarp.core.object_repr import Readable, plural
from simwarp.model.model import Model
from simwarp.simulation.attachments import StepContext
from simwarp.vehicle.drivetrain.transmissions import EXCHANGE_TIME
from simwarp.vehicle.initial_velocity import Rolling
from simwarp.vehicle.reduced.reduced_construction import (
    drive_row,
    driven_wheels,
    lock_rows,
    shaft_inertia,
    standing_center,
    tables_of,
)
from simwarp.vehicle.reduced.reduced_tables_kernels import ReducedState, ReducedTables, row8
from simwarp.vehicle.reduced.reduced_vehicle_kernels import TireArrays, run_reduced_vehicle
from simwarp.vehicle.reduced.wheel_poses_kernels import pose_set_wheels, pose_wheels
from simwarp.vehicle.spec.parts import Array
from simwarp.vehicle.spec.tabulated_suspension import WheelTable
from simwarp.vehicle.spec.vehicle_spec import AutomaticShafts, ManualShafts, VehicleSpec
from simwarp.vehicle.tires.tires import Tires

WHEELS: Final = 4


class ReducedWheels(Readable):
    """Wheels, suspensions and drivelines of V alike reduced vehicles in every world.

    Args:
        spec: of the vehicles.
        reference: (3,) origin of the vehicle's frame of reference from the chassis' centre of mass [m].
        starts: speeds of each vehicle at the start.
        bodies: (V, 4) bodies that show the wheels; none where the chassis stands for them.
        model: of the vehicles.
        randomised: True if every world has a row of its own in `scale`.

    Attributes:
        travel: (W, V · 4) of the wheels' centres upwards, from the state in which the full vehicle is built [m].
        travel_rate: (W, V · 4) [m/s].
        spin: (W, V · 4) speed of the wheels about their axes, positive forwards [rad/s].
        turn_rate: (W, V · 4) the same seen from the chassis, after the last step [rad/s].
        axis: (W, V · 4) vec3 of the wheels' axes to the left, in axes of the chassis, in the last step.
        scale: (1 or W, V · 4, 2) factors of springs and dampers.
    """

    def __init__(
        self, spec: VehicleSpec, reference: Array, starts: Sequence[Rolling], bodies: Sequence[Sequence[int]],
        model: Model, *, randomised: bool,
    ) -> None:  # fmt: skip
        device, shape = model.device, (model.world_count, WHEELS * len(starts))
        self.count = len(starts)
        self.tables = _tables(spec, reference, device)
        self._bodies: wp.array = wp.array(np.array(bodies, np.int32).reshape(-1), dtype=int, device=device)
        self.split: wp.array = wp.array(np.array(driven_wheels(spec) or [[0, 0]], np.int32), dtype=int, device=device)
        spins = np.concatenate([rolling_speeds(spec, start)[:WHEELS] for start in starts])
        standing = np.tile([tables_of(axle).standing for axle in spec.axles for _ in (0, 1)], len(starts))
        state: Any = ReducedState()
        state.travel = writable_from(np.tile(standing, (shape[0], 1)), wp.float32, device, label="travel")
        state.travel_rate = writable(shape, wp.float32, device, label="travel_rate")
        state.spin = writable_from(np.tile(spins, (shape[0], 1)), wp.float32, device, label="spin")
        state.turn = writable(shape, wp.float64, device, label="turn")
        state.turn_rate = writable_from(np.tile(spins, (shape[0], 1)), wp.float32, device, label="turn_rate")
        motors = np.tile([start.motor_speed for start in starts], (shape[0], 1))
        state.motor_speed = writable_from(motors, wp.float32, device, label="motor_speed")
        state.input_speed = writable_from(motors, wp.float32, device, label="input_speed")
        ones = np.ones((shape[0] if randomised else 1, shape[1], 2))
        state.scale = writable_from(ones, wp.float32, device, label="scale")
        state.axis = wp.array(np.tile((0.0, 1.0, 0.0), (*shape, 1)), dtype=wp.vec3, device=device)
        self.state = state
        self.travel: wp.array = state.travel
        self.travel_rate: wp.array = state.travel_rate
        self.spin: wp.array = state.spin
        self.turn_rate: wp.array = state.turn_rate
        self.axis: wp.array = state.axis
        self.scale: wp.array = state.scale

    def of(self, number: int) -> ReducedWheels:
        """One of the vehicles: views of the same memory."""
        part, wheels = copy.copy(self), slice(WHEELS * number, WHEELS * (number + 1))
        for name in ("travel", "travel_rate", "spin", "turn_rate", "axis", "scale"):
            setattr(part, name, getattr(self, name)[:, wheels])
        return part

    def _readable_title(self) -> str:
        worlds = plural(self.travel.shape[0], "world")
        return f": {plural(self.travel.shape[1], 'wheel')} in each of {worlds} on {self.travel.device}"

    def roll(self, speeds: Array) -> None:
        """Let the one vehicle of every world roll.

        Args:
            speeds: (W, 6) of `rolling_speeds` [rad/s].
        """
        for name, values in (
            ("spin", speeds[:, :WHEELS]), ("turn_rate", speeds[:, :WHEELS]),
            ("motor_speed", speeds[:, WHEELS : WHEELS + 1]), ("input_speed", speeds[:, WHEELS + 1 :]),
        ):  # fmt: skip
            getattr(self.state, name).assign(values.astype(np.float32))

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a reset restores and a snapshot keeps: (W, V · 4), of motors (W, V), in SI units."""
        names = ("travel", "travel_rate", "spin", "turn", "turn_rate", "motor_speed", "input_speed")
        return {f"wheels_{name}": getattr(self.state, name) for name in names}

    def record(
        self, simulation: StepContext, dt: float, vehicle: Any, powertrain: Any, vehicle_input: wp.array,
        lock: wp.array, tires: Tires, outputs: Sequence[Any],
    ) -> Any:  # fmt: skip
        """Launch of one sub-step.

        Args:
            simulation: whose state and controls it reads and writes.
            dt: length of the sub-step [s].
            vehicle, powertrain: structures of the vehicles and of what drives them.
            vehicle_input: (W, V, 4) steering, throttle, brakes and clutch, -1 or 0 to 1.
            lock: (W, V, L) of the differentials, 0 to 1.
            tires: on the wheels.
            outputs: state of the powertrain and motion of the vehicles.
        """
        model, control = simulation.model, simulation.control.arrays
        given: Any = TireArrays()
        given.tables, given.parameter = tires.tables, tires.parameter
        given.ground_friction, given.state = tires.ground_friction, tires.state
        return simulation.shares.record(
            run_reduced_vehicle, self.count,
            inputs=[
                dt, vehicle, self.tables, powertrain, vehicle_input, lock, given, tires.terrain, tires.envelopes,
                model.assets, model.parameters, simulation.state.arrays,
            ],
            outputs=[self.state, *outputs, tires.reports, control], in_turn=not simulation.shares.own_slots,
        )  # fmt: skip

    def record_poses(self, simulation: StepContext, vehicle: Any, vehicle_input: wp.array) -> list[Any]:
        """Launch that moves the wheels' bodies to where the wheels are; `vehicle_input` (W, V, 4) is without a unit."""
        if not self._bodies.size:
            return []
        inputs = [vehicle, self.tables, self._bodies, vehicle_input, self.state]
        return [
            simulation.shares.record(pose_wheels, self.count, inputs=inputs, outputs=[simulation.state.arrays])
        ]  # fmt: skip

    def record_set_poses(
        self, simulation: StepContext, mask: wp.array, vehicle: Any, vehicle_input: wp.array
    ) -> list[Any]:
        """Launch of `record_poses` in worlds whose state was set: those of `mask`, (W,); inputs are without a unit."""
        if not self._bodies.size:
            return []
        inputs = [mask, vehicle, self.tables, self._bodies, vehicle_input, self.state]
        return [
            simulation.shares.record(pose_set_wheels, self.count, inputs=inputs, outputs=[simulation.state.arrays])
        ]  # fmt: skip


def rolling_speeds(spec: VehicleSpec, start: Rolling) -> Array:
    """(6,) of a rolling vehicle's wheels about their axes, of its engine and of the shaft behind it [rad/s]."""
    radii = [axle.tire.radius for axle in spec.axles for _ in (0, 1)]
    return np.array([*(start.speed / np.array(radii)), start.motor_speed, start.motor_speed])


def shares_tables(one: VehicleSpec, other: VehicleSpec) -> bool:
    """Whether the tables of two reduced vehicles, which all worlds of a simulation have in common, are the same.

    They hold the suspensions, what turns with the wheels and what moves with their centres.

    Args:
        one, other: with equal frames of reference, brakes and transmissions.
    """
    return one.driveline == other.driveline and all(
        mine.suspension == theirs.suspension
        and (mine.tire.mass, mine.tire.inertia[1]) == (theirs.tire.mass, theirs.tire.inertia[1])
        for mine, theirs in zip(one.axles, other.axles, strict=True)
    )


def _tables(spec: VehicleSpec, reference: Array, device: Any) -> Any:
    table: Any = ReducedTables()
    suspensions = [tables_of(axle) for axle in spec.axles for _ in (0, 1)]
    wheels: list[WheelTable] = [
        side for axle in spec.axles for side in (tables_of(axle).left, tables_of(axle).right)
    ]  # fmt: skip
    places, dampers, firsts, damper_firsts = [], [], [0], [0]
    for suspension, wheel in zip(suspensions, wheels, strict=True):
        grids = [
            np.array(getattr(wheel, name)) for name in ("ahead", "aside", "axis_x", "axis_z", "windup", "spring_load")
        ]
        grids[0], grids[1] = grids[0] + reference[0], grids[1] + reference[1]
        twist = np.broadcast_to(np.array(wheel.bar_twist)[:, None], grids[0].shape)
        places.append(np.stack([*grids, twist, np.zeros_like(twist)], axis=-1).reshape(-1, 8))
        dampers.append(np.array(wheel.damper_load))
        firsts.append(firsts[-1] + len(places[-1]))
        damper_firsts.append(damper_firsts[-1] + len(dampers[-1]))
        assert len(suspension.rate) == dampers[-1].shape[1]
    table.first, table.damper_first = wp.vec4i(*firsts[:4]), wp.vec4i(*damper_firsts[:4])
    table.rows = wp.vec4i(*(len(each.travel) for each in suspensions))
    table.columns = wp.vec4i(*(len(each.steering) for each in suspensions))
    table.travel_first = wp.vec4(*(each.travel[0] for each in suspensions))
    table.travel_scale = wp.vec4(*(1.0 / (each.travel[1] - each.travel[0]) for each in suspensions))
    table.rates = wp.vec4i(*(len(each.rate) for each in suspensions))
    table.rate_first = wp.vec4(*(each.rate[0] for each in suspensions))
    table.rate_scale = wp.vec4(*(1.0 / (each.rate[1] - each.rate[0]) for each in suspensions))
    table.height = wp.vec4(*(wheel.height + reference[2] for wheel in wheels))
    table.free = wp.vec4(*(0.0 if each.fixed else 1.0 for each in suspensions))
    table.place = wp.array(np.concatenate(places), dtype=row8, device=device)
    table.damper = wp.array(np.concatenate([each.reshape(-1) for each in dampers]), dtype=float, device=device)
    starts = np.concatenate([[0], np.cumsum([each.size for each in dampers])])
    table.damper_first = wp.vec4i(*starts[:4].tolist())
    _fill_masses(table, spec, wheels, reference, device)
    table.bar_stiffness = wp.vec2(*(tables_of(axle).bar_stiffness for axle in spec.axles))
    table.bar_damping = wp.vec2(*(tables_of(axle).bar_damping for axle in spec.axles))
    _fill_driveline(table, spec, wheels)
    return table


def _fill_masses(
    table: Any, spec: VehicleSpec, wheels: Sequence[WheelTable], reference: Array, device: Any
) -> None:  # fmt: skip
    """Inertia of the travels with the tires, which move with the wheels' centres."""
    mass, momentum, moment = [], [], []
    for number, wheel in enumerate(wheels):
        axle = spec.axles[number // 2]
        suspension = tables_of(axle)
        slope, center = np.zeros(3), np.array(standing_center(axle, number % 2))
        if not suspension.fixed:
            middle, near = len(suspension.steering) // 2, suspension.travel
            across = [np.gradient([row[middle] for row in values], near) for values in (wheel.ahead, wheel.aside)]
            slope = np.array([*(np.interp(suspension.standing, near, rate) for rate in across), 1.0])
        moving = axle.tire.mass * slope
        p = np.array(wheel.momentum) + moving
        mass.append(wheel.mass + moving @ slope)
        momentum.append(p)
        moment.append(np.array(wheel.moment) + np.cross(center, moving) + np.cross(reference, p))
    table.mass = wp.vec4(*mass)
    table.momentum = wp.array(np.array(momentum), dtype=wp.vec3, device=device)
    table.moment = wp.array(np.array(moment), dtype=wp.vec3, device=device)


def _fill_driveline(table: Any, spec: VehicleSpec, wheels: Sequence[WheelTable]) -> None:
    axles = [axle for axle in spec.axles for _ in (0, 1)]
    spin = np.array([wheel.spin_inertia + axle.tire.inertia[1] for wheel, axle in zip(wheels, axles, strict=True)])
    table.spin_inertia = wp.vec4(*spin)
    compliance = np.linalg.inv(np.diag(spin) + shaft_inertia(spec.driveline))
    table.spin_compliance = wp.mat44(*compliance.ravel())
    table.drive = wp.vec4(*drive_row(spec))
    table.brake_torque = wp.vec4(*(0.0 if axle.brake is None else axle.brake.max_torque for axle in axles))
    gears = spec.transmission
    if isinstance(gears, (AutomaticShafts, ManualShafts)):
        table.motor_inertia, table.input_inertia = gears.motorshaft_inertia, gears.input_inertia
        table.gear_damping = gears.driveshaft_inertia / EXCHANGE_TIME
    locks = lock_rows(spec.driveline)
    table.locks = len(locks)
    rows = np.zeros((4, 4))
    held, locking = np.zeros(4), np.zeros(4)
    for index, (row, open_torque, added) in enumerate(locks):
        rows[index], held[index], locking[index] = row, open_torque, added
    table.lock_row, table.lock_held, table.lock_torque = wp.mat44(*rows.ravel()), wp.vec4(*held), wp.vec4(*locking)
    answers = rows @ compliance
    slips = np.einsum("ij,ij->i", rows, answers)
    table.lock_answer, table.lock_inertia = wp.mat44(*answers.ravel()), wp.vec4(*(1.0 / np.where(slips, slips, 1.0)))
