"""Overall steering ratio of a vehicle, by its linkage alone."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from simwarp.vehicle.spec.tabulated_suspension import TabulatedSuspension
from simwarp.vehicle.spec.vehicle_spec import VehicleSpec
from simwarp.vehicle.suspensions.kinematics import travel_table

NEAR: Final = 0.01
"""Steering inputs to either side of straight ahead between which the rate is measured."""


def angle_per_steering(spec: VehicleSpec) -> float:
    """Mean angle of the wheels of the first steered axle per steering input (-1..1), straight ahead, as the linkage
    turns them at the height at which the vehicle is built [rad]; NaN where nothing is steered.

    The angle of a steering wheel at full input over this is the overall steering ratio of ISO 8855.
    """
    for index, axle in enumerate(spec.axles):
        if isinstance(axle.suspension, TabulatedSuspension):
            if len(axle.suspension.steering) > 1:
                return _of_tables(axle.suspension)
        elif axle.steering is not None:
            table = travel_table(spec, index, 0.0, np.array([-NEAR, NEAR]))
            right, left = table.steer.mean(axis=1)
            return float(left - right) / (2.0 * NEAR) or math.nan
    return math.nan


def _of_tables(suspension: TabulatedSuspension) -> float:
    """By the columns beside straight ahead, at no travel."""
    angles = []
    for near in (-NEAR, NEAR):
        headings = []
        for wheel in (suspension.left, suspension.right):
            ahead, up = (
                np.interp(near, suspension.steering, _row(suspension, grid)) for grid in (wheel.axis_x, wheel.axis_z)
            )
            # the axis points to the left: a wheel that heads to the left leans it backwards
            headings.append(-math.asin(float(ahead) / math.sqrt(1.0 - float(up) ** 2)))
        angles.append(0.5 * sum(headings))
    return (angles[1] - angles[0]) / (2.0 * NEAR)


def _row(suspension: TabulatedSuspension, grid: tuple[tuple[float, ...], ...]) -> list[float]:
    """Of a table, at no travel."""
    columns = np.transpose(grid)
    return [float(np.interp(0.0, suspension.travel, column)) for column in columns]
