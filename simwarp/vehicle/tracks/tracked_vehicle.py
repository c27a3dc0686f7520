"""Tracked vehicles at work: driver's inputs, powertrain, brakes and readings of two tracks, in every world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

import warp as wp

from simwarp.core.arrays import writable
from simwarp.core.object_repr import Row, array_text, plural
from simwarp.core.types import WORLD, ModelError, Vec3, finite_vector
from simwarp.model.model import Model
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.simulation.solver_options import SolverOptions
from simwarp.soil.soil_parameters import SoilSpec
from simwarp.vehicle.drivetrain.powertrains import powertrain_state, powertrain_tables
from simwarp.vehicle.inputs_kernels import VehicleTables
from simwarp.vehicle.spec.track_parts import SimpleTrackDriveline
from simwarp.vehicle.tires.ground_kernels import TerrainTables
from simwarp.vehicle.tracks.belts import Belts
from simwarp.vehicle.tracks.tracked_construction import TrackedVehicleParts
from simwarp.vehicle.tracks.tracked_vehicle_kernels import (
    TrackTables,
    measure_set_tracked_vehicle,
    measure_tracked_vehicle,
    run_tracked_vehicle,
)
from simwarp.vehicle.vehicle import Vehicle, check_per_world, motion_arrays

TRACK_SOLVER: Final = SolverOptions(max_iterations=100, fallback=False, position_projection=2, refinement=0)
"""For simulations of tracks, shoe by shoe: more iterations, or refinement of the digits of light bodies under heavy
ones, change a vehicle's motion by 1e-3 of it (docs/decisions.md).
"""


class TrackedVehicle(ForceElement):
    """Powertrain, brakes, steering and belts of one tracked vehicle, in every world: a `ForceElement`.

    Pass it to the Simulation: `Simulation(model, dt, elements=[vehicle], solver=TRACK_SOLVER)`, on belts with
    `VEHICLE_SOLVER`.

    Args:
        parts: from `add_tracked_vehicle`.
        model: made with `per_world=per_world()` at least.
        point: whose motion `position` to `acceleration_b` tell, in the vehicle's frame of reference [m].
        ground: surface under belts (`ground`); the plane z = 0 when None. Chains meet shapes.
        soil: deformable ground under belts: a `SoilSpec` or the name of a preset; None: it is hard. For chains there is
            `simwarp.soil.soil_under_tracks`.
        randomised: True if every world has rows of its own in `belts.parameter`, `soil` and `ground_friction`.

    Attributes:
        bodies: (N,) int32, indices of its bodies in the model, the chassis first.
        chassis: (1,) int32, the body in the model.
        input: (W, 4) steering -1..1 (positive to the left), throttle, braking and clutch 0..1. Write it, or let a
            driver do so.
        gyration: (W,) int32, 1: full steering turns the inner side's torque around, so that the vehicle turns on the
            spot; of a simple driveline.
        position: (W,) vec3d of the point, world [m].
        angles: (W,) vec3 roll, pitch (positive nose down), yaw [rad].
        velocity_b, acceleration_b: (W,) vec3 of the point in axes of the chassis [m/s, m/s²]; the acceleration is that
            of the last step, without gravity, and zero where the state was set since.
        omega_b: (W,) vec3 of the chassis in its axes [rad/s]; the third entry is the yaw rate.
        gear: (W,) -1 reverse, 0 neutral, 1 and up forward. Writable: a manual gearbox takes it as it is.
        engine_speed, engine_torque, drive_torque: (W,) of the engine's shaft [rad/s], of the engine alone, and of the
            transmission on the drive shaft [N·m].
        sprocket_speed: (W, 2) left and right, positive forwards [rad/s].
        tension: (W, 2) half the force of each tensioner: of each of the chain's two runs around the idler [N].
        belts: both belts, with their readings, parameters and ground; None of a vehicle with chains.

    Raises:
        ModelError: the model shares an array that each world's vehicle has to write, the hull is fixed, or chains get
            a ground of belts.
    """

    def __init__(
        self, parts: TrackedVehicleParts, model: Model, *, point: Vec3 = (0.0, 0.0, 0.0),
        ground: TerrainTables | None = None, soil: SoilSpec | str | None = None, randomised: bool = False,
    ) -> None:  # fmt: skip
        check_per_world(model)
        if parts.chassis == WORLD:
            raise ModelError("TrackedVehicle: the hull is fixed; build it with hull_fixed=False")
        if parts.chains and (ground is not None or soil is not None):
            name = "ground" if ground is not None else "soil"
            raise ModelError(
                f"TrackedVehicle: {name} is that of belts, and '{parts.spec.name}' has chains, which meet shapes and "
                "soil_under_tracks; leave it out, or build with_belts(spec)"
            )
        self.parts, self.model = parts, model
        self.belts = Belts(parts.belts, model, ground=ground, soil=soil, randomised=randomised) if parts.belts else None
        worlds, device = model.world_count, model.device
        bodies = [parts.chassis, *(body for body in parts.bodies if body != parts.chassis)]
        self.bodies: wp.array = wp.array(bodies, dtype=int, device=device)
        self.chassis: wp.array = self.bodies[:1]
        self.input_rows = writable((worlds, 1, 4), wp.float32, device)
        self.input = self.input_rows[:, 0]
        self._tables = _vehicle_tables(parts, model)
        self._tables.point = wp.vec3(*(parts.reference + finite_vector("TrackedVehicle", "point", point, 3)))
        self._tracks = _track_tables(parts, model)
        spec, line = parts.spec, parts.driveline
        self._powertrain = powertrain_tables(model, line.line, parts.gears, spec.engine, spec.transmission)
        if line.torque_sign < 0.0:
            # turned around, what accelerates the input shaft would be a negative inertia of the sprockets
            self._powertrain.input_inertia = 0.0
        self._powertrain_state: Any = powertrain_state([parts.start], model)
        self._motion: Any = motion_arrays((worlds, 1), model)
        self.gyration = writable((worlds,), wp.int32, device)
        if isinstance(spec.driveline, SimpleTrackDriveline) and spec.driveline.gyration:
            self.gyration.fill_(1)
        self.position: wp.array = self._motion.position[:, 0]
        self.angles: wp.array = self._motion.angles[:, 0]
        self.velocity_b: wp.array = self._motion.velocity_b[:, 0]
        self.omega_b: wp.array = self._motion.omega_b[:, 0]
        self.acceleration_b: wp.array = self._motion.acceleration_b[:, 0]
        self.gear: wp.array = self._powertrain_state.gear[:, 0]
        self.engine_speed: wp.array = self._powertrain_state.engine_speed[:, 0]
        self.engine_torque: wp.array = self._powertrain_state.engine_torque[:, 0]
        self.drive_torque: wp.array = self._powertrain_state.drive_torque[:, 0]
        self.sprocket_speed: wp.array = wp.zeros((worlds, 2), dtype=float, device=device)
        chains = wp.zeros((worlds, 2), dtype=float, device=device)
        self.tension: wp.array = chains if self.belts is None else self.belts.tension

    def _readable_title(self) -> str:
        return f" '{self.parts.spec.name}': {plural(self.model.world_count, 'world')} on {self.model.device}"

    def _readable_rows(self) -> dict[str, Row]:
        spec = self.parts.spec
        return {
            "chassis": self.model.body_names[self.parts.chassis],
            "tracks": f"{spec.left.shoes} and {spec.right.shoes} shoes{', as belts' if spec.on_belts else ''}",
            "input": f"{array_text(self.input)}: steering, throttle, braking, clutch",
        }

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a reset restores and a snapshot keeps."""
        state = self._powertrain_state
        arrays = {
            "input": self.input_rows,
            "gyration": self.gyration,
            "gear": state.gear,
            "shift_time": state.shift_time,
            "engine_speed": state.engine_speed,
            "last_input": state.last_input,
            "last_drive": state.last_drive,
        }
        if self.belts is not None:
            arrays |= {f"belt_{name}": array for name, array in self.belts.memory.items()}
        return {name: array for name, array in arrays.items() if array.size}

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers of the belts and their ground; none of chains."""
        return {} if self.belts is None else self.belts.world_parameters

    @property
    def assigned_bodies(self) -> tuple[int, ...]:
        """Bodies whose forces it writes: the chassis."""
        return (self.parts.chassis,)

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that turns inputs into torques and bounds, then those of belts."""
        model, control, state = simulation.model, simulation.control.arrays, simulation.state.arrays
        belts = [] if self.belts is None else self.belts.record(simulation, dt)
        return [
            simulation.shares.record(
                run_tracked_vehicle, 1,
                inputs=[
                    dt, self._tables, self._tracks, self._powertrain, self.input_rows, self.gyration, model.parameters,
                    state,
                ],
                outputs=[self._powertrain_state, self._motion, control],
            ),
            *belts,
        ]  # fmt: skip

    def record_after(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that measures the motion after a sub-step."""
        return [
            simulation.shares.record(
                measure_tracked_vehicle, 1,
                inputs=[dt, self._tables, self._tracks, simulation.model.parameters, simulation.state.arrays],
                outputs=[self._motion, self.sprocket_speed, self.tension],
            )
        ]  # fmt: skip

    def record_outputs(self, simulation: StepContext, mask: wp.array) -> Sequence[Any]:
        """The launch that measures the motion in worlds whose state was set."""
        return [
            simulation.shares.record(
                measure_set_tracked_vehicle, 1,
                inputs=[mask, self._tables, self._tracks, simulation.model.parameters, simulation.state.arrays],
                outputs=[self._motion, self.sprocket_speed, self.tension],
            )
        ]  # fmt: skip


def _vehicle_tables(parts: TrackedVehicleParts, model: Model) -> VehicleTables:
    """Chassis and drag; brakes and steering of tracks have tables of their own."""
    table, chassis = VehicleTables(), parts.spec.chassis
    table.chassis = parts.chassis
    table.drag = 0.5 * chassis.air_density * chassis.drag_coefficient * chassis.drag_area
    for name in ("body_shift", "dof_shift", "coupling_shift"):
        setattr(table, name, wp.zeros(1, dtype=int, device=model.device))
    return table


def _track_tables(parts: TrackedVehicleParts, model: Model) -> TrackTables:
    table, starts = TrackTables(), model.joint_dof_start
    tracks = (parts.spec.left, parts.spec.right)
    table.sprocket_dof = wp.vec2i(*(starts[side.sprocket] for side in (parts.left, parts.right)))
    table.tensioner_dof = wp.vec2i(*([starts[side.tensioner] for side in parts.chains] or [-1, -1]))
    table.tensioner_sign = wp.vec2(*(track.idler.tightening for track in tracks))
    table.brake_torque = wp.vec2(*(0.0 if track.brake is None else track.brake.max_torque for track in tracks))
    table.steers_by_torque = int(parts.driveline.steers_by_torque)
    table.steers_by_brake = int(parts.driveline.steers_by_brake)
    table.torque_sign = parts.driveline.torque_sign
    return table


AnyVehicle: TypeAlias = Vehicle | TrackedVehicle
"""What drivers drive."""
