"""Vehicles at work: the room that turns drivers' inputs into forces, in every world of a model."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import warp as wp

from simwarp.core.arrays import writable
from simwarp.core.object_repr import Names, Row, array_text, plural
from simwarp.core.types import ModelError, Vec3, finite_vector
from simwarp.model.model import Model
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.simulation.solver_options import SolverOptions
from simwarp.vehicle.construction import VehicleParts
from simwarp.vehicle.drivetrain.powertrains import powertrain_state, powertrain_tables
from simwarp.vehicle.inputs_kernels import (
    VehicleMotion,
    VehicleTables,
    measure_set_vehicle,
    measure_vehicle,
    run_vehicle,
)
from simwarp.vehicle.reduced.reduced_wheels import ReducedWheels
from simwarp.vehicle.spec.vehicle_spec import DifferentialDrive, SpecError
from simwarp.vehicle.tires.contact_tires import ContactTires
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tires.parameter_vector import MODELS
from simwarp.vehicle.tires.soil_tires import TEMPLATE as SOIL_RIGID, SoilTires
from simwarp.vehicle.tires.tire_obstacles import ObstacleNames, TireObstacles
from simwarp.vehicle.tires.tire_obstacles_kernels import find_envelopes
from simwarp.vehicle.tires.tires import Mount, Tires, tire_vector
from simwarp.vehicle.tires.tires_kernels import apply_tires

PER_WORLD: Final = ("joint_friction", "coupling_coefficient")
"""Model arrays that a vehicle writes: each world needs its own (`ModelBuilder.finalize(per_world=PER_WORLD)`)."""

VEHICLE_SOLVER: Final = SolverOptions(position_projection=0, refinement=0)
"""For simulations of vehicles. Projecting positions keeps the energy of mechanisms that hardly lose any, and refinement
the digits of light bodies under heavy ones: on the recorded manoeuvres both change less than 1e-4 of any column and
cost a fifth of the step.
"""


class Vehicles(ForceElement):
    """Tires, powertrain, brakes and steering of alike vehicles of one world, in every world: one `ForceElement`.

    Pass it to the Simulation: `Simulation(model, dt, elements=[vehicles], solver=VEHICLE_SOLVER)`. `vehicles[k]` is a
    `Vehicle` with the arrays of one of them, which are views of the same memory.

    Args:
        parts: from `add_vehicle`, of V vehicles of one description.
        model: made with `per_world=PER_WORLD` at least.
        ground: surface under the tires (`tires.ground`); the plane z = 0 when None.
        obstacles: shapes on WORLD that tires which are force laws meet beside the ground, by name or index, or "all";
            none when None.
        point: whose motion `position` to `acceleration_b` tell, in the vehicles' frames of reference [m].
        randomised: True if every world has rows of its own in `tires.parameter` and an entry of its own in
            `tires.ground_friction`; otherwise all share one.

    Attributes:
        parts: of the vehicles.
        chassis: (V,) int32, their bodies in the model.
        input: (W, V, 4) steering -1..1 (positive to the left), throttle, braking and clutch 0..1.
        lock: (W, V, locks) 0..1, closes the clutches of differentials that are `lockable`: central, front, rear.
        tires: forces, loads, slips and parameters of all tires, (W, V · wheels), vehicle after vehicle.
        position: (W, V) vec3d of the points, world [m].
        angles, velocity_b, omega_b, acceleration_b: (W, V) vec3, as those of `Vehicle`.
        gear, engine_speed, engine_torque, drive_torque: (W, V), as those of `Vehicle`.
        articulation: (W, V, trailers), as that of `Vehicle`.

    Raises:
        ModelError: there is no vehicle, they are not alike, or the model shares an array that each world's vehicles
            have to write.
    """

    def __init__(
        self, parts: Sequence[VehicleParts], model: Model, *, ground: TerrainTables | None = None,
        obstacles: ObstacleNames | None = None, point: Vec3 = (0.0, 0.0, 0.0), randomised: bool = False,
    ) -> None:  # fmt: skip
        check_per_world(model)
        self.parts = tuple(parts)
        self.model = model
        shifts = _shifts(self.parts, model)
        first, shape = self.parts[0], (model.world_count, len(self.parts))
        self.chassis: wp.array = wp.array([each.chassis for each in self.parts], dtype=int, device=model.device)
        self.input = writable((*shape, 4), wp.float32, model.device)
        self.lock = writable((*shape, len(first.driveline.locks)), wp.float32, model.device)
        self._tables = _reduced_tables(first) if first.spec.is_reduced else _tables(first, model)
        for name, values in shifts.items():
            setattr(self._tables, name, wp.array(values, dtype=int, device=model.device))
        self._tables.point = wp.vec3(*(first.reference + finite_vector("Vehicle", "point", point, 3)))
        self._motion: Any = motion_arrays(shape, model, len(first.spec.trailers))
        self._powertrain = powertrain_tables(
            model, first.driveline, first.gears, first.spec.engine, first.spec.transmission
        )
        self._powertrain_state: Any = powertrain_state([each.start for each in self.parts], model)
        self.position: wp.array = self._motion.position
        self.angles: wp.array = self._motion.angles
        self.velocity_b: wp.array = self._motion.velocity_b
        self.omega_b: wp.array = self._motion.omega_b
        self.acceleration_b: wp.array = self._motion.acceleration_b
        self.articulation: wp.array = self._motion.articulation
        self.gear: wp.array = self._powertrain_state.gear
        self.engine_speed: wp.array = self._powertrain_state.engine_speed
        self.engine_torque: wp.array = self._powertrain_state.engine_torque
        self.drive_torque: wp.array = self._powertrain_state.drive_torque
        met = None if obstacles is None else TireObstacles(model, obstacles)
        self.tires = _tires(self.parts, model, ground, met, randomised)
        self.reduced = self._reduced_wheels(randomised)
        self._each = tuple(_member(self, number) for number in range(len(self.parts)))

    def _reduced_wheels(self, randomised: bool) -> ReducedWheels | None:
        """Wheels and powertrain of reduced vehicles; None of full ones."""
        first = self.parts[0]
        if not first.spec.is_reduced:
            return None
        shown = [[side.spindle for side in each.sides] for each in self.parts if each.has_wheel_bodies]
        starts = [each.start for each in self.parts]
        wheels = ReducedWheels(first.spec, first.reference, starts, shown, self.model, randomised=randomised)
        powertrain: Any = self._powertrain
        powertrain.split_dof = wheels.split
        return wheels

    def _readable_title(self) -> str:
        count, model = len(self.parts), self.model
        return (
            f": {count} '{self.parts[0].spec.name}' in each of {plural(model.world_count, 'world')} on {model.device}"
        )

    def _readable_rows(self) -> dict[str, Row]:
        return {
            "chassis": Names(len(self.parts), (self.model.body_names[each.chassis] for each in self.parts)),
            "input": f"{array_text(self.input)}: steering, throttle, braking, clutch",
        }

    def __len__(self) -> int:
        return len(self._each)

    def __getitem__(self, number: int) -> Vehicle:
        return self._each[number]

    def __iter__(self) -> Iterator[Vehicle]:
        return iter(self._each)

    @property
    def input_rows(self) -> wp.array:
        """(W, V, 4), the inputs, as drivers' kernels take them."""
        return self.input

    def hold_gears(self) -> None:
        """From now on automatic transmissions stay in their gears, as manual ones do; `gear` is written to shift."""
        self._powertrain.shift_up.fill_(math.inf)
        self._powertrain.shift_down.fill_(-math.inf)

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a reset restores and a snapshot keeps. The couplings of the gears follow from the gears."""
        state = self._powertrain_state
        arrays = {
            "input": self.input,
            "lock": self.lock,
            "tire_state": self.tires.state,
            "gear": state.gear,
            "shift_time": state.shift_time,
            "engine_speed": state.engine_speed,
            "last_input": state.last_input,
            "last_drive": state.last_drive,
        }
        if self.reduced is not None:
            arrays |= self.reduced.memory
        return {name: array for name, array in arrays.items() if array.size}

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers of the tires, and the ground under them."""
        return self.tires.world_parameters

    @property
    def assigned_bodies(self) -> tuple[int, ...]:
        """Bodies whose forces it writes: the chassis, and the wheels where tires make forces."""
        return tuple(body for each in self for body in each.assigned_bodies)

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Launches of one sub-step: inputs and powertrains, then tires."""
        model, control, state = simulation.model, simulation.control.arrays, simulation.state.arrays
        if self.reduced is not None:
            return self._record_reduced(simulation, dt)
        inputs = simulation.shares.record(
            run_vehicle, len(self.parts),
            inputs=[dt, self._tables, self._powertrain, self.input, self.lock, model.parameters, state],
            outputs=[self._powertrain_state, self._motion, control],
        )  # fmt: skip
        if not isinstance(self.tires, Tires):
            self._warn_of_missing_ground(simulation)
            return [inputs, *self.tires.record(simulation)]
        wheels = self.tires.shape[1]
        tires = simulation.shares.record(
            apply_tires, wheels, inputs=self.tires.inputs(dt, state, model.assets),
            outputs=[control.element_force, control.element_torque],
        )  # fmt: skip
        if self.tires.obstacles is None:
            return [inputs, tires]
        around = self.tires.envelope_inputs(state)
        return [
            inputs,
            simulation.shares.record(find_envelopes, wheels, inputs=around[:-1], outputs=around[-1:]),
            tires,
        ]

    def _record_reduced(self, simulation: StepContext, dt: float) -> list[Any]:
        """Of reduced vehicles: one launch for all, behind that which finds obstacles."""
        assert self.reduced is not None
        assert isinstance(self.tires, Tires)  # of reduce_vehicle
        launches = []
        if self.tires.obstacles is not None:
            around = self.tires.envelope_inputs(simulation.state.arrays)
            launches.append(
                simulation.shares.record(
                    find_envelopes, self.tires.shape[1], inputs=around[:-1], outputs=around[-1:]
                )
            )  # fmt: skip
        acting = self.reduced.record(
            simulation, dt, self._tables, self._powertrain, self.input, self.lock, self.tires,
            [self._powertrain_state, self._motion],
        )  # fmt: skip
        return [*launches, acting]

    def _warn_of_missing_ground(self, simulation: StepContext) -> None:
        assert not isinstance(self.tires, Tires)  # these have a plane at least
        missing = self.tires.missing_ground(simulation, {body for each in self.parts for body in each.bodies})
        if missing:
            spec = self.parts[0].spec
            text = f"vehicle '{spec.name}': its {spec.axles[0].tire.template} tires have nothing to stand on: {missing}"
            warnings.warn(text, stacklevel=5)

    def record_after(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that measures the motions after a sub-step."""
        loads = [] if isinstance(self.tires, Tires) else self.tires.record_after(simulation)
        if self._has_obstacles:  # which are looked for around the bodies of wheels
            loads = self._record_poses(simulation)
        return [
            *loads,
            simulation.shares.record(
                measure_vehicle, len(self.parts),
                inputs=[dt, self._tables, simulation.state.arrays], outputs=[self._motion],
            ),
        ]  # fmt: skip

    def record_shown(self, simulation: StepContext) -> Sequence[Any]:
        """The launch that moves the bodies of a reduced vehicle's wheels."""
        return () if self._has_obstacles else self._record_poses(simulation)

    @property
    def _has_obstacles(self) -> bool:
        return isinstance(self.tires, Tires) and self.tires.obstacles is not None

    def _record_poses(self, simulation: StepContext) -> list[Any]:
        return [] if self.reduced is None else self.reduced.record_poses(simulation, self._tables, self.input)

    def record_outputs(self, simulation: StepContext, mask: wp.array) -> Sequence[Any]:
        """The launch that measures the motions in worlds whose state was set."""
        shown = []
        if self.reduced is not None:
            shown = self.reduced.record_set_poses(simulation, mask, self._tables, self.input)
        return [
            *shown,
            simulation.shares.record(
                measure_set_vehicle, len(self.parts),
                inputs=[mask, self._tables, simulation.state.arrays], outputs=[self._motion],
            )
        ]  # fmt: skip


