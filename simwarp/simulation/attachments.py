"""Base classes of force elements, which act before a sub-step, and of sensors, which follow it, and what both see.

Force elements, such as tires and engines, act on bodies and joints, with states of their own: they read the state and
write `Control.element_force`, `element_torque` and `element_joint_force`, each its own entries. One that adds to those
of elements before it, as soil does, finds theirs in `assigned_bodies`. Sensors measure; they are in `simwarp.sensors`.
"""

from __future__ import annotations

import abc
import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Final, Protocol

import warp as wp

from simwarp.core.object_repr import Readable
from simwarp.core.types import ModelError, formatted
from simwarp.core.wording import close_names
from simwarp.model.checks import checked_instances
from simwarp.model.model import Model
from simwarp.simulation.diagnostics import Diagnostics
from simwarp.simulation.state import Contacts, Control, State
from simwarp.simulation.world_launches import WorldShares

if TYPE_CHECKING:
    from simwarp.simulation.read_interval import IntervalLaunches, ReadInterval

NEAR: Final = 0.9
"""Likeness from which on a name counts as a mistyped hook (`difflib`): about one letter of six."""


class StepContext(Protocol):
    """What force elements and sensors see of their Simulation.

    Attributes:
        model, state, control, contacts, diagnostics: those of the Simulation.
        shares: records launches whose worlds are shared among threads.
        read_interval: where the sensors' clocks stand between two reads of their data.
        elements: all force elements, in the order of their launches.
        substeps: sub-steps of one step.
        read_every: steps between two reads of the sensors' data.
    """

    model: Model
    state: State
    control: Control
    contacts: Contacts
    diagnostics: Diagnostics
    shares: WorldShares
    read_interval: ReadInterval
    elements: tuple[ForceElement, ...]
    substeps: int
    read_every: int


class ForceElement(Readable):
    """Base of what applies forces in every sub-step. A subclass overrides the hooks it needs; others do nothing.

    The Simulation asks for launches once, when it is built, and repeats them. A force element belongs to one Simulation
    for good, whose state it holds: another Simulation needs another element.

    Attributes:
        implicit: True for a class that also writes `Control.element_mass`, `element_coupling` and `element_inertia` of
            its bodies.

    Raises:
        ModelError: a subclass has a name that is nearly that of a hook.
    """

    implicit: ClassVar[bool] = False
    _attached = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        _refuse_mistyped_hooks(cls, ForceElement)

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that outlives a step, by name: contiguous arrays (W, ...) of four or eight bytes per number. A reset
        brings back what they held at construction; a snapshot keeps them.
        """
        return {}

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers that may differ by world, by name: contiguous arrays (1 or W, ...). A copy of a world takes them
        along; resets and snapshots leave them alone.
        """
        return {}

    @property
    def assigned_bodies(self) -> tuple[int, ...]:
        """Indices of the bodies whose `element_force` and `element_torque` it writes anew in every sub-step."""
        return ()

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Recorded launches (`simulation.shares.record`) that come before each sub-step.

        Those of `wp.launch(..., record_cmd=True)` will do, but run on one thread.

        Args:
            simulation: the element's Simulation.
            dt: of a sub-step [s].
        """
        return ()

    def record_after(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Recorded launches that follow each sub-step of `dt` [s]: of an element that also measures."""
        return ()

    def record_shown(self, simulation: StepContext) -> Sequence[Any]:
        """Recorded launches that publish what no sub-step needs: what sensors and whoever reads between steps see, such
        as poses of bodies that are posed. They come before the sensors that are launched, and once behind the last
        sub-step of `Simulation.step(n)`. What they publish follows from the present state.
        """
        return ()

    def record_outputs(self, simulation: StepContext, mask: wp.array[wp.bool]) -> Sequence[Any]:
        """Recorded launches that publish outputs of the present state. They run at construction, and whenever the state
        of worlds is set.

        Args:
            simulation: the element's Simulation.
            mask: (W,) bool, the first input of each launch.
        """
        return ()

    def record_reset(self, simulation: StepContext, mask: wp.array[wp.bool]) -> Sequence[Any] | None:
        """Recorded launches that reset the worlds of the (W,) mask, the first input of each; None: the Simulation
        brings `memory` back.
        """
        return None

    def world_problems(self) -> Mapping[int, str]:
        """Faults by world, in a line with the remedy each, for `Simulation.problems`: such as memory that ran out."""
        return {}


class Sensor(Readable, abc.ABC):
    """Base of what measures every world on a clock of its own, inside the step. A subclass has `name`, `data`,
    `timestamp` and `valid`, and overrides the hooks it needs; others do nothing.

    A Simulation calls `check` of all sensors, then `record` of each once. It launches what that returned after each
    sub-step, and calls `begin` at construction and whenever somebody sets the state of worlds: `reset`,
    `set_joint_state` and `measure`. A sensor belongs to one Simulation for good.

    Attributes:
        name: unique among the sensors of a Simulation.

    Raises:
        ModelError: a subclass has a name that is nearly that of a hook.
    """

    name: str = ""
    _attached = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        _refuse_mistyped_hooks(cls, Sensor)

    @property
    @abc.abstractmethod
    def data(self) -> wp.array:
        """(W, ...) the latest frame that is published; the same memory throughout."""

    @property
    @abc.abstractmethod
    def timestamp(self) -> wp.array:
        """(W,) float64 [s]: the world's time when that frame was complete."""

    @property
    @abc.abstractmethod
    def valid(self) -> wp.array:
        """(W,) bool: false in worlds that are frozen (`WorldStatus.NON_FINITE`)."""

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """Everything that outlives a sub-step, by name: contiguous arrays (W, ...) or (W·slots, ...), part of
        snapshots. A reset leaves it to `begin`.
        """
        return {}

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers that may differ by world, by name: contiguous arrays (1 or W, ...). A copy of a world takes them
        along; resets and snapshots leave them alone.
        """
        return {}

    def check(self, simulation: StepContext, dt: float) -> None:
        """Raises a ModelError where the sensor cannot be part of the Simulation with sub-steps of `dt` [s], and changes
        nothing.
        """

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Recorded launches (`simulation.shares.record`) that follow each sub-step, as those of a `ForceElement`.

        Args:
            simulation: the sensor's Simulation.
            dt: of a sub-step [s].
        """
        return ()

    def record_interval(self, simulation: StepContext) -> IntervalLaunches | None:
        """The launches that are due in each sub-step between two reads of the data; None: those of `record` in every
        sub-step. Called after `record`.
        """
        return None

    def begin(self, simulation: StepContext, mask: wp.array[wp.bool]) -> None:
        """Resets the worlds of the (W,) mask and publishes a frame of their present state at once."""


