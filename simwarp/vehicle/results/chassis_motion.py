"""Motion of a vehicle's frame of reference as it is recorded, on wheels or tracks."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle

Array = npt.NDArray[np.float64]


def matrices(q: Array) -> Array:
    """(..., 3, 3) rotation matrices of (..., 4) xyzw quaternions."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


@dataclasses.dataclass(frozen=True)
class ChassisMotion:
    """Of some worlds, n of them.

    Attributes:
        time: (n,) of the simulation [s].
        rotation: (n, 3, 3) of the chassis.
        center: (n, 3) its centre of mass [m].
        position: (n, 3) of the frame of reference [m].
        velocity: (n, 3) of the centre of mass [m/s].
        omega: (n, 3) world axes [rad/s].
        speed: (n,) of the frame of reference, forwards [m/s].
        yaw_rate: (n,) about the chassis' z [rad/s].
    """

    time: Array
    rotation: Array
    center: Array
    position: Array
    velocity: Array
    omega: Array
    speed: Array
    yaw_rate: Array

    @staticmethod
    def of(simulation: Simulation, vehicle: AnyVehicle, worlds: slice) -> ChassisMotion:
        """The present one; waits for the device."""
        state, parts = simulation.state, vehicle.parts
        rotation = matrices(state.body_rot.numpy()[worlds, parts.chassis].astype(float))
        velocity = state.body_v.numpy()[worlds, parts.chassis].astype(float)
        omega = state.body_omega.numpy()[worlds, parts.chassis].astype(float)
        arm = rotation @ parts.reference
        center = state.body_x.numpy()[worlds, parts.chassis].copy()
        return ChassisMotion(
            time=state.world_time.numpy()[worlds].copy(),  # the array itself goes on
            rotation=rotation, center=center, position=center + arm, velocity=velocity, omega=omega,
            speed=np.einsum("wi,wi->w", velocity + np.cross(omega, arm), rotation[:, :, 0]),
            yaw_rate=np.einsum("wi,wi->w", omega, rotation[:, :, 2]),
        )  # fmt: skip

    @property
    def level_axes(self) -> Array:
        """(n, 3, 3): x of the chassis laid level, y to the left and z up as columns: ISO 8855's intermediate axes."""
        x = self.rotation[:, :, 0] * (1.0, 1.0, 0.0)
        x /= np.linalg.norm(x, axis=1)[:, None]
        z = np.broadcast_to((0.0, 0.0, 1.0), x.shape)
        return np.stack([x, np.cross(z, x), z], axis=-1)

    def columns(self) -> dict[str, Array]:
        """(n,) by the names of a record."""
        x, rotation = self.position, self.rotation
        return {
            "x_m": x[:, 0], "y_m": x[:, 1], "z_m": x[:, 2],
            "yaw_rad": np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]),
            "pitch_rad": -np.arcsin(np.clip(rotation[:, 2, 0], -1.0, 1.0)),
            "roll_rad": np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2]),
            "speed_mps": self.speed, "yawrate_radps": self.yaw_rate,
        }  # fmt: skip
