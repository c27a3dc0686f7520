"""Actuators at work: the part of a Simulation that turns controls into efforts and targets, in every world."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.actuators.actuator_spec import Activation, ActuatorSpec, Law, SitePull
from simwarp.actuators.actuators_kernels import (
    ActuatorParameters,
    ActuatorState,
    ActuatorTables,
    drive_actuators,
    map_actions,
)
from simwarp.core.array_devices import refuse_elsewhere
from simwarp.core.arrays import (
    ANY,
    NOT_NEGATIVE,
    POSITIVE,
    Domain,
    FixedAttributes,
    WritableArray,
    writable,
    writable_from,
)
from simwarp.core.constraints import Meaning, Positive
from simwarp.core.object_repr import Names, Row, plural
from simwarp.core.types import WORLD, DriveMode, ModelError, finite_vector, formatted, number
from simwarp.core.wording import suggestion
from simwarp.model.checks import (
    checked_instances,
    checked_name,
    checked_names,
    checked_pose,
    index_within,
    positive_number,
)
from simwarp.model.effort_routing import EffortRoute
from simwarp.model.model import Model
from simwarp.model.rules import INFINITE, RULES, held_fields, instance_of
from simwarp.simulation.attachments import ForceElement, StepContext


def checked_specs(model: Model, specs: Any) -> tuple[ActuatorSpec, ...]:
    """The actuators, all of which fit the model.

    Raises:
        ModelError: one does not, or two have a name or a drive in common.
    """
    kinds, remedy = "a list of ActuatorSpec", "write ActuatorSpec(name=..., terms=...)"
    listed = checked_instances("Actuators", "specs", specs, ActuatorSpec, kinds, remedy)
    names: set[str] = set()
    driven: dict[tuple[int, int], str] = {}
    for spec in listed:
        thing = checked_name("actuator", spec.name)
        if spec.name in names:
            raise ModelError(f"{thing}: the name is taken by another actuator; choose one of its own")
        names.add(spec.name)
        held_fields(thing, ActuatorSpec, vars(spec))
        _check_transmission(thing, spec, model)
        _check_laws(thing, spec)
        if spec.law is Law.SERVO:
            _check_servo(thing, spec, model)
            place = (spec.terms[0][0], int(spec.target))
            if place in driven:
                raise ModelError(
                    f"{thing}: a drive has one target, but actuator '{driven[place]}' writes it too; "
                    "give one of them Law.EFFORT"
                )
            driven[place] = spec.name
    return listed


def _check_transmission(thing: str, spec: ActuatorSpec, model: Model) -> None:
    """What it pulls on exists and can be moved."""
    if (spec.site is None) == (not spec.terms):
        given = "both" if spec.terms else "neither"
        raise ModelError(f"{thing}: give terms or a site, got {given}; an actuator pulls on one of them")
    if spec.site is not None:
        _check_site(thing, spec.site, model)
    for column, coefficient in spec.terms:
        if not 0 <= column < model.dof_count:
            raise ModelError(
                f"{thing}: column must be in 0..{model.dof_count - 1}, got {formatted(column)}; take model.dof(name)"
            )
        if coefficient == 0.0:
            raise ModelError(f"{thing}: coefficient must not be 0, got {formatted(coefficient)}; leave the term out")
        if model.effort_models[column].mode >= DriveMode.PRESCRIBED_POSITION:
            raise ModelError(
                f"{thing}: joint '{_joint_name(model, column)}' has a prescribed motion, which no force changes; "
                "leave out its drive"
            )


def _check_site(thing: str, site: SitePull, model: Model) -> None:
    ends: list[tuple[str, Any, int]] = [("body", site.body, 0 if site.reference is None else WORLD)]
    if site.reference is not None:
        ends.append(("reference", site.reference, WORLD))
    for role, body, least in ends:
        rule = f"site {role} must be a body index in 0..{model.body_count - 1}{' or WORLD' if least == WORLD else ''}"
        index_within(thing, rule, body, model.body_count, "take model.body(name)", least=least)
    if site.body == site.reference:
        raise ModelError(f"{thing}: site body and reference must differ, got {site.body} for both; leave one out")
    checked_pose(thing, site.pose)
    checked_pose(thing, site.reference_pose)
    if not finite_vector(thing, "site gear", site.gear, 6).any():
        raise ModelError(
            f"{thing}: site gear must not be zero throughout, got {formatted(site.gear)}; give a direction"
        )


def _check_laws(thing: str, spec: ActuatorSpec) -> None:
    """Fields that need each other."""
    if spec.activation in (Activation.FILTER, Activation.FILTER_EXACT):
        positive_number(thing, "time_constant", spec.time_constant, "s", "use Activation.NONE for no filter")
    if spec.activation_range is not None and not spec.has_activation:
        raise ModelError(f"{thing}: activation_range needs an activation, got Activation.NONE; leave the range out")
    if spec.torque_speed is None and spec.corner_speed != 0.0:
        raise ModelError(f"{thing}: corner_speed needs torque_speed, got None; give (stall force, free speed)")
    if spec.torque_speed is not None and spec.corner_speed >= spec.torque_speed[1]:
        free, corner = spec.torque_speed[1], spec.corner_speed
        raise ModelError(f"{thing}: corner_speed must be below the free speed {free:g}, got {corner:g}; lower it")


def _check_servo(thing: str, spec: ActuatorSpec, model: Model) -> None:
    """A servo hangs on the drive of one coordinate."""
    if len(spec.terms) != 1:
        raise ModelError(
            f"{thing}: a SERVO moves one coordinate, got {len(spec.terms)} terms; "
            "make their sum one with add_combination, or take Law.EFFORT"
        )
    if spec.torque_speed is not None:
        raise ModelError(f"{thing}: a SERVO has no torque_speed, its drive is implicit; take Law.EFFORT")
    column = spec.terms[0][0]
    effort = model.effort_models[column]
    if effort.mode is not DriveMode.POSITION or effort.path is EffortRoute.BODY_FORCE:
        raise ModelError(
            f"{thing}: a SERVO needs a PositionDrive on joint '{_joint_name(model, column)}'; "
            "give its coordinate drive=PositionDrive(stiffness=..., damping=...)"
        )
    upper, lower = (getattr(model, f"drive_effort_{end}").numpy()[0, column] for end in ("limit", "lower"))
    lower = -upper if lower > 0.0 else lower  # one that is positive stands for the other side's
    asked = None if spec.force_range is None else np.clip(spec.force_range, -1.0e30, 1.0e30)
    if asked is not None and not np.allclose(asked, np.clip((lower, upper), -1.0e30, 1.0e30), rtol=1e-6):
        raise ModelError(
            f"{thing}: the force_range of a SERVO is that of its drive, {_bounds_text(lower, upper)}, "
            f"got {spec.force_range}; give the PositionDrive this effort_limit"
        )


def _joint_name(model: Model, column: int) -> str:
    joint = int(np.searchsorted(model.joint_dof_start, column, side="right")) - 1
    return model.joint_names[joint]


def _bounds_text(lower: float, upper: float) -> str:
    return "which has none" if lower <= -1.0e30 and upper >= 1.0e30 else f"({lower:g}, {upper:g})"


PER_WORLD: Final = (
    "gain", "bias", "force_range", "time_constant", "delay", "stall_force", "free_speed", "corner_speed",
)  # fmt: skip
"""Arrays that may have a row for each world."""


class Actuators(ForceElement, FixedAttributes):
    """All actuators of a model, in every world: a `ForceElement`.

    Pass it to the Simulation: `Simulation(model, dt, elements=[actuators])`. It writes the entries of its coordinates
    and bodies in `Control.element_joint_force`, `element_force` and `element_torque`, and the targets of its servos;
    what the user writes into `joint_force` and `body_force` is added to them. No other force element may write the same
    entries.

    Args:
        model: that they move.
        specs: the actuators; their order is that of the columns.
        per_world: names of arrays with a row for each world, to be randomised (`PER_WORLD`).
        dt: time of a sub-step [s]: needed where a control is delayed, for the length of its line.

    Attributes:
        specs: the actuators.
        names: of the controls.
        ctrl: (W, A) float32 controls. Write them; a reset brings back what they were at construction, zero.
        activation: (W, A) float64 states between control and force.
        force: (W, A) float32 actuator forces of the last sub-step; of a servo, its law at the sub-step's start.
        gain, bias: (1 or W, A) vec3.
        force_range: (1 or W, A) vec2, 1e30 stands for no bound.
        time_constant: (1 or W, A) of filters [s].
        delay: (1 or W, A) of the control [s], at most as long as built.
        stall_force, free_speed, corner_speed: (1 or W, A) of `torque_speed`; a stall force of 1e30 stands for none.

    Raises:
        ModelError: an actuator does not fit the model; says which and why.
    """

    HOST_STATE: ClassVar[frozenset[str]] = frozenset({"_mapped"})
    """Attributes that no launch reads."""
    FIXED: ClassVar = ("ctrl", "activation", "force", *PER_WORLD)

    gain: WritableArray
    bias: WritableArray
    force_range: WritableArray
    time_constant: WritableArray
    delay: WritableArray
    stall_force: WritableArray
    free_speed: WritableArray
    corner_speed: WritableArray

    @RULES.arguments("Actuators")
    def __init__(
        self, model: Annotated[Model, instance_of(Model, "pass what finalize returned")],
        specs: Iterable[ActuatorSpec], *, per_world: Iterable[str] = (),
        dt: Annotated[Positive, Meaning("the time of a sub-step [s]")] | None = None,
    ) -> None:  # fmt: skip
        self.model = model
        self.specs = checked_specs(model, specs)
        self.names = tuple(spec.name for spec in self.specs)
        wanted = checked_names("Actuators", "per_world", per_world, PER_WORLD)
        self._dt = dt
        count, worlds, device = len(self.specs), model.world_count, model.device
        self.ctrl = writable((worlds, count), wp.float32, device, label="actuators.ctrl")
        self.activation = writable((worlds, count), wp.float64, device, label="actuators.activation")
        self.force = writable((worlds, count), wp.float32, device, label="actuators.force")
        self._line = wp.zeros((worlds, *_line_shape(self.specs, self._dt)), dtype=wp.float32, device=device)
        self._cursor = wp.zeros(worlds, dtype=wp.int32, device=device)
        self._tables: Any = _tables(self.specs, device)
        self._parameters: Any = ActuatorParameters()
        for name, (values, dtype, domain) in _parameter_values(self.specs).items():
            rows = np.repeat(values[None], worlds if name in wanted else 1, axis=0)
            hint = "" if name in wanted else f"all worlds share it: Actuators(per_world=('{name}',)) gives each its own"
            array = writable_from(rows, dtype, device, label=f"actuators.{name}", domain=domain, hint=hint)
            setattr(self, name, array)
            setattr(self._parameters, name, array)
        self._state = ActuatorState()
        kept = {"ctrl": self.ctrl, "activation": self.activation, "force": self.force}
        for name, each in {**kept, "line": self._line, "cursor": self._cursor}.items():
            setattr(self._state, name, each)
        self._given = wp.zeros((worlds, count), dtype=wp.float32, device=device)
        self._mapped: tuple[Any, ...] = ()
        self._mapping: Any = None
        if count:
            self._mapping = wp.launch(
                map_actions, dim=(worlds, count), device=device, record_cmd=True,
                inputs=[self._given, self._tables.ctrl_range, self.ctrl],
            )  # fmt: skip
        self._fix()

    def __len__(self) -> int:
        return len(self.specs)

    def column(self, name: str) -> int:
        """Column of an actuator by name.

        Raises:
            ModelError: there is none of this name.
        """
        if name not in self.names:
            hint = suggestion(name, self.names, f"there are {', '.join(self.names[:8]) or 'none'}")
            raise ModelError(f"Actuators: no actuator {formatted(name)}; {hint}")
        return self.names.index(name)

    def _readable_title(self) -> str:
        model = self.model
        return f": {plural(len(self.specs), 'actuator')}, {plural(model.world_count, 'world')} on {model.device}"

    def _readable_rows(self) -> dict[str, Row]:
        own = [name for name in PER_WORLD if getattr(self, name).shape[0] > 1]
        return {
            "controls": Names(len(self.specs), (f"{spec.name} ({spec.law.name.lower()})" for spec in self.specs)),
            "per world": Names(len(own), own),
        }

    @property
    def ctrl_range(self) -> npt.NDArray[np.float64]:
        """(A, 2) bounds of the controls, infinite where there are none."""
        return np.array([spec.bounds for spec in self.specs], np.float64).reshape(-1, 2)

    def set_from_action(self, action: Any) -> None:
        """Sets all controls from actions: -1 to 1 becomes the range of each control; one without bounds on both sides
        is the action itself.

        Args:
            action: (W, A) float32 tensor or Warp array on the model's device, which is read as it is, with nothing
                allocated and nothing waited for; or numbers of the host.

        Raises:
            ModelError: it has another shape or type, or is an array of another device: to move it in every step would
                wait each time.
        """
        shape = tuple(self.ctrl.shape)
        if isinstance(action, wp.array) or hasattr(action, "data_ptr"):
            refuse_elsewhere("set_from_action: action must", action, self.model.device)
            warps = isinstance(action, wp.array)
            source: Any = action if warps else wp.from_torch(action.detach(), requires_grad=False)
        else:
            self.ctrl[...] = action  # checks what it gets
            wp.copy(self._given, self.ctrl)
            source = self._given
        if tuple(source.shape) != shape or source.dtype != wp.float32:
            kind = f"{source.dtype.__name__}{tuple(source.shape)}"
            remedy = "reshape" if source.dtype == wp.float32 else "convert it to float32"
            raise ModelError(
                f"set_from_action: action must be float32{shape} (worlds, actuators), got {kind}; {remedy}"
            )
        if self._mapping is None:
            return
        memory = (source.ptr, source.strides)
        if memory != self._mapped:
            self._mapping.set_param_at_index(0, source)
            self._mapped = memory
        self._mapping.launch()

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a reset restores and a snapshot keeps."""
        arrays: dict[str, wp.array] = {"ctrl": self.ctrl}
        if any(spec.has_activation for spec in self.specs):
            arrays["activation"] = self.activation
        if self._line.size:
            arrays |= {"line": self._line, "cursor": self._cursor}
        return {name: array for name, array in arrays.items() if array.size}

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers of the actuators: `PER_WORLD`."""
        return {name: getattr(self, name) for name in PER_WORLD}

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch of one sub-step.

        Raises:
            ModelError: the Simulation is of another model, has another sub-step than the delays, or other actuators on
                the same coordinates or bodies.
        """
        if simulation.model is not self.model:
            raise ModelError("Actuators: they are of another model than the Simulation; make them of its own")
        if self._line.size and self._dt is not None and abs(dt - self._dt) > 1.0e-6 * dt:
            raise ModelError(
                f"Actuators: delays were laid out for sub-steps of {self._dt:g} s, the Simulation has {dt:g} s; "
                f"pass Actuators(dt={dt:g})"
            )
        for other in simulation.elements:
            if isinstance(other, Actuators) and other is not self and self._shares_entries(other):
                raise ModelError(
                    "Actuators: two of them write the same coordinates or bodies; pass all specs to one Actuators"
                )
        if not self.specs:
            return []
        model, control, state = simulation.model, simulation.control.arrays, simulation.state.arrays
        inputs = [dt, self._tables, self._parameters, model.parameters, state, self._state]
        return [simulation.shares.record(drive_actuators, inputs=inputs, outputs=[control])]

    @property
    def assigned_bodies(self) -> tuple[int, ...]:
        """Bodies whose forces they write."""
        return tuple(sorted(_entries(self.specs)[1]))

    def _shares_entries(self, other: Actuators) -> bool:
        """True where two of them write the same entries of `Control`."""
        (dofs, bodies, targets), theirs = _entries(self.specs), _entries(other.specs)
        return bool(dofs & theirs[0] or bodies & theirs[1] or targets & theirs[2])


