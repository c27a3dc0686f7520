"""Shared by all sensors: schedule, mount, and the interface to a Simulation.

A sensor is made from a model, a `Mount` and a frozen configuration with a `schedule`, and is handed to a Simulation:
`Simulation(model, dt, sensors=[sensor])`. Its results are `data`, `timestamp` and `valid`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from simwarp.core.constraints import Meaning, NotNegative, Positive
from simwarp.core.types import WORLD, ModelError, Pose, formatted, pose
from simwarp.model.checks import checked_index, checked_pose
from simwarp.model.model import Model
from simwarp.model.rules import Configuration
from simwarp.simulation.attachments import Sensor

Config = TypeVar("Config")


__all__ = [
    "Configuration",
    "Mount",
    "Schedule",
    "ScheduleSteps",
    "Sensor",
    "body_index",
    "checked_config",
    "checked_model",
]


class ScheduleSteps(NamedTuple):
    """A schedule in whole sub-steps."""

    period: int
    window: int
    lag: int

    def next_published(self, count: int, phase: int) -> int:
        """Sub-step after which a frame is published next.

        Args:
            count: sub-steps since the world's state was set.
            phase: of the world.
        """
        # the frame of the beginning is published at once
        first = self.lag + (self.window + phase or self.period)
        return first + max(-(-(count + 1 - first) // self.period), 0) * self.period


@dataclasses.dataclass(frozen=True, kw_only=True)
class Schedule(Configuration):
    """Schedule of a sensor's measurements. Times are rounded to the nearest whole number of sub-steps.

    Frame k begins at s = phase + k / rate, collects over (s, s + window], is complete at its end and is published `lag`
    later. Time counts from the moment at which the world's state was set.

    Attributes:
        rate: frames per second [Hz]; at most one per sub-step.
        window: time over which a frame collects, at most 1 / rate [s]; 0: one instant.
        lag: from completion to publication [s].
        phase: "zero", or "random": a whole number of sub-steps within a period, per world and episode.

    Raises:
        ModelError: a value breaks its rule.
    """

    rate: Annotated[Positive, Meaning("frames per second [Hz]")]
    window: Annotated[NotNegative, Meaning("seconds, 0 for none")] = 0.0
    lag: Annotated[NotNegative, Meaning("seconds, 0 for none")] = 0.0
    phase: Literal["zero", "random"] = "zero"

    def check(self) -> None:
        """Checks that a window is within a period.

        Raises:
            ModelError: `window` is longer than 1 / `rate`.
        """
        if self.window > (1.0 + 1.0e-9) / self.rate:
            raise ModelError(
                f"Schedule: window must not be longer than a period (1 / rate = {1.0 / self.rate:.6g} s), "
                f"got {formatted(self.window)} s; shorten it or lower the rate"
            )

    def steps(self, dt: float) -> ScheduleSteps:
        """The schedule in sub-steps of `dt` seconds: the nearest whole numbers (halves up), a period of at least 1."""

        def nearest(time: float) -> int:
            # the quotient of two decimals is off by its rounding: 0.025 / 0.01 is meant to be a half
            return math.floor(time / dt + 0.5 + 1.0e-9)

        return ScheduleSteps(max(nearest(1.0 / self.rate), 1), nearest(self.window), nearest(self.lag))


@dataclasses.dataclass(frozen=True)
class Mount:
    """Mounting of a sensor: X forward, Y left, Z up in its own frame.

    Attributes:
        body: name or index of a body; `WORLD` for a fixed place.
        pose: of the sensor, in axes of the body, from its centre of mass [m]; world axes for `WORLD`.

    Raises:
        ModelError: the pose is none.
    """

    body: int | str = WORLD
    pose: Pose = dataclasses.field(default_factory=pose)

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", checked_pose("Mount", self.pose))


def checked_model(sensor: str, model: Any) -> Model:
    """The model that a sensor is made for, or a ModelError."""
    if isinstance(model, Model):
        return model
    remedy = "pass scene.model" if isinstance(getattr(model, "model", None), Model) else "pass what finalize returned"
    raise ModelError(f"sensor '{sensor}': model must be a Model, got {formatted(model)}; {remedy}")


def checked_config(sensor: str, config: Any, kind: type[Config], default: bool = True) -> Config:
    """The configuration of a sensor; None: the default of its kind, where there is one.

    Raises:
        ModelError: it is that of another sort of sensors, or none at all.
    """
    if config is None and default:
        return kind()
    if isinstance(config, kind):
        return config
    others = ", or give it to make_sensor, which finds the class" if dataclasses.is_dataclass(config) else ""
    raise ModelError(
        f"sensor '{sensor}': config must be of class {kind.__name__}, got {formatted(config)}; "
        f"write {kind.__name__}(...){others}"
    )


def body_index(sensor: str, body: int | str, model: Model) -> int:
    """Index of the body that a sensor names.

    Raises:
        ModelError: the model has no such body.
    """
    rule = f"body must be WORLD (-1), an index below {model.body_count} or a name"
    remedy = "take what add_body returned"
    return sensor_index(sensor, rule, body, model.body_count, model.body, remedy, least=WORLD)


def sensor_index(
    sensor: str, rule: str, given: Any, count: int, find: Callable[[str], int], remedy: str, *, least: int = 0
) -> int:
    """`checked_index` of something that a sensor names: all errors begin with the sensor."""

    def find_for_sensor(name: str) -> int:
        try:
            return find(name)
        except ModelError as error:
            raise ModelError(f"sensor '{sensor}': {error}") from None

    return checked_index(f"sensor '{sensor}'", rule, given, count, find_for_sensor, remedy, least=least)
