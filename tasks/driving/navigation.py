"""Estimate of a vehicle's pose: place and speed by a satellite receiver, heading by a gyroscope."""

from __future__ import annotations

from typing import Any

import torch
import warp as wp

import simwarp as sw

from ..framework.recorded_launches import TensorFunction, TensorLaunch, filled
from ..randomisation.randomness import WorldRandom
from .navigation_kernels import Navigator, advance_heading, estimate_positions

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
        name: of the vehicle, of several in a world: its noise is its own.

    Attributes:
        sensors: to be given to the simulation.
        heading: (W,) float32, integrated [rad].
        tables: readings and heading, for kernels.
    """

    def __init__(
        self, model: sw.Model, parts: sw.vehicle.VehicleParts, dt: float, decimation: int, random: WorldRandom,
        name: str = "",
    ) -> None:  # fmt: skip
        period = dt * decimation
        mount = sw.sensors.Mount(body=parts.chassis, pose=sw.pose(parts.reference))
        gps = sw.sensors.Gps(
            model, mount, sw.sensors.GpsConfig(schedule=sw.sensors.Schedule(rate=1.0 / period)), name=f"gps{name}"
        )
        imu = sw.sensors.Imu(
            model,
            mount,
            sw.sensors.ImuConfig(
                schedule=sw.sensors.Schedule(rate=1.0 / period, window=period), outputs=("gyroscope",)
            ),
            name=f"imu{name}",
        )
        self.sensors: list[Any] = [gps, imu]
        heading = wp.zeros(model.world_count, dtype=float, device=model.device)
        self.heading = sw.to_torch(heading)
        self.tables = filled(
            Navigator,
            position=gps.position,
            velocity=gps.velocity,
            rate=imu.data,
            heading=heading,
            period=period,
            place_noise=PLACE_NOISE,
            speed_noise=SPEED_NOISE,
            rate_noise=RATE_NOISE,
            rate_bias=RATE_BIAS,
            place_stream=random.stream(f"receiver{name}"),
            speed_stream=random.stream(f"receiver velocity{name}"),
            rate_stream=random.stream(f"gyroscope{name}"),
            bias_stream=random.stream(f"gyroscope bias{name}"),
        )
        device = self.heading.device
        fixed = [self.tables, random.draws]
        self._advance = TensorLaunch(advance_heading, model.world_count, fixed, device)
        results = [(torch.float32, (2,)), (torch.float32, ()), (torch.float32, ())]
        self._estimate = TensorFunction(estimate_positions, fixed, results, device)

    def advance(self) -> None:
        """Turn the heading by what the gyroscope measured over the control step that ends."""
        self._advance.launch()

    def estimate(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return place (W, 2) [m], heading (W,) [rad] and speed (W,) [m/s]."""
        place, heading, speed = self._estimate(shape=(len(self.heading),))
        return place, heading, speed
