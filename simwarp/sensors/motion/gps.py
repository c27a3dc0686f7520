"""Satellite receiver: latitude, longitude and altitude of a point of a body, and its velocity."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, cast

import numpy as np
import warp as wp

from simwarp.core.constraints import Ge, Le, Meaning
from simwarp.core.types import ModelError, formatted
from simwarp.model.model import Model
from simwarp.model.rules import RULES, instance_of
from simwarp.sensors.clock import Field
from simwarp.sensors.frame_sensor import VectorSensor
from simwarp.sensors.interface import Configuration, Mount, Schedule, checked_config
from simwarp.sensors.motion.geodesy_kernels import GeoFrame
from simwarp.sensors.motion.gps_kernels import GpsRings, sample_gps
from simwarp.sensors.noise import Noise, NoiseChain
from simwarp.simulation.attachments import StepContext

MAJOR = 6378137.0
"""Equatorial radius of WGS84 [m]."""
ECCENTRICITY2 = (2.0 - 1.0 / 298.257223563) / 298.257223563


@dataclasses.dataclass(frozen=True, kw_only=True)
class GeoOrigin(Configuration):
    """Geodetic position and heading of the world's origin. The world's z is the normal of the ellipsoid there.

    Attributes:
        latitude: geodetic, -90 to 90 [deg].
        longitude: -180 to 180, positive to the east [deg].
        altitude: above the ellipsoid [m].
        heading: angle from east to the world's X axis, counter-clockwise [rad]: 0 puts X east and Y north.

    Raises:
        ModelError: a value is outside its range.
    """

    latitude: Annotated[float, Ge(-90.0), Le(90.0), Meaning("degrees")] = 43.07
    longitude: Annotated[float, Ge(-180.0), Le(180.0), Meaning("degrees")] = -89.40
    altitude: Annotated[float, Ge(-1.0e5), Le(1.0e9)] = 260.0
    heading: Annotated[float, Ge(-1.0e9), Le(1.0e9)] = 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class GpsConfig(Configuration):
    """A satellite receiver.

    Attributes:
        schedule: times of the measurements; a frame holds the latest sample of its window.
        origin: geodetic position of the world.
        earth: "wgs84", or "sphere" of 6371 km, on which metres north and east are turned into angles one by one; it
            serves up to 89 degrees of latitude, since meridians meet at the poles.
        noise: of the position east, north and up at the place [m], per axis or for all.
        velocity_noise: of the velocity east, north and up at the place [m/s].

    Raises:
        ModelError: a sphere whose origin is at a pole.
    """

    schedule: Schedule = dataclasses.field(default_factory=lambda: Schedule(rate=10.0))
    origin: GeoOrigin = dataclasses.field(default_factory=GeoOrigin)
    earth: Literal["wgs84", "sphere"] = "wgs84"
    noise: tuple[Noise, ...] = ()
    velocity_noise: tuple[Noise, ...] = ()

    def check(self) -> None:
        """Checks that metres to the east are a longitude.

        Raises:
            ModelError: they are not, near a pole of the sphere.
        """
        if self.earth == "sphere" and abs(self.origin.latitude) > 89.0:
            raise ModelError(
                "GpsConfig: earth 'sphere' needs an origin whose latitude is within 89 degrees, "
                f"got {formatted(self.origin.latitude)}; use 'wgs84'"
            )


@RULES.arguments("geo_frame")
def geo_frame(
    origin: Annotated[GeoOrigin, instance_of(GeoOrigin, "write GeoOrigin(latitude=..., ...)")], spherical: bool = False
) -> GeoFrame:
    """The origin as kernels read it.

    Raises:
        ModelError: it is none.
    """
    frame = GeoFrame()
    frame.spherical = int(spherical)
    latitude, longitude = math.radians(origin.latitude), math.radians(origin.longitude)
    frame.latitude, frame.longitude = wp.float64(latitude), wp.float64(longitude)
    frame.altitude = wp.float64(origin.altitude)
    s, c = math.sin(origin.heading), math.cos(origin.heading)
    frame.local = wp.mat33d(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
    sp, cp, sl, cl = math.sin(latitude), math.cos(latitude), math.sin(longitude), math.cos(longitude)
    frame.axes = wp.mat33d(-sl, -sp * cl, cp * cl, cl, -sp * sl, cp * sl, 0.0, cp, sp)
    across = MAJOR / math.sqrt(1.0 - ECCENTRICITY2 * sp * sp)
    up = (across + origin.altitude) * cp
    frame.place = wp.vec3d(up * cl, up * sl, (across * (1.0 - ECCENTRICITY2) + origin.altitude) * sp)
    return frame


def to_local(origin: GeoOrigin, latitude: Any, longitude: Any, altitude: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """World coordinates (..., 3) [m] of places on the Earth [deg, deg, m] (WGS84): waypoints of a map, say."""
    frame = geo_frame(origin)
    phi, lam, h = (np.asarray(v, np.float64) for v in (np.radians(latitude), np.radians(longitude), altitude))
    across = MAJOR / np.sqrt(1.0 - ECCENTRICITY2 * np.sin(phi) ** 2)
    place = np.stack(
        np.broadcast_arrays(
            (across + h) * np.cos(phi) * np.cos(lam), (across + h) * np.cos(phi) * np.sin(lam),
            (across * (1.0 - ECCENTRICITY2) + h) * np.sin(phi),
        ),
        axis=-1,
    )  # fmt: skip
    axes = np.array(frame.axes).reshape(3, 3) @ np.array(frame.local).reshape(3, 3)
    return np.asarray((place - np.array(frame.place)) @ axes)


class Gps(VectorSensor):
    """Satellite receiver: position on the Earth, and velocity, of a point of a body.

    The world is a plane that touches the ellipsoid at `config.origin`: one kilometre away, z = 0 lies 8 cm above it.

    Args:
        model: whose worlds it measures.
        mount: body and pose; its axes do not matter.
        config: schedule, origin and noise.
        name: unique in a Simulation.
        seed: of the noise, together with the name.
        randomised: True if every world has rows of its own in noise parameters and mount.

    Attributes:
        data: (W, 3) float64: latitude, longitude [deg], altitude above the ellipsoid [m].
        truth: the same without noise.
        position: (W, 3) float32, the measured place in the world's own axes, from its origin [m]: for networks, since
            degrees do not fit into float32.
        velocity: (W, 3) float32, east, north and up at the place [m/s].
        velocity_truth: the same without noise.
        noise, velocity_noise: numbers of the noise (`NoiseChain.parameter`).
        mount: (1 or W,) `position` vec3d [m] on the body, to be written between steps.

    Raises:
        ModelError: the body does not exist, or noise does not fit the channels.
    """

    only_in_windows: ClassVar[bool] = True
    noise: NoiseChain
    velocity_noise: NoiseChain

    def __init__(
        self, model: Model, mount: Mount, config: GpsConfig | None = None, *, name: str = "gps", seed: int = 0,
        randomised: bool = False,
    ) -> None:  # fmt: skip
        self.config = checked_config(name, config, GpsConfig)
        metres = Field((3,), wp.float32)
        noise = {"noise": (self.config.noise, 3), "velocity_noise": (self.config.velocity_noise, 3)}
        super().__init__(
            model, name, self.config.schedule, 3, noise, mount=mount, dtype=wp.float64, seed=seed,
            randomised=randomised, others={"velocity": metres, "velocity_truth": metres, "position": metres},
        )  # fmt: skip
        self._frame = geo_frame(self.config.origin, self.config.earth == "sphere")

    @property
    def position(self) -> wp.array:
        """(W, 3) float32, measured, world axes [m]."""
        return self.frames.data["position"]

    @property
    def velocity(self) -> wp.array:
        """(W, 3) float32, measured, east, north, up [m/s]."""
        return self.frames.data["velocity"]

    @property
    def velocity_truth(self) -> wp.array:
        """(W, 3) float32, without noise, east, north, up [m/s]."""
        return self.frames.data["velocity_truth"]

    def _sample(self, simulation: StepContext) -> Sequence[Any]:
        frames = self.frames
        rings = cast(Any, GpsRings())
        for name, ring in frames.ring.items():
            setattr(rings, name, ring)
        return [
            simulation.shares.record(
                sample_gps,
                inputs=[
                    self._frame, self.mount, simulation.state.arrays, frames.tick, self.noise.arrays,
                    self.velocity_noise.arrays,
                ],
                outputs=[rings],
            )
        ]  # fmt: skip