class Vehicle(ForceElement):
    """Tires, powertrain, brakes and steering of one vehicle, in every world: a `ForceElement`.

    Pass it to the Simulation: `Simulation(model, dt, elements=[vehicle], solver=VEHICLE_SOLVER)`. One of `Vehicles` has
    the same arrays, and is no element of its own.

    Args:
        parts: from `add_vehicle`.
        model: made with `per_world=PER_WORLD` at least.
        ground: surface under the tires (`tires.ground`); the plane z = 0 when None.
        obstacles: shapes on WORLD that tires which are force laws meet beside the ground, by name or index, or "all";
            none when None.
        point: whose motion `position` to `acceleration_b` tell, in the vehicle's frame of reference [m].
        randomised: True if every world has rows of its own in `tires.parameter` and an entry of its own in
            `tires.ground_friction`; otherwise all share one.

    Attributes:
        bodies: (N,) int32, indices of its bodies in the model, the chassis first; with the loads that joints hold, and
            the nodes of flexible tires.
        input: (W, 4) steering -1..1 (positive to the left), throttle, braking and clutch 0..1. Write it, or let a
            driver do so. Of a differential drive they are speeds of its motors (docs/vehicles.md).
        lock: (W, locks) 0..1, closes the clutches of differentials that are `lockable`: central, front, rear.
        tires: forces, loads, slips and parameters of the tires, (W, wheels) in the order of `parts.sides`.
        position: (W,) vec3d of the point, world [m].
        angles: (W,) vec3 roll, pitch (positive nose down), yaw [rad].
        velocity_b, acceleration_b: (W,) vec3 of the point in axes of the chassis [m/s, m/s²]; the acceleration is that
            of the last step, without gravity, and zero where the state was set since.
        omega_b: (W,) vec3 of the chassis in its axes [rad/s]; the third entry is the yaw rate.
        gear: (W,) -1 reverse, 0 neutral, 1 and up forward. Writable: a manual gearbox takes it as it is.
        engine_speed, engine_torque, drive_torque: (W,) of the engine's shaft [rad/s], of the engine alone, and of the
            transmission on the drive shaft [N·m].
        articulation: (W, trailers) yaw of each trailer seen from the unit that tows it, positive where it is turned to
            the left [rad].

    Raises:
        ModelError: the model shares an array that each world's vehicle has to write.
    """

    def __init__(
        self, parts: VehicleParts, model: Model, *, ground: TerrainTables | None = None,
        obstacles: ObstacleNames | None = None, point: Vec3 = (0.0, 0.0, 0.0), randomised: bool = False,
    ) -> None:  # fmt: skip
        alone = Vehicles([parts], model, ground=ground, obstacles=obstacles, point=point, randomised=randomised)
        self._show(alone, 0)

    def _show(self, vehicles: Vehicles, number: int) -> None:
        """Takes the arrays of one of some vehicles."""
        self._vehicles, self._number = vehicles, number
        self.parts, self.model = vehicles.parts[number], vehicles.model
        self.bodies: wp.array = wp.array(_bodies(self.parts, self.model), dtype=int, device=self.model.device)
        self.input = vehicles.input[:, number]
        # no view can be made of nothing
        none = writable((self.model.world_count, 0), wp.float32, self.model.device)
        self.lock = vehicles.lock[:, number] if vehicles.lock.size else none
        wheels = len(self.parts.sides)
        alone = len(vehicles.parts) == 1
        self.reduced = None if vehicles.reduced is None else vehicles.reduced.of(number)
        self.tires = vehicles.tires if alone else vehicles.tires.of(number * wheels, wheels)
        self.position: wp.array = vehicles.position[:, number]
        self.angles: wp.array = vehicles.angles[:, number]
        self.velocity_b: wp.array = vehicles.velocity_b[:, number]
        self.omega_b: wp.array = vehicles.omega_b[:, number]
        self.acceleration_b: wp.array = vehicles.acceleration_b[:, number]
        self.articulation: wp.array = vehicles.articulation[:, number] if vehicles.articulation.size else none
        self.gear: wp.array = vehicles.gear[:, number]
        self.engine_speed: wp.array = vehicles.engine_speed[:, number]
        self.engine_torque: wp.array = vehicles.engine_torque[:, number]
        self.drive_torque: wp.array = vehicles.drive_torque[:, number]

    def _readable_title(self) -> str:
        model = self.model
        return f" '{self.parts.spec.name}': {plural(model.world_count, 'world')} on {model.device}"

    def _readable_rows(self) -> dict[str, Row]:
        return {
            "chassis": self.model.body_names[self.parts.chassis],
            "wheels": Names(len(self.parts.sides), (self.model.body_names[side.spindle] for side in self.parts.sides)),
            "input": f"{array_text(self.input)}: steering, throttle, braking, clutch",
            "tires": ", ".join(dict.fromkeys(axle.tire.template for axle in self.parts.spec.all_axles)),
        }

    @property
    def chassis(self) -> wp.array:
        """(1,) int32, the body in the model."""
        return self._vehicles.chassis[self._number : self._number + 1]

    @property
    def input_rows(self) -> wp.array:
        """(W, 1, 4), the inputs with an axis of vehicles, as drivers' kernels take them."""
        return self._vehicles.input[:, self._number : self._number + 1]

    def hold_gears(self) -> None:
        """From now on an automatic transmission stays in its gear, as a manual one does; `gear` is written to shift."""
        self._element().hold_gears()

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a reset restores and a snapshot keeps."""
        return self._element().memory

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers of the tires, and the ground under them."""
        return self._element().world_parameters

    @property
    def assigned_bodies(self) -> tuple[int, ...]:
        """Bodies whose forces it writes: the chassis, and the wheels where its tires make forces."""
        pulled = tuple(unit.chassis for unit in self.parts.units)
        if self.reduced is not None or not isinstance(self.tires, Tires):
            return pulled
        return (*pulled, *(side.spindle for side in self.parts.sides))

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Launches of one sub-step: inputs and powertrain, then tires."""
        return self._element().record(simulation, dt)

    def record_after(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that measures the motion after a sub-step."""
        return self._element().record_after(simulation, dt)

    def record_shown(self, simulation: StepContext) -> Sequence[Any]:
        """The launch that moves the bodies of a reduced vehicle's wheels."""
        return self._element().record_shown(simulation)

    def record_outputs(self, simulation: StepContext, mask: wp.array) -> Sequence[Any]:
        """The launch that measures the motion in worlds whose state was set."""
        return self._element().record_outputs(simulation, mask)

    @property
    def _attached(self) -> bool:
        return self._element()._attached

    @_attached.setter
    def _attached(self, value: bool) -> None:
        self._element()._attached = value

    def _element(self) -> Vehicles:
        """What acts in the simulation: this vehicle alone."""
        count = len(self._vehicles)
        if count > 1:
            raise ModelError(
                f"Simulation: elements: vehicle {self._number} is one of {count} `Vehicles`, which act together; pass "
                "those in its place"
            )
        return self._vehicles


