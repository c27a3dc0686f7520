"""Geometry of the float64 reference: joint frames, scalar rows with their Jacobians, joint coordinates.

Written from the definitions of `RowKind` and `ELEMENTS` alone; vectorised over the rows of one world.
"""

from __future__ import annotations

import numpy as np

from simwarp.core.types import WORLD, JointType, RowKind
from simwarp.model.builder import ModelBuilder
from simwarp.model.joint_types import ELEMENTS

ETA_LINEAR = 0.6  # m/s
ETA_ANGULAR = 3.0  # rad/s
LINEAR_KINDS = (RowKind.POINT_AXIS0, RowKind.POINT_AXIS1, RowKind.DISTANCE)


def matrices(quats: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) of unit xyzw quaternions (N, 4)."""
    x, y, z, w = np.moveaxis(np.asarray(quats, float).reshape(-1, 4), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def quat_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton products of xyzw quaternions (N, 4)."""
    av, aw, bv, bw = a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]
    vector = aw * bv + bw * av + np.cross(av, bv)
    return np.hstack([vector, aw * bw - np.sum(av * bv, axis=1, keepdims=True)])


def quat_exp(rotation_vectors: np.ndarray) -> np.ndarray:
    """Unit quaternions (N, 4) of rotation vectors (N, 3)."""
    angle = np.linalg.norm(rotation_vectors, axis=1, keepdims=True)
    half_sinc = 0.5 * np.sinc(angle / (2.0 * np.pi))
    return np.hstack([rotation_vectors * half_sinc, np.cos(0.5 * angle)])


def rotation_log(m: np.ndarray) -> np.ndarray:
    """Rotation vector of one rotation matrix, |.| <= pi."""
    skew = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    sine, cosine = 0.5 * np.linalg.norm(skew), 0.5 * (np.trace(m) - 1.0)
    angle = np.arctan2(sine, cosine)
    if angle < 1e-8:
        return 0.5 * skew
    if np.pi - angle > 1e-4:
        return skew * (angle / (2.0 * sine))
    # near half a turn the skew part vanishes: the axis is the dominant column of R + R^T - (2 cos) 1
    symmetric = 0.5 * (m + m.T) - cosine * np.eye(3)
    axis = symmetric[:, int(np.argmax(np.diag(symmetric)))]
    axis = axis / np.linalg.norm(axis)
    return axis * angle * (1.0 if axis @ skew >= 0.0 else -1.0)