def _entries(specs: Sequence[ActuatorSpec]) -> tuple[set[int], set[int], set[tuple[int, int]]]:
    """Coordinates, bodies, and targets of coordinates that actuators write."""
    dofs = {int(dof) for spec in specs if spec.law is Law.EFFORT for dof, _ in spec.terms}
    targets = {(int(spec.terms[0][0]), int(spec.target)) for spec in specs if spec.law is Law.SERVO}
    sites = [spec.site for spec in specs if spec.site is not None]
    bodies = {body for site in sites for body in (site.body, site.reference) if body is not None and body != WORLD}
    return dofs, bodies, targets


def _line_shape(specs: Sequence[ActuatorSpec], dt: float | None) -> tuple[int, int]:
    """Delayed controls, and samples that a line keeps."""
    delays = [number(spec.delay) for spec in specs if spec.delay > 0.0]
    if not delays:
        return 0, 1
    if dt is None:
        name = next(spec.name for spec in specs if spec.delay > 0.0)
        raise ModelError(
            f"actuator '{name}': a delay needs the time of a sub-step, got None; pass Actuators(dt=...), "
            "the Simulation's dt / substeps"
        )
    # As the kernel rounds: half a sub-step counts as a whole one
    return len(delays), math.floor(max(delays) / dt + 0.5) + 1


