"""Numbers in which worlds of a batch differ: parameters of the model, the state at the start, and what drives them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError
from simwarp.identify.fit_error import FitError
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import Model, initial_state
from simwarp.model.parameters import parameter_values
from simwarp.simulation.simulation import Simulation

Array = npt.NDArray[np.float64]

FACTORS: Final = (
    ("spring_table", "joint_stiffness"), ("damper_table", "joint_damping"), ("damper_map", "joint_damping"),
)  # fmt: skip
"""Tables of a coordinate, which all worlds share, and the parameter that is a factor of their efforts."""
SHARED: Final = (
    "worlds share its points, so that only a factor of all its efforts can be fitted; take what else is in it along, "
    "such as a spring's bump_curve, in `also`"
)


@dataclasses.dataclass(frozen=True)
class WorldNumbers:
    """Numbers of one world.

    Attributes:
        parameters: of the model, by name.
        state: at the start, by name.
        others: of what else is in the simulation, by names of the target.
    """

    parameters: Mapping[str, npt.NDArray[Any]]
    state: Mapping[str, npt.NDArray[Any]]
    others: Mapping[str, npt.NDArray[Any]]

    def different(self, other: WorldNumbers) -> set[str]:
        """Names of parameters and others in which two worlds differ.

        Raises:
            FitError: an array has another length: the worlds would be of different models.
        """
        found = set()
        for mine, theirs in ((self.parameters, other.parameters), (self.others, other.others)):
            for name, values in mine.items():
                if values.shape != theirs[name].shape:
                    raise FitError(f"it changes the size of {name}, which all worlds share")
                if not np.array_equal(values, theirs[name]):
                    found.add(name)
        return found


@dataclasses.dataclass(frozen=True)
class World:
    """One world of a batch.

    Attributes:
        numbers: that it has.
        inputs: (steps, inputs) in the order of the configuration, in SI.
        start: values of readings at its beginning.
    """

    numbers: WorldNumbers
    inputs: Array
    start: Mapping[str, float]


class InputRows:
    """Rows of an array that inputs are written into before every step: in place on a CPU, else copied.

    Args:
        array: whose last axis is that of the inputs.

    Attributes:
        values: to be written, in the shape of the array.
    """

    def __init__(self, array: Any) -> None:
        self._array, self._in_place = array, bool(array.device.is_cpu)
        self.values: npt.NDArray[Any] = array.numpy() if self._in_place else array.numpy().copy()

    def publish(self) -> None:
        """Let the next step read the values."""
        if not self._in_place:
            self._array.assign(self.values)


class Rollout(Protocol):
    """A simulation of many worlds of one target."""

    def run(self, worlds: Sequence[World], samples: int) -> Array:
        """(samples + 1, W, readings), the first at the start; nan from where a world broke down on."""


class Target(Protocol):
    """What can be fitted: a vehicle, a robot, a model.

    Attributes:
        name: in reports.
        document: its numbers as plain values.
        usual_warmup: time that it takes to settle from a start [s].
    """

    name: str
    document: Any
    usual_warmup: float

    def numbers(self, document: Any, start: Mapping[str, float]) -> WorldNumbers:
        """The numbers of a world with another document.

        Raises:
            ValueError: the document breaks a rule.
        """

    def rollout(self, worlds: int, differing: set[str], readings: Sequence[str], inputs: Sequence[str]) -> Rollout:
        """A simulation of so many worlds, which differ in these parameters and others."""

    def check_names(self, readings: Sequence[str], inputs: Sequence[str]) -> None:
        """Refuse readings and inputs that the target does not have."""

    def can_start_with(self, name: str) -> bool:
        """Whether a world can start with a value of a reading."""

    def measured_start(self, readings: Sequence[str]) -> Sequence[str]:
        """Readings whose measured values a world starts with."""

    def model_names(self) -> Model:
        """A model of one world, for the names of its parts."""

    def saved(self, document: Any) -> Any:
        """A document as its file has it."""


def model_numbers(builder: ModelBuilder, base: ModelBuilder) -> WorldNumbers:
    """Numbers of a builder's model; tables that all entries scale alike become factors of stiffness and damping.

    Args:
        builder: of the world.
        base: of the batch's model, whose tables all worlds share.

    Raises:
        FitError: a table has another shape than that of the batch.
    """
    parameters = dict(parameter_values(builder))
    for index, (joint, own) in enumerate(zip(builder.joints, base.joints, strict=True)):
        first = builder.dof_start(index)
        for local, (mine, theirs) in enumerate(zip(joint.dofs, own.dofs, strict=True)):
            for table, name in FACTORS:
                before, after = getattr(theirs, table), getattr(mine, table)
                if not _equal(before, after):
                    ratio = _ratio(before, after, f"{table} of joint '{joint.name}'")
                    parameters[name] = parameters[name].copy()
                    parameters[name][first + local] *= ratio
    return WorldNumbers(parameters, initial_state(builder), {})


def _equal(before: Any, after: Any) -> bool:
    if before is None or after is None:
        return before is after
    return np.array_equal(_numbers(before), _numbers(after))


def _numbers(table: Any) -> Array:
    flat: list[float] = []

    def collect(value: Any) -> None:
        if isinstance(value, (tuple, list, np.ndarray)):
            for item in value:
                collect(item)
        else:
            flat.append(float(value))

    collect(table)
    return np.array(flat)


def _ratio(before: Any, after: Any, place: str) -> float:
    """The factor between the efforts of two tables, whose places are the same."""
    if before is None or after is None or _numbers(before).shape != _numbers(after).shape:
        raise FitError(f"{place}: {SHARED}")
    *places, efforts = before
    *others, changed = after
    first, second = _numbers(efforts), _numbers(changed)
    return uniform_ratio(first, second, np.array_equal(_numbers(places), _numbers(others)), place)


def uniform_ratio(before: Array, after: Array, same_places: bool, place: str) -> float:
    """The one factor between all numbers.

    Raises:
        FitError: there is none.
    """
    largest = int(np.argmax(np.abs(before))) if before.size else 0
    ratio = after[largest] / before[largest] if before.size and before[largest] != 0.0 else float("nan")
    if not same_places or not np.allclose(after, ratio * before, rtol=1e-6, atol=0.0):
        raise FitError(f"{place}: {SHARED}")
    return float(ratio)


def write_world_numbers(simulation: Simulation, differing: set[str], worlds: Sequence[World]) -> None:
    """Write parameters and states at the start into a simulation that was just reset; the last world fills the rest."""
    model: Model = simulation.model
    rows = [*worlds, *[worlds[-1]] * (model.world_count - len(worlds))]
    for name in sorted(differing):
        values = np.stack([world.numbers.parameters[name] for world in rows])
        try:
            getattr(model, name).assign(values)
        except ModelError as error:
            raise FitError(f"parameters: {error}") from None
    for name in rows[0].numbers.state:
        values = np.stack([world.numbers.state[name] for world in rows])
        if values.size:
            getattr(simulation.state, name).assign(values)
