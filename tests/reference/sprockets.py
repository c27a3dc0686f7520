"""Contacts of a ball with a sprocket's arcs and with a groove, in float64: every arc is looked at."""

from __future__ import annotations

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class Touch:
    """A contact, in the frame of the sprocket or groove."""

    gap: float
    normal: np.ndarray
    """From the ball."""
    point: np.ndarray
    """On the ball."""
    feature: int


@dataclasses.dataclass(frozen=True)
class Profile:
    """Arcs of a sprocket about z [m, rad]."""

    center: float
    arc: float
    tip: float
    teeth: int
    half_width: float
    offset: float = 0.0

    def centers(self) -> list[tuple[int, np.ndarray]]:
        """Number and centre of every arc: one a gap, or two."""
        found = []
        for k in range(self.teeth):
            for side in (1.0, -1.0) if self.offset > 0.0 else (1.0,):
                angle = 2.0 * np.pi * k / self.teeth + side * self.offset
                place = self.center * np.array([np.cos(angle), np.sin(angle)])
                found.append((2 * k + (1 if side < 0.0 else 0), place))
        return found


def ball_in_sprocket(profile: Profile, p: np.ndarray, radius: float) -> Touch | None:
    """The contact of a ball at p, however far; None where the profile has none."""
    flat = np.asarray(p[:2], np.float64)
    if abs(p[2]) > profile.half_width or np.linalg.norm(flat) > profile.center:
        return None
    feature, c = min(profile.centers(), key=lambda each: float(np.linalg.norm(flat - each[1])))
    d = float(np.linalg.norm(flat - c))
    away = (flat - c) / d
    if d >= profile.arc:  # behind the arc
        return None
    if np.linalg.norm(c + profile.arc * away) > profile.tip:
        return None
    normal = np.array([*away, 0.0])
    return Touch(profile.arc - radius - d, normal, np.asarray(p) + radius * normal, feature)


def ball_in_groove(disc_radius: float, half_width: float, p: np.ndarray, radius: float) -> Touch | None:
    """The contact of a ball at p with the nearer disc; None beyond their radius."""
    if np.hypot(p[0], p[1]) > disc_radius:
        return None
    side = -1.0 if p[2] < 0.0 else 1.0
    normal = np.array([0.0, 0.0, side])
    return Touch(half_width - radius - abs(p[2]), normal, np.asarray(p) + radius * normal, 1 if side < 0.0 else 0)
