"""Hostile values for every parameter of every public method of ModelBuilder: one clear line, or a finite model."""

from __future__ import annotations

import dataclasses
import fractions
import inspect
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import simwarp as sw
from simwarp.core.types import (
    WORLD,
    Dof,
    JointType,
    Material,
    ModelError,
    Pose,
    PositionDrive,
    PrescribedPosition,
    VelocityMotor,
    pose,
)
from simwarp.model.builder import ModelBuilder
from simwarp.model.model import PARAMETERS, initial_state
from simwarp.model.parameters import parameter_values

NAN, INF = float("nan"), float("inf")
DEEP: list[Any] = []
for _ in range(3000):
    DEEP = [DEEP]
LOOP: list[Any] = []
LOOP.append(LOOP)


class Unprintable:
    """Its repr fails."""

    def __repr__(self) -> str:
        raise ValueError("no")


HOSTILE: list[Any] = [
    None, "", "abc", "1", "\n", "a\nb", "\0", "\ud800", "n" * 100_000, b"abc", NAN, INF, -INF, 1e39, -1e39, 1e308,
    1e200, 1e-60, 5e-324, 10**400, 10**5000, -(10**400), 2**31, 2**33, -1, 0, 1, 3, True, False, 1j, [], [1], (1, 2, 3),
    (0.0, 0.0, 0.0), (NAN, 0, 0), (1e200, 0.0, 0.0), (1e-200, 0.0, 0.0), (10**400, 0, 0), ("1", "2", "3"), (None,) * 3,
    (True, False, True), [[1, 2], [3]], [[[1.0]]], [{}], {}, {"a": 1}, set(), object(), Unprintable(), type, len,
    DEEP, LOOP,
    np.float32(2.0), np.int64(2), np.str_("abc"), np.array(1.0), np.array(1 + 1j), np.array([1.0, 2.0, 3.0]),
    np.array([object()] * 3), np.array("abc"), np.zeros((0, 3)), np.full((3, 3), NAN), np.datetime64("2020-01-01"),
    fractions.Fraction(1, 3), pose((1e39 * 0, 0, 0)), Pose(np.zeros(2), np.zeros(4)), Pose(None, None),  # type: ignore[arg-type]
    Material(), Material(friction=NAN), Material(friction="x"), Material(restitution=2.0), Dof(), [Dof()],  # type: ignore[arg-type]
    [Dof(stiffness=1e39)], [Dof(limit=(1e39, INF))], PositionDrive(stiffness=10**400), PositionDrive(stiffness=None),  # type: ignore[arg-type]
    PositionDrive(stiffness=1.0, effort_limit=1e-60), VelocityMotor(effort_limit="x"), VelocityMotor(effort_limit=1e39),  # type: ignore[arg-type]
    PrescribedPosition(table=((0, 1e39), (0, 1))), PrescribedPosition(table=(0, 1)), PrescribedPosition(table="ab"),  # type: ignore[arg-type]
    ((0.0, 1.0), (0.0, 1e39)), ((0.0, 1.0), (0.0, 10**400)), ((0, 1), (0, 1), ((0, 1), (0, 1))), ((), (), ()), ((), ()),
    ((0, 1), (0, 1), ((0, NAN), (0, 1))), (("a", "b"), (0, 1)), [(0, 1e39)], [(0, 10**400)], [(0, 1e-60)], [(0, None)],
    [(None, 1.0)], [(0, "0", 1.0)], [(0, 0, 0, 1.0)], [[0, 1.0]], "x=1", [(0, NAN)], [(0, 0.0)],
]  # fmt: skip

