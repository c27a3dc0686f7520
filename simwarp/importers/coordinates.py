"""Coordinates of a source file and ours: positions and rates of its joints in its own order, batched both ways."""

from __future__ import annotations

import dataclasses
import enum

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from simwarp.core.types import ModelError

Array = npt.NDArray[np.float64]


class CoordinateKind(enum.Enum):
    """Form of a joint's position in the source."""

    SCALAR = (1, 1, 1)
    """One number [m or rad]."""
    BALL = (4, 3, 3)
    """A unit quaternion wxyz, and an angular velocity in the child's axes [rad/s]."""
    FREE = (7, 6, 6)
    """Position of the body's origin in the world [m], quaternion wxyz; velocity in world axes, angular velocity in the
    body's axes.
    """

    @property
    def positions(self) -> int:
        """Numbers of a position in the source."""
        return int(self.value[0])

    @property
    def rates(self) -> int:
        """Numbers of a rate in the source, and coordinates of ours."""
        return int(self.value[1])


@dataclasses.dataclass(frozen=True)
class JointCoordinates:
    """Where the coordinates of one joint stand.

    Attributes:
        name: of the joint in the source.
        kind: form of its position there.
        position: its first column in the source's positions.
        rate: its first column in the source's rates.
        dof: its first column in `State.joint_q`.
        offset: position in the source at which our coordinate is 0 (of a SCALAR) [m or rad].
        rotation: of a ball's child in the world as built, xyzw: its coordinates have the world's axes as built.
    """

    name: str
    kind: CoordinateKind
    position: int
    rate: int
    dof: int
    offset: float = 0.0
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


@dataclasses.dataclass(frozen=True)
class CoordinateMap:
    """The coordinates of all joints of a file.

    Attributes:
        joints: of the file.
        position_count, rate_count: numbers of a state in the source.
        dof_count: coordinates of ours.
        initial: (position_count,) positions at which the model is built.
    """

    joints: tuple[JointCoordinates, ...]
    position_count: int
    rate_count: int
    dof_count: int
    initial: Array

    def q_from(self, positions: npt.ArrayLike) -> Array:
        """(..., dofs) our coordinates of (..., position_count) positions of the source."""
        given = _rows("positions", positions, self.position_count)
        q = np.zeros((*given.shape[:-1], self.dof_count))
        for joint in self.joints:
            if joint.kind is CoordinateKind.SCALAR:
                q[..., joint.dof] = given[..., joint.position] - joint.offset
                continue
            first = joint.position + joint.kind.positions - 4
            turned = _rotation(given[..., first : first + 4])
            vector = turned.as_rotvec()
            if joint.kind is CoordinateKind.BALL:
                vector = Rotation(joint.rotation).apply(vector)
            else:
                q[..., joint.dof : joint.dof + 3] = given[..., joint.position : joint.position + 3]
            end = joint.dof + joint.kind.rates
            q[..., end - 3 : end] = vector.reshape(*given.shape[:-1], 3)
        return q

    def positions_from(self, q: npt.ArrayLike) -> Array:
        """(..., position_count) positions of the source at our coordinates (..., dofs)."""
        given = _rows("q", q, self.dof_count)
        positions = np.broadcast_to(self.initial, (*given.shape[:-1], self.position_count)).copy()
        for joint in self.joints:
            if joint.kind is CoordinateKind.SCALAR:
                positions[..., joint.position] = given[..., joint.dof] + joint.offset
                continue
            end = joint.dof + joint.kind.rates
            vector = given[..., end - 3 : end].reshape(-1, 3)
            if joint.kind is CoordinateKind.BALL:
                vector = Rotation(joint.rotation).apply(vector, inverse=True)
            else:
                positions[..., joint.position : joint.position + 3] = given[..., joint.dof : joint.dof + 3]
            first = joint.position + joint.kind.positions - 4
            xyzw = Rotation.from_rotvec(vector).as_quat().reshape(*given.shape[:-1], 4)
            positions[..., first : first + 4] = np.roll(xyzw, 1, axis=-1)
        return positions

    def qd_from(self, rates: npt.ArrayLike, positions: npt.ArrayLike | None = None) -> Array:
        """(..., dofs) our rates of (..., rate_count) rates of the source at its `positions` (as built when None)."""
        given = _rows("rates", rates, self.rate_count)
        places = self._places(positions, given.shape[:-1])
        qd = np.zeros((*given.shape[:-1], self.dof_count))
        for joint in self.joints:
            count = joint.kind.rates
            qd[..., joint.dof : joint.dof + count] = given[..., joint.rate : joint.rate + count]
            if joint.kind is not CoordinateKind.SCALAR:
                end = joint.dof + count
                turned = self._turn(joint, places).apply(
                    given[..., joint.rate + count - 3 : joint.rate + count].reshape(-1, 3)
                )
                qd[..., end - 3 : end] = turned.reshape(*given.shape[:-1], 3)
        return qd

    def rates_from(self, qd: npt.ArrayLike, positions: npt.ArrayLike | None = None) -> Array:
        """(..., rate_count) rates of the source of our (..., dofs) at its `positions` (as built when None)."""
        given = _rows("qd", qd, self.dof_count)
        places = self._places(positions, given.shape[:-1])
        rates = np.zeros((*given.shape[:-1], self.rate_count))
        for joint in self.joints:
            count = joint.kind.rates
            rates[..., joint.rate : joint.rate + count] = given[..., joint.dof : joint.dof + count]
            if joint.kind is not CoordinateKind.SCALAR:
                end = joint.rate + count
                own = given[..., joint.dof + count - 3 : joint.dof + count].reshape(-1, 3)
                turned = self._turn(joint, places).apply(own, inverse=True)
                rates[..., end - 3 : end] = turned.reshape(*given.shape[:-1], 3)
        return rates

    def _places(self, positions: npt.ArrayLike | None, shape: tuple[int, ...]) -> Array:
        """Positions of the source, one row for each row of rates."""
        given = self.initial if positions is None else _rows("positions", positions, self.position_count)
        return np.broadcast_to(given, (*shape, self.position_count))

    def _turn(self, joint: JointCoordinates, places: Array) -> Rotation:
        """From the child's axes to those of our coordinates."""
        first = joint.position + joint.kind.positions - 4
        turned = _rotation(places[..., first : first + 4])
        return Rotation(joint.rotation) * turned if joint.kind is CoordinateKind.BALL else turned


def _rotation(wxyz: Array) -> Rotation:
    return Rotation(np.roll(wxyz.reshape(-1, 4), -1, axis=-1))


def _rows(what: str, values: npt.ArrayLike, columns: int) -> Array:
    array = np.asarray(values, np.float64)
    if array.ndim == 0 or array.shape[-1] != columns:
        raise ModelError(
            f"{what} must have {columns} numbers in its last axis, got shape {array.shape}; pass all joints"
        )
    return array
