"""Which speeds, gains and steering laws suit a vehicle: what manoeuvres take where nothing else is asked for."""

from __future__ import annotations

from typing import Final

from simwarp.vehicle.driving.drivers import HELD, ScriptSpec
from simwarp.vehicle.driving.path_tracking import (
    LookAhead,
    PIDGains,
    Unicycle,
    full_speed,
    look_ahead_for,
    unicycle_for,
    wheelbase,
)
from simwarp.vehicle.driving.reachable_speeds import held_speed
from simwarp.vehicle.spec.parts import Points
from simwarp.vehicle.spec.vehicle_spec import DifferentialDrive, SpecError, VehicleSpec

STEERING_RUN: Final = 12.0
BRAKING_RUN: Final = 15.0
"""Speeds of the recorded runs, for vehicles whose description has no other ones [m/s]."""
RADIUS: Final = 30.0
"""Of a circle [m], and its most in wheelbases."""
WHEELBASES: Final = 15.0


def usual_speed(spec: VehicleSpec) -> float:
    """Of manoeuvres with steering [m/s]."""
    return spec.maneuver_defaults.speed_of_steering_run or held_speed(spec, STEERING_RUN)


def usual_radius(spec: VehicleSpec, given: float | None, usual: float) -> float:
    """Of a circle [m]: what the description gives, or a usual one that is not too large for the vehicle."""
    return given or min(usual, WHEELBASES * wheelbase(spec))


def speed_gains(spec: VehicleSpec) -> PIDGains:
    """Of the pedals that hold a speed: the reference runs' own, or of a throttle that is a speed."""
    if isinstance(spec.driveline, DifferentialDrive):
        share = 1.0 / full_speed(spec)
        return PIDGains(proportional=0.5 * share, integral=2.0 * share)
    return PIDGains(proportional=0.5, integral=0.1)


def scripted(spec: VehicleSpec, *, speed: Points, braking: Points, steering: Points = HELD) -> ScriptSpec:
    """A script that holds its speeds by the vehicle's gains."""
    gains = speed_gains(spec)
    return ScriptSpec(
        steering=steering, braking=braking, speed=speed, proportional=gains.proportional, integral=gains.integral
    )


def steering_for(spec: VehicleSpec, seconds: float = 0.0, speed: float = 0.0) -> LookAhead | Unicycle:
    """Steering along a path: by yaw rate where it turns on the spot, else by a point ahead."""
    if isinstance(spec.driveline, DifferentialDrive):
        return unicycle_for(spec)
    return look_ahead_for(spec, seconds, speed)


def needs_axles(spec: VehicleSpec) -> None:
    """Refuses vehicles that no driver can lead along a path.

    Raises:
        SpecError: it has one axle.
    """
    if len(spec.axles) < 2:
        raise SpecError("axles: must be two or more for a driver who follows a path, got 1; take another manoeuvre")
