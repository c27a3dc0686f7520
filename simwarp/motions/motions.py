"""Motion functions at work: a force element that drives coordinates, bodies and inputs by functions of time."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Final, TypeAlias

import numpy as np
import warp as wp

from simwarp.core.array_devices import refuse_elsewhere
from simwarp.core.arrays import ANY, FixedAttributes, WritableArray, writable_from
from simwarp.core.object_repr import Names, Row, plural
from simwarp.core.types import DriveMode, ModelError, Vec3, formatted
from simwarp.core.wording import suggestion
from simwarp.model.checks import checked_instances, whole_number
from simwarp.model.effort_routing import EffortRoute
from simwarp.model.model import Model
from simwarp.model.rules import RULES, Configuration, Flag, Name, instance_of, vector
from simwarp.motions.motion_functions import FunctionField, MotionFunction, Smoothness
from simwarp.motions.motion_tape import TapeWriter
from simwarp.motions.motions_kernels import MotionTables, drive_motions, publish_motions, write_signal
from simwarp.simulation.attachments import ForceElement, StepContext

NEEDED: Final = {DriveMode.PRESCRIBED_POSITION: Smoothness.RATE, DriveMode.PRESCRIBED_SPEED: Smoothness.VALUE}
"""Without which a prescribed motion takes infinite forces."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class JointMotion(Configuration):
    """Moves a coordinate by its drive: a prescribed position or speed without a table, or the target of a
    `PositionDrive` or `VelocityMotor` [m or rad, or per s].

    A prescribed position follows the function exactly, at every sub-step; a prescribed speed and the targets of drives
    are those of the sub-step's end.

    Attributes:
        joint: its name.
        function: of time. A prescribed position needs a continuous rate, a prescribed speed a continuous value.
        coordinate: of the joint, from 0.
    """

    joint: Name
    function: FunctionField
    coordinate: int = 0


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class JointForce(Configuration):
    """A force along a coordinate, as it is at the sub-step's start [N or N·m].

    Attributes:
        joint: its name.
        function: of time.
        coordinate: of the joint, from 0.
    """

    joint: Name
    function: FunctionField
    coordinate: int = 0


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class BodyWrench(Configuration):
    """A force and a torque on a body, each a vector times the function, as they are at the sub-step's start.

    Attributes:
        body: its name.
        function: of time.
        force: [N] per unit of the function.
        torque: [N·m] per unit of the function.
        point: where the force acts, from the body's centre of mass, body axes [m].
        turning: the vectors are in body axes, and turn with it; otherwise in world axes.
    """

    body: Name
    function: FunctionField
    force: Annotated[Vec3, vector(3)] = (0.0, 0.0, 0.0)
    torque: Annotated[Vec3, vector(3)] = (0.0, 0.0, 0.0)
    point: Annotated[Vec3, vector(3)] = (0.0, 0.0, 0.0)
    turning: Flag = False

    def check(self) -> None:
        """It acts.

        Raises:
            ModelError: force and torque are zero.
        """
        if not np.any(self.force) and not np.any(self.torque):
            raise ModelError(
                f"BodyWrench on body '{self.body}': force and torque must not both be zero; give a direction"
            )


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class InputSignal(Configuration):
    """Values in a column of an array, as they are at the sub-step's start: of a vehicle's or the actuators' inputs.

    Attributes:
        array: (W, n) float32, such as `vehicle.input` or `actuators.ctrl`.
        function: of time.
        column: of the array.
        name: for messages and the names of numbers.
    """

    array: Annotated[wp.array, instance_of(wp.array, "pass vehicle.input or actuators.ctrl")]
    function: FunctionField
    column: int
    name: Name = "input"


Motion: TypeAlias = JointMotion | JointForce | BodyWrench | InputSignal


