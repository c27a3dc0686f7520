"""Rotations of a batch of bodies, in torch: what observations of a moving body are made of. Quaternions are xyzw."""

from __future__ import annotations

import enum

import torch


class Orientation(enum.Enum):
    """How the orientation of a torso is observed."""

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
