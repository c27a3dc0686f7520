"""Simulation: owns the buffers of a run, steps all worlds, resets and sets some of them, takes snapshots."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import Any, cast

import numpy as np
import warp as wp

from simwarp.contacts import Contacts
from simwarp.diagnostics import Diagnostics, explain_worlds
from simwarp.force_elements import ForceElement, words
from simwarp.kernels.collision.world import collide_worlds, make_collision_scratch
from simwarp.kernels.energy import measure_energy
from simwarp.kernels.tables import StepConfig
from simwarp.kernels.world import Operation, Sizes, copy_rows, copy_worlds, make_scratch, run_worlds_kernel
from simwarp.model import Model
from simwarp.sensor_protocol import Sensor
from simwarp.state import Control, State, initial_arrays
from simwarp.types import ConeSolver, ContactModel, FrictionLaw, ModelError, shown

REFINED_MASS_RATIO = 100.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class SolverOptions:
    """Numbers of the solver (docs/theory.md).

    Attributes:
        recovery_speed: fastest correction of a position error [m/s].
        recovery_rate: the same for angles [rad/s].
        position_projection: passes that move positions onto the joints after each step; when None, 1 for models
            with closed loops (whose energy it keeps over long runs) and 0 for trees.
        refinement: passes of iterative refinement on the free motion; when None, 1 for models whose heaviest body
            has more than 100 times the mass of the lightest, else 0.
        pivot_tolerance: a row whose pivot falls below this share of its diagonal counts as redundant.
        max_iterations: of the solve of limits, friction and contacts.
        tolerance: residual at which it stops [m/s or rad/s].
        row_tolerance: residual above which bilateral rows are solved a second time [m/s or rad/s].
        gyroscopic: whether spinning bodies precess.
        solver: of limits, friction and contacts: "apgd", "psor", "spg", "padmm" or "interior_point".
        rescue: let the interior point solve what is left above the tolerance in worlds with a dense Schur complement;
            when None, where models have contacts and masses that differ by more than 100.
        friction_law: "exact" (Coulomb) or "convex" (its relaxation, in which sliding contacts separate).
        contact_model: "rigid" (unilateral rows), "smooth" or "smooth_hooke" (penalty forces by the law of Hertz or
            Hooke from Young's modulus and Poisson's ratio; dt has to resolve the collision time).
        bounce_speed: restitution acts where the rebound is faster than this [m/s].
        contact_envelope: a contact takes part if its gap, after a step without contacts, would be below this [m].
        dense_rows: most rows for which the Schur complement of the contacts is formed; larger worlds apply it row by
            row.
    """

    recovery_speed: float = 0.6
    recovery_rate: float = 3.0
    position_projection: int | None = None
    refinement: int | None = None
    pivot_tolerance: float = 1.0e-5
    max_iterations: int = 1000
    tolerance: float = 1.0e-5
    row_tolerance: float = 5.0e-6
    gyroscopic: bool = True
    solver: str = "apgd"
    rescue: bool | None = None
    friction_law: str = "exact"
    contact_model: str = "rigid"
    bounce_speed: float = 0.15
    contact_envelope: float = 1.0e-3
    dense_rows: int = 128


@dataclasses.dataclass(frozen=True)
class Snapshot:
    """A copy of everything that a step reads and changes. Opaque; pass it to `Simulation.restore`."""

    state: State
    control: Control
    contacts: Contacts
    memory: tuple[wp.array, ...] = ()


class Simulation:
    """Steps `model.world_count` worlds together.

    Nothing is allocated and nothing is read back to the host in `step`.

    Args:
        model: from `ModelBuilder.finalize`.
        dt: time of one `step` call [s].
        substeps: equal parts that it is divided into.
        solver: see `SolverOptions`.
        joint_reactions: record the force and torque of every joint (`diagnostics.joint_reaction_force`).
        elements: force elements, such as a Vehicle's, launched before each sub-step.
        sensors: cameras, inertial units and others of `simwarp.sensors`, launched after each sub-step.
        read_every: calls of `step` between two looks at the sensors' data; frames that nobody would see are not taken.
            With 1, every frame that is the latest after some `step` is there.

    Raises:
        ModelError: dt, substeps or read_every is not usable, two sensors have the same name, or one cannot be part of
            this Simulation. No sensor belongs to it then, and all may be used in another.
    """

    def __init__(
        self,
        model: Model,
        dt: float,
        *,
        substeps: int = 1,
        solver: SolverOptions | None = None,
        joint_reactions: bool = False,
        elements: Sequence[ForceElement] = (),
        sensors: Sequence[Sensor] = (),
        read_every: int = 1,
    ) -> None:
        if not (isinstance(dt, (int, float)) and math.isfinite(dt) and dt > 0.0):
            raise ModelError(f"Simulation: dt must be > 0 s, got {dt!r}")
        for name, count in (("substeps", substeps), ("read_every", read_every)):
            if not isinstance(count, (int, np.integer)) or count < 1:
                raise ModelError(f"Simulation: {name} must be an integer >= 1, got {count!r}")
        self.model = model
        self.dt = float(dt)
        self.substeps = int(substeps)
        self.solver = solver if solver is not None else SolverOptions()
        self.read_every = int(read_every)
        self.elements = tuple(elements)
        self.sensors = _named_apart(sensors)
        self.control = Control(model, elements=bool(self.elements))
        self.diagnostics = Diagnostics(model, reactions=joint_reactions)
        self._config = self._step_config(joint_reactions)
        for sensor in self.sensors:  # all of them before any belongs to this Simulation
            if hasattr(sensor, "check"):
                sensor.check(self, self._config.dt)
        solvers = _choice("solver", ConeSolver, self.solver.solver) != ConeSolver.APGD
        rescue = model.shape_count > 0 and model.mass_ratio > REFINED_MASS_RATIO
        self._all_solvers = solvers or (rescue if self.solver.rescue is None else self.solver.rescue)
        self._kernel = run_worlds_kernel(self._all_solvers)
        self._no_coordinates = wp.zeros((1, 1), dtype=wp.float32, device=model.device)
        self._all_worlds = wp.full(model.world_count, True, dtype=wp.bool, device=model.device)
        # one lane on a CPU, whose launches are serial; a lane per world where worlds run side by side
        lanes = model.world_count if model.device.is_cuda else 1
        self._scratch = make_scratch(model.device, lanes, self._sizes())
        self.contacts = Contacts(model)
        self._collision_scratch = make_collision_scratch(
            model.device, lanes, model.shape_count, model.contact_capacity, model.topology.grid_buckets
        )
        self.state = initial_arrays(model)
        self._launch(Operation.MEASURE, self._all_worlds)
        self._initial = State(model)
        self._initial.copy_from(self.state)
        element_memory = [words(array, model.world_count) for part in self.elements for array in part.memory.values()]
        self._initial_memory = [(array, wp.clone(array)) for array in element_memory]
        self.physics_commands = self._record_step()
        """Recorded launches of a sub-step; those of the sensors come after them."""
        self.sensor_commands = [launch for sensor in self.sensors for launch in sensor.record(self, self._config.dt)]
        self.memory = (*element_memory, *(array for sensor in self.sensors for array in sensor.memory.values()))
        """What force elements and sensors remember; `Snapshot.memory` holds a copy."""
        self._begin_sensors(self._all_worlds)

    @property
    def time(self) -> wp.array:
        """(W,) float64 [s]: how long each world has run since its last reset."""
        return self.state.world_time

    def step(self) -> None:
        """Advances every world by `dt`, in `substeps` parts. Frozen (non-finite) worlds stay as they are."""
        for _ in range(self.substeps):
            for command in self.physics_commands:
                command.launch()
            for command in self.sensor_commands:
                command.launch()

    def reset(self, world_mask: Any = None, *, sensors: bool = True) -> None:
        """Puts the worlds of the mask (all when None) back to the model's initial state.

        Args:
            world_mask: (W,) bool, a Warp array, a torch tensor or anything NumPy reads.
            sensors: take their first frames now; where more is set before a world is ready, leave it to
                `begin_sensors`.
        """
        mask = self._mask(world_mask)
        wp.launch(
            copy_worlds, dim=self.model.world_count, device=self.model.device,
            inputs=[mask, self._initial.arrays], outputs=[self.state.arrays, self.contacts.arrays],
        )  # fmt: skip
        for present, initial in self._initial_memory:
            wp.launch(
                copy_rows, dim=self.model.world_count, device=self.model.device,
                inputs=[mask, initial], outputs=[present],
            )  # fmt: skip
        if sensors:
            self._begin_sensors(mask)

    def begin_sensors(self, world_mask: Any = None) -> None:
        """Starts the sensors' clocks in the worlds of the mask anew, with a frame of the present state."""
        self._begin_sensors(self._mask(world_mask))

    def keep_as_initial(self) -> None:
        """From now on a reset brings back the present state, at time 0: of a vehicle that has settled, say."""
        self._initial.copy_from(self.state)
        self._initial.world_time.zero_()
        for present, initial in self._initial_memory:
            wp.copy(initial, present)

    def set_joint_state(self, world_mask: Any, q: Any, qd: Any) -> None:
        """Sets coordinates and rates in the worlds of the mask: forward kinematics over the tree, then the loops
        are closed by Newton's method from there, and rates become consistent with them.

        Coordinates of joints that close loops only help to count turns. Floating bodies without a FREE joint stay.
        Worlds whose loops do not close get `WorldStatus.NOT_ASSEMBLED`.

        Args:
            world_mask: (W,) bool; all worlds when None.
            q: (W, dofs) [m or rad]; the present ones when None.
            qd: (W, dofs) [m/s or rad/s]; zeros when None.
        """
        shape = (self.model.world_count, self.model.dof_count)
        position = wp.clone(self.state.joint_q) if q is None else self._values("q", q, shape)
        rate = self._values("qd", np.zeros(shape, np.float32) if qd is None else qd, shape)
        mask = self._mask(world_mask)
        self._launch(Operation.ASSEMBLE, mask, position, rate)
        self._begin_sensors(mask)

    def measure(self, world_mask: Any = None, *, sensors: bool = True) -> None:
        """Publishes `body_q` and joint coordinates after a user wrote `body_x`, `body_rot` or velocities.

        `sensors`: as in `reset`.
        """
        mask = self._mask(world_mask)
        self._launch(Operation.MEASURE, mask)
        if sensors:
            self._begin_sensors(mask)

    def measure_energy(self) -> wp.array:
        """`diagnostics.energy` of the present state: (W,) float64 [J], kinetic, of weights and of linear springs."""
        wp.launch(
            measure_energy, dim=self.model.world_count, device=self.model.device,
            inputs=[self.model.topology, self.model.parameters, self.state.arrays], outputs=[self.diagnostics.energy],
        )  # fmt: skip
        return self.diagnostics.energy

    def problems(self) -> list[str]:
        """One line for each world that is in trouble: what it is, and what helps. Waits for the device."""
        return explain_worlds(self.state, self.contacts, self.diagnostics, self.solver.tolerance)

    def snapshot(self) -> Snapshot:
        """A copy of the state and the control; restoring it and stepping repeats the run bit by bit."""
        state, contacts = State(self.model), Contacts(self.model)
        control = Control(self.model, elements=bool(self.elements))
        state.copy_from(self.state)
        contacts.copy_from(self.contacts)
        for name in Control.NAMES:
            wp.copy(getattr(control, name), getattr(self.control, name))
        return Snapshot(state, control, contacts, tuple(wp.clone(array) for array in self.memory))

    def restore(self, snapshot: Snapshot) -> None:
        """Brings back what `snapshot` held, in place: views and captured steps stay valid.

        Raises:
            ModelError: it is that of a Simulation with another model, other force elements or other sensors.
        """
        if not isinstance(snapshot, Snapshot):
            raise ModelError(f"restore: snapshot must be a Snapshot, got {shown(snapshot)}; pass what snapshot() made")
        rows = [(array.shape, array.dtype) for array in (self.state.body_x, self.state.joint_q, *self.memory)]
        kept_rows = [
            (array.shape, array.dtype)
            for array in (snapshot.state.body_x, snapshot.state.joint_q, *snapshot.memory)
        ]  # fmt: skip
        if rows != kept_rows:
            names = ", ".join(sensor.name for sensor in self.sensors) or "none"
            raise ModelError(
                "restore: the snapshot must be of a Simulation with the same model, force elements and sensors "
                f"({names}), got one that keeps {len(snapshot.memory)} arrays of theirs instead of {len(self.memory)} "
                "or other shapes; make it in this Simulation"
            )
        self.state.copy_from(snapshot.state)
        self.contacts.copy_from(snapshot.contacts)
        for name in Control.NAMES:
            wp.copy(getattr(self.control, name), getattr(snapshot.control, name))
        for present, kept in zip(self.memory, snapshot.memory, strict=True):
            wp.copy(present, kept)

    # ---- inside --------------------------------------------------------------------------------------------------

    def _step_config(self, reactions: bool) -> StepConfig:
        config = StepConfig()
        config.dt = self.dt / self.substeps
        config.recovery_speed = self.solver.recovery_speed
        config.recovery_rate = self.solver.recovery_rate
        config.pivot_tolerance = self.solver.pivot_tolerance
        passes = self.solver.position_projection
        config.projection_iterations = int(self.model.has_loops) if passes is None else int(passes)
        refinement = self.solver.refinement
        config.refinement = int(self.model.mass_ratio > REFINED_MASS_RATIO) if refinement is None else refinement
        config.max_iterations = self.solver.max_iterations
        config.tolerance = self.solver.tolerance
        config.row_tolerance = self.solver.row_tolerance
        config.reactions = int(reactions)
        config.gyroscopic = int(self.solver.gyroscopic)
        config.friction_law = int(_choice("friction_law", FrictionLaw, self.solver.friction_law))
        config.solver = int(_choice("solver", ConeSolver, self.solver.solver))
        config.contact_model = int(_choice("contact_model", ContactModel, self.solver.contact_model))
        config.bounce_speed = self.solver.bounce_speed
        config.contact_envelope = self.solver.contact_envelope
        config.dense_rows = self.solver.dense_rows
        return config

    def _launch(
        self, operation: Operation, mask: wp.array, q: wp.array | None = None, qd: wp.array | None = None,
        *, record: bool = False,
    ) -> Any:  # fmt: skip
        q = self._no_coordinates if q is None else q
        qd = self._no_coordinates if qd is None else qd
        return wp.launch(
            self._kernel, dim=self.model.world_count, device=self.model.device, record_cmd=record,
            inputs=[
                int(operation), self._config, self.model.topology, self.model.parameters, self.control.arrays,
                mask, q, qd, self._scratch, self.state.arrays, self.contacts.arrays,
            ],
            outputs=[self.diagnostics.arrays],
        )  # fmt: skip

    def _record_step(self) -> list[Any]:
        """The physics of a step as recorded launches: a fifth of the host time of fresh ones."""
        commands = [command for part in self.elements for command in part.record(self, self._config.dt)]
        if self.model.topology.pair_count > 0:
            commands.append(
                wp.launch(
                    collide_worlds, dim=self.model.world_count, device=self.model.device, record_cmd=True,
                    inputs=[
                        self._config, self.model.topology, self.model.parameters, self.model.assets,
                        self.state.arrays, self._collision_scratch,
                    ],
                    outputs=[self.contacts.arrays],
                )
            )  # fmt: skip
        commands.append(self._launch(Operation.STEP, self._all_worlds, record=True))
        measuring = [part.record_after for part in self.elements if hasattr(part, "record_after")]
        return commands + [command for record in measuring for command in record(self, self._config.dt)]

    def _begin_sensors(self, mask: wp.array) -> None:
        """A frame of the present state, in worlds where somebody set it."""
        for sensor in self.sensors:
            sensor.begin(self, mask)

    def _sizes(self) -> Sizes:
        model, topology = self.model, self.model.topology
        rows_per_contact = 6 if model.has_rolling_friction else 3
        rows = model.bounded_count + rows_per_contact * model.contact_capacity
        dense = min(rows, self.solver.dense_rows)
        return Sizes(
            links=topology.link_count, slots=topology.slot_count, rows=topology.row_count, turns=model.turn_count,
            blocks=model.bounded_count + model.contact_capacity, cone_rows=rows, dense_rows=dense,
            factor_rows=dense if self._all_solvers else 0, entries=2 * model.path_length,
        )  # fmt: skip

    def _mask(self, world_mask: Any) -> wp.array:
        """The mask as a Warp array of bool on the model's device."""
        if world_mask is None:
            return self._all_worlds
        shape = (self.model.world_count,)
        kind = str(getattr(world_mask, "dtype", "")).lower()
        if isinstance(world_mask, wp.array):
            if world_mask.dtype != wp.bool:
                raise ModelError(f"world_mask must be of bool, got a Warp array of {world_mask.dtype.__name__}")
            mask = world_mask
        elif hasattr(world_mask, "data_ptr"):
            if "bool" not in kind:
                raise ModelError(f"world_mask must be of bool, got a tensor of {kind}; compare it first")
            mask = cast(wp.array, wp.from_torch(world_mask.contiguous(), dtype=wp.bool))
        else:
            values = np.asarray(world_mask)
            if values.dtype != np.bool_:
                raise ModelError(f"world_mask must be of bool, got {values.dtype}; it is no list of indices")
            mask = wp.array(values, dtype=wp.bool, device=self.model.device)
        if tuple(mask.shape) != shape:
            raise ModelError(f"world_mask must have shape {shape} (worlds), got {tuple(mask.shape)}")
        return mask

    def _values(self, name: str, values: Any, shape: tuple[int, int]) -> wp.array:
        """Coordinates or rates as a Warp array of float32 on the model's device; host values may broadcast."""
        if isinstance(values, wp.array) and values.dtype == wp.float32 and values.is_contiguous:
            array = values
        elif hasattr(values, "data_ptr"):
            array = cast(wp.array, wp.from_torch(values.detach().float().contiguous(), dtype=wp.float32))
        else:
            try:
                data = values.numpy() if isinstance(values, wp.array) else values
                data = np.broadcast_to(np.asarray(data, dtype=np.float32), shape)
            except (TypeError, ValueError) as error:
                raise ModelError(
                    f"set_joint_state: {name} must have shape {shape} (worlds, dofs), got {_shape_of(values)}"
                ) from error
            array = wp.array(np.ascontiguousarray(data), dtype=wp.float32, device=self.model.device)
        if tuple(array.shape) != shape:
            raise ModelError(f"set_joint_state: {name} must have shape {shape} (worlds, dofs), got {array.shape}")
        return array