BODIES = 4
CORNERS = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])
TRIANGLES = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
PAIR: dict[str, Any] = {"name": "new", "parent": 0, "child": 2}
ENDS: dict[str, Any] = {"anchor0": (0.0, 0.0, 0.0), "anchor1": (1.0, 0.0, 0.0)}
SHAPE: dict[str, Any] = {
    "name": "new shape", "pose": pose((0, 0, 1)), "material": Material(), "margin": 0.01, "group": 1, "mask": 1,
}  # fmt: skip
"""Options of every shape; the box stands for all."""
LAW: dict[str, Any] = {
    **{each.name: 0.1 if each.default == 0.0 else None for each in dataclasses.fields(Dof)},
    "limit": (-1.0, 1.0), "stiffness": 1.0,
}  # fmt: skip
"""Options of every joint of one coordinate; the hinge stands for all."""
MESH: dict[str, Any] = {
    "material": sw.flex.Elastic(young=1e6, density=1000.0), "pose": pose(), "surface": Material(),
    "velocity": (0, 0, 0), "omega": (0, 0, 0), "double": False,
}  # fmt: skip
"""Options of both kinds of meshes."""
VALID: dict[str, dict[str, Any]] = {
    "add_body": {"name": "new", "mass": 1.0, "inertia": (1, 1, 1), "pose": None, "velocity": (0, 0, 0),
                 "omega": (0, 0, 0), "strict": True},
    "add_shaft": {"name": "new", "inertia": 1.0, "position": 0.0, "speed": 0.0},
    "add_joint_fixed": {**PAIR, "anchor": (0, 0, 0)},
    "add_joint_revolute": {**PAIR, "axis": (0, 0, 1), "anchor": (0, 0, 0), **LAW},
    "add_joint_prismatic": {**PAIR, "axis": (0, 0, 1), "anchor": (0, 0, 0)},
    "add_joint_spherical": {**PAIR, "anchor": (0, 0, 0), "rotation": (0, 0, 0, 1), "dofs": ()},
    "add_joint_cylindrical": {**PAIR, "axis": (0, 0, 1), "anchor": (0, 0, 0), "dofs": ()},
    "add_joint_universal": {**PAIR, "anchor": (0, 0, 0), "axis0": (1, 0, 0), "axis1": (0, 1, 0), "dofs": ()},
    "add_joint_planar": {**PAIR, "normal": (0, 0, 1), "direction": (1, 0, 0), "anchor": (0, 0, 0), "dofs": ()},
    "add_joint_free": {"name": "new", "child": 3, "anchor": (0, 0, 0), "dofs": ()},
    "add_joint_point_on_plane": {**PAIR, "anchor": (0, 0, 0), "normal": (0, 0, 1)},
    "add_joint_point_on_line": {**PAIR, "anchor": (0, 0, 0), "axis": (0, 0, 1)},
    "add_joint_parallel": {**PAIR, "axis": (0, 0, 1)},
    "add_joint_perpendicular": {**PAIR, "axis0": (1, 0, 0), "axis1": (0, 1, 0)},
    "add_joint_oldham": {**PAIR, "anchor": (0, 0, 0), "normal": (0, 0, 1)},
    "add_joint_distance": {**PAIR, **ENDS, "length": None, "limit": None},
    "add_joint_revolute_spherical": {**PAIR, **ENDS, "axis": (0, 0, 1)},
    "add_joint_revolute_translational": {**PAIR, **ENDS, "axis": (0, 0, 1), "direction": (1, 0, 0)},
    "add_spring": {**PAIR, **ENDS},
    "add_joint_elastic": {
        **PAIR, **ENDS, "up": (0.0, 0.0, 1.0), "stiffness": (1.0,) * 6, "damping": (0.0,) * 6, "dofs": (),
    },
    "add_rod": {
        "name": "new", "points": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], "section": sw.flex.Round(diameter=0.02),
        "material": sw.flex.Elastic(young=1e7, density=1000.0), "up": (0.0, 0.0, 1.0), "twist": 0.1, "elements": 2,
        "start": sw.flex.Clamp(), "end": sw.flex.Hinge(2), "radius": 0.01, "surface": Material(),
    },
    "add_solid_mesh": {
        "name": "new", "mesh": sw.flex.box((0.2, 0.1, 0.1), (2, 1, 1)), **MESH, "fixed": "x_max", "radius": 0.01,
        "glue": {"b3": "x_min"}, "contact": "faces",
    },
    "add_shell": {
        "name": "new", "vertices": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], "triangles": [(0, 1, 2), (0, 2, 3)],
        **MESH, "thickness": 0.01, "fixed": [0], "radius": 0.01, "pressure": 10.0, "glue": {3: [1]},
        "contact": sw.flex.MeshContact.NODES,
    },
    "add_bushing": {
        **PAIR, "anchor": (0, 0, 0), "rotation": (0, 0, 0, 1), "stiffness": (1,) * 6, "damping": (0,) * 6, "dofs": (),
    },
    "add_joint_relative_rotation": {**PAIR, "axis": (0, 0, 1)},
    "add_massless_body": {"name": "new", "pose": None, "posed": False},
    "add_loop_joint": {**PAIR, "kind": JointType.FIXED, "frame0": pose(), "frame1": pose()},
    "coordinate_of": {"column": 0},
    "set_drive": {"joint": 0, "drive": PositionDrive(stiffness=1.0), "dof": 0},
    "add_combination": {"name": "new", "terms": [(0, 1.0), (1, 2.0)], **LAW},
    "add_coupling": {"name": "new", "terms": [(0, 1.0), (1, 2.0)], "offset": None, "damping": 0.0},
    "add_gear": {"name": "new", "joint0": 0, "joint1": 2, "ratio": 2.0},
    "add_rack": {"name": "new", "pinion": 0, "rack": 1, "radius": 0.1},
    "add_screw": {"name": "new", "cylindrical": 3, "lead": 0.1},
    "dof_start": {"joint": 0},
    "finalize": {"world_count": 1, "device": "cpu", "per_world": (), "contact_capacity": None},
    "add_shape_plane": {"body": WORLD},
    "add_shape_sphere": {"body": 0, "radius": 0.1},
    "add_shape_capsule": {"body": 0, "radius": 0.1, "half_length": 0.1},
    "add_shape_cylinder": {"body": 0, "radius": 0.1, "half_length": 0.1},
    "add_shape_box": {"body": 0, "half": (0.1, 0.1, 0.1), **SHAPE},
    "add_shape_ellipsoid": {"body": 0, "half": (0.1, 0.1, 0.1)},
    "add_shape_cone": {"body": 0, "radius": 0.1, "half_length": 0.1},
    "add_shape_sprocket": {"body": 0, "arc_center_radius": 0.3, "arc_radius": 0.089, "tip_radius": 0.26, "teeth": 10,
                           "half_width": 0.1, "arc_offset": 0.01},
    "add_shape_groove": {"body": 0, "radius": 0.1, "half_width": 0.02},
    "add_shape_primitive": {"body": 0, "kind": "cone", "size": (0.1, 0.1, 0.1)},
    "add_shape_hull": {"body": 0, "points": CORNERS, "scale": (1, 1, 1)},
    "add_shape_height_field": {"body": WORLD, "heights": np.zeros((3, 3)), "size": (1.0, 1.0), "scale": (1, 1, 1)},
    "add_shape_mesh": {"body": WORLD, "vertices": CORNERS, "triangles": TRIANGLES, "scale": (1, 1, 1), "convex": False,
                       "decompose": False},
    "add_hull_asset": {"points": CORNERS},
    "add_height_field_asset": {"heights": np.zeros((3, 3)), "size": (1.0, 1.0)},
    "add_mesh_asset": {"vertices": CORNERS, "triangles": TRIANGLES},
    "add_solid": {"name": "solid", "kind": "box", "size": (0.1, 0.1, 0.1), "mass": None, "density": 1000.0,
                  "points": None, "pose": None, "velocity": (0, 0, 0), "omega": (0, 0, 0), "material": Material(),
                  "margin": 0.0, "group": 1, "mask": 1},
    "exclude_collision": {"body0": 0, "body1": 1},
    "exclude_shapes": {"shape0": 0, "shape1": 1},
    "add_shape_pair": {"shape0": 0, "shape1": 1, "material": Material()},
}  # fmt: skip


