"""Rotations of bodies in torch. Quaternions are xyzw and of unit length."""

from __future__ import annotations

import torch


def in_world_axes(rotation: torch.Tensor, vector: torch.Tensor) -> torch.Tensor:
    """Return vectors of a body in axes of the world: v' = v + 2 w (u x v) + 2 u x (u x v), of q = (u, w).

    Args:
        rotation: (..., 4) of the body.
        vector: (..., 3) in axes of the body.
    """
    axis, w = rotation[..., :3], rotation[..., 3:]
    across = 2.0 * torch.linalg.cross(axis, vector)
    return vector + w * across + torch.linalg.cross(axis, across)


def in_body_axes(rotation: torch.Tensor, vector: torch.Tensor) -> torch.Tensor:
    """Return vectors of the world in axes of a body: the rotation of :func:`in_world_axes` turned back.

    Args:
        rotation: (..., 4) of the body.
        vector: (..., 3) in axes of the world.
    """
    axis, w = rotation[..., :3], rotation[..., 3:]
    across = 2.0 * torch.linalg.cross(axis, vector)
    return vector - w * across + torch.linalg.cross(axis, across)


def heading_of(rotation: torch.Tensor) -> torch.Tensor:
    """Return (...) the angle of a body's x axis about the vertical, from -pi to pi [rad].

    Args:
        rotation: (..., 4) of the body.
    """
    x, y, z, w = rotation.unbind(-1)
    return torch.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