def _member(vehicles: Vehicles, number: int) -> Vehicle:
    """One of the vehicles."""
    vehicle = Vehicle.__new__(Vehicle)
    vehicle._show(vehicles, number)
    return vehicle


def _shifts(parts: Sequence[VehicleParts], model: Model) -> dict[str, list[int]]:
    """How far the indices of each vehicle's bodies, degrees of freedom and couplings are from the first one's."""
    if not parts:
        raise ModelError("Vehicles: parts must be of at least one vehicle, got none; call add_vehicle")
    first, joints = parts[0], [_joints(each) for each in parts]
    starts = model.joint_dof_start
    shifts: dict[str, list[int]] = {"body_shift": [], "dof_shift": [], "coupling_shift": []}
    for each, mine in zip(parts, joints, strict=True):
        body, coupling = each.chassis - first.chassis, each.gears.gear_coupling - first.gears.gear_coupling
        dofs = {starts[a] - starts[b] for a, b in zip(mine, joints[0], strict=False)}
        spindles = {a.spindle - b.spindle for a, b in zip(each.sides, first.sides, strict=False)}
        if each.spec != first.spec or len(dofs) > 1 or spindles != {body}:
            raise ModelError(
                f"Vehicles: vehicles must be alike, got '{first.spec.name}' and '{each.spec.name}' of another "
                "description; make one `Vehicles` for each"
            )
        for name, shift in zip(shifts, (body, dofs.pop() if dofs else 0, coupling), strict=True):
            shifts[name].append(shift)
    return shifts


