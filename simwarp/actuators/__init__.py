"""Actuators: motors and servos between a policy's controls and the joints of a robot."""

from __future__ import annotations

from simwarp.actuators.actuator_spec import (
    Activation,
    ActuatorSpec,
    Law,
    SitePull,
    Target,
    dc_motor,
    pd_actuator,
    servo_actuator,
    torque_actuator,
)
from simwarp.actuators.actuators import PER_WORLD, Actuators

__all__ = [
    "PER_WORLD",
    "Activation",
    "ActuatorSpec",
    "Actuators",
    "Law",
    "SitePull",
    "Target",
    "dc_motor",
    "pd_actuator",
    "servo_actuator",
    "torque_actuator",
]
