"""Poses of links: composition and inverse, and the masses of parts moved and summed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from simwarp.core.rotation import matrix_of, quat_conjugate, quat_from_matrix, quat_multiply, rotate
from simwarp.core.types import Pose, pose as make_pose
from simwarp.geometry.assets import MassProperties

Array = npt.NDArray[np.float64]

NO_MASS = MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))


def composed(outer: Pose, inner: Pose) -> Pose:
    """The pose of a frame that stands at `inner` in a frame at `outer`."""
    return make_pose(point_of(outer, inner.position), quat_multiply(outer.rotation, inner.rotation))


def inverse(pose: Pose) -> Pose:
    """The pose of the outer frame in the inner one."""
    back = quat_conjugate(pose.rotation)
    return Pose(-rotate(back, pose.position), back)


def relative(base: Pose, pose: Pose) -> Pose:
    """`pose` in the frame at `base`, both given in a third one."""
    return composed(inverse(base), pose)


def point_of(pose: Pose, point: Array) -> Array:
    """A point of the inner frame, in the outer one."""
    return pose.position + rotate(pose.rotation, point)


def pose_from_matrix(matrix: Array) -> Pose:
    """The pose of a homogeneous (4, 4) matrix of a rotation and a translation [m]."""
    return make_pose(matrix[:3, 3], quat_from_matrix(matrix[:3, :3]))


def scalar_first(wxyz: Iterable[float]) -> Array:
    """An xyzw quaternion from a scalar-first one."""
    w, x, y, z = (float(value) for value in wxyz)
    return np.array([x, y, z, w])


def moved_mass(part: MassProperties, pose: Pose) -> MassProperties:
    """A part that stands at `pose` in another frame: centre and inertia in the axes of that frame."""
    turn = matrix_of(pose.rotation)
    return MassProperties(part.mass, point_of(pose, part.centre), turn @ part.inertia @ turn.T)


def total_mass(parts: Iterable[MassProperties]) -> MassProperties:
    """Mass, centre and inertia about it of all parts, given in one frame (parallel axes: Huygens and Steiner)."""
    listed = [part for part in parts if part.mass > 0.0 or part.inertia.any()]
    mass = float(sum(part.mass for part in listed))
    if mass == 0.0:
        return MassProperties(0.0, np.zeros(3), sum((part.inertia for part in listed), np.zeros((3, 3))))
    centre = sum((part.mass * part.centre for part in listed), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in listed:
        arm = part.centre - centre
        inertia += part.inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return MassProperties(mass, centre, inertia)
