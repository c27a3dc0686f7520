"""A compiled model of MuJoCo in its initial position, and where its parts go in the builder."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import quat_conjugate, quat_from_matrix, quat_multiply, rotate
from simwarp.core.types import WORLD, Pose, pose as make_pose
from simwarp.importers.imported import NamedFrame
from simwarp.importers.report import ImportReport
from simwarp.model.builder import ModelBuilder

Array = npt.NDArray[np.float64]

DEFAULT_SOLREF: Final = np.array([0.02, 1.0])
DEFAULT_SOLIMP: Final = np.array([0.9, 0.95, 0.001, 0.5, 2.0])
"""MuJoCo's softness of constraints where a file sets none."""


@dataclasses.dataclass
class Source:
    """The model, its data at `qpos0`, and what was built of it so far.

    Attributes:
        model, data: of MuJoCo; `mj_forward` was called at `qpos0`.
        report: filled by all parts of the reader.
        builder: filled by all parts of the reader.
        prefix: of all names.
        placement: pose of the file's world in ours.
        decompose: whether meshes become convex parts, or how; see `load_mjcf`.
        bodies: our body of each source body, `WORLD` for fixed ones.
        dofs: our column of each degree of freedom of the source.
        ends: our bodies on either side of each joint of the source: the parent's, the child's.
        shapes: our shape slots of each geom.
        tendons: our column of the coordinate of each tendon that has one.
        flexes: of the specification that MuJoCo compiled.
        vertices: source bodies that are vertices of flexes, and no bodies of ours.
        shortcuts: tags of the actuators that are refused by them.
    """

    model: Any
    data: Any
    report: ImportReport
    builder: ModelBuilder
    prefix: str
    placement: Pose
    decompose: bool | Mapping[str, Any] = False
    bodies: list[int] = dataclasses.field(default_factory=list)
    dofs: dict[int, int] = dataclasses.field(default_factory=dict)
    ends: dict[int, tuple[int, int]] = dataclasses.field(default_factory=dict)
    shapes: dict[int, tuple[int, ...]] = dataclasses.field(default_factory=dict)
    tendons: dict[int, int] = dataclasses.field(default_factory=dict)
    flexes: Sequence[Any] = ()
    vertices: frozenset[int] = frozenset()
    shortcuts: dict[int, str] = dataclasses.field(default_factory=dict)

    def name(self, kind: str, index: int) -> str:
        """Name of a part in the source; `kind` and a number where it has none."""
        accessor = getattr(self.model, kind)
        return self.prefix + (accessor(index).name or f"{kind}{index}")

    def label(self, kind: str, index: int) -> str:
        """The name for messages: without prefix."""
        return self.name(kind, index).removeprefix(self.prefix)

    def point(self, position: npt.ArrayLike) -> Array:
        """A point of the file's world in ours [m]."""
        return self.placement.position + rotate(self.placement.rotation, np.asarray(position, np.float64))

    def direction(self, vector: npt.ArrayLike) -> Array:
        """A direction of the file's world in ours."""
        return rotate(self.placement.rotation, np.asarray(vector, np.float64))

    def rotation(self, wxyz: npt.ArrayLike) -> Array:
        """A rotation in the file's world (wxyz) in ours (xyzw)."""
        return quat_multiply(self.placement.rotation, np.roll(np.asarray(wxyz, np.float64), -1))

    def pose(self, position: npt.ArrayLike, wxyz: npt.ArrayLike) -> Pose:
        """A pose in the file's world in ours."""
        return make_pose(self.point(position), self.rotation(wxyz))

    def pose_of_axes(self, position: npt.ArrayLike, matrix: npt.ArrayLike) -> Pose:
        """The same of axes as columns of a matrix (9,)."""
        turned = quat_from_matrix(np.asarray(matrix, np.float64).reshape(3, 3))
        return make_pose(self.point(position), quat_multiply(self.placement.rotation, turned))

    def frame(self, body: int, pose: Pose) -> NamedFrame:
        """A frame given in our world, fixed to a source body."""
        return self.attached(self.bodies[body], pose)

    def attached(self, body: int, pose: Pose) -> NamedFrame:
        """A frame given in our world, fixed to one of our bodies."""
        if body == WORLD:
            return NamedFrame(WORLD, pose)
        own = self.builder.bodies[body].pose
        inverse = quat_conjugate(own.rotation)
        offset = rotate(inverse, pose.position - own.position)
        return NamedFrame(body, make_pose(offset, quat_multiply(inverse, pose.rotation)))

    def local_pose(self, body: int, position: npt.ArrayLike, wxyz: npt.ArrayLike) -> Pose:
        """Pose in our world of a frame given in the axes of a source body, from its origin."""
        turned = np.roll(self.data.xquat[body], -1)
        place = self.data.xpos[body] + rotate(turned, np.asarray(position, np.float64))
        quat = quat_multiply(turned, np.roll(np.asarray(wxyz, np.float64), -1))
        return make_pose(self.point(place), quat_multiply(self.placement.rotation, quat))
