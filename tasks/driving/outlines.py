"""Vehicles from above, as maps and pictures draw them."""

from __future__ import annotations

import torch


def corners(half: tuple[float, float, float], device: torch.device | str) -> torch.Tensor:
    """Return (4, 2) corners of a box from above, of its half lengths, one after the other [m]."""
    signs = torch.tensor([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]], device=device)
    return signs * torch.tensor(half[:2], device=device)


def outline(point: torch.Tensor, heading: torch.Tensor, half: tuple[float, float, float]) -> torch.Tensor:
    """Return (W, 5, 3) the closed outline of a vehicle from above, at points (W, 3) [m] with headings (W,) [rad]."""
    corner = corners(half, point.device).to(point.dtype)[[0, 1, 2, 3, 0]]
    cosine, sine = heading.double().cos().view(-1, 1), heading.double().sin().view(-1, 1)
    turned = torch.stack(
        [cosine * corner[:, 0] - sine * corner[:, 1], sine * corner[:, 0] + cosine * corner[:, 1]], dim=2
    )
    return torch.nn.functional.pad(turned + point[:, None, :2], (0, 1)).float()