class Motions(ForceElement, FixedAttributes):
    """Motion functions of all worlds at work: a `ForceElement`.

    Pass it to the Simulation, before the vehicle or the actuators whose inputs it writes:
    `Simulation(model, dt, elements=[motions, vehicle])`. Before every sub-step it evaluates all functions at the time
    of each world, which a reset sets to 0, and writes targets of drives, forces and inputs. No other force element may
    write the same ones; forces on bodies are added to those of elements before it. It has no state: what it writes
    follows from the time.

    Args:
        model: that they move.
        motions: what follows which function.
        per_world: the numbers of all functions have a row for each world, to be randomised, even if they are equal.

    Attributes:
        motions: as given.
        numbers: (1 or W, N) float64 numbers of all functions [units of each], in the order of `number_names`. Write
            those that have a name; a duration or a period must stay positive.
        number_names: of the columns, such as "slider.amplitude" or "slider.parts[1].rate"; empty for coefficients.

    Raises:
        ModelError: a motion does not fit the model; says which and why.
    """

    FIXED: ClassVar = ("motions", "numbers", "number_names")

    numbers: WritableArray

    @RULES.arguments("Motions")
    def __init__(
        self, model: Annotated[Model, instance_of(Model, "pass what finalize returned")], motions: Iterable[Motion],
        *, per_world: Flag = False,
    ) -> None:  # fmt: skip
        self.model = model
        kinds = "a list of motions"
        self.motions: tuple[Motion, ...] = checked_instances(
            "Motions", "motions", motions, Motion, kinds, "write JointMotion(joint=..., function=...)"
        )
        worlds, device = model.world_count, model.device
        self._bodies: dict[int, int] = {}
        writer = TapeWriter(worlds)
        starts = []
        for motion in self.motions:
            starts.append(writer.function(functools.partial(motion.function.write, name=_label(motion))))
        self._tape = writer.tape(device, worlds, rows=worlds if per_world else None)
        self.number_names = tuple(writer.names)
        hint = "" if self._tape.numbers.shape[0] == worlds else "all worlds share them: Motions(per_world=True)"
        self.numbers = writable_from(
            self._tape.numbers.numpy(), wp.float64, device, label="motions.numbers", domain=ANY, hint=hint
        )
        self._tape.numbers = self.numbers
        self._tables = self._motion_tables(starts, device)
        self._check_doubles()
        self._fix()

    def __len__(self) -> int:
        return len(self.motions)

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers of the functions."""
        return {"numbers": self.numbers}

    def number(self, name: str) -> int:
        """Column of `numbers` by name.

        Raises:
            ModelError: there is none of this name.
        """
        if not name or name not in self.number_names:
            known = [each for each in self.number_names if each]
            hint = suggestion(name, known, f"there are {', '.join(known[:8]) or 'none'}")
            raise ModelError(f"Motions: no number {formatted(name)}; {hint}")
        return self.number_names.index(name)

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launches of one sub-step.

        Raises:
            ModelError: the Simulation is of another model, or an element behind it writes forces on the same bodies.
        """
        if simulation.model is not self.model:
            raise ModelError("Motions: they are of another model than the Simulation; make them of its own")
        self._dt = dt
        if not self.motions:
            return []
        self._share_bodies(simulation)
        state, record = simulation.state.arrays, simulation.shares.record
        signals = [
            record(write_signal, inputs=[k, each.column, self._tables, self._tape, state], outputs=[each.array])
            for k, each in enumerate(self.motions)
            if isinstance(each, InputSignal)
        ]
        inputs = [dt, self._tables, self._tape, state]
        return [record(drive_motions, inputs=inputs, outputs=[simulation.control.arrays]), *signals]

    def record_outputs(self, simulation: StepContext, mask: wp.array[wp.bool]) -> Sequence[Any]:
        """The launch that writes targets where the state was set."""
        if not self.motions:
            return []
        inputs = [mask, self._dt, self._tables, self._tape, simulation.state.arrays]
        return [simulation.shares.record(publish_motions, inputs=inputs, outputs=[simulation.control.arrays])]

    @property
    def assigned_bodies(self) -> tuple[int, ...]:
        """Bodies whose forces they write."""
        return tuple(sorted({self.model.body(each.body) for each in self.motions if isinstance(each, BodyWrench)}))

    def _readable_title(self) -> str:
        model = self.model
        return f": {plural(len(self.motions), 'function')}, {plural(model.world_count, 'world')} on {model.device}"

    def _readable_rows(self) -> dict[str, Row]:
        return {
            "motions": Names(
                len(self.motions), (f"{_label(each)} ({type(each.function).__name__})" for each in self.motions)
            ),
            "per world": "all numbers" if self.numbers.shape[0] > 1 else "",
        }  # fmt: skip

    def _motion_tables(self, starts: Sequence[int], device: Any) -> Any:
        """Constants on the model's device."""
        targets = [_checked_target(self.model, motion) for motion in self.motions]
        wrenches = [motion if isinstance(motion, BodyWrench) else None for motion in self.motions]

        def make(values: Any, dtype: Any = wp.int32, *shape: int) -> Any:
            kind = wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype))
            return wp.array(np.array(values, kind).reshape(-1, *shape), dtype=dtype, device=device)

        def vectors(read: Callable[[BodyWrench], Any]) -> Any:
            return make([(0.0,) * 3 if each is None else read(each) for each in wrenches], wp.vec3, 3)

        tables = MotionTables()
        tables.start = make(starts)
        tables.dof = make([dof for dof, _ in targets])
        tables.mode = make([int(mode) for _, mode in targets])
        tables.body = make([-1 if each is None else self.model.body(each.body) for each in wrenches])
        tables.force = vectors(lambda each: each.force)
        tables.torque = vectors(lambda each: each.torque)
        tables.point = vectors(lambda each: each.point)
        tables.turning = make([int(each is not None and each.turning) for each in wrenches])
        tables.own_dof = make(sorted({dof for dof, mode in targets if dof >= 0 and mode is DriveMode.NONE}))
        tables.own_body = make(self.assigned_bodies)
        return tables

    def _share_bodies(self, simulation: StepContext) -> None:
        """Bodies that elements before this one write keep what those wrote."""
        place = next(k for k, each in enumerate(simulation.elements) if each is self)
        for other in simulation.elements[place + 1 :]:
            for body in sorted(set(other.assigned_bodies) & set(self.assigned_bodies)):
                if not isinstance(other, Motions):
                    raise ModelError(
                        f"Motions: forces on body '{self.model.body_names[body]}' must be written after those of "
                        f"{type(other).__name__}; name Motions behind it in elements"
                    )
        before = {body for each in simulation.elements[:place] for body in each.assigned_bodies}
        own = [body for body in self.assigned_bodies if body not in before]
        self._tables.own_body = wp.array(own, dtype=wp.int32, device=self.model.device)

    def _check_doubles(self) -> None:
        """Two functions do not drive one coordinate or input."""
        driven: set[Any] = set()
        for motion in self.motions:
            place: Any = None
            if isinstance(motion, JointMotion):
                place = self.model.dof(motion.joint, motion.coordinate)
            elif isinstance(motion, InputSignal):
                place = (motion.array.ptr, motion.column)
            if place is not None and place in driven:
                raise ModelError(f"{_title(motion)}: has two functions; add them, function + function")
            driven.add(place)