class Rows:
    """All rows of one world as arrays: the bilateral rows of the joints, then one row per degree of freedom.

    `evaluate` fills `jacobian` (n, 6 B + S; columns 6 b .. 6 b + 5 are v and omega of body b, then the
    shafts), `value` (the constraint C, or the row's length for DISTANCE dofs) and `side1` (the coefficients
    of the child, even where that is the WORLD).
    """

    def __init__(self, builder: ModelBuilder) -> None:
        self.joints = list(builder.joints)
        self.body_count = len(builder.bodies)
        shafts = [j for j, joint in enumerate(self.joints) if joint.type == JointType.SHAFT]
        self.shaft_of = {j: k for k, j in enumerate(shafts)}
        self.width = 6 * self.body_count + len(shafts)
        self.parent = np.array([j.parent for j in self.joints], int)
        self.child = np.array([j.child for j in self.joints], int)
        self.local0 = np.array([j.frame0.position for j in self.joints]).reshape(-1, 3)
        self.local1 = np.array([j.frame1.position for j in self.joints]).reshape(-1, 3)
        self.frame0 = matrices(np.array([j.frame0.rotation for j in self.joints]))
        self.frame1 = matrices(np.array([j.frame1.rotation for j in self.joints]))
        table: list[tuple[int, int, int, int, float]] = []
        for index, joint in enumerate(self.joints):
            for row in ELEMENTS[joint.type].rows:
                offset = joint.offset if row.kind in (RowKind.DISTANCE, RowKind.POINT_AXIS1) else 0.0
                table.append((index, int(row.kind), row.axis0, row.axis1, offset))
        self.bilateral = len(table)
        self.dof_start = []
        for index, joint in enumerate(self.joints):
            self.dof_start.append(len(table) - self.bilateral)
            table += [(index, int(row.kind), row.axis0, row.axis1, 0.0) for row in ELEMENTS[joint.type].dofs]
        self.dof_count = len(table) - self.bilateral
        columns = np.array(table, float).reshape(-1, 5)
        self.joint, self.kind, self.axis0, self.axis1 = columns[:, :4].astype(int).T
        self.offset = columns[:, 4]
        self.eta = np.where(np.isin(self.kind, LINEAR_KINDS), ETA_LINEAR, ETA_ANGULAR)
        self.linear = np.isin(self.kind, LINEAR_KINDS)
        for combined, terms in self._combinations():
            self.eta[combined] = min(self.eta[self.bilateral + dof] for dof, _ in terms)

    def frames(self, x: np.ndarray, rotation: np.ndarray) -> None:
        """Anchors and axes of every joint frame in the world, from body positions and rotation matrices."""
        x_w = np.vstack([x.reshape(-1, 3), np.zeros(3)])
        r_w = np.concatenate([rotation.reshape(-1, 3, 3), np.eye(3)[None]])
        p, c = self.parent, self.child  # WORLD is -1: the last entry
        self.center0, self.center1 = x_w[p], x_w[c]
        self.anchor0 = x_w[p] + np.einsum("nij,nj->ni", r_w[p], self.local0)
        self.anchor1 = x_w[c] + np.einsum("nij,nj->ni", r_w[c], self.local1)
        self.axes0, self.axes1 = r_w[p] @ self.frame0, r_w[c] @ self.frame1

    def _allowed(self) -> np.ndarray:
        """(J, 3): d of every joint without its components along bilateral POINT_AXIS0 rows."""
        d = self.anchor1 - self.anchor0
        allowed = d.copy()
        for n in range(self.bilateral):
            if self.kind[n] == int(RowKind.POINT_AXIS0):
                j = self.joint[n]
                e = self.axes0[j, :, self.axis0[n]]
                allowed[j] -= e * (e @ d[j])
        return allowed

    def evaluate(self, x: np.ndarray, rotation: np.ndarray) -> None:
        """Values and Jacobians of all rows at the given poses."""
        self.frames(x, rotation)
        n, j = len(self.joint), self.joint
        d = self.anchor1[j] - self.anchor0[j]
        e0 = self.axes0[j, :, self.axis0]
        e1 = self.axes1[j, :, self.axis1]
        length = np.linalg.norm(d, axis=1)
        kinds = {kind: self.kind == int(kind) for kind in RowKind}
        linear = np.zeros((n, 3))
        linear[kinds[RowKind.POINT_AXIS0]] = e0[kinds[RowKind.POINT_AXIS0]]
        linear[kinds[RowKind.POINT_AXIS1]] = e1[kinds[RowKind.POINT_AXIS1]]
        far = kinds[RowKind.DISTANCE]
        linear[far] = d[far] / length[far, None]
        # where the two bodies are taken: A1 and A0 plus the allowed part of d for POINT_AXIS0 (so that a violation
        # has no lever), A0 for POINT_AXIS1, each its own for DISTANCE
        point0 = np.where(kinds[RowKind.POINT_AXIS0][:, None], (self.anchor0 + self._allowed())[j], self.anchor0[j])
        point1 = np.where(kinds[RowKind.POINT_AXIS1][:, None], self.anchor0[j], self.anchor1[j])
        angular = np.zeros((n, 3))
        angular[kinds[RowKind.ANGLE0]] = e0[kinds[RowKind.ANGLE0]]
        angular[kinds[RowKind.ANGLE1]] = e1[kinds[RowKind.ANGLE1]]
        dot = kinds[RowKind.DOT]
        angular[dot] = np.cross(e1, e0)[dot]
        self.side0 = -np.hstack([linear, np.cross(point0 - self.center0[j], linear) + angular])
        self.side1 = np.hstack([linear, np.cross(point1 - self.center1[j], linear) + angular])
        self.value = np.einsum("ni,ni->n", d, linear) - self.offset
        self.value[far] = length[far] - self.offset[far]
        self.value[dot] = np.einsum("ni,ni->n", e0, e1)[dot]
        self._assemble()

    def _assemble(self) -> None:
        jacobian = np.zeros((len(self.joint), self.width))
        index = np.arange(len(self.joint))
        columns = np.arange(6)
        for body, side in ((self.parent[self.joint], self.side0), (self.child[self.joint], self.side1)):
            moves = body != WORLD
            jacobian[index[moves, None], 6 * body[moves, None] + columns] += side[moves]
        for row in np.flatnonzero(self.kind == int(RowKind.SHAFT)):
            jacobian[row] = 0.0
            jacobian[row, 6 * self.body_count + self.shaft_of[int(self.joint[row])]] = 1.0
        for combined, terms in self._combinations():
            jacobian[combined] = sum(factor * jacobian[self.bilateral + dof] for dof, factor in terms)
        self.jacobian = jacobian

    def _combinations(self) -> list[tuple[int, tuple[tuple[int, float], ...]]]:
        """Rows that are sums of others, and their terms."""
        rows = np.flatnonzero(self.kind == int(RowKind.SUM))
        return [(int(row), self.joints[self.joint[row]].terms) for row in rows]

    def coordinates(self, shaft: np.ndarray, predicted: np.ndarray | None) -> np.ndarray:
        """Joint coordinates at the frames evaluated last; angles next to `predicted` when that is given."""
        q = np.zeros(self.dof_count)
        for index, joint in enumerate(self.joints):
            values = self._joint_coordinates(index, joint.type, shaft)
            start = self.dof_start[index]
            for k, (value, wraps) in enumerate(values):
                if wraps and predicted is not None:
                    value += 2.0 * np.pi * np.round((predicted[start + k] - value) / (2.0 * np.pi))
                q[start + k] = value
        for row, terms in self._combinations():
            q[row - self.bilateral] = sum(factor * q[dof] for dof, factor in terms)
        return q

    def _joint_coordinates(self, index: int, kind: JointType, shaft: np.ndarray) -> list[tuple[float, bool]]:
        """(coordinate, whether it is an angle to unwrap) of each degree of freedom."""
        f0, f1 = self.axes0[index], self.axes1[index]
        d = self.anchor1[index] - self.anchor0[index]
        x0, y0, z0 = f0.T
        x1, y1, _ = f1.T
        turn = (float(np.arctan2(x1 @ y0, x1 @ x0)), True)
        if kind == JointType.REVOLUTE:
            return [turn]
        if kind == JointType.PRISMATIC:
            return [(d @ z0, False)]
        if kind == JointType.CYLINDRICAL:
            return [(d @ z0, False), turn]
        if kind == JointType.UNIVERSAL:
            return [(np.arctan2(y1 @ z0, y1 @ y0), True), (np.arctan2(f1[:, 2] @ x0, x1 @ x0), True)]
        if kind == JointType.PLANAR:
            return [(d @ x0, False), (d @ y0, False), turn]
        if kind == JointType.DISTANCE:
            return [(float(np.linalg.norm(d)), False)]
        if kind == JointType.SHAFT:
            return [(shaft[self.shaft_of[index]], False)]
        angles = [(value, False) for value in rotation_log(f0.T @ f1)]
        if kind == JointType.SPHERICAL:
            return angles
        if kind in (JointType.FREE, JointType.BUSHING):
            return [(value, False) for value in d @ f0] + angles
        return []