def _joints(parts: VehicleParts) -> list[int]:
    """All joints and shafts that a vehicle's inputs and powertrain act on."""
    line, gears = parts.driveline, parts.gears
    split = [joint for left, right, *_ in line.split for joint in (left, right)]
    found = [*(s.joint for s in parts.steerings), *(s.spin for s in parts.sides), *(lock.slip for lock in line.locks)]
    shafts = [*line.motors, line.shaft, gears.motor_shaft, gears.input_shaft, gears.clutch_shaft]
    return [joint for joint in (*found, *split, *shafts) if joint >= 0]


def check_per_world(model: Model) -> None:
    """Checks that each world has its own of what a vehicle writes.

    Raises:
        ModelError: the model shares such an array.
    """
    for name in PER_WORLD:
        array = getattr(model, name)
        if array.size and array.shape[0] != model.world_count:
            raise ModelError(
                f"Vehicle: every world needs its own {name}, but the model shares it; "
                f"finalize(..., per_world={list(PER_WORLD)})"
            )


def per_world(others: Iterable[str] = ()) -> list[str]:
    """Names for `finalize(per_world=...)`: what a vehicle writes and what the caller randomises."""
    return sorted({*PER_WORLD, *others})


def _bodies(parts: VehicleParts, model: Model) -> list[int]:
    """All bodies that joints connect with the chassis, which comes first, then nodes of meshes glued to them."""
    pairs = [(joint.parent, joint.child) for joint in model.builder.joints if min(joint.parent, joint.child) >= 0]
    found = [parts.chassis]
    if parts.spec.is_reduced and parts.has_wheel_bodies:
        found += [side.spindle for side in parts.sides]
    for body in found:
        reached = {a + b - body for a, b in pairs if body in (a, b)}
        found += sorted(reached.difference(found))
    held = set(found)
    for mesh in model.builder.flexible_meshes:
        if any(glued and body in held for body, glued in zip(mesh.bodies, mesh.glued, strict=True)):
            found += [mesh.bodies[node] for node in mesh.nodes]
    return found