def _label(motion: Motion) -> str:
    """Short name of what moves."""
    if isinstance(motion, JointMotion | JointForce):
        return motion.joint if motion.coordinate == 0 else f"{motion.joint}[{motion.coordinate}]"
    return motion.body if isinstance(motion, BodyWrench) else motion.name


def _title(motion: Motion) -> str:
    """What an error begins with."""
    place = motion.joint if isinstance(motion, JointMotion | JointForce) else _label(motion)
    kind = "joint " if isinstance(motion, JointMotion | JointForce) else ""
    kind = "body " if isinstance(motion, BodyWrench) else kind
    return f"{type(motion).__name__} of {kind}'{place}'"


def _checked_target(model: Model, motion: Motion) -> tuple[int, DriveMode]:
    """The coordinate and its drive, NONE for a force; -1 for a motion of no coordinate.

    Raises:
        ModelError: there is none of this name, or it cannot follow this function.
    """
    thing = _title(motion)
    if isinstance(motion, BodyWrench):
        return -1, DriveMode.NONE
    if isinstance(motion, InputSignal):
        refuse_elsewhere(f"{thing}: array must", motion.array, model.device)
        shape = tuple(motion.array.shape)
        if len(shape) != 2 or shape[0] != model.world_count or motion.array.dtype != wp.float32:
            got = f"{motion.array.dtype.__name__}{shape}"
            raise ModelError(
                f"{thing}: array must be float32({model.world_count}, n), got {got}; pass one for each world"
            )
        whole_number(thing, "column", motion.column, 0, shape[1] - 1, "count from 0")
        return -1, DriveMode.NONE
    dof = model.dof(motion.joint, motion.coordinate)
    effort = model.effort_models[dof]
    if isinstance(motion, JointForce):
        if effort.mode >= DriveMode.PRESCRIBED_POSITION:
            raise ModelError(f"{thing}: its motion is prescribed, which no force changes; take JointMotion")
        return dof, DriveMode.NONE
    if effort.mode is DriveMode.NONE or effort.path is EffortRoute.BODY_FORCE:
        raise ModelError(
            f"{thing}: its coordinate must have a drive; give the joint drive=PrescribedPosition(), or take JointForce"
        )
    tables: Any = model.topology.dof_table
    if tables.numpy()[dof, 2] >= 0:
        raise ModelError(f"{thing}: its drive follows a table; leave the table out")
    _check_smoothness(thing, motion.function, effort.mode)
    return dof, effort.mode


def _check_smoothness(thing: str, function: MotionFunction, mode: DriveMode) -> None:
    needed = NEEDED.get(mode, Smoothness.JUMPS)
    found = function.smoothness
    if found < needed:
        what = ("value", "rate")[found]
        wants = {
            Smoothness.RATE: "a second derivative, hence a continuous rate",
            Smoothness.VALUE: "a continuous value",
        }
        motion = "position" if mode is DriveMode.PRESCRIBED_POSITION else "speed"
        raise ModelError(
            f"{thing}: a prescribed {motion} needs a function with {wants[needed]}, "
            f"got {type(function).__name__} whose {what} jumps; "
            "take CubicSpline or Polynomial345, or drive it by a PositionDrive"
        )
