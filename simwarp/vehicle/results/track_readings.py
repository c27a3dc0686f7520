"""What is recorded of a tracked vehicle beside the motion of its chassis."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.types import WORLD
from simwarp.simulation.simulation import Simulation
from simwarp.vehicle.results.chassis_motion import ChassisMotion, matrices
from simwarp.vehicle.spec.tracked_vehicle_spec import Track
from simwarp.vehicle.tracks.shoe_construction import ShoeTrackParts
from simwarp.vehicle.tracks.tracked_vehicle import TrackedVehicle

Array = npt.NDArray[np.float64]

SIDES: Final = ("L", "R")
MOST_ARMS: Final = 16
"""Of a side, in files of records that are driven again."""


def track_columns(arms: tuple[int, int], *, pins: bool = True) -> tuple[str, ...]:
    """Names of the columns of a tracked vehicle's record.

    Args:
        arms: road wheels of the left and the right track.
        pins: with the pins' forces, of a Simulation with `joint_reactions=True`.
    """

    def both(text: str) -> list[str]:
        return [text.format(side) for side in SIDES]

    return (
        "t_s", "x_m", "y_m", "z_m", "yaw_rad", "pitch_rad", "roll_rad", "speed_mps", "yawrate_radps",
        *both("sprocket_{}_radps"), *both("track_speed_{}_mps"), "engine_radps", "engine_Nm", "gear",
        "drive_Nm", "drive_W", *both("tension_{}_N"), *both("idler_{}_m"),
        *(f"arm_{side}{k}_rad" for side, count in zip(SIDES, arms, strict=True) for k in range(count)),
        *([*both("pin_mean_{}_N"), *both("pin_max_{}_N")] if pins else ()),
        "ground_x_N", "ground_z_N", "energy_J", "throttle", "brake", "steer",
    )  # fmt: skip


def runs_backwards(track: Track) -> bool:
    """True if shoes go from the lower pin of the sprocket towards the idler: a sprocket at the rear."""
    return track.sprocket_location[0] < track.idler_location[0]


class TrackReadings:
    """Columns of a tracked vehicle from the arrays of its Simulation.

    Sprockets and tracks are positive in forward drive; the speed of a track is that of its shoes along the chain, seen
    from the chassis. `idler` is x of the idler's axis in the vehicle's frame, `ground` the force of all that is fixed
    on the vehicle, world axes, `drive_W` the power of the transmission into the driveline, `energy_J` that of the model
    (`Simulation.measure_energy`).
    """

    def __init__(self, simulation: Simulation, vehicle: TrackedVehicle) -> None:
        self._simulation, self._vehicle = simulation, vehicle
        self._sides = (vehicle.parts.left, vehicle.parts.right)
        self._tracks = (vehicle.parts.spec.left, vehicle.parts.spec.right)
        self._belts = vehicle.belts
        self._reactions = vehicle.belts is None and simulation.diagnostics.joint_reaction_force.size > 0
        shapes: Any = simulation.model.builder.shapes
        self._fixed = [index for index, shape in enumerate(shapes) if shape.body == WORLD]
        left, right = (len(side.arms) for side in self._sides)
        self.names = track_columns((left, right), pins=self._reactions)
        """Of the columns."""

    def read(self, motion: ChassisMotion, worlds: slice) -> dict[str, Array]:
        """(n,) by name, of the present state."""
        simulation, vehicle = self._simulation, self._vehicle
        q, inputs = simulation.state.joint_q.numpy()[worlds], vehicle.input.numpy()[worlds]
        found = {
            "engine_radps": vehicle.engine_speed.numpy()[worlds], "gear": vehicle.gear.numpy()[worlds].astype(float),
            "engine_Nm": vehicle.engine_torque.numpy()[worlds],
            "energy_J": simulation.measure_energy().numpy()[worlds].copy(),
            "throttle": inputs[:, 1], "brake": inputs[:, 2], "steer": inputs[:, 0],
        }  # fmt: skip
        starts, rates = simulation.model.joint_dof_start, simulation.state.joint_qd.numpy()[worlds]
        torque, line = vehicle.drive_torque.numpy()[worlds], vehicle.parts.driveline.line
        turning = sum((share * rates[:, starts[joint]] for joint, share in line.speed), np.zeros_like(torque))
        found |= {"drive_Nm": torque, "drive_W": torque * turning}
        speeds, tensions = vehicle.sprocket_speed.numpy()[worlds], vehicle.tension.numpy()[worlds]
        for k, (name, side, track) in enumerate(zip(SIDES, self._sides, self._tracks, strict=True)):
            if self._belts is None:
                assert isinstance(side, ShoeTrackParts)  # of a vehicle without belts
                moved, speed = q[:, starts[side.tensioner]], self._track_speed(side, track, motion, worlds)
            else:
                moved, speed = (array.numpy()[worlds][:, k] for array in (self._belts.idler, self._belts.speed))
            found |= {
                f"sprocket_{name}_radps": speeds[:, k], f"tension_{name}_N": tensions[:, k],
                f"track_speed_{name}_mps": speed,
                f"idler_{name}_m": track.idler_location[0] + np.cos(track.idler.slide_angle) * moved,
            }  # fmt: skip
            found |= {f"arm_{name}{index}_rad": q[:, starts[arm]] for index, arm in enumerate(side.arms)}
        force = -simulation.contacts.shape_contact_force.numpy()[worlds][:, self._fixed].sum(axis=1)
        if self._belts is not None:
            force = force + self._belts.force.numpy()[worlds].sum(axis=1)
        found |= {"ground_x_N": force[:, 0], "ground_z_N": force[:, 2]}
        return {**found, **self._pins(worlds)}

    def _track_speed(self, side: ShoeTrackParts, track: Track, motion: ChassisMotion, worlds: slice) -> Array:
        """Mean speed of the shoes along the chain, seen from the chassis [m/s]."""
        state, shoes = self._simulation.state, list(side.shoes)
        along = matrices(state.body_rot.numpy()[worlds][:, shoes].astype(float))[..., 0]
        away = state.body_x.numpy()[worlds][:, shoes] - motion.center[:, None]
        carried = motion.velocity[:, None] + np.cross(motion.omega[:, None], away)
        speed = np.einsum("wsi,wsi->ws", state.body_v.numpy()[worlds][:, shoes] - carried, along).mean(axis=1)
        forwards: Array = speed if runs_backwards(track) else -speed
        return forwards

    def _pins(self, worlds: slice) -> dict[str, Array]:
        """Mean and greatest of the pins' forces [N]."""
        if not self._reactions:
            return {}
        force = np.linalg.norm(self._simulation.diagnostics.joint_reaction_force.numpy()[worlds], axis=-1)
        found: dict[str, Array] = {}
        for name, side in zip(SIDES, self._vehicle.parts.chains, strict=True):
            pins = force[:, list(side.pins)]
            found |= {f"pin_mean_{name}_N": pins.mean(axis=1), f"pin_max_{name}_N": pins.max(axis=1)}
        return found