def _reduced_tables(parts: VehicleParts) -> VehicleTables:
    """Chassis and drag: a reduced vehicle has no joints to act on."""
    table, chassis = VehicleTables(), parts.spec.chassis
    table.chassis = parts.chassis
    table.drag = chassis.drag_factor
    return table


def _tables(parts: VehicleParts, model: Model) -> VehicleTables:
    starts = model.joint_dof_start
    brakes = [
        (starts[side.spin], parts.spec.all_axles[side.axle].brake)
        for side in parts.sides
        if parts.spec.all_axles[side.axle].brake is not None
    ]
    table = VehicleTables()
    chassis = parts.spec.chassis
    table.chassis = parts.chassis
    table.drag = chassis.drag_factor
    behind = [unit.chassis for unit in parts.units[1:]]
    table.trailer_body = wp.array(behind, dtype=int, device=model.device)
    drags = [unit.chassis.drag_factor for unit in parts.spec.units[1:]]
    table.trailer_drag = wp.array(drags, dtype=float, device=model.device)
    table.steering_dof = wp.array([starts[s.joint] for s in parts.steerings], dtype=int, device=model.device)
    table.steering_travel = wp.array([s.travel for s in parts.steerings], dtype=float, device=model.device)
    table.brake_dof = wp.array([dof for dof, _ in brakes], dtype=int, device=model.device)
    locks = parts.driveline.locks
    table.lock_dof = wp.array([starts[lock.slip] for lock in locks], dtype=int, device=model.device)
    table.lock_held = wp.array([lock.held for lock in locks], dtype=float, device=model.device)
    table.lock_torque = wp.array([lock.locking for lock in locks], dtype=float, device=model.device)
    torques = [brake.max_torque for _, brake in brakes if brake is not None]
    table.brake_torque = wp.array(torques, dtype=float, device=model.device)
    table.motor_dof = wp.array([starts[motor] for motor in parts.driveline.motors], dtype=int, device=model.device)
    if isinstance(parts.spec.driveline, DifferentialDrive):
        table.motor_speed = parts.spec.driveline.max_speed
    return table


