"""Interfaces of force elements, which act before a step, of sensors, which follow it, and their view of the Simulation.

Force elements, such as tires and engines, act on bodies and joints every step, with states of their own: they read the
state and write `Control.element_force`, `element_torque` and `element_joint_force`, each its own entries; one that adds
to those of elements before it, as soil does, finds theirs in `assigned_bodies`. Their states
are part of resets and snapshots. Sensors measure; they are in `simwarp.sensors`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol

import warp as wp

from simwarp.core.types import ModelError, shown
from simwarp.model.model import Model
from simwarp.simulation.contacts import Contacts
from simwarp.simulation.diagnostics import Diagnostics
from simwarp.simulation.sensor_rounds import SensorRounds
from simwarp.simulation.state import Control, State
from simwarp.simulation.world_launches import WorldShares


class StepContext(Protocol):
    """Interface of a Simulation to its force elements and sensors.

    Attributes:
        model, state, control, contacts, diagnostics: those of the Simulation.
        shares: records launches whose worlds are shared among threads.
        rounds: where the sensors' clocks stand between two looks.
        elements: all force elements, in the order of their launches.
        substeps: sub-steps of one step.
        read_every: steps between two looks at the sensors' data.
    """

    model: Model
    state: State
    control: Control
    contacts: Contacts
    diagnostics: Diagnostics
    shares: WorldShares
    rounds: SensorRounds
    elements: tuple[ForceElement, ...]
    substeps: int
    read_every: int


class ForceElement(Protocol):
    """Interface of a part of the Simulation that applies forces. One that also measures has `record_after`, like
    `record`, for launches that follow each sub-step, and may have `record_outputs(simulation, mask)`: launches that
    publish what the present state tells. Their first input is the (W,) mask; they run at construction and wherever
    somebody set the state of worlds, as a sensor's `begin`. One that resets its memory itself has
    `record_reset(simulation, mask)` likewise. One with an attribute `implicit` writes `Control.element_mass`,
    `element_coupling` and `element_inertia` of its bodies. `assigned_bodies`: indices of the bodies whose
    `element_force` and `element_torque` it writes anew in every sub-step. One that may run short of something has
    `world_problems()`: a line with the remedy by world, for `Simulation.problems`.
    """

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that outlives a step, by name: contiguous arrays (W, ...) of four or eight bytes per number. At
        construction they hold the values that a reset brings back.
        """
        ...

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Recorded launches (`simulation.shares.record`) that come before each sub-step.

        Those of `wp.launch(..., record_cmd=True)` will do, but run on one thread.

        Args:
            simulation: the element's Simulation.
            dt: of a sub-step [s].
        """
        ...


class Sensor(Protocol):
    """Measures every world on a clock of its own, inside the step.

    A sensor may also have `check(simulation, dt)`: it raises a ModelError where the sensor cannot be part of the
    Simulation, and changes nothing. All sensors are asked before the first one is recorded. One that need not be
    launched in every sub-step has `between_looks(simulation)`, which returns a `SensorRound`, or None.

    A Simulation calls `record` once, launches what it returned after each sub-step, and calls `begin` at construction
    and whenever somebody sets the state of worlds: `reset`, `set_joint_state` and `measure`.
    """

    @property
    def name(self) -> str:
        """Unique among the sensors of a Simulation."""
        ...

    @property
    def data(self) -> wp.array:
        """(W, ...) the latest frame that is published; the same memory throughout."""
        ...

    @property
    def timestamp(self) -> wp.array:
        """(W,) float64 [s]: the world's time when that frame was complete."""
        ...

    @property
    def valid(self) -> wp.array:
        """(W,) bool: false in worlds that are frozen (`WorldStatus.NON_FINITE`)."""
        ...

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """Everything that outlives a sub-step, by name: contiguous arrays (W, ...) or (W·slots, ...), part of
        snapshots. A reset leaves it to `begin`.
        """
        ...

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """Recorded launches (`simulation.shares.record`) that follow each sub-step, as those of a `ForceElement`.

        Args:
            simulation: the sensor's Simulation.
            dt: of a sub-step [s].
        """
        ...

    def begin(self, simulation: StepContext, mask: wp.array[wp.bool]) -> None:
        """Resets the worlds of the (W,) mask and publishes a frame of their present state at once."""
        ...


def recorded(record: Callable[..., Iterable[Any]], simulation: StepContext, *arguments: Any) -> list[Any]:
    """Launches that a method of a force element or a sensor records for a Simulation that is being built.

    Raises:
        ModelError: the method asks the Simulation for what is not there yet, as by `step` or `reset`, or returns
            something that is no launch.
    """
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
    if not isinstance(commands, Iterable):
        raise ModelError(f"{name}: must return a sequence of launches, got {shown(commands)}; return () for none")
    commands = list(commands)
    for command in commands:
        if not callable(getattr(command, "launch", None)):
            raise ModelError(
                f"{name}: must return launches, got {shown(command)} among them; take what shares.record returns"
            )
    return commands
