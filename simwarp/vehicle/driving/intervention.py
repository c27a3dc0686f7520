"""Interventions: what a test does to a driver's inputs from a moment on, by patterns of steering and braking."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import warp as wp

from simwarp.core.arrays import writable_from
from simwarp.core.object_repr import ReadableFields
from simwarp.core.piecewise_linear import function_arrays
from simwarp.core.types import formatted
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.vehicle.driving.drivers import HELD
from simwarp.vehicle.driving.specs_of_worlds import per_world, specs_of_worlds
from simwarp.vehicle.intervention_kernels import (
    InterventionRow,
    InterventionState,
    InterventionTables,
    PedalUse,
    intervene,
)
from simwarp.vehicle.spec.parts import Points
from simwarp.vehicle.spec.vehicle_spec import SpecError
from simwarp.vehicle.vehicle import Vehicle

NOWHERE: Final = -1.0e30
"""x that every vehicle is beyond [m]."""


class Pedals(enum.Enum):
    """What becomes of the throttle: the driver's, released, or held where it was; brakes follow their pattern."""

    DRIVER = "driver"
    RELEASED = "released"
    HELD = "held"


_USES: Final = {Pedals.DRIVER: PedalUse.DRIVER, Pedals.RELEASED: PedalUse.RELEASED, Pedals.HELD: PedalUse.HELD}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Intervention(ReadableFields):
    """From `after` on, and not before the vehicle's frame is beyond an x, a test has the steering or the pedals.

    Patterns are piecewise linear functions of the time since [s], constant beyond their ends.

    Attributes:
        after: of the manoeuvre's own time [s].
        beyond: x of the vehicle's frame of reference [m].
        steering: pattern of shares of `amplitude`, added to the steering when it began; None: the driver steers on.
        amplitude: of the steering's pattern, -1..1.
        pedals: what becomes of the throttle.
        braking: pattern of shares of `brakes`; it acts unless the pedals are the driver's.
        brakes: 0..1.
        pause: time of the steering's pattern at which it waits until the roll rate is below `calm` [s]; None: never.
        calm: roll rate [rad/s].

    Raises:
        SpecError: a pattern has no points, or its times are not in order; an amplitude is out of range.
    """

    after: float = 0.0
    beyond: float = NOWHERE
    steering: Points | None = None
    amplitude: float = 0.0
    pedals: Pedals = Pedals.DRIVER
    braking: Points = HELD
    brakes: float = 0.0
    pause: float | None = None
    calm: float = math.radians(1.5)

    def __post_init__(self) -> None:
        for name in ("steering", "braking"):
            points = HELD if getattr(self, name) is None else getattr(self, name)
            times = [time for time, _ in points]
            if not points or times != sorted(times):
                raise SpecError(f"{name}: must be (time, value) points in order, got {formatted(points)}")
        for name, low in (("amplitude", -1.0), ("brakes", 0.0)):
            if not low <= getattr(self, name) <= 1.0:
                raise SpecError(f"{name}: must be from {low:g} to 1, got {getattr(self, name)!r}")


NEVER: Final = 1.0e30
"""[s]."""


def no_intervention() -> Intervention:
    """One that never begins."""
    return Intervention(after=NEVER)


class Intervening(ForceElement):
    """Acts by an `Intervention` in every world: a `ForceElement` between a driver and its vehicle.

    Args:
        vehicle: whose `input` it overwrites.
        spec: patterns, and when they begin, of all worlds or one for each.
        start: time of the simulation at which the manoeuvre's own begins [s].

    Raises:
        SpecError: there are neither one nor as many specs as worlds.

    Attributes:
        amplitude: (W,) of the steering's pattern; write it before it begins.
        brakes: (W,) of the brakes' pattern; likewise.
        beyond: (W,) least x of the vehicle's frame of reference [m]; likewise.
    """

    def __init__(self, vehicle: Vehicle, spec: Intervention | Sequence[Intervention], start: float = 0.0) -> None:
        worlds, device = vehicle.model.world_count, vehicle.model.device
        self.vehicle = vehicle
        self.specs = specs = specs_of_worlds(spec, Intervention, worlds)
        self.amplitude, self.brakes, self.beyond = (
            writable_from(per_world([getattr(each, name) for each in specs], worlds), wp.float32, device)
            for name in ("amplitude", "brakes", "beyond")
        )
        self._tables = _tables(vehicle, specs)
        rows = [_row(each, 2 * index, start) for index, each in enumerate(specs)]
        self._rows: wp.array = wp.array(rows, dtype=InterventionRow, device=device)
        self._state = InterventionState()
        self._state.begun = wp.zeros(worlds, dtype=int, device=device)
        for name in ("since", "clock", "steering", "throttle"):
            setattr(self._state, name, wp.zeros(worlds, dtype=float, device=device))

    def _readable_title(self) -> str:
        times = " or ".join(f"{time:g}" for time in sorted({each.after for each in self.specs if each.after < NEVER}))
        return f" of vehicle '{self.vehicle.parts.spec.name}', from {times or 'no'} s on"

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """Whether it has begun, its clocks, and the inputs of that moment."""
        return {name: getattr(self._state, name) for name in ("begun", "since", "clock", "steering", "throttle")}

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that overwrites the inputs."""
        amplitudes = (self.beyond, self.amplitude, self.brakes)
        return [
            simulation.shares.record(
                intervene,
                inputs=[dt, self._tables, self._rows, *amplitudes, simulation.state.arrays],
                outputs=[self._state, self.vehicle.input],
            )
        ]  # fmt: skip


def _tables(vehicle: Vehicle, specs: Sequence[Intervention]) -> InterventionTables:
    tables: Any = InterventionTables()
    tables.chassis, tables.reference = vehicle.parts.chassis, wp.vec3(*vehicle.parts.reference)
    patterns = [points for each in specs for points in (each.steering or HELD, each.braking)]
    tables.start, tables.time, tables.value = function_arrays(patterns, float, vehicle.model.device)
    found: InterventionTables = tables
    return found


def _row(spec: Intervention, patterns: int, start: float) -> InterventionRow:
    row: Any = InterventionRow()
    row.patterns, row.after = patterns, start + spec.after
    row.steers, row.pedals = int(spec.steering is not None), int(_USES[spec.pedals])
    row.pause = -1.0 if spec.pause is None else spec.pause
    row.calm = spec.calm
    found: InterventionRow = row
    return found