def motion_arrays(shape: tuple[int, int], model: Model, trailers: int = 0) -> Any:
    """A `VehicleMotion` of (W, V) vehicles that stand still."""
    motion: Any = VehicleMotion()
    motion.position = wp.zeros(shape, dtype=wp.vec3d, device=model.device)
    for name in ("angles", "velocity_b", "omega_b", "acceleration_b", "last_v"):
        setattr(motion, name, wp.zeros(shape, dtype=wp.vec3, device=model.device))
    motion.articulation = wp.zeros((*shape, trailers), dtype=float, device=model.device)
    return motion


def _tires(
    parts: Sequence[VehicleParts], model: Model, ground: TerrainTables | None, obstacles: TireObstacles | None,
    randomised: bool,
) -> Tires | ContactTires | SoilTires:  # fmt: skip
    """Force elements, shapes in contact, or wheels on soil; a vehicle has one kind of them."""
    sides = [side for each in parts for side in each.sides]
    template = parts[0].spec.axles[0].tire.template
    if obstacles is not None and template not in MODELS:
        raise SpecError(
            f"obstacles: must be left out with '{template}' tires, which are shapes themselves and meet every shape"
            " that may touch them"
        )
    on_soil = [axle.tire.template == SOIL_RIGID for axle in parts[0].spec.all_axles]
    if all(on_soil):
        return SoilTires(len(sides), model, terrain=ground)
    meshes = [side.mesh for side in sides if side.mesh is not None]
    if len(meshes) == len(sides):
        nodes = [[mesh.bodies[node] for node in mesh.nodes] for mesh in meshes]
        return ContactTires([mesh.shapes for mesh in meshes], nodes, model)
    if meshes:
        raise SpecError("axles: tires must be flexible on all wheels or on none, got both; choose one kind")
    if any(on_soil):
        raise SpecError("axles: tires must be soil-rigid on all wheels or on none, got both; choose one kind")
    rigid = [side for side in sides if side.shape >= 0]
    if not rigid:
        mounts = [mount for each in parts for mount in _mounts(each)]
        worlds, bodies = model.world_count, model.body_count
        if not all(each.has_wheel_bodies for each in parts):
            if obstacles is not None:
                raise SpecError(
                    "obstacles: must be left out with wheel_bodies=False, for they are looked for around bodies"
                )
            # numbers of their own, as they are no bodies of the model
            mounts = [mount._replace(body=wheel) for wheel, mount in enumerate(mounts)]
            bodies = len(mounts)
        return Tires(
            mounts, worlds, bodies, model.device, terrain=ground, obstacles=obstacles, randomised=randomised
        )  # fmt: skip
    if len(rigid) < len(sides):
        raise SpecError("axles: tires must be rigid on all wheels or on none, got both; choose one kind")
    return ContactTires([[side.shape] for side in rigid], [[side.spindle] for side in rigid], model)


def _mounts(parts: VehicleParts) -> list[Mount]:
    """Tires on their spindles, whose centres of mass are the wheels' centres."""
    axles = parts.spec.all_axles
    rows = [tire_vector(axle.tire, f"{parts.spec.name}: axles[{index}].tire") for index, axle in enumerate(axles)]
    return [Mount(rows[side.axle], side.spindle, side="left" if side.side > 0.0 else "right") for side in parts.sides]