def _named_apart(sensors: Sequence[Sensor]) -> tuple[Sensor, ...]:
    """The sensors, whose names are all different: their randomness hangs on them."""
    if not isinstance(sensors, (list, tuple)):
        if isinstance(sensors, Iterable) and not isinstance(sensors, (str, bytes, dict)):
            sensors = tuple(sensors)
        else:
            raise ModelError(f"Simulation: sensors must be a list, got {shown(sensors)}; write sensors=[...]")
    for sensor in sensors:
        known = all(hasattr(sensor, part) for part in ("name", "memory", "record", "begin"))
        if isinstance(sensor, type) or not known:
            raise ModelError(
                f"Simulation: sensors must be sensors, got {shown(sensor)} among them; make one first, such as "
                "Camera(scene, mount, config)"
            )
    names = [sensor.name for sensor in sensors]
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"Simulation: two sensors are called '{name}'; give one another name")
    return tuple(sensors)


def _choice(name: str, choices: type[IntEnum], value: Any) -> IntEnum:
    """The member of an enum that a lower-case string names."""
    names = [member.name.lower() for member in choices]
    if value not in names:
        raise ModelError(f"SolverOptions: {name} must be one of {', '.join(names)}, got {value!r}")
    return choices[value.upper()]


def _shape_of(values: Any) -> str:
    try:
        return str(np.shape(values.numpy() if isinstance(values, wp.array) else values))
    except ValueError:
        return repr(values)
