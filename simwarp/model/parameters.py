"""Parameters: what may differ per world, with its domain, and the values of one world as built."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from operator import attrgetter
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
from simwarp.model.specifications import Specification
from simwarp.model.topology import all_sums, coupling_width

PARAMETERS: Final[Mapping[str, Field]] = ParameterFields.FIELDS
"""Name -> declaration of every parameter that may differ per world."""


def parameter_values(builder: Specification) -> dict[str, npt.NDArray[Any]]:
    """One world's parameters in the dtypes of `PARAMETERS`, in their order.

    Raises:
        ModelError: a value lies outside the parameter's domain, or is beyond its dtype.
    """
    values = {}
    computed = _computed_values(builder)
    for name, parameter in PARAMETERS.items():
        given = _from_source(builder, parameter) if parameter.source else computed[name]
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


def _from_source(builder: Specification, parameter: Field) -> npt.NDArray[np.float64]:
    """One world's parameter from the attribute of the builder's items that its `source` names."""
    kind, _, path = parameter.source.partition(".")
    groups: dict[str, Sequence[Any]] = {
        "body": builder.bodies, "joint": builder.joints, "dof": [dof for joint in builder.joints for dof in joint.dofs],
        "coupling": all_sums(builder), "shape": builder.shapes,
    }  # fmt: skip
    values = [attrgetter(path)(item) for item in groups[kind]]
    return np.array(values, np.float64).reshape(len(values), *getattr(parameter.dtype, "_shape_", ()))


def _computed_values(builder: Specification) -> dict[str, npt.NDArray[Any]]:
    """One world's parameters that no single attribute holds."""

    def floats(values: Iterable[Any], *shape: int) -> npt.NDArray[np.float64]:
        return np.array([*values], np.float64).reshape(-1, *shape)

    joints, dofs = builder.joints, [dof for joint in builder.joints for dof in joint.dofs]
    drives = [dof.drive for dof in dofs]
    pd = [drive if isinstance(drive, PositionDrive) else PositionDrive(stiffness=0.0) for drive in drives]
    efforts = [drive.effort_limit if isinstance(drive, PositionDrive | VelocityMotor) else INFINITE for drive in drives]
    limits = floats(((-INFINITE, INFINITE) if dof.limit is None else dof.limit for dof in dofs), 2)
    sums = all_sums(builder)
    coefficients = np.zeros((len(sums), coupling_width(builder)))
    for row, coupling in enumerate(sums):
        coefficients[row, : len(coupling.terms)] = [value for _, value in coupling.terms]
    initial = _initial_coordinates(builder)
    offsets = [
        sum(value * initial[dof] for dof, value in coupling.terms) if coupling.offset is None else coupling.offset
        for coupling in sums
    ]
    return {
        "gravity": finite_vector("finalize", "gravity", builder.gravity, 3),
        "joint_frame0": floats((matrix_of(joint.frame0.rotation) for joint in joints), 3, 3),
        "joint_frame1": floats((matrix_of(joint.frame1.rotation) for joint in joints), 3, 3),
        "joint_armature": floats(dof.armature for dof in dofs)
        + floats(joint.inertia for joint in joints for _ in joint.dofs),
        "joint_limit_lower": np.maximum(limits[:, 0], -INFINITE),
        "joint_limit_upper": np.minimum(limits[:, 1], INFINITE),
        "drive_stiffness": floats(drive.stiffness for drive in pd),
        "drive_damping": floats(drive.damping for drive in pd),
        "drive_effort_limit": np.minimum(floats(efforts), INFINITE),
        "coupling_coefficient": coefficients,
        "coupling_offset": floats(offsets),
        "shape_enabled": np.ones(len(builder.shapes), np.int32),
    }


def _initial_coordinates(builder: Specification) -> list[float]:
    """Joint coordinates as built: zero but for shafts (only couplable joints matter here)."""
    return [joint.initial_q for joint in builder.joints for _ in joint.dofs]
