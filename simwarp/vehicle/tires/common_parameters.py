"""A vector of a tire's parameters: the part that all models share."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from simwarp.vehicle.spec.vehicle_spec import SpecError, Tire
from simwarp.vehicle.tires.parameter_vector_kernels import Common
from simwarp.vehicle.tires.tire_parameters import CommonParameters

Vector: TypeAlias = npt.NDArray[np.float64]

THIRD = 1.0 / 3.0
"""Rill's estimate: the effective radius is the unloaded one less a third of the deflection."""
NO_BOTTOM = 1.0e6
"""Deflection that no tire reaches [m]."""


def missing(key: str, what: str) -> SpecError:
    """The error for a value that nothing gives."""
    return SpecError(f"{key}: missing; give {what}")


def common_vector(tire: Tire, common: CommonParameters, size: int, *, camber: float, share: float) -> Vector:
    """A vector with the values of every model; `camber` is the usual limit [°], `share` see `Common.RADIUS_SHARE`."""
    vector = np.zeros(size)
    vector[Common.RADIUS] = tire.radius
    vector[Common.WIDTH] = tire.width
    vector[Common.RADIUS_SHARE] = share
    vector[Common.REFERENCE_FRICTION] = common.reference_friction
    vector[[Common.FRICTION_LOWER, Common.FRICTION_UPPER]] = common.friction_limits
    vector[Common.CAMBER_LIMIT] = np.deg2rad(camber) if common.camber_limit is None else common.camber_limit
    vector[Common.LOAD_LIMIT] = np.finfo(np.float32).max
    vector[Common.BOTTOM_DEFLECTION] = NO_BOTTOM
    vector[Common.BRISTLE_STIFFNESS] = common.bristle_stiffness
    vector[Common.BRISTLE_DAMPING] = common.bristle_damping
    # what a patch moves at least: the tire alone, turning or carried along
    vector[Common.PATCH_MASS_X] = tire.inertia[1] / tire.radius**2
    vector[Common.PATCH_MASS_Y] = tire.mass
    vector[[Common.BLEND_BEGIN, Common.BLEND_END]] = common.blend
    if common.relaxation_length is not None:
        vector[[Common.RELAXATION_X, Common.RELAXATION_Y]] = common.relaxation_length
    return vector
