"""Vehicles commanded by ROS 2: twists and Ackermann commands, turned into what a driver of the vehicle holds."""

from __future__ import annotations

import functools
import math
from typing import Any, Final

import numpy as np

from simwarp.core.types import ModelError
from simwarp.ros2.command_topics import (
    ACKERMANN,
    ACKERMANN_STAMPED,
    CMD_VEL,
    Apply,
    CommandError,
    CommandTopic,
    checked_numbers,
    velocity_topic,
)
from simwarp.vehicle.driving.path_tracking import wheelbase
from simwarp.vehicle.driving.steering_ratio import steered_axle, steering_angles
from simwarp.vehicle.driving.twist import TwistDriver, TwistGains, twist_gains_for
from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec
from simwarp.vehicle.spec.vehicle_spec import DifferentialDrive, VehicleSpec
from simwarp.vehicle.tracks.tracked_vehicle import AnyVehicle

STEERED: Final = TwistGains(yaw_feedforward=1.0, yaw_proportional=0.0, yaw_integral=0.0)
"""Of a vehicle with a steering: the second command is the steering input."""
GRID: Final = np.linspace(-1.0, 1.0, 41)
"""Steering inputs at which the angle of the wheels is known; linear between them."""


class SteeringMap:
    """Steering inputs for angles of a virtual wheel in the middle of the front axle, as Ackermann commands have them.

    Args:
        spec: of a vehicle with a steered axle.

    Attributes:
        wheelbase: distance of the first and the last axle [m].
        least, most: angles at full steering to the right and to the left [rad].

    Raises:
        ModelError: the linkage does not reach.
    """

    def __init__(self, spec: VehicleSpec) -> None:
        axle = steered_axle(spec)
        assert axle is not None, spec.name
        angles = steering_angles(spec, GRID)
        places = [each.location[0] for each in spec.axles]
        if spec.axles[axle].location[0] < 0.5 * (max(places) + min(places)):
            angles = -angles  # wheels behind turn the other way
        reached = np.flatnonzero(np.isfinite(angles))
        if len(reached) and angles[reached[-1]] < angles[reached[0]]:
            reached = reached[::-1]
        if len(reached) < 2 or not (np.diff(angles[reached]) > 0.0).all():
            raise ModelError(f"vehicle '{spec.name}': its steering does not reach from lock to lock; see simwarp rig")
        self._inputs, self._angles = GRID[reached], angles[reached]
        self.wheelbase = wheelbase(spec)
        self.least, self.most = float(self._angles[0]), float(self._angles[-1])

    def input_for(self, angle: float) -> float:
        """Steering input, -1 to 1, for an angle [rad]; at its end where the wheels turn no further."""
        return float(np.interp(angle, self._angles, self._inputs))

    def angle_for(self, speed: float, turn: float) -> float:
        """Angle of the virtual wheel for a speed [m/s] and a yaw rate [rad/s]: it rolls without slip. 0 at standstill,
        where a car cannot turn [rad].
        """
        return 0.0 if speed == 0.0 else math.atan(self.wheelbase * turn / speed)


class VehicleCommands:
    """Topics that a vehicle is driven by, and the driver that holds what they say.

    A vehicle with a steering takes `/cmd_vel` and `/ackermann_cmd`, others `/cmd_vel`.

    Args:
        vehicle: one of each world.
        spec: its description.
        world: that is driven.
        stamped: `/cmd_vel` is TwistStamped.

    Attributes:
        driver: a force element, to come before the vehicle's.
        map: of its steering; None: it has none.

    Raises:
        ModelError: nothing drives its wheels, or its steering does not reach.
    """

    def __init__(self, vehicle: AnyVehicle, spec: AnyVehicleSpec, *, world: int = 0, stamped: bool = False) -> None:
        self._world, self._stamped = world, stamped
        self.map: SteeringMap | None = None
        gains = TwistGains()
        if isinstance(spec, VehicleSpec):
            if spec.driveline is None:
                raise ModelError(f"vehicle '{spec.name}': has no driveline that could move it; add one")
            if isinstance(spec.driveline, DifferentialDrive):
                gains = twist_gains_for(spec)
            elif steered_axle(spec) is not None:
                gains, self.map = STEERED, SteeringMap(spec)
        driven: Any = vehicle
        self.driver = TwistDriver(driven, gains)
        self._speed, self._angle = 0.0, 0.0
        self._wanted = (0.0, 0.0, 0.0, 0.0)
        self._source = CMD_VEL

    def topics(self) -> list[CommandTopic]:
        """What it listens to; the first one is the usual one."""
        rests = {topic: functools.partial(self._stand, topic) for topic in (CMD_VEL, ACKERMANN)}
        found = [velocity_topic(self._twist, rests[CMD_VEL], stamped=self._stamped, sideways=False)]
        if self.map is not None:
            found.append(CommandTopic(ACKERMANN, ACKERMANN_STAMPED, self._read, rests[ACKERMANN]))
        return found

    def advance(self, dt: float) -> None:
        """Moves speed and angle towards an Ackermann command that bounds their rates; before each control step."""
        speed, angle, acceleration, rate = self._wanted
        self._speed = towards(self._speed, speed, acceleration * dt)
        self._angle = towards(self._angle, angle, rate * dt)
        if self.map is not None:
            self._set(self._speed, self.map.input_for(self._angle))

    def rest(self) -> None:
        """Stands still, as after a reset."""
        self._speed = self._angle = 0.0
        self._wanted = (0.0, 0.0, 0.0, 0.0)
        self._set(0.0, 0.0)

    def _twist(self, ahead: float, left: float, turn: float) -> None:
        if self.map is None:
            self._set(ahead, turn)
        else:
            self._drive(CMD_VEL, ahead, self.map.angle_for(ahead, turn))

    def _drive(self, source: str, speed: float, angle: float, acceleration: float = 0.0, rate: float = 0.0) -> None:
        self._source, self._wanted = source, (speed, angle, acceleration, rate)

    def _stand(self, topic: str) -> None:
        """Stands still, unless another topic drives by now."""
        if topic == self._source:
            self._twist(0.0, 0.0, 0.0)

    def _set(self, first: float, second: float) -> None:
        self.driver.command[self._world, 0] = first
        self.driver.command[self._world, 1] = second

    def _read(self, message: Any) -> Apply:
        """An AckermannDriveStamped: rates of 0 mean at once, as its definition says; the jerk is not used.

        Raises:
            CommandError: a number is not finite, or a rate is negative.
        """
        drive = message.drive
        values = {
            field: checked_numbers(ACKERMANN, f"drive.{field}", getattr(drive, field))[0]
            for field in ("speed", "steering_angle", "acceleration", "steering_angle_velocity")
        }
        for field in ("acceleration", "steering_angle_velocity"):
            if values[field] < 0.0:
                raise CommandError(f"{ACKERMANN}: drive.{field} must be >= 0, got {values[field]:g}; 0 means at once")
        speed, angle, acceleration, rate = values.values()
        return lambda: self._drive(ACKERMANN, speed, angle, acceleration, rate)


def towards(value: float, target: float, most: float) -> float:
    """A value one step nearer to a target: by `most`, at once where that is 0."""
    return target if most == 0.0 or abs(target - value) <= most else value + math.copysign(most, target - value)
