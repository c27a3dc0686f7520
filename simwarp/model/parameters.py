"""Parameters: what may differ per world, with its domain, and the values of one world as built."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import warp as wp

from simwarp.core.arrays import ANY, NOT_NEGATIVE, POSITIVE, Domain
from simwarp.core.rotation import matrix_of
from simwarp.core.types import PositionDrive, ShapeType, VelocityMotor, finite_vector
from simwarp.model.checks import INFINITE
from simwarp.model.specifications import ShapeSpec, Specification
from simwarp.model.topology import coupling_width


@dataclasses.dataclass(frozen=True)
class Parameter:
    """Dtype, meaning and domain of a per-world parameter; its shape is (1 or W, n)."""

    dtype: Any
    text: str
    domain: Domain = ANY


A_LIMIT: Final = Domain(remedy="1e30 and -1e30 stand for no limit")
AN_EFFORT: Final = Domain(least=0.0, remedy="1e30 stands for no limit")

PARAMETERS: dict[str, Parameter] = {
    "gravity": Parameter(wp.vec3, "(1 or W,) acceleration [m/s²], world frame"),
    "body_mass": Parameter(wp.float32, "(1 or W, B) [kg]", POSITIVE),
    "body_inertia_b": Parameter(wp.mat33, "(1 or W, B) about the centre of mass, body frame [kg·m²]", POSITIVE),
    "joint_anchor0": Parameter(wp.vec3d, "(1 or W, J) origin of frame 0 from the first body's centre, its frame [m]"),
    "joint_anchor1": Parameter(wp.vec3d, "(1 or W, J) origin of frame 1 from the second body's centre, its frame [m]"),
    "joint_frame0": Parameter(wp.mat33d, "(1 or W, J) axes of frame 0 in the first body"),
    "joint_frame1": Parameter(wp.mat33d, "(1 or W, J) axes of frame 1 in the second body"),
    "joint_offset": Parameter(wp.float64, "(1 or W, J) length of a rod [m]"),
    "joint_armature": Parameter(wp.float32, "(1 or W, dofs) [kg or kg·m²]", NOT_NEGATIVE),
    "joint_stiffness": Parameter(wp.float32, "(1 or W, dofs) [N/m or N·m/rad]", NOT_NEGATIVE),
    "joint_rest": Parameter(wp.float32, "(1 or W, dofs) [m or rad]"),
    "joint_damping": Parameter(wp.float32, "(1 or W, dofs) [N·s/m or N·m·s/rad]", NOT_NEGATIVE),
    "joint_preload": Parameter(wp.float32, "(1 or W, dofs) [N or N·m]"),
    "joint_friction": Parameter(wp.float32, "(1 or W, dofs) dry friction [N or N·m]", NOT_NEGATIVE),
    "joint_limit_lower": Parameter(wp.float32, "(1 or W, dofs) [m or rad]", A_LIMIT),
    "joint_limit_upper": Parameter(wp.float32, "(1 or W, dofs) [m or rad]", A_LIMIT),
    "drive_stiffness": Parameter(wp.float32, "(1 or W, dofs) [N/m or N·m/rad]", NOT_NEGATIVE),
    "drive_damping": Parameter(wp.float32, "(1 or W, dofs) [N·s/m or N·m·s/rad]", NOT_NEGATIVE),
    "drive_effort_limit": Parameter(wp.float32, "(1 or W, dofs) [N or N·m]", AN_EFFORT),
    "coupling_coefficient": Parameter(wp.float32, "(1 or W, couplings, terms)"),
    "coupling_offset": Parameter(wp.float64, "(1 or W, couplings)"),
    "coupling_damping": Parameter(
        wp.float32, "(1 or W, couplings) of a viscous coupling, 0: rigid [N·m·s/rad]", NOT_NEGATIVE
    ),
    "shape_x": Parameter(wp.vec3d, "(1 or W, S) origin from the body's centre of mass, body axes [m]"),
    "shape_rot": Parameter(wp.quat, "(1 or W, S) xyzw, shape axes to body axes"),
    "shape_size": Parameter(wp.vec3, "(1 or W, S) meaning by `ShapeType` [m]", NOT_NEGATIVE),
    "shape_margin": Parameter(wp.float32, "(1 or W, S) thickness added to the surface [m]", NOT_NEGATIVE),
    "shape_asset": Parameter(wp.int32, "(1 or W, S) asset that a hull, height field or mesh shows"),
    "shape_enabled": Parameter(wp.int32, "(1 or W, S) 0 takes the shape out"),
    "shape_friction": Parameter(wp.float32, "(1 or W, S)", NOT_NEGATIVE),
    "shape_rolling_friction": Parameter(wp.float32, "(1 or W, S) [m]", NOT_NEGATIVE),
    "shape_spinning_friction": Parameter(wp.float32, "(1 or W, S) [m]", NOT_NEGATIVE),
    "shape_restitution": Parameter(wp.float32, "(1 or W, S)", Domain(0.0, 1.0)),
    "shape_cohesion": Parameter(wp.float32, "(1 or W, S) [N]", NOT_NEGATIVE),
    "shape_compliance": Parameter(wp.float32, "(1 or W, S) [m/N]", NOT_NEGATIVE),
    "shape_damping": Parameter(wp.float32, "(1 or W, S) relaxation time of the compliance [s]", NOT_NEGATIVE),
    "shape_young_modulus": Parameter(wp.float32, "(1 or W, S) of the smooth contact model [Pa]", NOT_NEGATIVE),
    "shape_poisson_ratio": Parameter(wp.float32, "(1 or W, S) of the smooth contact model", Domain(0.0, 0.5)),
}


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
        parameter.domain.check(f"finalize: {name}", values[name])
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
