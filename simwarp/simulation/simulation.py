"""Simulation: it owns the arrays of a run, steps all worlds, resets some of them, and makes snapshots."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, NoReturn

import warp as wp

from simwarp.core.arrays import FixedAttributes, reinterpret_int32
from simwarp.core.constraints import Ge, Le, Meaning
from simwarp.core.memory import check_layouts
from simwarp.core.object_repr import Names, Readable, Row, plural
from simwarp.core.threads import thread_count
from simwarp.core.types import ModelError, formatted
from simwarp.core.warp_start import report_compiling
from simwarp.kernels.collision.contact_lists import make_lists
from simwarp.kernels.collision.placement import make_collision_scratch
from simwarp.kernels.core.layouts import run_layouts
from simwarp.kernels.core.tables import StepConfig, make_progress
from simwarp.kernels.dynamics.energy import measure_energy
from simwarp.kernels.dynamics.world import (
    assembly_kernels,
    copy_rows,
    copy_worlds,
    flag_worlds,
    make_scratch,
    measure_worlds,
)
from simwarp.model.checks import whole_number
from simwarp.model.effective_parameters import idle_changes
from simwarp.model.identity import run_parts
from simwarp.model.limit_order import coordinate_titles, crossed_limits
from simwarp.model.model import FEWER, Model
from simwarp.model.parameters import PARAMETERS, non_finite_parameters
from simwarp.model.rules import RULES, Flag, instance_of
from simwarp.simulation.attachments import (
    ForceElement,
    Sensor,
    attached,
    checked_elements,
    checked_sensors,
    recorded,
    recorded_or_none,
)
from simwarp.simulation.diagnostics import Diagnostics, explain_worlds
from simwarp.simulation.flexible_options import FlexibleOptions
from simwarp.simulation.joint_values import joint_values
from simwarp.simulation.mesh_places import MeshPlaces
from simwarp.simulation.read_interval import ReadInterval
from simwarp.simulation.readings import Readings, span_text
from simwarp.simulation.snapshot import Snapshot
from simwarp.simulation.solver_options import SolverOptions, check_contact_model, needs_all_solvers, step_config
from simwarp.simulation.stage_recording import record_collision, record_step
from simwarp.simulation.state import Contacts, Control, State, initial_arrays
from simwarp.simulation.state_check import StateCheck, StateFaults
from simwarp.simulation.step_program import StepProgram
from simwarp.simulation.step_sizes import (
    collision_sizes,
    list_sizes,
    scratch_slots_of,
    step_layouts,
    step_sizes,
)
from simwarp.simulation.step_times import SUBSTEP_LIMIT, checked_dt, checked_read_every, checked_steps
from simwarp.simulation.world_copies import (
    CopyPlan,
    WorldCopies,
    checked_sources,
    parameter_arrays,
    refuse_other,
    worlds_of,
)
from simwarp.simulation.world_launches import WorldLaunch, WorldShares, unshared
from simwarp.simulation.world_masks import mask_of_worlds

__all__ = ["Simulation", "Snapshot", "SolverOptions"]


class Simulation(Readable, Readings, FixedAttributes):
    """Steps `model.world_count` worlds together.

    It owns the arrays of a run: state, control, contacts, diagnostics, and scratch memory. A sub-step has these phases:

    1. force elements write their forces (`ForceElement.record`);
    2. collision finds the contacts, and the step moves the bodies (`stage_recording.py`);
    3. force elements measure (`record_after`, `record_shown`), and sensors follow on their clocks (`Sensor.record`).

    All launches are recorded when the Simulation is made; nothing is allocated or read back to the host in `step`.

    Args:
        model: from `ModelBuilder.finalize`.
        dt: time of one `step` call [s].
        substeps: equal parts that it is divided into.
        solver: see `SolverOptions`.
        flex: of rods and other flexible parts; see `FlexibleOptions`.
        joint_reactions: record the force and torque of every joint (`diagnostics.joint_reaction_force`).
        joint_accelerations: record the acceleration of every coordinate (`diagnostics.joint_qdd`).
        elements: force elements, such as a Vehicle's, launched before each sub-step. They, and the sensors, belong to
            this Simulation for good.
        sensors: cameras, inertial units and others of `simwarp.sensors`, launched after each sub-step.
        read_every: calls of `step` between two reads of the sensors' data; frames that nobody would see are not taken.
            With 1, every frame that is the latest after some `step` is there.
        check_start: warn (`InitialStateWarning`) of shapes of one mechanism that overlap as built and of coordinates
            that start outside their limits; False where another state is set before the first step.
        threads: of a CPU that share the worlds; None: `SIMWARP_THREADS`, else all that the process may use. Results are
            the same bits for any number. A GPU needs one.

    Raises:
        ModelError: dt, substeps or read_every is not usable, two sensors have the same name, or a force element or
            sensor cannot be part of this Simulation. None belongs to it then, and all may be used in another.
    """

    FIXED: ClassVar = (
        "model", "dt", "substeps", "solver", "flex", "read_every", "elements", "sensors", "state", "control",
        "contacts", "diagnostics", "memory", "identity", "shares", "read_interval",
    )  # fmt: skip

    @report_compiling()
    @RULES.arguments("Simulation")
    def __init__(
        self,
        model: Annotated[Model, instance_of(Model, "pass what finalize returned")],
        dt: float,
        *,
        substeps: Annotated[int, Ge(1), Le(SUBSTEP_LIMIT), Meaning("1, the default")] = 1,
        solver: Annotated[SolverOptions, instance_of(SolverOptions, "write SolverOptions(...)")] | None = None,
        flex: Annotated[FlexibleOptions, instance_of(FlexibleOptions, "write sw.flex.Options(...)")] | None = None,
        joint_reactions: Flag = False,
        joint_accelerations: Flag = False,
        elements: Sequence[ForceElement] = (),
        sensors: Sequence[Sensor] = (),
        read_every: int = 1,
        check_start: Flag = True,
        threads: int | None = None,
    ) -> None:
        self.model, self.substeps = model, substeps
        self.dt = checked_dt(dt, substeps)
        self.solver = solver or SolverOptions()
        check_contact_model(model, self.solver)
        self.flex = flex or FlexibleOptions()
        self.read_every = checked_read_every(read_every, substeps)
        reports = {"reactions": joint_reactions, "accelerations": joint_accelerations}
        self.elements = checked_elements(elements)
        self.sensors = checked_sensors(sensors)
        with attached((*self.elements, *self.sensors)):
            self._allocate(reports, threads)
            for sensor in self.sensors:  # all of them before one is recorded
                sensor.check(self, self._config.dt)
            with self.shares.recording_together():
                self._record()
            self._warn_of_unshared()
            self._state_check = StateCheck(model, self.state, self.contacts, self._config, self._colliding)
            if check_start:
                self._state_check.warn(stacklevel=4)
            self._begin_sensors(self._all_worlds)
        self._fix()

    def _record(self) -> None:
        """Records all launches. What is recorded before the first of them runs is compiled side by side."""
        model = self.model
        self._measuring = self.shares.record(
            measure_worlds, inputs=[self._all_worlds, model.topology, model.parameters, self._scratch],
            outputs=[self.state.arrays, self.contacts.arrays],
        )  # fmt: skip
        self._colliding = self._record_collision(self._config)
        self.physics_commands = self._record_physics(self._config, self._colliding)
        """Recorded launches of a sub-step; those of the sensors come after them."""
        self.sensor_commands = [recorded(sensor.record, self, self._config.dt) for sensor in self.sensors]
        """Those of each sensor in every sub-step."""
        self._showing = [command for part in self.elements for command in recorded(part.record_shown, self)]
        self.read_interval.sensors += [sensor.record_interval(self) for sensor in self.sensors]
        self._setting = self._record_setting()
        self._measuring_energy = [
            self.shares.record(
                measure_energy, inputs=[model.topology, model.parameters, self.state.arrays],
                outputs=[self.diagnostics.energy],
            )
        ]  # fmt: skip
        self.mesh_places = MeshPlaces(model, self.shares, self.state.arrays)
        self._measuring_energy += self.mesh_places.record_energy(self.diagnostics.energy)
        self._publishing = [
            command for part in self.elements for command in recorded(part.record_outputs, self, self._all_worlds)
        ]
        self._measuring.launch()
        self._resetting = self._record_reset()
        self._copies: WorldCopies | None = None
        self._program = self.program(())
        self.memory = (*self._element_memory, *(each for part in self.sensors for each in part.memory.values()))
        """State of force elements and sensors; `Snapshot.memory` holds a copy."""
        self.identity = model.identity.extended(run_parts(self.elements, self.sensors, self._config.dt))
        """Properties that a snapshot must have in common with this Simulation."""

    @property
    def time(self) -> wp.array:
        """(W,) float64 [s]: how long each world has run since its last reset."""
        return self.state.world_time

    def step(self, steps: int = 1) -> None:
        """Advances every world by `steps` times `dt`, each in `substeps` parts; frozen (non-finite) worlds stay.

        The state after `step(n)` is that after n calls of `step()`, bit by bit, and comes faster: threads meet once, at
        the end, and sensors need not be launched in between.

        Args:
            steps: how many, >= 0.

        Raises:
            ModelError: `steps` is no such number.
        """
        self._program.run(checked_steps(steps, self.substeps))

    def advance(self, steps: int) -> None:
        """Another name for `step(steps)`."""
        self.step(steps)

    def program(self, before: Sequence[WorldLaunch]) -> StepProgram:
        """A step with launches before it (`shares.record`), to be run many times over without Python in between."""
        parts = self.physics_commands, self._showing, self.sensor_commands
        return StepProgram(self.read_interval, self.shares, before, *parts, self.substeps)

    def reset(self, world_mask: Any = None, *, sensors: bool = True) -> None:
        """Puts the worlds of the mask (all when None) back to the model's initial state.

        Args:
            world_mask: (W,) bool, a Warp array, a torch tensor or anything NumPy reads.
            sensors: publish first frames, and a vehicle's outputs, now. Pass False where more of the state is set
                afterwards, and call `begin_sensors` then.
        """
        mask = self._mask("reset", world_mask)
        self._run_in(mask, self._resetting)
        if sensors:
            self._begin_sensors(mask)

    def begin_sensors(self, world_mask: Any = None) -> None:
        """Restarts the sensors' clocks in the worlds of the mask. Sensors publish a frame of the present state, and
        force elements their outputs.
        """
        self._begin_sensors(self._mask("begin_sensors", world_mask))

    def keep_as_initial(self) -> None:
        """Makes the present state, at time 0, the one that a reset brings back: that of a settled vehicle, say."""
        self._initial.copy_from(self.state)
        self._initial.world_time.zero_()
        for present, initial in self._initial_memory:
            wp.copy(initial, present)

    def set_joint_state(self, world_mask: Any, q: Any, qd: Any) -> None:
        """Sets coordinates and rates in the worlds of the mask: forward kinematics over the tree, then the loops
        are closed by Newton's method from there, and rates become consistent with them.

        Coordinates of joints that close loops only help to count turns. Floating bodies without a FREE joint stay.
        Worlds whose loops do not close get `WorldStatus.NOT_ASSEMBLED`. These worlds forget their contacts: forces of
        contacts are zero until the next step, which starts without their impulses.

        Args:
            world_mask: (W,) bool; all worlds when None.
            q: (W, dofs) [m or rad]; the present ones when None.
            qd: (W, dofs) [m/s or rad/s]; zeros when None.

        Raises:
            ModelError: shapes do not fit, or a value of the mask's worlds is not finite. Values on a GPU are not read
                back: there such worlds get `WorldStatus.NON_FINITE`, and are frozen until they are set again.
        """
        mask = self._mask("set_joint_state", world_mask)
        position = self.state.joint_q if q is None else self._values("q", q, mask)
        rate = self._no_rates if qd is None else self._values("qd", qd, mask)
        if rate.ptr == self.state.joint_qd.ptr and rate.size:  # written while it is read
            rate = wp.clone(rate)
        for command, first in self._setting:
            command.use(first, position)
            command.use(first + 1, rate)
        self._run_in(mask, [command for command, _ in self._setting])
        self._begin_sensors(mask)

    def measure(self, world_mask: Any = None, *, sensors: bool = True) -> None:
        """Publishes `body_q`, joint coordinates and a vehicle's outputs after a user wrote `body_x`, `body_rot` or
        velocities. Contacts are forgotten as in `set_joint_state`.

        `sensors`: as in `reset`.
        """
        mask = self._mask("measure", world_mask)
        self._run_in(mask, [self._measuring])
        if sensors:
            self._begin_sensors(mask)

    def measure_energy(self) -> wp.array:
        """`diagnostics.energy` of the present state: (W,) float64 [J], kinetic, of weights, joint springs and meshes.

        Positions are those of a step, velocities those half a step before: the sum swings with the motion
        (docs/integrators.md).
        """
        for command in self._measuring_energy:
            command.launch()
        return self.diagnostics.energy

    def problems(self) -> list[str]:
        """One line for each world that is in trouble: the fault and its remedy. Waits for the device."""
        model = self.model
        titles = coordinate_titles(model.joint_names, model.joint_dof_start)
        findings = [
            crossed_limits(model.joint_limit_lower, model.joint_limit_upper, titles, model.world_count),
            idle_changes(model, self.solver.contact_model),
            non_finite_parameters({name: getattr(model, name) for name in PARAMETERS}, model.world_count),
            {world: str(faults) for world, faults in self._state_check.by_world().items()},
            *(part.world_problems() for part in self.elements),
        ]
        return explain_worlds(
            model, self.state, self.contacts, self.diagnostics, self.solver.tolerance, findings=findings
        )  # fmt: skip

    def check_state(self, world: int = 0) -> StateFaults:
        """Shapes that overlap and coordinates outside their limits in the present state of a world. A step corrects
        them by moving the bodies (docs/theory.md). Waits for the device; nothing changes.

        Raises:
            ModelError: there is no such world.
        """
        most = self.model.world_count - 1
        return self._state_check.of(whole_number("check_state", "world", world, 0, most, "count from 0"))

    def snapshot(self, world: int | None = None) -> Snapshot:
        """A copy of the state and the control; restoring it and stepping repeats the run bit by bit.

        Args:
            world: the only one that is copied, to be restored into any worlds; None: all.

        Raises:
            ModelError: there is no such world, or the copy does not fit into memory.
        """
        if world is None:
            snapshot = self.empty_snapshot()
            for kept, present in zip(snapshot.arrays().values(), self._arrays(), strict=True):
                wp.copy(kept, present)
            return snapshot
        first = whole_number("snapshot", "world", world, 0, self.model.world_count - 1, "count from 0")
        elements, implicit = bool(self.elements), self.control.element_mass.shape[0] > 0
        parts = run_parts(self.elements, self.sensors, self._config.dt, share=self.model.world_count)
        snapshot = Snapshot.of_one_world(self.model, elements, implicit, self.memory, parts)
        snapshot.take(self._arrays(), first)
        return snapshot

    def empty_snapshot(self) -> Snapshot:
        """A snapshot that holds nothing yet, in the layout of this Simulation's."""
        return Snapshot.empty(
            self.model, elements=bool(self.elements), implicit=self.control.element_mass.shape[0] > 0,
            memory=self.memory, identity=self.identity,
        )  # fmt: skip

    def restore(self, snapshot: Snapshot, worlds: Any = None) -> None:
        """Brings back what `snapshot` held, in place: views and captured steps stay valid.

        It must be of a Simulation with the same `identity`: worlds, bodies, joints, couplings, shapes with their
        geometries, capacities, force elements and sensors. Parameters of the model and options of the solver may
        differ: they are not part of a snapshot. That of one world goes into as many as you like, of any Simulation that
        differs in the number of worlds alone.

        Args:
            snapshot: of all worlds, or of one.
            worlds: that get it, as indices or a (W,) bool mask; None: all. Others do not change by a bit.

        Raises:
            ModelError: it is that of another simulation; says what differs. Or there are no such worlds. Nothing has
                changed then.
        """
        if not isinstance(snapshot, Snapshot):
            raise ModelError(
                f"restore: snapshot must be a Snapshot, got {formatted(snapshot)}; pass what snapshot() made"
            )
        kept, spread = list(snapshot.arrays().values()), snapshot.world_count == 1 < self.model.world_count
        refuse_other("restore: the snapshot", self, snapshot.identity, kept, snapshot.world_count, same=not spread)
        if spread or worlds is not None:
            source: Any = 0 if spread else (worlds := worlds_of("restore", worlds, self.model))
            plan = checked_sources("restore", source, worlds, self.model, snapshot.world_count, name="worlds")
            self._copy("restore", plan, kept, snapshot.world_count)
        else:
            for target, each in zip(self._arrays(), kept, strict=True):
                wp.copy(target, each)
            self._run_in(self._all_worlds, self._publishing)
        self.read_interval.begin_from_clocks()

    @RULES.arguments("copy_worlds")
    def copy_worlds(
        self, source: Any, targets: Any = None, *, of: Simulation | None = None, parameters: Flag = True
    ) -> wp.array:
        """Makes worlds copies of others, on the device: state, control, contacts with their warm starts, memory of
        force elements and sensors, and parameters. They then go on alike, bit by bit; worlds that are not named do not
        change by a bit.

        Draws of noise that are still to come, and what a reset brings back, stay each world's own. For use while a
        graph is captured, call it once before, and give a mask on the device.

        Args:
            source: the world to be copied; or one for each target.
            targets: worlds that become copies, as indices, or as a (W,) bool mask (Warp, torch, NumPy); None: all. The
                source may be among them.
            of: Simulation that has the source; None: this one. It differs in the number of worlds alone, and in the
                values of what may differ per world.
            parameters: also copy what worlds have of their own in parameters of the model, force elements and sensors;
                what all worlds share stays as it is.

        Returns:
            (W,) int32: the world that each has become a copy of, -1 where it stayed; the same memory throughout.

        Raises:
            ModelError: a world does not exist, is named twice, or is both copied and overwritten; `of` is another
                Simulation, or on another device. Nothing has changed then.
        """
        call = "copy_worlds"
        origin = self if of is None else of
        if not isinstance(origin, Simulation):
            raise ModelError(f"{call}: of must be a Simulation, got {formatted(of)}; pass the one that has the source")
        same, count = origin is self, origin.model.world_count
        arrays = origin._arrays() + (parameter_arrays(origin) if parameters else [])
        if not same:
            refuse_other(f"{call}: of", self, origin.identity, arrays, count)
        plan = checked_sources(call, source, targets, self.model, count, same=same)
        copies = self._copy(call, plan, arrays, count, same=same)
        self.read_interval.begin_like(origin.read_interval)
        return copies.source_of

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a Simulation cannot be pickled or copied: it refers to memory of a device; build it again from the same "
            "ModelBuilder and bring its state over with snapshot().save(path) and Snapshot.load(path, simulation)"
        )

    def _readable_title(self) -> str:
        model, parts = self.model, f" in {self.substeps} sub-steps" if self.substeps > 1 else ""
        return f": {plural(model.world_count, 'world')} on {model.device}, dt = {self.dt:g} s{parts}"

    def _readable_rows(self) -> dict[str, Row]:
        model = self.model
        counts = {"body": model.body_count, "joint": model.joint_count, "dof": model.dof_count,
                  "shape": model.shape_count}  # fmt: skip
        return {
            "model": ", ".join(plural(count, thing) for thing, count in counts.items()),
            "solver": f"{self.solver.solver}, at most {plural(self.solver.max_iterations, 'iteration')}",
            "elements": Names(len(self.elements), (type(part).__name__ for part in self.elements)),
            "sensors": Names(len(self.sensors), (f"{each.name} ({type(each).__name__})" for each in self.sensors)),
            "threads": str(self.shares.threads) if self.shares.threads > 1 else "",
            "time": span_text(self.time, "s"),
        }

    # ---- inside --------------------------------------------------------------------------------------------------

    def _allocate(self, reports: Mapping[str, bool], threads: int | None) -> None:
        """The arrays of the run and of its steps, once it is known that they fit into the device's memory."""
        model, solver = self.model, self.solver
        self._all_solvers = needs_all_solvers(model, solver)
        self._sizes = step_sizes(model, solver.dense_rows, self._all_solvers)
        self._element_memory = [
            reinterpret_int32(array, model.world_count) for part in self.elements for array in part.memory.values()
        ]
        effects = {"elements": bool(self.elements), "implicit": any(part.implicit for part in self.elements)}
        self.shares = WorldShares(model.world_count, thread_count(threads), model.device)
        """Records launches whose worlds are shared among threads."""
        self.read_interval = ReadInterval(self.read_every * self.substeps, self.shares)
        """Where the sensors' clocks stand between two reads of their data."""
        slots = scratch_slots_of(self.shares)
        layouts = run_layouts(model.sizes(**effects, **reports))
        layouts |= step_layouts(model, self._sizes, slots, own_slots=self.shares.own_slots)
        copies = sum(4 * array.size for array in self._element_memory)
        check_layouts(f"Simulation: {model.world_count} worlds", layouts, model.device, FEWER, copies)
        self.control = Control(model, **effects)
        self.diagnostics = Diagnostics(model, **reports)
        self._config = step_config(solver, self.flex, self.dt / self.substeps, model.mass_ratio, **reports)
        self._all_worlds = wp.full(model.world_count, True, dtype=wp.bool, device=model.device)
        self._scratch = make_scratch(model.device, slots, self._sizes)
        self._progress = make_progress(model.device, model.world_count)
        self.contacts = Contacts(model)
        self._collision_scratch = make_collision_scratch(model.device, slots, collision_sizes(model))
        self._contact_lists = make_lists(model.device, slots, list_sizes(model, own_slots=self.shares.own_slots))
        self.state = initial_arrays(model)

    def physics_of(self, dt: float) -> list[WorldLaunch]:
        """Record the launches of a sub-step of another length [s], like `physics_commands`; run them by `shares.run`.

        Raises:
            ModelError: no step can have this length.
        """
        reports = {"reactions": bool(self._config.reactions), "accelerations": bool(self._config.accelerations)}
        config = step_config(self.solver, self.flex, checked_dt(dt, 1), self.model.mass_ratio, **reports)
        with self.shares.recording_together():
            return self._record_physics(config, self._record_collision(config))

    def _record_collision(self, config: StepConfig) -> list[WorldLaunch]:
        return record_collision(
            self.shares, self.model, config=config, state=self.state.arrays, contacts=self.contacts.arrays,
            scratch=self._collision_scratch, lists=self._contact_lists,
        )  # fmt: skip

    def _record_physics(self, config: StepConfig, colliding: Sequence[WorldLaunch]) -> list[Any]:
        """The launches of a sub-step, in order: forces of the elements, collision, step, what elements measure."""
        stepping = record_step(
            self.shares, self.model, rows=self._sizes.cone_rows, all_solvers=self._all_solvers,
            newton=self._sizes.factor_rows > 0,
            config=config, control=self.control.arrays, state=self.state.arrays, contacts=self.contacts.arrays,
            reports=self.diagnostics.arrays, scratch=self._scratch, progress=self._progress,
        )  # fmt: skip
        dt = config.dt
        before = [command for part in self.elements for command in recorded(part.record, self, dt)]
        after = [command for part in self.elements for command in recorded(part.record_after, self, dt)]
        return [*before, *colliding, *stepping, *after]

    def _record_reset(self) -> list[Any]:
        """Launches that bring the initial state, which is that of now, back in the worlds of the mask."""
        own: list[Any] = []
        copied: list[wp.array] = []
        for part in self.elements:
            launches = recorded_or_none(part.record_reset, self, self._all_worlds)
            if launches is None:
                copied += part.memory.values()
            else:
                own += launches
        self._initial = State(self.model)
        self._initial.copy_from(self.state)
        words = [reinterpret_int32(array, self.model.world_count) for array in copied]
        self._initial_memory = [(array, wp.clone(array)) for array in words]
        state = self.shares.record(
            copy_worlds,
            inputs=[self._all_worlds, self._initial.arrays],
            outputs=[self.state.arrays, self.contacts.arrays],
        )
        rows = [
            self.shares.record(copy_rows, inputs=[self._all_worlds, initial], outputs=[present])
            for present, initial in self._initial_memory
        ]
        return [state, *rows, *own]

    def _record_setting(self) -> list[tuple[WorldLaunch, int]]:
        """Launches that set worlds to coordinates and rates, each with the index of these inputs."""
        self._no_rates = wp.zeros_like(self.state.joint_qd)
        launches = [
            (self.shares.record(
                kernel,
                inputs=[
                    self._all_worlds, self._config, self.model.topology, self.model.parameters, self.control.arrays,
                    self.state.joint_q, self._no_rates, self._scratch,
                ],
                outputs=[self.state.arrays, self.contacts.arrays],
            ), 5)
            for kernel in assembly_kernels(self.model.topology.row_count)
        ]  # fmt: skip
        if not self.model.device.is_cuda:
            return launches
        flag = self.shares.record(
            flag_worlds, inputs=[self._all_worlds, self.state.joint_q, self._no_rates],
            outputs=[self.state.world_status],
        )  # fmt: skip
        return [*launches, (flag, 1)]

    def _warn_of_unshared(self) -> None:
        names = unshared([*self._program.every.commands, *self._showing])
        if names and self.shares.threads > 1:
            warnings.warn(
                f"Simulation: {', '.join(names)} will run on one of {self.shares.threads} threads, as wp.launch "
                "recorded it; record it with simulation.shares.record",
                stacklevel=4,
            )

    def _run_in(self, mask: wp.array, commands: Sequence[WorldLaunch]) -> None:
        """Launches for the worlds of a mask, which is the first input of each."""
        for command in commands:
            command.use(0, mask)
        self.shares.run(commands)

    def _begin_sensors(self, mask: wp.array) -> None:
        """Outputs of force elements and frames of the present state, in worlds where somebody set it."""
        self._run_in(mask, self._publishing)
        if mask is self._all_worlds:
            self.read_interval.begin_all()
        for sensor in self.sensors:
            sensor.begin(self, mask)

    def _arrays(self) -> list[wp.array]:
        """Arrays of a snapshot, in its order."""
        groups = (self.state, self.control, self.contacts)
        return [*(array for part in groups for array in part.in_files().values()), *self.memory]

    def _copy(
        self, call: str, plan: CopyPlan, arrays: Sequence[wp.array], worlds: int, *, same: bool = False
    ) -> WorldCopies:
        """Copies worlds of arrays of a snapshot, and of parameters, and publishes outputs of the copies."""
        if self._copies is None:
            self._copies = WorldCopies(self.shares, [*self._arrays(), *parameter_arrays(self)])
        self._copies.aim(call, plan, same=same)
        self._copies.run(arrays, worlds)
        self._run_in(self._copies.written, self._publishing)
        return self._copies

    def _mask(self, call: str, world_mask: Any) -> wp.array:
        """The mask as a Warp array of bool on the model's device; `call` is what errors name."""
        return self._all_worlds if world_mask is None else mask_of_worlds(call, world_mask, self.model)

    def _values(self, name: str, values: Any, mask: wp.array) -> wp.array:
        """Coordinates or rates as a Warp array on the model's device."""
        return joint_values(name, values, self.model, None if mask is self._all_worlds else mask)
