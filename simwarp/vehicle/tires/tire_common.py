"""A row of a tire's parameters: the part that all models share."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.kernels.vehicle.tires.parameter_vector import Common
from simwarp.vehicle.spec.vehicle_spec import SpecError, Tire
from simwarp.vehicle.tires.tire_parameters import CommonParameters

Row: TypeAlias = npt.NDArray[np.float64]

THIRD = 1.0 / 3.0
"""Rill's estimate: the effective radius is the unloaded one less a third of the deflection."""
NO_BOTTOM = 1.0e6
"""Deflection that no tire reaches [m]."""


def missing(key: str, what: str) -> SpecError:
    """The error for a value that nothing gives."""
    return SpecError(f"{key}: missing; give {what}")


def common_row(tire: Tire, common: CommonParameters, size: int, *, camber: float, share: float) -> Row:
    """A row with the values of every model; `camber` is the usual limit [°], `share` see `Common.RADIUS_SHARE`."""
    row = np.zeros(size)
    row[Common.RADIUS] = tire.radius
    row[Common.WIDTH] = tire.width
    row[Common.RADIUS_SHARE] = share
    row[Common.REFERENCE_FRICTION] = common.reference_friction
    row[[Common.FRICTION_LOWER, Common.FRICTION_UPPER]] = common.friction_limits
    row[Common.CAMBER_LIMIT] = np.deg2rad(camber) if common.camber_limit is None else common.camber_limit
    row[Common.LOAD_LIMIT] = np.finfo(np.float32).max
    row[Common.BOTTOM_DEFLECTION] = NO_BOTTOM
    row[Common.BRISTLE_STIFFNESS] = common.bristle_stiffness
    row[Common.BRISTLE_DAMPING] = common.bristle_damping
    # what a patch moves at least: the tire alone, turning or carried along
    row[Common.PATCH_MASS_X] = tire.inertia[1] / tire.radius**2
    row[Common.PATCH_MASS_Y] = tire.mass
    row[[Common.BLEND_BEGIN, Common.BLEND_END]] = common.blend
    return row
