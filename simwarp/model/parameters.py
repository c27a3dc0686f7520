"""Parameters: what may differ per world, with its domain, and the values of one world as built."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import ANY, Domain
from simwarp.core.fields import Field
from simwarp.core.rotation import matrix_of
from simwarp.core.types import PositionDrive, ShapeType, VelocityMotor, finite_vector
from simwarp.kernels.core.fields import ParameterFields
from simwarp.model.checks import INFINITE
from simwarp.model.specifications import ShapeSpec, Specification
from simwarp.model.topology import coupling_width

PARAMETERS: Final[Mapping[str, Field]] = ParameterFields.FIELDS
"""Name -> declaration of every parameter that may differ per world."""


def parameter_values(builder: Specification) -> dict[str, npt.NDArray[Any]]:
    """One world's parameters in the dtypes of `PARAMETERS`, in their order.

    Raises:
        ModelError: a value lies outside the parameter's domain, or is beyond its dtype.
    """
    values = {}
    for name, given in {**_joint_values(builder), **_shape_values(builder.shapes)}.items():
        parameter = PARAMETERS[name]
        dtype = wp.dtype_to_numpy(getattr(parameter.dtype, "_wp_scalar_type_", parameter.dtype))
        with np.errstate(over="ignore"):  # told in the next line
            values[name] = given.astype(dtype)
        (parameter.domain or ANY).check(f"finalize: {name}", values[name])
    return values


def asset_domain(builder: Specification) -> Domain:
    """That of `shape_asset`: kernels would read beyond the geometries that there are."""
    counts = {
        ShapeType.HULL: len(builder.hulls),
        ShapeType.HEIGHT_FIELD: len(builder.height_fields),
        ShapeType.MESH: len(builder.meshes),
    }
    last = np.array([counts.get(shape.type, 0) - 1 for shape in builder.shapes])
    return Domain(np.minimum(last, 0), last, "pass what add_hull_asset and the like returned for this kind of shape")


def _joint_values(builder: Specification) -> dict[str, npt.NDArray[Any]]:
    """One world's parameters of bodies, joints and couplings."""

    def floats(values: Iterable[Any], *shape: int) -> npt.NDArray[np.float64]:
        return np.array([*values], np.float64).reshape(-1, *shape)

    joints, dofs = builder.joints, [dof for joint in builder.joints for dof in joint.dofs]
    drives = [dof.drive for dof in dofs]
    pd = [drive if isinstance(drive, PositionDrive) else PositionDrive(stiffness=0.0) for drive in drives]
    efforts = [drive.effort_limit if isinstance(drive, PositionDrive | VelocityMotor) else INFINITE for drive in drives]
    limits = floats(((-INFINITE, INFINITE) if dof.limit is None else dof.limit for dof in dofs), 2)
    coefficients = np.zeros((len(builder.couplings), coupling_width(builder)))
    for row, coupling in enumerate(builder.couplings):
        coefficients[row, : len(coupling.terms)] = [value for _, value in coupling.terms]
    initial = _initial_coordinates(builder)
    offsets = [
        sum(value * initial[dof] for dof, value in coupling.terms) if coupling.offset is None else coupling.offset
        for coupling in builder.couplings
    ]
    return {
        "gravity": finite_vector("finalize", "gravity", builder.gravity, 3),
        "body_mass": floats(body.mass for body in builder.bodies),
        "body_inertia_b": floats((body.inertia for body in builder.bodies), 3, 3),
        "joint_anchor0": floats((joint.frame0.position for joint in joints), 3),
        "joint_anchor1": floats((joint.frame1.position for joint in joints), 3),
        "joint_frame0": floats((matrix_of(joint.frame0.rotation) for joint in joints), 3, 3),
        "joint_frame1": floats((matrix_of(joint.frame1.rotation) for joint in joints), 3, 3),
        "joint_offset": floats(joint.offset for joint in joints),
        "joint_armature": floats(dof.armature for dof in dofs)
        + floats(joint.inertia for joint in joints for _ in joint.dofs),
        "joint_stiffness": floats(dof.stiffness for dof in dofs),
        "joint_rest": floats(dof.rest for dof in dofs),
        "joint_damping": floats(dof.damping for dof in dofs),
        "joint_preload": floats(dof.preload for dof in dofs),
        "joint_friction": floats(dof.friction for dof in dofs),
        "joint_limit_lower": np.maximum(limits[:, 0], -INFINITE),
        "joint_limit_upper": np.minimum(limits[:, 1], INFINITE),
        "drive_stiffness": floats(drive.stiffness for drive in pd),
        "drive_damping": floats(drive.damping for drive in pd),
        "drive_effort_limit": np.minimum(floats(efforts), INFINITE),
        "coupling_coefficient": coefficients,
        "coupling_offset": floats(offsets),
        "coupling_damping": floats(coupling.damping for coupling in builder.couplings),
    }


def _shape_values(shapes: list[ShapeSpec]) -> dict[str, npt.NDArray[Any]]:
    """One world's parameters of the shapes."""

    def material(field: str) -> npt.NDArray[Any]:
        return np.array([getattr(shape.material, field) for shape in shapes], np.float64)

    return {
        "shape_x": np.array([shape.pose.position for shape in shapes], np.float64).reshape(-1, 3),
        "shape_rot": np.array([shape.pose.rotation for shape in shapes], np.float64).reshape(-1, 4),
        "shape_size": np.array([shape.size for shape in shapes], np.float64).reshape(-1, 3),
        "shape_margin": np.array([shape.margin for shape in shapes], np.float64),
        "shape_asset": np.array([shape.asset for shape in shapes], np.int32),
        "shape_enabled": np.ones(len(shapes), np.int32),
        "shape_friction": material("friction"),
        "shape_rolling_friction": material("rolling_friction"),
        "shape_spinning_friction": material("spinning_friction"),
        "shape_restitution": material("restitution"),
        "shape_cohesion": material("cohesion"),
        "shape_compliance": material("compliance"),
        "shape_damping": material("damping"),
        "shape_young_modulus": material("young_modulus"),
        "shape_poisson_ratio": material("poisson_ratio"),
    }


def _initial_coordinates(builder: Specification) -> list[float]:
    """Joint coordinates as built: zero but for shafts (only couplable joints matter here)."""
    return [joint.initial_q for joint in builder.joints for _ in joint.dofs]
