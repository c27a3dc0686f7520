"""Kinematics of trees of hinges in float64 NumPy: poses, Jacobians by central differences, and the search."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simwarp.core.types import JointType
from simwarp.model.builder import ModelBuilder

Array = npt.NDArray[np.float64]


def transform(rotation: Rotation, position: npt.ArrayLike) -> Array:
    """Homogeneous matrix."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), position
    return matrix


def moved(kind: JointType, q: Array) -> Array:
    """Frame 1 seen from frame 0, of hinges and welds."""
    assert kind in (JointType.REVOLUTE, JointType.FIXED)
    return transform(Rotation.from_euler("z", q.sum()), np.zeros(3))


def body_pose(builder: ModelBuilder, body: int, q: Array) -> Array:
    """Pose of a body's centre of mass; every body hangs on its parent by one joint."""
    for index, joint in enumerate(builder.joints):
        if joint.child == body:
            start = builder.dof_start(index)
            frames = [transform(Rotation.from_quat(f.rotation), f.position) for f in (joint.frame0, joint.frame1)]
            above = np.eye(4) if joint.parent < 0 else body_pose(builder, joint.parent, q)
            shift = moved(joint.type, q[start : builder.dof_start(index + 1)])
            return np.asarray(above @ frames[0] @ shift @ np.linalg.inv(frames[1]))
    raise AssertionError(f"body {body} floats")


def point_position(builder: ModelBuilder, body: int, point: npt.ArrayLike, q: Array) -> Array:
    """A point of a body in the world."""
    return np.asarray((body_pose(builder, body, q) @ np.append(point, 1.0))[:3])


def point_jacobian(builder: ModelBuilder, body: int, point: npt.ArrayLike, q: Array, step: float = 1e-6) -> Array:
    """(6, dofs) by central differences, which are exact to some step² and 1e-16 / step."""
    columns = []
    for dof in range(len(q)):
        ends = []
        for sign in (1.0, -1.0):
            there = q.copy()
            there[dof] += sign * step
            ends.append((point_position(builder, body, point, there), body_pose(builder, body, there)[:3, :3]))
        (ahead, turned), (back, before) = ends
        angle = Rotation.from_matrix(turned @ before.T).as_rotvec()
        columns.append(np.concatenate([ahead - back, angle]) / (2.0 * step))
    return np.array(columns).T


def search(
    builder: ModelBuilder, body: int, point: npt.ArrayLike, start: Array, target: Array, *,
    low: Array, high: Array, damping: float, longest: float, iterations: int, tolerance: float,
) -> tuple[Array, float]:  # fmt: skip
    """Coordinates and the distance left: Levenberg and Marquardt in the joints' space, with a set of active stops."""
    q = np.clip(start, low, high)
    for _ in range(iterations + 1):
        error = target - point_position(builder, body, point, q)
        left = float(np.linalg.norm(error))
        if left <= tolerance or _ == iterations:
            break
        jacobian = point_jacobian(builder, body, point, q)[:3]
        free = np.abs(jacobian).max(axis=0) > 0.0
        while True:
            part = jacobian[:, free]
            normal = part.T @ part + (0.5 * left**2 + damping**2) * np.eye(part.shape[1])
            turn = np.zeros(len(q))
            turn[free] = np.linalg.solve(normal, part.T @ error)
            turn /= max(1.0, np.abs(turn).max() / longest)
            stopped = free & (((turn > 0.0) & (q >= high)) | ((turn < 0.0) & (q <= low)))
            if not stopped.any():
                break
            free &= ~stopped
        q = np.clip(q + turn, low, high)
    return q, left
