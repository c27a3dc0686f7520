"""What a channel is, and the sample of a state that it is read from."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.results.chassis_motion import ChassisMotion
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Channel:
    """One column: its name with the unit as its ending, the unit, what it means, and how a sample is read; `recorded`:
    from reactions of joints.
    """

    name: str
    unit: str
    meaning: str
    read: Callable[[Sample], Array]
    recorded: bool = False


class Sample:
    """The state at one time, with each array fetched from the device once.

    Args:
        simulation: of the vehicle.
        motion: of the chassis.
        worlds: that are recorded.
        acceleration: (n, 3) of the chassis' centre of mass, world axes [m/s²].
    """

    def __init__(self, simulation: Simulation, motion: ChassisMotion, worlds: slice, acceleration: Array) -> None:
        self.simulation, self.motion, self.worlds, self.acceleration = simulation, motion, worlds, acceleration
        self._fetched: dict[int, tuple[Any, Array]] = {}

    def of(self, array: Any) -> Array:
        """An array's recorded worlds in double precision; a row that all worlds share stays one row."""
        if id(array) not in self._fetched:
            values = np.asarray(array.numpy(), float)
            self._fetched[id(array)] = (array, values if values.shape[0] == 1 else values[self.worlds])
        return self._fetched[id(array)][1]


def wheel_names(axles: int, behind: int = 0) -> tuple[str, ...]:
    """FL, FR of the first axle, RL, RR of the last, and 2L, 2R and so on of those between, from the front. Those of
    the `behind` axles of trailers go on with the numbers: behind a vehicle of two axles, 3L, 3R.
    """
    ends = {0: "F", axles - 1: "R"} if axles > 1 else {0: "F"}
    return tuple(f"{ends.get(axle, str(axle + 1))}{side}" for axle in range(axles + behind) for side in "LR")


def wheel_names_of(spec: VehicleSpec) -> tuple[str, ...]:
    """Those of a vehicle with its trailers."""
    return wheel_names(len(spec.axles), len(spec.all_axles) - len(spec.axles))


def articulation_names(spec: VehicleSpec) -> tuple[str, ...]:
    """Columns of the angles between a vehicle and its trailers, from the front."""
    return tuple(f"articulation{number + 1}_rad" for number in range(len(spec.trailers)))


def along(axes: Array, vector: Array, axis: int) -> Array:
    """(n,) component of vectors (n, 3) along one of axes (n, 3, 3), which are columns."""
    return np.einsum("wi,wi->w", vector, axes[:, :, axis])


def entry(s: Sample, source: Any, field: str, index: int) -> Array:
    """A column of an array that is looked up when it is read: soil puts its own in place of a tire's."""
    return s.of(getattr(source, field))[:, index]