def _bounds(pair: tuple[float, float] | None) -> tuple[float, float]:
    lower, upper = pair or (-math.inf, math.inf)
    return max(lower, -INFINITE), min(upper, INFINITE)


def _parameter_values(
    specs: Sequence[ActuatorSpec],
) -> dict[str, tuple[npt.NDArray[np.float64], Any, Domain]]:
    """Values of one world, type and domain of the arrays that may differ per world."""

    def column(read: Callable[[ActuatorSpec], Any], *shape: int) -> npt.NDArray[np.float64]:
        return np.array([read(spec) for spec in specs], np.float64).reshape(len(specs), *shape)

    def motor(spec: ActuatorSpec) -> tuple[float, float]:
        return spec.torque_speed or (INFINITE, INFINITE)

    delay = column(lambda spec: spec.delay)
    most = np.float32(delay.max(initial=0.0)) * (delay > 0.0)  # as the array holds it
    longest = Domain(0.0, most, "build the actuators with the longest delay")
    corner = column(lambda spec: spec.corner_speed)
    return {
        "gain": (column(lambda spec: spec.gain, 3), wp.vec3, ANY),
        "bias": (column(lambda spec: spec.bias, 3), wp.vec3, ANY),
        "force_range": (column(lambda spec: _bounds(spec.force_range), 2), wp.vec2, ANY),
        # where there is no filter it has no effect
        "time_constant": (column(lambda spec: spec.time_constant or 1.0), wp.float32, POSITIVE),
        "delay": (delay, wp.float32, longest),
        "stall_force": (column(lambda spec: motor(spec)[0]), wp.float32, NOT_NEGATIVE),
        "free_speed": (column(lambda spec: motor(spec)[1]), wp.float32, POSITIVE),
        "corner_speed": (corner, wp.float32, NOT_NEGATIVE),
    }


