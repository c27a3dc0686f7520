"""Encoders of joints and wheels, tachometers and speedometers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Final, Literal, TypeAlias, cast

import numpy as np
import warp as wp

from simwarp.core.arrays import WritableArray, with_zeros, writable_from
from simwarp.core.constraints import Direction, Rule, RuleError
from simwarp.core.rotation import unit_vector
from simwarp.core.types import JointType, ModelError, RowKind, formatted, numbers
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.model import Model
from simwarp.sensors.frame_sensor import VectorSensor
from simwarp.sensors.interface import Configuration, Mount, Schedule, checked_config, checked_model, sensor_index
from simwarp.sensors.motion.encoders_kernels import EncoderArrays, RateMeter, sample_encoder, sample_rate
from simwarp.sensors.noise import Noise, NoiseChain, Numbers, PositiveNumbers
from simwarp.simulation.attachments import StepContext

READINGS: Final = ("position", "counts", "speed")
MEMORY: Final = ("origin", "last", "start")
TURN: Final = 2.0 * math.pi
Coordinate: TypeAlias = str | int
"""A joint of one coordinate by name, or a column of `joint_q` (`model.dof(name, local)`)."""


def _not_zero(ratio: Any) -> None:
    if not np.all(ratio):
        raise RuleError("not 0, one number or one per joint")


@dataclasses.dataclass(frozen=True, kw_only=True)
class EncoderConfig(Configuration):
    """An encoder on coordinates of joints: a joint encoder, or that of a wheel.

    Everything is measured at the encoder's own shaft, which moves `ratio` times as far as the coordinate. It knows
    whole turns: positions go on beyond one.

    Attributes:
        schedule: times of the measurements; a frame holds the latest position or count of its window.
        reading: "position" [rad or m]; "counts" since the beginning of the episode; or "speed" [rad/s or m/s], the
            change of the position over the window (without a window the coordinate's rate, which is not counted).
        counts_per_turn: of a rotation; one number, or one per coordinate. None: not counted.
        step: travel per count instead [rad or m].
        ratio: travel of the encoder per coordinate, of either sign; one number, or one per coordinate.
        noise: of what is read; for positions and counts before they are counted [rad or m].

    Raises:
        ModelError: both a number of counts and a step, a value that is not positive, or counts of nothing.
    """

    schedule: Schedule = dataclasses.field(default_factory=lambda: Schedule(rate=1000.0))
    reading: Literal["position", "counts", "speed"] = "position"
    counts_per_turn: PositiveNumbers | None = None
    step: PositiveNumbers | None = None
    ratio: Annotated[Numbers, Rule(_not_zero)] = 1.0
    noise: tuple[Noise, ...] = ()

    def check(self) -> None:
        """Checks that there is one way to count, and that counts count something.

        Raises:
            ModelError: both `counts_per_turn` and `step` are given, or neither for the reading "counts".
        """
        if self.counts_per_turn is not None and self.step is not None:
            raise ModelError("EncoderConfig: give either counts_per_turn or step, got both; a turn is 2 pi")
        if self.reading == "counts" and self.counts_per_turn is None and self.step is None:
            raise ModelError("EncoderConfig: reading counts needs something to count; give counts_per_turn or step")


class Encoder(VectorSensor):
    """Positions, counts or speeds of coordinates.

    Args:
        model: whose worlds it measures.
        coordinates: joints of one coordinate by name, or columns of `joint_q`: hinges, slides, shafts, turns.
        config: schedule, reading, counts and noise.
        name: unique in a Simulation.
        seed: of the noise, together with the name.
        randomised: True if every world has rows of its own in the noise's parameters, `step` and `ratio`.

    Attributes:
        data: (W, n) float32, see `EncoderConfig.reading`; counts are exact up to 2^24.
        truth: the same without noise and not rounded to counts.
        step, ratio: (1 or W, n) float64, to be written between steps; a step of 0: positions and speeds not counted.
        noise: numbers of the noise (`NoiseChain.parameter`).

    Raises:
        ModelError: there is no such joint, it has no coordinate or several, or counts per turn of a slide.
    """

    noise: NoiseChain

    def __init__(
        self, model: Model, coordinates: Coordinate | Sequence[Coordinate], config: EncoderConfig | None = None, *,
        name: str = "encoder", seed: int = 0, randomised: bool = False,
    ) -> None:  # fmt: skip
        self.config = checked_config(name, config, EncoderConfig)
        checked_model(name, model)
        listed = _listed(name, coordinates)
        self.dofs = [_column(name, item, model) for item in listed]
        count = len(self.dofs)
        if not count:
            raise ModelError(f"sensor '{name}': coordinates must name at least one, got none; give a joint")
        noise = {"noise": (self.config.noise, count)}
        super().__init__(model, name, self.config.schedule, count, noise, seed=seed, randomised=randomised)
        arrays = cast(Any, EncoderArrays())
        arrays.reading = READINGS.index(self.config.reading)
        arrays.dof = wp.array(self.dofs, dtype=int, device=model.device)
        for field, values in (("ratio", self.config.ratio), ("step", self._steps(model))):
            numbers = np.tile(_per_coordinate(name, field, values, count), (self.copies, 1))
            setattr(arrays, field, writable_from(numbers, wp.float64, model.device))
        self._encoder = with_zeros(arrays, (model.world_count, count), model.device, *MEMORY)

    @property
    def step(self) -> WritableArray:
        """(1 or W, n) of the encoder's shaft per count [rad or m]."""
        found: WritableArray = self._encoder.step
        return found

    @property
    def ratio(self) -> WritableArray:
        """(1 or W, n) travel of the encoder per coordinate."""
        found: WritableArray = self._encoder.ratio
        return found

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a snapshot keeps."""
        return {**super().memory, **{f"coordinate {name}": getattr(self._encoder, name) for name in MEMORY}}

    @property
    def world_parameters(self) -> Mapping[str, wp.array]:
        """Numbers of the noise, step and ratio."""
        return {**super().world_parameters, "step": self.step, "ratio": self.ratio}

    def _steps(self, model: Model) -> Any:
        """Travel per count."""
        if self.config.counts_per_turn is None:
            return 0.0 if self.config.step is None else self.config.step
        for dof in self.dofs:
            if not _turns(dof, model):
                joint = model.joint_names[_joint_of(dof, model)]
                raise ModelError(
                    f"sensor '{self.name}': counts_per_turn needs a rotation, but joint '{joint}' slides; give step"
                )
        return TURN / np.asarray(self.config.counts_per_turn, dtype=np.float64)

    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        frames = self.frames
        return [
            simulation.shares.record(
                sample_encoder,
                inputs=[
                    frames.dt, frames.clock, simulation.state.arrays, frames.tick, self._encoder, self.noise.arrays,
                ],
                outputs=[frames.ring["truth"], frames.ring["data"]],
            )
        ]  # fmt: skip


@dataclasses.dataclass(frozen=True, kw_only=True)
class TachometerConfig(Configuration):
    """A tachometer.

    Attributes:
        schedule: times of the measurements; frames are means over the window.
        unit: "rpm" or "rad/s".
        axis: about which a body turns, in axes of the mount; without meaning on a joint.
        noise: of the reading, in its unit.
    """

    schedule: Schedule = dataclasses.field(default_factory=lambda: Schedule(rate=100.0))
    unit: Literal["rpm", "rad/s"] = "rpm"
    axis: Direction = (0.0, 0.0, 1.0)
    noise: tuple[Noise, ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpeedometerConfig(Configuration):
    """A speedometer.

    Attributes:
        schedule: times of the measurements; frames are means over the window.
        noise: [m/s].
    """

    schedule: Schedule = dataclasses.field(default_factory=lambda: Schedule(rate=100.0))
    noise: tuple[Noise, ...] = ()


class Tachometer(VectorSensor):
    """Angular speed of a body about an axis of its own, or rate of a joint's coordinate.

    Args:
        model: whose worlds it measures.
        source: a `Mount` (the turning of its body against the world), or a joint of one coordinate (name, or column
            of `joint_qd`).
        config: schedule, unit, axis and noise.
        name: unique in a Simulation.
        seed: of the noise, together with the name.
        randomised: True if every world has rows of its own in noise parameters and mount.

    Attributes:
        data: (W, 1) float32 [rpm or rad/s].
        truth: the same without noise.
        noise: numbers of the noise (`NoiseChain.parameter`).
        mount: (1 or W,) `rotation` quatd on the body, to be written between steps; without meaning on a joint.

    Raises:
        ModelError: the body or the joint does not exist.
    """

    only_in_windows: ClassVar[bool] = True
    noise: NoiseChain

    def __init__(
        self, model: Model, source: Mount | Coordinate, config: TachometerConfig | None = None, *,
        name: str = "tachometer", seed: int = 0, randomised: bool = False,
    ) -> None:  # fmt: skip
        self.config = checked_config(name, config, TachometerConfig)
        mount = source if isinstance(source, Mount) else Mount()
        super().__init__(
            model, name, self.config.schedule, 1, {"noise": (self.config.noise, 1)}, mount=mount, seed=seed,
            randomised=randomised,
        )  # fmt: skip
        self._meter = _meter(self.mount, unit_vector("TachometerConfig", "axis", self.config.axis))
        self._meter.turning = 1
        self._meter.dof = -1 if mount is source else _column(name, source, model)
        self._meter.scale = wp.float64(60.0 / TURN if self.config.unit == "rpm" else 1.0)

    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        return [_record_rate(self, self._meter, simulation)]


class Speedometer(VectorSensor):
    """Speed of a point of a body along X of its mount, negative backwards.

    Args:
        model: whose worlds it measures.
        mount: place and axes on a body.
        config: schedule and noise.
        name: unique in a Simulation.
        seed: of the noise, together with the name.
        randomised: True if every world has rows of its own in noise parameters and mount.

    Attributes:
        data: (W, 1) float32 [m/s].
        truth: the same without noise.
        noise: numbers of the noise (`NoiseChain.parameter`).
        mount: (1 or W,) `position` vec3d [m] and `rotation` quatd on the body, to be written between steps.

    Raises:
        ModelError: the body does not exist.
    """

    only_in_windows: ClassVar[bool] = True
    noise: NoiseChain

    def __init__(
        self, model: Model, mount: Mount, config: SpeedometerConfig | None = None, *, name: str = "speedometer",
        seed: int = 0, randomised: bool = False,
    ) -> None:  # fmt: skip
        self.config = checked_config(name, config, SpeedometerConfig)
        super().__init__(
            model, name, self.config.schedule, 1, {"noise": (self.config.noise, 1)}, mount=mount, seed=seed,
            randomised=randomised,
        )  # fmt: skip
        self._meter = _meter(self.mount, (1.0, 0.0, 0.0))

    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        return [_record_rate(self, self._meter, simulation)]


def _meter(mount: Any, axis: Any) -> Any:
    """A meter of the velocity along an axis of a mount."""
    meter = cast(Any, RateMeter())
    meter.dof = -1
    meter.axis = wp.vec3d(*(float(component) for component in axis))
    meter.scale = wp.float64(1.0)
    meter.mount = mount
    return meter


def _record_rate(sensor: Tachometer | Speedometer, meter: Any, simulation: StepContext) -> Any:
    frames = sensor.frames
    return simulation.shares.record(
        sample_rate,
        inputs=[frames.clock, meter, simulation.state.arrays, frames.tick, sensor.noise.arrays, sensor._sums],
        outputs=[frames.ring["truth"], frames.ring["data"]],
    )  # fmt: skip


def _listed(sensor: str, coordinates: Any) -> list[Any]:
    """One coordinate or several as a list."""
    if isinstance(coordinates, (str, int, np.integer)):
        return [coordinates]
    if isinstance(coordinates, (list, tuple, np.ndarray)) and np.ndim(coordinates) == 1:
        return list(coordinates)
    raise ModelError(
        f"sensor '{sensor}': coordinates must be joints by name or columns of joint_q, got {formatted(coordinates)}; "
        "an encoder sits on a joint: pass its name"
    )


def _column(sensor: str, item: Any, model: Model) -> int:
    """Column of `joint_q` of a coordinate."""

    def only_column(name: str) -> int:
        first, end = model.joint_dof_start[model.joint(name) :][:2]
        if end - first != 1:
            raise ModelError(
                f"joint '{name}' has {end - first} coordinates, not one; "
                f"give a column, such as model.dof('{name}', 0), or another joint"
            )
        return first

    rule = f"a coordinate must be the name of a joint or a column below {model.dof_count}"
    return sensor_index(sensor, rule, item, model.dof_count, only_column, "take model.dof(name)")


def _joint_of(dof: int, model: Model) -> int:
    return int(np.searchsorted(model.joint_dof_start, dof, side="right")) - 1


def _turns(dof: int, model: Model) -> bool:
    """True if a coordinate is an angle."""
    joint = _joint_of(dof, model)
    kind = JointType(int(model.topology.joint_type.numpy()[joint]))
    row = ELEMENTS[kind].dofs[dof - model.joint_dof_start[joint]]
    return row.kind in (RowKind.ANGLE0, RowKind.ANGLE1, RowKind.SHAFT)


def _per_coordinate(sensor: str, field: str, values: Any, count: int) -> Any:
    """(count,) of one number, or one per coordinate."""
    given = np.atleast_1d(numbers(values))
    if len(given) not in (1, count):
        raise ModelError(
            f"sensor '{sensor}': {field} must be one number or {count}, got {len(given)}; give one for all, or one per "
            "coordinate"
        )
    return np.broadcast_to(given, count)
