"""Magnetometer: the Earth's field, that of a dipole, in axes of the sensor."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar

import warp as wp

from simwarp.core.constraints import Ge, Le, Meaning, NotNegative
from simwarp.model.model import Model
from simwarp.sensors.frame_sensor import VectorSensor
from simwarp.sensors.interface import Configuration, Mount, Schedule, checked_config
from simwarp.sensors.motion.gps import GeoOrigin, geo_frame
from simwarp.sensors.motion.magnetometer_kernels import sample_magnetometer
from simwarp.sensors.noise import Noise, NoiseChain
from simwarp.simulation.attachments import StepContext


@dataclasses.dataclass(frozen=True, kw_only=True)
class MagnetometerConfig(Configuration):
    """A magnetometer.

    Attributes:
        schedule: times of the measurements; frames are means over the window.
        origin: geodetic position of the world.
        noise: [T], per axis or for all; a constant bias (hard iron) is the mean of a `NormalNoise`.
        strength: of the field at the magnetic equator [T].
        pole_latitude, pole_longitude: of the geomagnetic north pole [deg].
    """

    schedule: Schedule = dataclasses.field(default_factory=lambda: Schedule(rate=100.0))
    origin: GeoOrigin = dataclasses.field(default_factory=GeoOrigin)
    noise: tuple[Noise, ...] = ()
    strength: NotNegative = 3.05e-5
    pole_latitude: Annotated[float, Ge(-90.0), Le(90.0), Meaning("degrees")] = 80.65
    pole_longitude: Annotated[float, Ge(-180.0), Le(180.0), Meaning("degrees")] = -72.68


class Magnetometer(VectorSensor):
    """The magnetic field at a point of a body, in axes of the sensor.

    The field is that of a dipole in the Earth's centre, whose axis leaves it at the geomagnetic north pole. Measured
    fields differ from it by up to a fifth in strength and some degrees in direction.

    Args:
        model: whose worlds it measures.
        mount: place and axes on a body.
        config: schedule, origin, field and noise.
        name: unique in a Simulation.
        seed: of the noise, together with the name.
        randomised: True if every world has rows of its own in noise parameters and mount.

    Attributes:
        data: (W, 3) float32 [T].
        truth: the same without noise.
        noise: numbers of the noise (`NoiseChain.parameter`).
        mount: (1 or W,) `position` vec3d [m] and `rotation` quatd on the body, to be written between steps.

    Raises:
        ModelError: the body does not exist, or noise does not fit the channels.
    """

    only_in_windows: ClassVar[bool] = True
    noise: NoiseChain

    def __init__(
        self, model: Model, mount: Mount, config: MagnetometerConfig | None = None, *, name: str = "magnetometer",
        seed: int = 0, randomised: bool = False,
    ) -> None:  # fmt: skip
        self.config = checked_config(name, config, MagnetometerConfig)
        super().__init__(
            model, name, self.config.schedule, 3, {"noise": (self.config.noise, 3)}, mount=mount, seed=seed,
            randomised=randomised,
        )  # fmt: skip
        self._frame = geo_frame(self.config.origin)
        latitude, longitude = math.radians(self.config.pole_latitude), math.radians(self.config.pole_longitude)
        self._pole = wp.vec3d(
            math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)
        )

    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        frames = self.frames
        return [
            simulation.shares.record(
                sample_magnetometer,
                inputs=[
                    frames.clock, self._frame, self._pole, self.config.strength, self.mount, simulation.state.arrays,
                    frames.tick, self.noise.arrays, self._sums,
                ],
                outputs=[frames.ring["truth"], frames.ring["data"]],
            )
        ]  # fmt: skip
