"""Transmissions with shafts of their own: motor shaft, input shaft, gears as a coupling, a manual clutch."""

from __future__ import annotations

import dataclasses
from typing import Final

from simwarp.model.builder import ModelBuilder
from simwarp.vehicle.drivetrain.drivelines import DrivelineParts, add_clutch
from simwarp.vehicle.initial_velocity import Rolling, gear_ratio, turn_shaft
from simwarp.vehicle.spec.vehicle_spec import AutomaticShafts, ManualShafts, SpecError, Transmission

EXCHANGE_TIME: Final = 1.0e-3
"""The drive shaft of a transmission slips against that of the driveline like a viscous coupling of inertia / this time
[s]: what the exchange of speed and torque between the two amounts to in the models that the data are from.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TransmissionParts:
    """Shafts and couplings of a transmission, in the builder; -1 of those that it does not have."""

    motor_shaft: int = -1
    """That the engine drives."""
    input_shaft: int = -1
    """Between converter or clutch and gears."""
    gear_coupling: int = -1
    clutch_shaft: int = -1
    """Slip of a manual clutch: a coordinate whose dry friction is the clutch's torque."""


def add_transmission(
    builder: ModelBuilder, prefix: str, gears: Transmission | None, driveline: DrivelineParts, start: Rolling, *,
    exchange_time: float = EXCHANGE_TIME,
) -> TransmissionParts:  # fmt: skip
    """Shafts between the engine and a driveline; none of transmissions whose engine turns with the drive shaft.

    Args:
        builder: of the model.
        prefix: of the shafts' names.
        gears: the transmission.
        driveline: that it drives.
        start: gear and speeds.
        exchange_time: of the slip behind the gears [s]; see `EXCHANGE_TIME`.

    Raises:
        SpecError: there is no driveline.
    """
    if not isinstance(gears, (AutomaticShafts, ManualShafts)):
        return TransmissionParts()
    if not driveline.speed:
        raise SpecError(f"transmission: '{gears.template}' needs a driveline; add one, such as 'simple'")
    motor = builder.add_shaft(f"{prefix}motor_shaft", inertia=gears.motorshaft_inertia)
    inner = builder.add_shaft(f"{prefix}gear_shaft", inertia=gears.input_inertia)
    for shaft in (motor, inner):
        turn_shaft(builder, shaft, start.motor_speed)
    # neutral takes the coupling out at the first step
    ratio = gear_ratio(gears, start.gear) or gears.forward_ratios[0]
    coupling = builder.add_coupling(
        f"{prefix}gears", [(inner, ratio), *((joint, -value) for joint, value in driveline.speed)], offset=0.0,
        damping=gears.driveshaft_inertia / exchange_time,
    )  # fmt: skip
    slip = -1
    if isinstance(gears, ManualShafts):
        inertia = min(gears.motorshaft_inertia, gears.input_inertia)
        slip = add_clutch(builder, f"{prefix}clutch", (motor, inner), inertia, gears.clutch_limit)
    return TransmissionParts(motor_shaft=motor, input_shaft=inner, gear_coupling=coupling, clutch_shaft=slip)
