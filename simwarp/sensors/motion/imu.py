"""Inertial sensors: accelerometer and gyroscope, in one unit or each alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal, TypeAlias, get_args

import warp as wp

from simwarp.core.arrays import with_zeros
from simwarp.core.constraints import As, Different, MinLen, OneOrMany
from simwarp.model.model import Model
from simwarp.sensors.frame_sensor import VectorSensor
from simwarp.sensors.interface import Configuration, Mount, Schedule, checked_config
from simwarp.sensors.motion.imu_kernels import InertialArrays, sample_inertial
from simwarp.sensors.noise import Noise, NoiseChain
from simwarp.simulation.attachments import StepContext

Output: TypeAlias = Literal["accelerometer", "gyroscope"]
OutputNames: TypeAlias = Annotated[tuple[Output, ...], MinLen(1), Different, OneOrMany()]
PARTS: Final = get_args(Output)
MOTION: Final = ("velocity", "omega", "rotation")
"""What is remembered of the body."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImuConfig(Configuration):
    """An inertial unit.

    Attributes:
        schedule: times of the measurements; frames are means over the window.
        outputs: "accelerometer", "gyroscope" or both.
        accelerometer_noise: of the specific force [m/s²], per axis or for all.
        gyroscope_noise: of the angular velocity [rad/s].
    """

    schedule: Schedule = dataclasses.field(default_factory=lambda: Schedule(rate=100.0))
    outputs: Annotated[Sequence[str], As(OutputNames)] = PARTS
    accelerometer_noise: tuple[Noise, ...] = ()
    gyroscope_noise: tuple[Noise, ...] = ()


class Imu(VectorSensor):
    """Specific force and angular velocity at a point of a body, in axes of the sensor.

    The specific force is Rᵀ (a - g), with the acceleration a of the mounted point and gravity g: a sensor at rest reads
    +9.81 along the axis that points up, one in free fall zero. There is a sample after every sub-step of the window.

    Args:
        model: whose worlds it measures.
        mount: place and axes on a body.
        config: schedule, parts and noise.
        name: unique in a Simulation.
        seed: of the noise, together with the name.
        randomised: True if every world has rows of its own in noise parameters and mount.

    Attributes:
        data: (W, 3 or 6) float32: specific force [m/s²], angular velocity [rad/s], in the order of `config.outputs`.
        truth: the same without noise.
        accelerometer_noise, gyroscope_noise: numbers of the noise (`NoiseChain.parameter`).
        mount: (1 or W,) `position` vec3d [m] and `rotation` quatd on the body, to be written between steps.

    Raises:
        ModelError: the body does not exist, or noise does not fit the channels.
    """

    accelerometer_noise: NoiseChain
    gyroscope_noise: NoiseChain

    def __init__(
        self, model: Model, mount: Mount, config: ImuConfig | None = None, *, name: str = "imu", seed: int = 0,
        randomised: bool = False,
    ) -> None:  # fmt: skip
        self.config = checked_config(name, config, ImuConfig)
        outputs = self.config.outputs
        noise = {name: (getattr(self.config, name), 3) for name in ("accelerometer_noise", "gyroscope_noise")}
        super().__init__(
            model, name, self.config.schedule, 3 * len(outputs), noise, mount=mount, seed=seed, randomised=randomised
        )  # fmt: skip
        self._inertial = with_zeros(InertialArrays(), model.world_count, model.device, *MOTION)
        for part in PARTS:
            setattr(self._inertial, part, 3 * outputs.index(part) if part in outputs else -1)
        self._inertial.sums = self._sums

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """State that a snapshot keeps."""
        return {**super().memory, **{f"body {name}": getattr(self._inertial, name) for name in MOTION}}

    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        model, frames = simulation.model, self.frames
        return [
            simulation.shares.record(
                sample_inertial,
                inputs=[
                    frames.dt, frames.clock, self.mount, model.parameters, simulation.state.arrays, frames.tick,
                    self._inertial, self.accelerometer_noise.arrays, self.gyroscope_noise.arrays,
                ],
                outputs=[frames.ring["truth"], frames.ring["data"]],
            )
        ]  # fmt: skip