def _tables(specs: Sequence[ActuatorSpec], device: Any) -> ActuatorTables:
    """Constants on the model's device."""

    def make(values: Any, dtype: Any, *shape: int) -> Any:
        kind = wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype))
        return wp.array(np.array(values, kind).reshape(-1, *shape), dtype=dtype, device=device)

    table = ActuatorTables()
    for name in ("law", "target", "activation", "early"):
        setattr(table, name, make([int(getattr(spec, name)) for spec in specs], wp.int32))
    table.ctrl_range = make([_bounds(spec.ctrl_range) for spec in specs], wp.vec2, 2)
    table.activation_range = make([_bounds(spec.activation_range) for spec in specs], wp.vec2, 2)
    table.length_offset = make([spec.length_offset for spec in specs], wp.float32)
    delayed = [index for index, spec in enumerate(specs) if spec.delay > 0.0]
    table.line = make([delayed.index(k) if k in delayed else -1 for k in range(len(specs))], wp.int32)
    table.term_start = make(np.cumsum([0, *(len(spec.terms) for spec in specs)]), wp.int32)
    table.term_dof = make([dof for spec in specs for dof, _ in spec.terms], wp.int32)
    table.term_coefficient = make([factor for spec in specs for _, factor in spec.terms], wp.float32)
    sites = [spec.site for spec in specs if spec.site is not None]
    order = iter(range(len(sites)))
    table.site = make([-1 if spec.site is None else next(order) for spec in specs], wp.int32)
    dofs, bodies, _ = _entries(specs)
    table.own_dof, table.own_body = make(sorted(dofs), wp.int32), make(sorted(bodies), wp.int32)
    _fill_sites(table, sites, make)
    return table


def _fill_sites(table: ActuatorTables, sites: Sequence[SitePull], make: Callable[..., Any]) -> None:
    """Frames, gears and references."""
    table.site_body = make([site.body for site in sites], wp.int32)
    table.site_x = make([site.pose.position for site in sites], wp.vec3d, 3)
    table.site_rot = make([site.pose.rotation for site in sites], wp.quatd, 4)
    table.site_force = make([site.gear[:3] for site in sites], wp.vec3, 3)
    table.site_torque = make([site.gear[3:] for site in sites], wp.vec3, 3)
    table.referred = make([site.reference is not None for site in sites], wp.int32)
    table.reference_body = make([WORLD if site.reference is None else site.reference for site in sites], wp.int32)
    table.reference_x = make([site.reference_pose.position for site in sites], wp.vec3d, 3)
    table.reference_rot = make([site.reference_pose.rotation for site in sites], wp.quatd, 4)