def base() -> ModelBuilder:
    """A hinge (joint 0), a slide (1), a shaft (2), a thread (3); body 3 floats."""
    builder = ModelBuilder()
    for k in range(BODIES):
        builder.add_body(f"b{k}", mass=1.0, inertia=(1, 1, 1), pose=pose((float(k), 0, 0)))
    builder.add_joint_revolute("hinge", WORLD, 0, axis=(0, 0, 1))
    builder.add_joint_prismatic("slide", 0, 1, axis=(0, 0, 1))
    builder.add_shaft("shaft", inertia=1.0)
    builder.add_joint_cylindrical("thread", 1, 2, axis=(0, 0, 1))
    builder.add_shape_sphere(1, radius=0.1)
    builder.add_shape_sphere(2, radius=0.1)
    return builder


def methods() -> Iterator[tuple[str, list[str]]]:
    """Public methods with the parameters that their signatures name."""
    for name, method in inspect.getmembers(ModelBuilder, inspect.isfunction):
        if not name.startswith("_"):
            parameters = list(inspect.signature(method).parameters.values())[1:]
            yield name, [each.name for each in parameters if each.kind is not inspect.Parameter.VAR_KEYWORD]


def test_every_public_method_and_parameter_is_in_the_table():
    assert {name: set(names) - set(VALID.get(name, ())) for name, names in methods()} == {name: set() for name in VALID}


