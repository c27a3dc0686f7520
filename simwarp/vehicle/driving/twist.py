"""A driver for vehicles with differential steering: a forward speed and a yaw rate, as mobile robots are commanded."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import warp as wp

from simwarp.core.arrays import writable
from simwarp.core.constraints import NotNegative, Positive
from simwarp.core.types import ModelError
from simwarp.simulation.attachments import ForceElement, StepContext
from simwarp.vehicle.driving.path_tracking import full_speed, full_yaw_rate
from simwarp.vehicle.spec.parts import Spec
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.twist_kernels import TwistLaw, drive_twist


@dataclasses.dataclass(frozen=True, kw_only=True)
class TwistGains(Spec):
    """Two controllers with a feedforward and a PI: the pedals by the speed, the steering by the yaw rate.

    The defaults are for vehicles with an engine, whose throttle and brakes are forces. `twist_gains_for` makes those of
    a vehicle with differential drive, whose inputs are speeds.

    Raises:
        SpecError: a number is negative or not finite.
    """

    speed_feedforward: NotNegative = 0.0
    """Pedal per speed asked for [s/m]."""
    speed_proportional: NotNegative = 0.5
    """Pedal per error of the speed [s/m]."""
    speed_integral: NotNegative = 0.2
    """Pedal per integral of the error [1/m]."""
    yaw_feedforward: NotNegative = 0.0
    """Steering per yaw rate asked for [s/rad]."""
    yaw_proportional: NotNegative = 0.5
    """Steering per error of the yaw rate [s/rad]."""
    yaw_integral: NotNegative = 1.0
    """Steering per integral of the error [1/rad]."""
    brake_share: NotNegative = 0.2
    """Braking per negative pedal."""
    standstill: Positive = 0.1
    """Below this speed it changes between reverse and forward, and brakes hold where nothing is asked for [m/s]."""


def twist_gains_for(spec: VehicleSpec) -> TwistGains:
    """Gains for a vehicle with differential drive: the inputs that its speeds ask for at once, and a PI for slip.

    Raises:
        SpecError: it has another driveline.
    """
    fastest, turning = full_speed(spec), full_yaw_rate(spec)
    return TwistGains(
        speed_feedforward=1.0 / fastest, speed_proportional=0.2 / fastest, speed_integral=1.0 / fastest,
        yaw_feedforward=1.0 / turning, yaw_proportional=0.2 / turning, yaw_integral=2.0 / turning,
        brake_share=0.0, standstill=0.1 * fastest,
    )  # fmt: skip


class SteeredVehicle(Protocol):
    """What a `TwistDriver` needs of a vehicle: the arrays of a `Vehicle` of these names.

    Where there is an array `gear`, too, commands backwards put the vehicle in reverse.
    """

    @property
    def input_rows(self) -> wp.array:
        """(W, 1, 4) steering, throttle, braking, clutch."""
        ...

    @property
    def velocity_b(self) -> wp.array:
        """(W,) vec3 in axes of the chassis [m/s]."""
        ...

    @property
    def omega_b(self) -> wp.array:
        """(W,) vec3 in axes of the chassis [rad/s]."""
        ...


class TwistDriver(ForceElement):
    """Holds a forward speed and a yaw rate in every world: a `ForceElement` that comes before its vehicle.

    For vehicles that steer by different speeds of their sides, with `twist_gains_for(spec)`, and for others whose
    steering turns them, tracked ones with an engine, say. With both commands zero the vehicle stands on its brakes.

    Args:
        vehicle: one, whose inputs it writes.
        gains: of its controllers; `TwistGains()` when None.

    Attributes:
        command: (W, 2) forward speed [m/s], negative backwards, and yaw rate [rad/s], positive to the left. Write it at
            any time; a reset brings zeros back.

    Raises:
        ModelError: there is more than one vehicle in a world.
    """

    def __init__(self, vehicle: SteeredVehicle, gains: TwistGains | None = None) -> None:
        rows = vehicle.input_rows
        if rows.shape[1] != 1:
            raise ModelError(f"TwistDriver: vehicle must be one, got {rows.shape[1]}; make a driver for each of them")
        worlds, device = rows.shape[0], rows.device
        self.vehicle, self.gains = vehicle, TwistGains() if gains is None else gains
        self.command = writable((worlds, 2), wp.float32, device)
        self._sum: wp.array = wp.zeros(worlds, dtype=wp.vec2, device=device)
        gear = getattr(vehicle, "gear", None)
        self._gear: wp.array = wp.zeros(0, dtype=int, device=device) if gear is None else gear
        self._law = _law(self.gains)

    def _readable_title(self) -> str:
        return f" of {self.vehicle!r}"

    @property
    def memory(self) -> Mapping[str, wp.array]:
        """The command and the controllers' integrals."""
        return {"command": self.command, "error_sum": self._sum}

    def record(self, simulation: StepContext, dt: float) -> Sequence[Any]:
        """The launch that writes the inputs."""
        vehicle = self.vehicle
        return [
            simulation.shares.record(
                drive_twist,
                inputs=[dt, self._law, self.command, vehicle.velocity_b, vehicle.omega_b],
                outputs=[self._gear, self._sum, vehicle.input_rows],
            )
        ]  # fmt: skip


def _law(gains: TwistGains) -> Any:
    law: Any = TwistLaw()
    law.speed = wp.vec3(gains.speed_feedforward, gains.speed_proportional, gains.speed_integral)
    law.yaw_rate = wp.vec3(gains.yaw_feedforward, gains.yaw_proportional, gains.yaw_integral)
    law.brake_share, law.standstill = gains.brake_share, gains.standstill
    return law
