"""Angles of the road wheels over the steering input, by the linkage alone; the overall steering ratio."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

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
    right, left = steering_angles(spec, np.array([-NEAR, NEAR]))
    return float(left - right) / (2.0 * NEAR) or math.nan


def steered_axle(spec: VehicleSpec) -> int | None:
    """Index of the first axle that a steering turns; None: there is none."""
    for index, axle in enumerate(spec.axles):
        if isinstance(axle.suspension, TabulatedSuspension):
            if len(axle.suspension.steering) > 1:
                return index
        elif axle.steering is not None:
            return index
    return None


def steering_angles(spec: VehicleSpec, steering: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Mean angles of the wheels of the first steered axle at steering inputs (n,), at the height at which the vehicle
    is built.

    Returns:
        (n,) positive to the left [rad]; NaN where the linkage does not reach, or nothing is steered.
    """
    index = steered_axle(spec)
    if index is None:
        return np.full(len(steering), math.nan)
    suspension = spec.axles[index].suspension
    if isinstance(suspension, TabulatedSuspension):
        return _of_tables(suspension, steering)
    return np.asarray(travel_table(spec, index, 0.0, steering).steer.mean(axis=1), np.float64)


def _of_tables(suspension: TabulatedSuspension, steering: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """By the columns of the tables, at no travel."""
    headings = []
    for wheel in (suspension.left, suspension.right):
        ahead, up = (
            np.interp(steering, suspension.steering, _row(suspension, grid)) for grid in (wheel.axis_x, wheel.axis_z)
        )
        # the axis points to the left: a wheel that heads to the left leans it backwards
        headings.append(-np.arcsin(ahead / np.sqrt(1.0 - up**2)))
    return np.asarray(0.5 * (headings[0] + headings[1]), np.float64)


def _row(suspension: TabulatedSuspension, grid: tuple[tuple[float, ...], ...]) -> list[float]:
    """Of a table, at no travel."""
    columns = np.transpose(grid)
    return [float(np.interp(0.0, suspension.travel, column)) for column in columns]
