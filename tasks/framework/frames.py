"""Rotations of a batch of bodies, in torch: what observations of a moving body are made of. Quaternions are xyzw."""

from __future__ import annotations

import enum

import torch


class Orientation(enum.Enum):
    """Representation of a torso's orientation in observations."""

    EULER = "euler"
    QUATERNION = "quaternion"


def rotate_back(rotation: torch.Tensor, vector: torch.Tensor) -> torch.Tensor:
    """Return (W, 3) vectors of the world frame in the axes of a body turned by ``rotation`` (W, 4)."""
    axis, scalar = rotation[:, :3], rotation[:, 3:]
    twice = 2.0 * torch.linalg.cross(vector, axis, dim=1)
    return vector + scalar * twice + torch.linalg.cross(twice, axis, dim=1)


def euler_123(rotation: torch.Tensor) -> torch.Tensor:
    """Return (W, 3) Cardan angles [rad]: the rotation is that about x, then about the new y, then about the new z.

    Near the upright position these are roll, pitch and heading; the second lies in [-pi/2, pi/2].
    """
    x, y, z, w = rotation.unbind(dim=1)
    first = torch.atan2(2.0 * (w * x - y * z), 1.0 - 2.0 * (x * x + y * y))
    second = torch.asin((2.0 * (x * z + w * y)).clamp(-1.0, 1.0))
    third = torch.atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (y * y + z * z))
    return torch.stack([first, second, third], dim=1)


def heading_quaternion(angle: torch.Tensor) -> torch.Tensor:
    """Return (W, 4) quaternions that turn by ``angle`` (W,) [rad] about the vertical."""
    zero = torch.zeros_like(angle)
    return torch.stack([zero, zero, (0.5 * angle).sin(), (0.5 * angle).cos()], dim=1)


def rotate(rotation: torch.Tensor, vector: torch.Tensor) -> torch.Tensor:
    """Return vectors (..., 3) of a body's axes in those of the world; rotations (..., 4) broadcast with them."""
    axis, scalar = rotation[..., :3], rotation[..., 3:]
    axis, vector = torch.broadcast_tensors(axis, vector)
    twice = 2.0 * torch.linalg.cross(axis, vector, dim=-1)
    return vector + scalar * twice + torch.linalg.cross(axis, twice, dim=-1)


def quat_product(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """Return the product of quaternions (..., 4), broadcast: ``second`` turns before ``first``."""
    ax, ay, az, aw = first.unbind(dim=-1)
    bx, by, bz, bw = second.unbind(dim=-1)
    return torch.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        dim=-1,
    )


def tilt_to(normal: torch.Tensor) -> torch.Tensor:
    """Return (W, 4) the shortest turns that take the vertical to unit vectors (W, 3) that look upwards."""
    x, y, z = normal.unbind(dim=1)
    turn = torch.stack([-y, x, torch.zeros_like(x), 1.0 + z], dim=1)
    return turn / turn.norm(dim=1, keepdim=True)


def heading_of(rotation: torch.Tensor) -> torch.Tensor:
    """Return (W,) the direction in which a body's x axis points, seen from above [rad]; rotations (W, 4)."""
    x, y, z, w = rotation.unbind(dim=1)
    return torch.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def to_heading(away: torch.Tensor, heading: torch.Tensor) -> torch.Tensor:
    """Return plane vectors (W, N, 2) of the world in axes of a heading (W,): ahead and to the left."""
    cosine, sine = heading.cos().unsqueeze(1), heading.sin().unsqueeze(1)
    return torch.stack(
        [cosine * away[..., 0] + sine * away[..., 1], cosine * away[..., 1] - sine * away[..., 0]], dim=2
    )
