"""Actuators: motors and servos between a policy's controls and the joints of a robot."""

from __future__ import annotations

from simwarp.actuators.actuator_spec import Activation, ActuatorSpec, Law, SitePull

__all__ = ["Activation", "ActuatorSpec", "Law", "SitePull"]
