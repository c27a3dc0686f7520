"""Motion of a vehicle's frame of reference as it is recorded, on wheels or tracks."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from simwarp.core.host_views import HostViews
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle

Array = npt.NDArray[np.float64]


def matrices(q: Array) -> Array:
    """(..., 3, 3) rotation matrices of (..., 4) xyzw quaternions."""
    x, y, z, w = (q[..., index] for index in range(4))
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    xw, yw, zw = x * w, y * w, z * w
    found = np.empty((3, 3, *q.shape[:-1]))
    found[0, 0], found[0, 1], found[0, 2] = 1 - 2 * (yy + zz), 2 * (xy - zw), 2 * (xz + yw)
    found[1, 0], found[1, 1], found[1, 2] = 2 * (xy + zw), 1 - 2 * (xx + zz), 2 * (yz - xw)
    found[2, 0], found[2, 1], found[2, 2] = 2 * (xz - yw), 2 * (yz + xw), 1 - 2 * (xx + yy)
    return np.moveaxis(found, (0, 1), (-2, -1))


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
        return ChassisMotion.made(vehicle, ChassisMotion.take(simulation, vehicle, worlds, HostViews()))

    @staticmethod
    def take(simulation: Simulation, vehicle: AnyVehicle, worlds: slice, views: HostViews) -> dict[str, Array]:
        """Copies of what the present motion is made of; waits for the device."""
        state, chassis = simulation.state, vehicle.parts.chassis
        bodies = {"rotation": state.body_rot, "center": state.body_x, "velocity": state.body_v}
        bodies["omega"] = state.body_omega
        # the arrays themselves go on
        found = {name: views.of(array)[worlds, chassis].astype(float) for name, array in bodies.items()}
        return found | {"time": views.of(state.world_time)[worlds].copy()}

    @staticmethod
    def made(vehicle: AnyVehicle, taken: Mapping[str, Array]) -> ChassisMotion:
        """The motion of what was taken, at one or more times one after the other."""
        rotation, center = matrices(taken["rotation"]), taken["center"]
        velocity, omega = taken["velocity"], taken["omega"]
        reference = vehicle.parts.reference
        # term by term: a product of matrices rounds as its memory lies, which is not the same for one world and many
        arm = rotation[:, :, 0] * reference[0] + rotation[:, :, 1] * reference[1] + rotation[:, :, 2] * reference[2]
        return ChassisMotion(
            time=taken["time"],
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
