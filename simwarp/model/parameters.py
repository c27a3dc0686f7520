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
from simwarp.core.types import (
    FLOAT32_LEAST,
    FLOAT32_MAX,
    PositionDrive,
    ShapeType,
    VelocityMotor,
    finite_vector,
)
from simwarp.kernels.core.fields import ParameterFields
from simwarp.model.effort_routing import damped_by_table, effort_bounds
from simwarp.model.rules import INFINITE
from simwarp.model.specifications import Specification
from simwarp.model.topology import all_sums, coupling_width

BOUNDLESS: Final = (-INFINITE, INFINITE)
MIRRORED: Final = INFINITE
"""A `drive_effort_lower` that stands for minus the `drive_effort_limit`, whatever that becomes."""

PARAMETERS: Final[Mapping[str, Field]] = ParameterFields.FIELDS
"""Name -> declaration of every parameter that may differ per world."""
MASSLESS: Final = "massless bodies keep 0, the others need more"


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
        parameter_domain(builder, name).check(f"finalize: {name}", values[name])
    return values


def parameter_domain(builder: Specification, name: str) -> Domain:
    """Values that a parameter of this model may have, in one world."""
    massless = np.array([body.is_massless for body in builder.bodies], bool)
    if name == "shape_asset":
        return asset_domain(builder)
    if name == "body_mass" and massless.any():
        return Domain(np.where(massless, 0.0, FLOAT32_LEAST), np.where(massless, 0.0, FLOAT32_MAX), MASSLESS)
    if name == "body_inertia_b" and massless.any():
        bounds = massless[:, None, None]
        return Domain(np.where(bounds, 0.0, FLOAT32_LEAST), np.where(bounds, 0.0, FLOAT32_MAX), MASSLESS, 2)
    return PARAMETERS[name].domain or ANY


def asset_domain(builder: Specification) -> Domain:
    """That of `shape_asset`: kernels would read beyond the geometries that there are."""
    counts = {
        ShapeType.HULL: len(builder.hulls),
        ShapeType.HEIGHT_FIELD: len(builder.height_fields),
        ShapeType.MESH: len(builder.meshes),
        ShapeType.SPROCKET: len(builder.sprocket_profiles),
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

    parts = [part for mesh in builder.flexible_meshes for part in mesh.parts]
    joints, dofs = builder.joints, [dof for joint in builder.joints for dof in joint.dofs]
    drives = [dof.drive for dof in dofs]
    pd = [drive if isinstance(drive, PositionDrive) else PositionDrive(stiffness=0.0) for drive in drives]
    bounds = [effort_bounds(each) if isinstance(each, PositionDrive | VelocityMotor) else BOUNDLESS for each in drives]
    efforts = floats(bounds, 2)
    paired = [np.ndim(getattr(drive, "effort_limit", 0.0)) == 1 for drive in drives]
    springs = [1.0 if dof.spring_table is not None else dof.stiffness for dof in dofs]
    dampers = [1.0 if damped_by_table(dof) else dof.damping for dof in dofs]
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
        "joint_stiffness": floats(springs),
        "joint_damping": floats(dampers),
        "joint_limit_lower": np.maximum(limits[:, 0], -INFINITE),
        "joint_limit_upper": np.minimum(limits[:, 1], INFINITE),
        "drive_stiffness": floats(drive.stiffness for drive in pd),
        "drive_damping": floats(drive.damping for drive in pd),
        "drive_effort_limit": np.minimum(efforts[:, 1], INFINITE),
        "drive_effort_lower": np.where(paired, np.maximum(efforts[:, 0], -INFINITE), MIRRORED),
        "coupling_coefficient": coefficients,
        "coupling_offset": floats(offsets),
        "flexible_young": floats(part.material.young for part in parts),
        "flexible_damping_time": floats(part.material.damping_time for part in parts),
        "flexible_thickness": floats(part.thickness or 0.0 for part in parts),
        "flexible_pressure": floats(part.pressure for part in parts),
        "shape_enabled": np.ones(len(builder.shapes), np.int32),
    }


def _initial_coordinates(builder: Specification) -> list[float]:
    """Joint coordinates as built: zero but for shafts (only couplable joints matter here)."""
    return [joint.initial_q for joint in builder.joints for _ in joint.dofs]


def non_finite_parameters(arrays: Mapping[str, wp.array], world_count: int) -> dict[int, str]:
    """A line by world for parameters that nobody checked: those that a kernel or a copy wrote. Waits for them.

    A place that is not finite meets nothing, and a friction that is not one does nothing: no rate tells of it.

    Args:
        arrays: (1 or W, ...) by name, of a model.
        world_count: W.
    """
    found: dict[int, str] = {}
    for name, array in arrays.items():
        values = array.numpy()
        if values.dtype.kind != "f" or np.isfinite(values).all():
            continue
        rows = values.reshape(len(values), -1)
        for world in range(world_count):
            row = rows[min(world, len(rows) - 1)]
            faults = row[~np.isfinite(row)]
            if len(faults):
                told = f"model.{name} holds {faults[0]:g}: it was written where nothing is checked; write finite values"
                found.setdefault(world, told)
    return found
