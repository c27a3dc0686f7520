"""Float64 quaternions and frames on the host, for builders and importers (xyzw; the device has its own)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from simwarp.core.types import ModelError, Vec3, finite_vector, formatted

Array = npt.NDArray[np.float64]


UNIT_AXES = np.eye(3)


def cross(a: Array, b: Array) -> Array:
    """Cross product; of two vectors (3,) in a fraction of the time of `np.cross`, which is made for many."""
    if not (a.shape == b.shape == (3,) and a.dtype == b.dtype == np.float64):
        return np.cross(a, b)
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def quat_multiply(a: Array, b: Array) -> Array:
    """Hamilton product of xyzw quaternions: the rotation b followed by a."""
    av, aw, bv, bw = a[:3], a[3], b[:3], b[3]
    return np.concatenate([aw * bv + bw * av + cross(av, bv), [aw * bw - av @ bv]])


def quat_conjugate(q: Array) -> Array:
    """The inverse of a unit quaternion."""
    return np.array([-q[0], -q[1], -q[2], q[3]])


def rotate(q: Array, v: Array) -> Array:
    """`v` (3,) rotated by the unit quaternion `q`."""
    t = 2.0 * cross(q[:3], v)
    return v + q[3] * t + cross(q[:3], t)


def matrix_of(q: Array) -> Array:
    """3x3 rotation matrix of a unit quaternion."""
    return np.stack([rotate(q, axis) for axis in UNIT_AXES], axis=1)


def quat_from_matrix(m: Array) -> Array:
    """Unit xyzw quaternion of a rotation matrix (Shepperd's method: the largest component first)."""
    trace = float(np.trace(m))
    values = np.array([m[0, 0], m[1, 1], m[2, 2], trace])
    k = int(np.argmax(values))
    q = np.empty(4)
    if k == 3:
        q[:] = [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1.0 + trace]
    else:
        i, j, n = k, (k + 1) % 3, (k + 2) % 3
        q[i] = 1.0 - trace + 2.0 * m[i, i]
        q[j] = m[i, j] + m[j, i]
        q[n] = m[i, n] + m[n, i]
        q[3] = m[n, j] - m[j, n]
    return q / np.linalg.norm(q)


def unit_vector(thing: str, field: str, value: Vec3) -> Array:
    """`value` normalised, or a ModelError."""
    vector = finite_vector(thing, field, value, 3)
    norm = float(np.linalg.norm(vector))
    if norm < 1e-12:
        raise ModelError(
            f"{thing}: {field} must have a length, got {'zeros' if norm == 0.0 else formatted(value)}; give a direction"
        )
    return vector / norm


def frame_from_axis(thing: str, axis: Vec3, field: str = "axis", direction: Vec3 | None = None) -> Array:
    """Quaternion of a right-handed frame whose z is `axis`; x is the part of `direction` across it, and where that is
    None, that of the world axis least along it.
    """
    z = unit_vector(thing, field, axis)
    given = np.eye(3)[int(np.argmin(np.abs(z)))] if direction is None else unit_vector(thing, "direction", direction)
    x = given - (given @ z) * z
    length = float(np.linalg.norm(x))
    if length < 1e-6:
        raise ModelError(
            f"{thing}: direction must not be along {field}, got {formatted(direction)}; give one across it"
        )
    x /= length
    return quat_from_matrix(np.stack([x, cross(z, x), z], axis=1))


def frame_along(thing: str, along: Vec3, up: Vec3 | None = None) -> Array:
    """Quaternion of a right-handed frame whose x is `along`; z is the part of `up` across it, and where that is None,
    that of the world's z axis, or of its y axis where x is nearly vertical.
    """
    x = unit_vector(thing, "the direction", along)
    upright = np.eye(3)[2 if abs(x[2]) < 0.9 else 1]
    given = upright if up is None else unit_vector(thing, "up", up)
    z = given - (given @ x) * x
    length = float(np.linalg.norm(z))
    if length < 1e-6:
        raise ModelError(f"{thing}: up must not be along the rod, got {formatted(up)}; give a direction across it")
    z /= length
    return quat_from_matrix(np.stack([x, cross(z, x), z], axis=1))


def frame_from_axes(thing: str, axis_x: Vec3, axis_y: Vec3) -> Array:
    """Quaternion of the frame with the given x and y axes, which must be perpendicular to 1e-6."""
    x = unit_vector(thing, "axis0", axis_x)
    y = unit_vector(thing, "axis1", axis_y)
    if abs(x @ y) > 1e-6:
        raise ModelError(
            f"{thing}: the two axes must be perpendicular, got a cosine of {x @ y:.3g}; "
            "take the component of the second along the first out"
        )
    return quat_from_matrix(np.stack([x, y, cross(x, y)], axis=1))
