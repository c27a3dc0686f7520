"""Engine and transmission descriptions as the tables of `kernels.powertrain`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from simwarp.core.piecewise_linear import function_arrays
from simwarp.model.model import Model
from simwarp.vehicle.drivetrain.drivelines import DrivelineParts
from simwarp.vehicle.drivetrain.transmissions import TransmissionParts
from simwarp.vehicle.initial_velocity import Rolling
from simwarp.vehicle.powertrain_kernels import EngineKind, Powertrain, PowertrainState, TransmissionKind
from simwarp.vehicle.spec.vehicle_spec import (
    AutomaticCVT,
    AutomaticMap,
    AutomaticShafts,
    Engine,
    EngineMap,
    EngineShafts,
    EngineSimple,
    ManualShafts,
    Points,
    Transmission,
)

FLAT: Points = ((0.0, 0.0), (1.0, 0.0))


def powertrain_tables(
    model: Model, driveline: DrivelineParts, gears: TransmissionParts, engine: Engine | None,
    transmission: Transmission | None,
) -> Powertrain:  # fmt: skip
    """Constant data of a powertrain on the model's device."""
    table = Powertrain()

    def dof(joint: int) -> int:
        return -1 if joint < 0 else model.joint_dof_start[joint]

    table.motor_dof, table.input_dof = dof(gears.motor_shaft), dof(gears.input_shaft)
    table.drive_dof, table.slip_dof = dof(driveline.shaft), dof(gears.clutch_shaft)
    table.gear_coupling = gears.gear_coupling
    table.drive_inertia, table.shaft_reaction = driveline.inertia, driveline.shaft_reaction
    table.wheel_reaction = driveline.wheel_reaction
    split = driveline.split
    table.split_count = len(split)
    table.split_dof = _array([[dof(left), dof(right)] for left, right, *_ in split] or [[0, 0]], int, model)
    table.split_share = _array([entry[2] for entry in split] or [0.0], float, model)
    table.split_ratio = _array([entry[3] for entry in split] or [1.0], float, model)
    table.split_bias = _array([entry[4] for entry in split] or [1.0], float, model)
    curves = [*_engine(table, engine), *_transmission(table, transmission, model)]
    table.curve_start, table.curve_x, table.curve_y = function_arrays(curves, float, model.device)
    return table


def powertrain_state(starts: Sequence[Rolling], model: Model) -> Any:
    """The state of all worlds: the gears and the speeds that their vehicles start with, no shift yet."""
    state: Any = PowertrainState()
    shape = (model.world_count, len(starts))

    def rows(values: Any, dtype: type) -> Any:
        return _array(np.broadcast_to(values, shape), dtype, model)

    state.gear = rows([start.gear for start in starts], int)
    state.shift_time = wp.full(shape, -1.0e9, dtype=wp.float64, device=model.device)
    motor, drive = [start.motor_speed for start in starts], [start.drive_speed for start in starts]
    speeds = {"engine_speed": np.abs(motor), "last_input": motor, "last_drive": drive}
    for name in ("engine_speed", "engine_torque", "drive_speed", "drive_torque", "last_input", "last_drive"):
        setattr(state, name, rows(speeds.get(name, 0.0), float))
    return state


def _array(values: Any, dtype: type, model: Model) -> Any:
    kind = np.int32 if dtype is int else np.float32
    return wp.array(np.asarray(values, kind), dtype=dtype, device=model.device)


def _engine(table: Powertrain, engine: Engine | None) -> tuple[Points, Points]:
    """Numbers of the engine; returns its curves at full and at no throttle."""
    match engine:
        case EngineSimple():
            table.engine = int(EngineKind.SIMPLE)
            table.max_torque, table.max_power, table.max_speed = engine.max_torque, engine.max_power, engine.max_speed
        case EngineMap():
            table.engine, table.max_speed = int(EngineKind.MAP), engine.max_speed
            return engine.full_throttle, engine.zero_throttle
        case EngineShafts():
            table.engine = int(EngineKind.SHAFTS)
            return engine.torque, engine.losses
    return FLAT, FLAT


def _transmission(table: Powertrain, gears: Transmission | None, model: Model) -> tuple[Points, Points]:
    """Numbers of the transmission; returns the curves of its converter."""
    forward: tuple[float, ...] = (1.0,)
    reverse = -1.0
    down: list[float] = [0.0]
    up: list[float] = [np.inf]
    curves = FLAT, FLAT
    match gears:
        case AutomaticMap():
            table.transmission = int(TransmissionKind.AUTOMATIC_MAP)
            forward, reverse = gears.forward_ratios, gears.reverse_ratio
            down, up = [pair[0] for pair in gears.shift_points], [pair[1] for pair in gears.shift_points]
        case AutomaticShafts():
            table.transmission, table.latency = int(TransmissionKind.AUTOMATIC_SHAFTS), gears.shift_latency
            forward, reverse = gears.forward_ratios, gears.reverse_ratio
            down, up = [gears.downshift_speed] * len(forward), [gears.upshift_speed] * len(forward)
            curves = gears.capacity_factor, gears.torque_ratio
            table.input_inertia, table.gear_reaction = gears.input_inertia, gears.reaction
        case ManualShafts():
            table.transmission, table.clutch_limit = int(TransmissionKind.MANUAL_SHAFTS), gears.clutch_limit
            forward, reverse = gears.forward_ratios, gears.reverse_ratio
            down, up = [-np.inf] * len(forward), [np.inf] * len(forward)
        case AutomaticCVT():
            table.transmission, table.efficiency = int(TransmissionKind.CVT), gears.efficiency
            table.ratio_low, table.ratio_high = gears.min_ratio, gears.max_ratio
            table.speed_low, table.speed_high = gears.speed_begin, gears.speed_end
    table.gear_count = len(forward)
    table.ratio = _array([reverse, 0.0, *forward], float, model)
    table.shift_down, table.shift_up = _array(down, float, model), _array(up, float, model)
    return curves
