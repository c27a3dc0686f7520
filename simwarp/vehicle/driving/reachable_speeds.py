"""How fast a vehicle's engine and gears let it drive, and the gear that suits a speed: by its description alone."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from simwarp.vehicle.driving.path_tracking import full_speed
from simwarp.vehicle.initial_velocity import start_of
from simwarp.vehicle.spec.vehicle_spec import (
    AutomaticCVT,
    AutomaticMap,
    AutomaticShafts,
    DifferentialDrive,
    Engine,
    EngineMap,
    EngineShafts,
    EngineSimple,
    MultiAxleDriveline,
    Points,
    ShaftsDriveline2WD,
    ShaftsDriveline4WD,
    SimpleDriveline,
    VehicleSpec,
)

HELD_SHARE: Final = 0.85
"""Of the top speed: what is left of the torque holds the speed in a turn."""


def shaft_speed(spec: VehicleSpec, speed: float) -> float:
    """Of the drive shaft of a vehicle that rolls straight on at a speed [m/s]; 0 without one [rad/s]."""

    def behind(axle: int, ratio: float) -> float:
        return speed / spec.axles[axle].tire.radius / ratio

    match spec.driveline:
        case ShaftsDriveline2WD() as line:
            return behind(line.axle, line.gear_ratio)
        case ShaftsDriveline4WD() as line:
            front, rear = line.axles
            return 0.5 * (behind(front, line.front_gear_ratio) + behind(rear, line.rear_gear_ratio))
        case SimpleDriveline() as line:
            front, rear = line.axles
            share = line.front_torque_fraction
            return share * behind(front, line.front_gear_ratio) + (1.0 - share) * behind(rear, line.rear_gear_ratio)
        case MultiAxleDriveline() as line:
            return sum(behind(axle, line.gear_ratio) for axle in line.axles) / len(line.axles)
    return 0.0


def top_speed(spec: VehicleSpec) -> float:
    """At which the engine in its highest gear has no torque left, on unloaded tires [m/s]; infinite without an engine.

    Rolling and the air make a vehicle slower than that.
    """
    if isinstance(spec.driveline, DifferentialDrive):
        return full_speed(spec)
    gears = spec.transmission
    if spec.engine is None or gears is None:
        return math.inf
    highest = gears.max_ratio if isinstance(gears, AutomaticCVT) else max(gears.forward_ratios)
    return highest * _fastest(spec.engine) / shaft_speed(spec, 1.0)


def _fastest(engine: Engine) -> float:
    """Speed of an engine at full throttle that nothing resists [rad/s]."""
    match engine:
        case EngineSimple():
            return engine.max_speed
        case EngineMap():
            return min(engine.max_speed, _last_positive(engine.full_throttle, ()))
        case EngineShafts():
            return _last_positive(engine.torque, engine.losses)


def _last_positive(torque: Points, losses: Points) -> float:
    """Where the sum of two curves falls to zero for good; the end of the first one where it does not."""
    x = np.unique([at for at, _ in (*torque, *losses)])
    total = sum((np.interp(x, *np.transpose(curve)) for curve in (torque, losses) if curve), np.zeros(len(x)))
    above = np.flatnonzero(total > 0.0)
    if above.size == 0 or above[-1] == len(x) - 1:
        return float(torque[-1][0])
    k = int(above[-1])
    return float(x[k] + (x[k + 1] - x[k]) * total[k] / (total[k] - total[k + 1]))


def held_speed(spec: VehicleSpec, usual: float) -> float:
    """A usual speed [m/s], or what a vehicle can hold."""
    return min(usual, HELD_SHARE * top_speed(spec))


def held_gear(spec: VehicleSpec, speed: float) -> int | None:
    """The gear that an automatic transmission takes at a speed [m/s]; None where nothing shifts by itself."""
    if not isinstance(spec.transmission, (AutomaticMap, AutomaticShafts)):
        return None
    return start_of(spec.transmission, speed, shaft_speed(spec, speed), None).gear
