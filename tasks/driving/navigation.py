"""Estimate of a vehicle's pose: place and speed by a satellite receiver, heading by a gyroscope."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch

if TYPE_CHECKING:
    from simwarp import Model
    from simwarp.vehicle import VehicleParts

    from ..randomisation.randomness import WorldRandom

PLACE_NOISE = 0.1
"""Of the receiver, per axis [m]."""
SPEED_NOISE = 0.05
"""Of the receiver's velocity, per axis [m/s]."""
RATE_NOISE = 0.01
"""Of the gyroscope, white [rad/s]."""
RATE_BIAS = 0.002
"""Of the gyroscope, its bias in an episode [rad/s]."""


class Navigation:
    """A receiver and a gyroscope on the chassis, both read once per control step.

    Their noise is drawn by the task, world by world: the sensors' own would know neither the episodes of a seed nor the
    world's place in a larger batch.

    Args:
        model: whose worlds are measured.
        parts: of the vehicle.
        dt: physics step [s].
        decimation: physics steps per control step.
        random: draws the noise.

    Attributes:
        sensors: to be given to the simulation.
        heading: (W,) float32, integrated [rad].
    """

    def __init__(self, model: Model, parts: VehicleParts, dt: float, decimation: int, random: WorldRandom) -> None:
        from simwarp import pose
        from simwarp.sensors import Gps, GpsConfig, Imu, ImuConfig, Mount, Schedule

        self._period = dt * decimation
        self._random = random
        rate = 1.0 / self._period
        mount = Mount(body=parts.chassis, pose=pose(parts.reference))
        self._gps = Gps(model, mount, GpsConfig(schedule=Schedule(rate=rate)))
        self._imu = Imu(
            model, mount, ImuConfig(schedule=Schedule(rate=rate, window=self._period), outputs=("gyroscope",))
        )
        self.sensors: list[Any] = [self._gps, self._imu]
        from simwarp import to_torch

        self._position, self._velocity = to_torch(self._gps.position), to_torch(self._gps.velocity)
        self._rate = to_torch(self._imu.data)[:, 2]
        self.heading = torch.zeros_like(self._rate)

    def begin(self, world_mask: torch.Tensor, heading: torch.Tensor) -> None:
        """Set the heading (W,) [rad] at the beginning of an episode."""
        self.heading.copy_(torch.where(world_mask, heading.float(), self.heading))

    def advance(self) -> None:
        """Turn the heading by what the gyroscope measured over the control step that ends."""
        bias = self._random.normal("gyroscope bias", std=RATE_BIAS)
        noise = self._random.normal("gyroscope", std=RATE_NOISE, per_step=True)
        self.heading += self._period * (self._rate + (bias + noise).squeeze(1))

    def estimate(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return place (W, 2) [m], heading (W,) [rad] and speed (W,) [m/s]."""
        place = self._position[:, :2] + self._random.normal("receiver", std=PLACE_NOISE, size=2, per_step=True)
        noise = self._random.normal("receiver velocity", std=SPEED_NOISE, size=2, per_step=True)
        return place, self.heading, (self._velocity[:, :2] + noise).norm(dim=1)
