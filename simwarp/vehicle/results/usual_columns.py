"""Units and meanings of recorded columns: a unit is the ending of a name, axes and signs are those of ISO 8855."""

from __future__ import annotations

import fnmatch
from typing import Final

UNITS: Final = {
    "s": "s", "m": "m", "mps": "m/s", "mps2": "m/s²", "rad": "rad", "radps": "rad/s", "N": "N", "Nm": "N·m", "W": "W",
    "J": "J",
}  # fmt: skip
"""By the last word of a name; a name that ends in none of them is of a number without a unit."""

MEANINGS: Final = {
    "t_s": "time since the manoeuvre's zero",
    "x_m": "vehicle's frame of reference, world x",
    "y_m": "the same, world y",
    "z_m": "the same, world z, up",
    "yaw_rad": "from the world's x to the chassis' x, positive to the left",
    "pitch_rad": "of the chassis, positive where the nose goes down",
    "roll_rad": "of the chassis, positive where it leans to the right",
    "speed_mps": "of the frame of reference along the chassis' x, positive forwards",
    "yawrate_radps": "about the chassis' z, positive to the left",
    "latacc_com_mps2": "acceleration of the chassis' centre of mass to the left, level axes; mean since the row before",
    "v_times_yawrate_mps2": "speed times yaw rate",
    "omega_*_radps": "of the wheel seen from the chassis, positive forwards",
    "engine_radps": "speed of the engine's shaft",
    "engine_Nm": "torque of the engine alone",
    "gear": "-1 reverse, 0 neutral, from 1 on forward",
    "Fz_*_N": "the ground's force on the wheel along the ground's normal, positive off the ground",
    "throttle": "input, 0 to 1",
    "brake": "input, 0 to 1",
    "steer": "input, -1 to 1, positive to the left",
    "steerangle_*_rad": "of the wheel about the chassis' z, positive to the left",
    "articulation*_rad": "yaw of a trailer seen from the unit before it, positive to the left",
    "sink_*_m": "depth of the soil below the wheel's centre",
    "slip": "of the driven wheels, positive when driving",
    "pull_N": "pull at the carriage, positive forwards",
    "pull_per_weight": "pull over the vehicle's weight",
    "wheel_torque_Nm": "the ground's torque on the wheels, positive against their forward turn",
    "sprocket_*_radps": "of the sprocket seen from the hull, positive forwards",
    "track_speed_*_mps": "mean speed of the shoes along the chain seen from the hull, positive forwards",
    "drive_Nm": "torque of the transmission on the driveline",
    "drive_W": "power of the transmission into the driveline",
    "tension_*_N": "half the tensioner's force: of each run around the idler",
    "idler_*_m": "x of the idler's axis in the vehicle's frame of reference",
    "arm_*_rad": "of the road wheel's arm, positive with the wheel up",
    "pin_mean_*_N": "mean force of the pins",
    "pin_max_*_N": "greatest force of a pin",
    "ground_?_N": "force of all that is fixed on the vehicle, world axes",
    "energy_J": "mechanical energy of the whole model",
}  # fmt: skip
"""Of the usual columns; `*` stands for a wheel or a side. Names of channels that are chosen come with theirs."""


def unit_of(name: str) -> str:
    """Unit of a column, "1" of a number without one."""
    word = name.rpartition("_")[2]
    return UNITS.get(word, "1") if word != name else "1"


def meaning_of(name: str) -> str:
    """What a usual column holds, with axes and sign; empty for other names."""
    return next((text for pattern, text in MEANINGS.items() if fnmatch.fnmatchcase(name, pattern)), "")