def _refuse_mistyped_hooks(cls: type, base: type) -> None:
    """Refuse names of a class that are nearly those of hooks which it leaves as they are in the base."""
    unused = [
        name for name, hook in vars(base).items() if not name.startswith("_") and getattr(cls, name, None) is hook
    ]  # fmt: skip
    for name in vars(cls):
        if name.startswith("_") or name in vars(base):
            continue
        turned = [hook for hook in unused if _letters(hook) == _letters(name)]
        for hook in turned or close_names(name, unused, cutoff=NEAR):
            raise ModelError(
                f"class {cls.__name__}: '{name}' must not be mistaken for '{hook}' of {base.__name__}; "
                "write it so, or give it another name"
            )


def _letters(name: str) -> list[str]:
    """The letters of a name without their order, case and underscores."""
    return sorted(name.lower().replace("_", ""))


def checked_elements(elements: Any) -> tuple[ForceElement, ...]:
    """The force elements of a Simulation, each once.

    Raises:
        ModelError: they are no collection of force elements, or one stands there twice.
    """
    remedy = "make one first, such as Vehicle(model, ...), or derive a class of your own from simwarp.ForceElement"
    listed: tuple[ForceElement, ...] = checked_instances(
        "Simulation", "elements", elements, ForceElement, "force elements", remedy
    )
    for k, part in enumerate(listed):
        if any(part is other for other in listed[:k]):
            raise ModelError(
                f"Simulation: elements must stand there once each, got {type(part).__name__} twice; drop one"
            )
    return listed


def checked_sensors(sensors: Any) -> tuple[Sensor, ...]:
    """The sensors of a Simulation, whose names are all different: their randomness hangs on them.

    Raises:
        ModelError: they are no collection of sensors, or one has no name of its own.
    """
    remedy = "make one first, such as Camera(scene, mount, config), or derive a class of your own from simwarp.Sensor"
    listed: tuple[Sensor, ...] = checked_instances("Simulation", "sensors", sensors, Sensor, "sensors", remedy)
    names = [sensor.name for sensor in listed]
    for sensor, name in zip(listed, names, strict=True):
        if not name:
            raise ModelError(f"Simulation: a sensor must have a name, got a {type(sensor).__name__} without; set .name")
        if names.count(name) > 1:
            raise ModelError(f"Simulation: two sensors are called '{name}'; give one another name")
    return listed


@contextlib.contextmanager
def attached(parts: Sequence[ForceElement | Sensor]) -> Iterator[None]:
    """Attaches force elements and sensors to the Simulation that the block builds; frees them if the block fails.

    Raises:
        ModelError: one is part of a Simulation already.
    """
    mine: list[ForceElement | Sensor] = []
    try:
        for part in parts:
            if part._attached:
                title = f"sensor '{part.name}'" if isinstance(part, Sensor) else f"force element {type(part).__name__}"
                raise ModelError(f"{title}: is part of a Simulation already; make one for each")
            part._attached = True
            mine.append(part)
        yield
    except BaseException:
        for part in mine:
            part._attached = False
        raise


def recorded(record: Callable[..., Iterable[Any] | None], simulation: StepContext, *arguments: Any) -> list[Any]:
    """Launches that a hook of a force element or a sensor records for a Simulation that is being built.

    Raises:
        ModelError: the hook asks the Simulation for what is not there yet, as by `step` or `reset`, or returns
            something that is no launch.
    """
    commands = recorded_or_none(record, simulation, *arguments)
    if commands is None:
        raise ModelError(f"{record.__qualname__}: {_NO_LAUNCHES}, got None; return () for none")
    return commands


def recorded_or_none(
    record: Callable[..., Iterable[Any] | None], simulation: StepContext, *arguments: Any
) -> list[Any] | None:
    """`recorded` of a hook that may return None."""
    name = record.__qualname__
    try:
        commands = record(simulation, *arguments)
    except AttributeError as error:
        if error.obj is not simulation:
            raise
        raise ModelError(
            f"{name}: steps, resets and snapshots must wait until the Simulation is built, but it needed "
            f"'{error.name}'; return launches, and call the Simulation after it is made"
        ) from error
    if commands is None:
        return None
    if not isinstance(commands, Iterable):
        raise ModelError(f"{name}: {_NO_LAUNCHES}, got {formatted(commands)}; return () for none")
    commands = list(commands)
    for command in commands:
        if not callable(getattr(command, "launch", None)):
            raise ModelError(
                f"{name}: must return launches, got {formatted(command)} among them; take what shares.record returns"
            )
    return commands


_NO_LAUNCHES: Final = "must return a sequence of launches"
