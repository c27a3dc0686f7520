"""Specification of a model as a builder collects it: bodies, joints, couplings and shapes as plain values."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np
import numpy.typing as npt

from simwarp.core.object_repr import Names, ReadableFields, Row
from simwarp.core.types import WORLD, Dof, FrictionRule, JointType, Material, PairRule, Pose, ShapeType
from simwarp.geometry.assets import HeightField, Hull, TriangleMesh
from simwarp.geometry.sprocket_profiles import SprocketProfile
from simwarp.meshes.mesh_specification import FlexibleMesh

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class BodySpec(ReadableFields):
    """One rigid body: mass [kg], inertia about its centre of mass in body axes [kg·m²], initial state (world)."""

    name: str
    mass: float
    inertia: Array
    pose: Pose
    velocity: Array
    omega: Array
    posed: bool = False
    """Moved by a force element alone: the step leaves it out."""

    @property
    def is_massless(self) -> bool:
        """True of a frame between joints, or one that is posed (`ModelBuilder.add_massless_body`)."""
        return self.mass == 0.0


@dataclasses.dataclass(frozen=True)
class Frame(ReadableFields):
    """A frame on a body: origin [m] relative to the centre of mass and xyzw orientation, in body axes."""

    position: Array
    rotation: Array


@dataclasses.dataclass(frozen=True)
class JointSpec(ReadableFields):
    """One element between frame 0 on body `parent` and frame 1 on body `child`.

    `offset` is the constant of its DISTANCE or POINT_AXIS1 row [m]; `inertia` that of a shaft [kg·m²]; `terms` are
    (public dof index, coefficient) of a combination. One that `closes_loop` is never part of the spanning tree, and
    its bodies may collide.
    """

    name: str
    type: JointType
    parent: int
    child: int
    frame0: Frame
    frame1: Frame
    dofs: tuple[Dof, ...]
    offset: float = 0.0
    inertia: float = 0.0
    initial_q: float = 0.0
    initial_qd: float = 0.0
    closes_loop: bool = False
    terms: tuple[tuple[int, float], ...] = ()


@dataclasses.dataclass(frozen=True)
class CouplingSpec(ReadableFields):
    """sum of coefficient x coordinate = offset, over up to twelve degrees of freedom (public dof indices); with
    `damping`, effort = -damping x sum of coefficient x rate instead; with `dof`, the law of that coordinate, a
    combination, which is the sum.
    """

    name: str
    terms: tuple[tuple[int, float], ...]
    offset: float | None
    damping: float = 0.0
    dof: int = -1


@dataclasses.dataclass(frozen=True)
class ShapeSpec(ReadableFields):
    """One shape slot: geometry on a body. `pose` is relative to the body's centre of mass, in its axes."""

    name: str
    body: int
    type: ShapeType
    pose: Pose
    size: Array
    material: Material
    margin: float
    group: int
    mask: int
    asset: int


class Specification(Protocol):
    """All of a model, as a ModelBuilder holds it.

    Attributes:
        gravity: (3,) acceleration [m/s²], world frame.
        bodies, joints, couplings, shapes: in the order of their indices.
        hulls, height_fields, meshes, sprocket_profiles: geometries that shapes refer to.
        flexible_meshes: whose nodes are bodies.
        excluded_bodies: pairs of bodies whose shapes never meet.
        excluded_shapes: pairs of shapes that never meet, the smaller index first.
        given_pairs: pairs of shapes that may meet in any case, the smaller index first, with the surface of their
            contact (None: made of theirs).
        friction_rule, pair_rule: see `FrictionRule`, `PairRule`.
    """

    gravity: Array
    bodies: list[BodySpec]
    joints: list[JointSpec]
    couplings: list[CouplingSpec]
    shapes: list[ShapeSpec]
    hulls: list[Hull]
    height_fields: list[HeightField]
    meshes: list[TriangleMesh]
    sprocket_profiles: list[SprocketProfile]
    flexible_meshes: list[FlexibleMesh]
    excluded_bodies: set[tuple[int, int]]
    excluded_shapes: set[tuple[int, int]]
    given_pairs: dict[tuple[int, int], Material | None]
    friction_rule: FrictionRule
    pair_rule: PairRule

    @property
    def dof_count(self) -> int:
        """Degrees of freedom of all joints."""

    def dof_start(self, joint: int) -> int:
        """First degree of freedom of a joint."""


def specification_rows(parts: Specification) -> dict[str, Row]:
    """Bodies, joints, couplings and shapes in rows, as a builder and its model print them."""
    bodies = parts.bodies
    return {
        "bodies": Names(len(bodies), (body.name for body in bodies)),
        "joints": Names(len(parts.joints), (f"{joint.name} ({_word(joint.type)})" for joint in parts.joints)),
        "couplings": Names(len(parts.couplings), (coupling.name for coupling in parts.couplings)),
        "shapes": Names(
            len(parts.shapes),
            (
                f"{shape.name} ({_word(shape.type)} on {'WORLD' if shape.body == WORLD else bodies[shape.body].name})"
                for shape in parts.shapes
            ),
        ),
    }


def _word(kind: JointType | ShapeType) -> str:
    return kind.name.lower().replace("_", " ")