def finite(builder: ModelBuilder, **options: Any) -> bool:
    """Whether a model of the builder can be made, and holds finite numbers."""
    arguments: dict[str, Any] = {"world_count": 1, "device": "cpu"} | options
    model = builder.finalize(**arguments)
    arrays = [*(getattr(model, name).numpy() for name in PARAMETERS), *model.initial.values()]
    return all(np.isfinite(array).all() for array in arrays)


LISTS = ("bodies", "joints", "couplings", "shapes", "hulls", "height_fields", "meshes", "flexible_meshes")


def complaint(builder: ModelBuilder, method: str, parameter: str, value: Any) -> str:
    """What is wrong with how a method takes a value; empty if nothing is. The builder stays as it was."""
    lengths = {name: len(getattr(builder, name)) for name in LISTS}
    arguments = VALID[method] | {parameter: value}
    try:
        if method == "finalize":
            return "" if finite(builder, **arguments) else "not finite"
        getattr(builder, method)(**arguments)
        values = [*parameter_values(builder).values(), *initial_state(builder).values()]
        return "" if all(np.isfinite(array).all() for array in values) else "not finite"
    except ModelError as error:
        return told(error)
    finally:
        for name, length in lengths.items():
            del getattr(builder, name)[length:]


def told(error: ModelError) -> str:
    """What is wrong with a message."""
    message = str(error)
    return "" if message.isprintable() and len(message) < 450 else f"message: {message[:200]!r}"


def named(value: Any) -> str:
    try:
        return f"{type(value).__name__} {value!r}"[:60]
    except Exception:  # noqa: BLE001
        return type(value).__name__


@pytest.mark.parametrize("method", VALID)
@pytest.mark.sweep
def test_hostile_values(method):
    wrong = []
    builder = base()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for parameter in VALID[method]:
            for value in HOSTILE:
                try:
                    found = complaint(builder, method, parameter, value)
                except Exception as error:  # noqa: BLE001
                    found = f"{type(error).__name__}: {str(error)[:150]}"
                if found:
                    wrong.append(f"{parameter} = {named(value)}: {found}")
    assert wrong == []
